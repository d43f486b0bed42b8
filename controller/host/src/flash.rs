//! Flash for two policies, in memory, with the manners of NOR flash: for
//! whoever runs a serial controller on a host.

use std::cell::Cell;
use std::sync::{Mutex, PoisonError};

use leg_control::serial::message::Slot;
use leg_control::serial::pilot::{Pilot, SharedPilot};
use leg_control::serial::slots::{FlashFault, PolicyFlash};

/// Bytes of a slot, unless asked for otherwise: those of the boards.
const SLOT_LEN: usize = 16 * 1024;

/// Two slots: an erase sets all bits, programming only clears them.
///
/// A policy borrows its slot for good, and this memory changes: so each state
/// of a slot that is looked at is kept until the process ends, 16 KiB for each
/// of the few looks that an upload takes.
#[derive(Clone, Debug)]
pub struct MemoryFlash {
    a: Words,
    b: Words,
}

/// A slot's words, and its bytes as last looked at.
#[derive(Clone, Debug)]
struct Words {
    now: Vec<u32>,
    seen: Cell<Option<&'static [u8]>>,
}

impl Words {
    fn erased(len: usize) -> Self {
        Self { now: vec![u32::MAX; len / 4], seen: Cell::new(None) }
    }
}

impl Default for MemoryFlash {
    fn default() -> Self {
        Self::new()
    }
}

impl MemoryFlash {
    /// Two erased slots of 16 KiB.
    #[must_use]
    pub fn new() -> Self {
        Self::with_slot_len(SLOT_LEN)
    }

    /// Two erased slots of this many bytes, rounded down to whole words.
    #[must_use]
    pub fn with_slot_len(bytes: usize) -> Self {
        Self { a: Words::erased(bytes), b: Words::erased(bytes) }
    }

    /// With these bytes at a slot's start and the rest erased, as a flash image
    /// or a probe leaves it; what does not fit is left out.
    #[must_use]
    pub fn loaded(mut self, slot: Slot, bytes: &[u8]) -> Self {
        let words = self.words(slot);
        *words = Words::erased(4 * words.now.len());
        for (word, part) in words.now.iter_mut().zip(bytes.chunks(4)) {
            let mut whole = [0xff; 4];
            whole[..part.len()].copy_from_slice(part);
            *word = u32::from_le_bytes(whole);
        }
        self
    }

    fn words(&mut self, slot: Slot) -> &mut Words {
        match slot {
            Slot::A => &mut self.a,
            Slot::B => &mut self.b,
        }
    }
}

impl PolicyFlash for MemoryFlash {
    fn slot_len(&self) -> usize {
        4 * self.a.now.len()
    }

    fn bytes(&self, slot: Slot) -> &'static [u8] {
        let words = match slot {
            Slot::A => &self.a,
            Slot::B => &self.b,
        };
        let bytes = words.seen.get().unwrap_or_else(|| {
            // The host is little-endian, as the wire is.
            let words: &'static [u32] = Vec::leak(words.now.clone());
            bytemuck::cast_slice(words)
        });
        words.seen.set(Some(bytes));
        bytes
    }

    fn erase(&mut self, slot: Slot) -> Result<(), FlashFault> {
        *self.words(slot) = Words::erased(self.slot_len());
        Ok(())
    }

    fn program(&mut self, slot: Slot, offset: u32, word: u32) -> Result<(), FlashFault> {
        if !offset.is_multiple_of(4) {
            return Err(FlashFault);
        }
        let words = self.words(slot);
        words.seen.set(None);
        let place = words.now.get_mut(offset as usize / 4).ok_or(FlashFault)?;
        *place &= word;
        if *place == word { Ok(()) } else { Err(FlashFault) }
    }

    fn erase_stalls(&self) -> bool {
        false
    }
}

/// A pilot that threads share by a lock.
#[derive(Debug)]
pub struct LockedPilot(Mutex<Pilot<'static>>);

impl LockedPilot {
    /// Puts a pilot behind a lock.
    #[must_use]
    pub fn new(pilot: Pilot<'static>) -> Self {
        Self(Mutex::new(pilot))
    }
}

impl SharedPilot for LockedPilot {
    fn with<R>(&self, f: impl FnOnce(&mut Pilot<'static>) -> R) -> R {
        f(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
