//! NOR flash for two policies, in memory: for a virtual board on a host.

use std::cell::Cell;
use std::sync::{Mutex, PoisonError};

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use leg_control::serial::message::Slot;
use leg_control::serial::node::{ControlNode, SharedNode};
use leg_control::serial::slots::MappedFlash;

/// Length of a slot, bytes, unless another is chosen: that of the boards.
const SLOT_LEN: usize = 16 * 1024;
const WORD: usize = 4;

/// Two slots, A below B: an erase sets all bits, programming only clears them.
///
/// A policy borrows its slot for good, and this memory changes: each state that
/// is looked at is therefore kept until the process ends, 32 KiB for each of the
/// few looks that an upload takes.
#[derive(Clone, Debug)]
pub struct MemoryFlash {
    now: Vec<u32>,
    /// The bytes as last looked at.
    seen: Cell<Option<&'static [u8]>>,
}

impl Default for MemoryFlash {
    fn default() -> Self {
        Self::new()
    }
}

impl MemoryFlash {
    /// Makes two erased slots of 16 KiB.
    #[must_use]
    pub fn new() -> Self {
        Self::with_slot_len(SLOT_LEN)
    }

    /// Makes two erased slots of this many bytes, rounded down to whole words.
    #[must_use]
    pub fn with_slot_len(bytes: usize) -> Self {
        Self { now: vec![u32::MAX; 2 * (bytes / WORD)], seen: Cell::new(None) }
    }

    /// Returns the flash with these bytes at a slot's start and the rest of the
    /// slot erased, as a flash image or a probe leaves it. Bytes that do not fit
    /// are left out.
    #[must_use]
    pub fn loaded(mut self, slot: Slot, bytes: &[u8]) -> Self {
        let half = self.now.len() / 2;
        let slot = &mut self.now[half * slot as usize..][..half];
        slot.fill(u32::MAX);
        for (word, part) in slot.iter_mut().zip(bytes.chunks(WORD)) {
            let mut whole = [0xff; WORD];
            whole[..part.len()].copy_from_slice(part);
            *word = u32::from_le_bytes(whole);
        }
        self.seen.set(None);
        self
    }
}

impl ErrorType for MemoryFlash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for MemoryFlash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        check_read(self, offset, bytes.len())?;
        let now: &[u8] = bytemuck::cast_slice(&self.now);
        bytes.copy_from_slice(&now[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        WORD * self.now.len()
    }
}

impl NorFlash for MemoryFlash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = WORD;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        check_erase(self, from, to)?;
        self.seen.set(None);
        self.now[from as usize / WORD..to as usize / WORD].fill(u32::MAX);
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        check_write(self, offset, bytes.len())?;
        self.seen.set(None);
        let (words, _) = bytes.as_chunks();
        for (to, word) in self.now[offset as usize / WORD..].iter_mut().zip(words) {
            *to &= u32::from_le_bytes(*word);
        }
        Ok(())
    }
}

impl MappedFlash for MemoryFlash {
    const ERASE_STALLS: bool = false;

    fn mapped(&self) -> &'static [u8] {
        let bytes = self.seen.get().unwrap_or_else(|| {
            // The host is little-endian, as the wire is.
            let words: &'static [u32] = Vec::leak(self.now.clone());
            bytemuck::cast_slice(words)
        });
        self.seen.set(Some(bytes));
        bytes
    }
}

/// A node that threads share by a lock.
#[derive(Debug)]
pub struct LockedNode(Mutex<ControlNode<'static>>);

impl LockedNode {
    /// Puts a node behind a lock.
    #[must_use]
    pub fn new(node: ControlNode<'static>) -> Self {
        Self(Mutex::new(node))
    }
}

impl SharedNode for LockedNode {
    fn with<R>(&self, f: impl FnOnce(&mut ControlNode<'static>) -> R) -> R {
        f(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
