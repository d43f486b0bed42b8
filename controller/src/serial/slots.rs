//! Two policy slots in NOR flash.
//!
//! A slot is a whole number of 4-byte words that are erased together. The blob
//! lies at its start and the *seal* in its last 32 bytes:
//!
//! | word | written | value |
//! |---|---|---|
//! | opened | when an upload begins | [`OPENED`]: from then on the slot counts only if sealed |
//! | sequence | at commit | one more than that of the other slot; a higher one is newer |
//! | length | at commit | length of the blob, bytes |
//! | crc32 | at commit | CRC-32 of the blob |
//! | seal | at commit, as the last word | CRC-32 of the four words before it |
//! | revoked | at a roll-back | [`REVOKED`]: the slot is never chosen again |
//! | 2 spare | never | |
//!
//! A word is programmed once after an erase, and the deciding word comes last,
//! so power may fail between any two words and the slots still define which
//! policy runs. A slot with a blank seal holds a blob that came with the flash
//! image or from a probe: it needs no seal, and its sequence number is 0. Blank
//! is all ones, or all zeros where RAM stands in for flash.

use embedded_storage::nor_flash::NorFlash;

use super::error::{BlobError, SlotError};
use super::message::Slot;
use super::store::{self, PolicyStore, StoreError};
use crate::checksum::{self, crc32};
use crate::policy::{self, MAGIC, Policy};

/// Bytes at the end of a slot that are not for the blob.
pub const SEAL_LEN: usize = 32;
/// Marks a slot in which an upload was begun: `OPEN`.
pub const OPENED: u32 = u32::from_le_bytes(*b"OPEN");
/// Marks a slot that was rolled back: `BACK`.
pub const REVOKED: u32 = u32::from_le_bytes(*b"BACK");

/// Offsets of the seal's words, bytes from its start.
mod place {
    pub(super) const OPENED: u32 = 0;
    pub(super) const SEQUENCE: u32 = 4;
    pub(super) const LENGTH: u32 = 8;
    pub(super) const CRC32: u32 = 12;
    pub(super) const SEAL: u32 = 16;
    pub(super) const REVOKED: u32 = 20;
}
/// Bytes that the seal's checksum is over.
const SEALED_LEN: usize = place::SEAL as usize;

/// NOR flash that is also visible in the address space: what
/// [`embedded_storage`] has no trait for. Its capacity is that of both slots,
/// slot A in the lower half; offsets begin there.
///
/// The flash must take single words: [`NorFlash::WRITE_SIZE`] divides 4. Each
/// half must be a whole number of erase units.
///
/// # Contract
/// Whoever erases or writes makes sure that nothing uses bytes of that range
/// borrowed before, least of all a policy. [`FlashSlots`] under a
/// [`super::handler::RequestHandler`] does: it changes only the slot whose
/// policy neither runs nor waits for its apex, and keeps no borrow.
pub trait MappedFlash: NorFlash {
    /// Whether the processor stalls during an erase, ticks included.
    const ERASE_STALLS: bool;

    /// Returns all of it as it is now, at a multiple of 4.
    fn mapped(&self) -> &'static [u8];
}

/// The policy store of a board.
#[derive(Clone, Debug)]
pub struct FlashSlots<F> {
    flash: F,
}

impl<F: MappedFlash> FlashSlots<F> {
    const WORDS: () = assert!(4 % F::WRITE_SIZE == 0, "the flash must take single words");

    /// Keeps policies in this flash.
    #[must_use]
    pub fn new(flash: F) -> Self {
        let () = Self::WORDS;
        Self { flash }
    }

    /// Returns the flash.
    #[must_use]
    pub fn flash(&self) -> &F {
        &self.flash
    }

    /// Returns the length of a slot, bytes.
    fn slot_len(&self) -> usize {
        self.flash.capacity() / 2
    }

    /// Returns the offset of a slot in the flash, bytes.
    fn start(&self, slot: Slot) -> u32 {
        match slot {
            Slot::A => 0,
            Slot::B => self.slot_len() as u32,
        }
    }

    /// Returns a whole slot as it is now.
    #[must_use]
    pub fn bytes(&self, slot: Slot) -> &'static [u8] {
        let (a, b) = self.flash.mapped().split_at_checked(self.slot_len()).unwrap_or_default();
        match slot {
            Slot::A => a,
            Slot::B => b,
        }
    }

    /// Programs a word, little-endian, at `offset` bytes from the slot's start,
    /// and reads it back.
    #[inline(never)]
    fn program(&mut self, slot: Slot, offset: u32, word: u32) -> Result<(), StoreError> {
        let at = self.start(slot) + offset;
        let word = word.to_le_bytes();
        let mut found = [0; 4];
        self.flash.write(at, &word).map_err(|_| StoreError)?;
        self.flash.read(at, &mut found).map_err(|_| StoreError)?;
        if found == word { Ok(()) } else { Err(StoreError) }
    }

    fn program_seal(&mut self, slot: Slot, place: u32, word: u32) -> Result<(), StoreError> {
        let seal_at = self.capacity() as u32;
        self.program(slot, seal_at + place, word)
    }
}

impl<F: MappedFlash> PolicyStore for FlashSlots<F> {
    const BEGIN_STALLS: bool = F::ERASE_STALLS;
    const OVERWRITES: bool = true;

    fn capacity(&self) -> usize {
        self.slot_len().saturating_sub(SEAL_LEN)
    }

    fn sequence(&self, slot: Slot) -> u32 {
        sequence(self.bytes(slot))
    }

    fn policy<R>(&self, slot: Slot, f: impl FnOnce(&Policy<'static>) -> R) -> Result<R, SlotError> {
        let (blob, sealed) = blob(self.bytes(slot))?;
        store::with_policy(blob, sealed, f)
    }

    /// Erases a slot and marks it as one in which an upload was begun.
    ///
    /// The blob that lies there is spoilt first: an erase cut short could leave
    /// a blank seal behind a whole blob.
    fn begin(&mut self, slot: Slot, _length: usize, _origin: &str) -> Result<(), StoreError> {
        self.program(slot, 0, 0)?;
        let (start, len) = (self.start(slot), self.slot_len() as u32);
        self.flash.erase(start, start + len).map_err(|_| StoreError)?;
        if self.bytes(slot).iter().any(|&byte| byte != 0xff) {
            return Err(StoreError);
        }
        self.program_seal(slot, place::OPENED, OPENED)
    }

    /// Bytes missing in the last word stay erased.
    fn write(&mut self, slot: Slot, offset: u32, bytes: &[u8]) -> Result<(), StoreError> {
        if bytes.len().saturating_add(offset as usize) > self.capacity() {
            return Err(StoreError);
        }
        for (index, part) in bytes.chunks(4).enumerate() {
            let mut word = [0xff; 4];
            for (to, &from) in word.iter_mut().zip(part) {
                *to = from;
            }
            self.program(slot, offset + 4 * index as u32, u32::from_le_bytes(word))?;
        }
        Ok(())
    }

    fn check(&self, slot: Slot, length: usize) -> Result<u32, BlobError> {
        store::check(self.bytes(slot).get(..length).unwrap_or_default())
    }

    /// Seals a slot: from the last word on its policy is the newest.
    fn commit(&mut self, slot: Slot, length: u32, crc32: u32) -> Result<(), StoreError> {
        let sequence = self.sequence(slot.other()).saturating_add(1).min(u32::MAX - 1);
        let words = [OPENED, sequence, length, crc32].map(u32::to_le);
        let sum = checksum::crc32(bytemuck::bytes_of(&words));
        self.program_seal(slot, place::SEQUENCE, sequence)?;
        self.program_seal(slot, place::LENGTH, length)?;
        self.program_seal(slot, place::CRC32, crc32)?;
        self.program_seal(slot, place::SEAL, sum)
    }

    fn revoke(&mut self, slot: Slot) -> Result<(), StoreError> {
        self.program_seal(slot, place::REVOKED, REVOKED)
    }
}

/// The state of a seal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seal {
    Blank,
    Opened,
    Broken,
    Revoked { sequence: u32 },
    Whole { sequence: u32, length: u32, crc32: u32 },
}

impl Seal {
    /// Returns the room for the blob, and the seal behind it.
    fn read(slot: &[u8]) -> Option<(&[u8], Self)> {
        let (room, bytes) = slot.split_last_chunk::<SEAL_LEN>()?;
        let mut words = [0_u32; SEAL_LEN / 4];
        for (word, bytes) in words.iter_mut().zip(bytes.as_chunks().0) {
            *word = u32::from_le_bytes(*bytes);
        }
        let sealed = crc32(bytes.get(..SEALED_LEN)?);
        Some((room, Self::of(words, sealed)))
    }

    fn of(words: [u32; SEAL_LEN / 4], checksum: u32) -> Self {
        let [opened, sequence, length, crc32, seal, revoked, ..] = words;
        let all = |blank: u32| words.iter().all(|&word| word == blank);
        if all(u32::MAX) || all(0) {
            return Self::Blank;
        }
        let is_whole = opened == OPENED && seal == checksum && sequence != u32::MAX;
        let blank = if opened == 0 { 0 } else { u32::MAX };
        // Any bit: the mark may be half written when the power fails.
        if revoked != blank {
            return Self::Revoked { sequence: if is_whole { sequence } else { 0 } };
        }
        match (is_whole, seal) {
            (true, _) => Self::Whole { sequence, length, crc32 },
            (false, u32::MAX) => Self::Opened,
            (false, _) => Self::Broken,
        }
    }

    fn sequence(self) -> u32 {
        match self {
            Self::Revoked { sequence } | Self::Whole { sequence, .. } => sequence,
            Self::Blank | Self::Opened | Self::Broken => 0,
        }
    }
}

/// Returns the sequence number in a slot's seal; 0 without a seal.
#[inline(never)]
fn sequence(slot: &[u8]) -> u32 {
    Seal::read(slot).map_or(0, |(_, seal)| seal.sequence())
}

/// Returns the blob in a slot, unchecked, and its checksum if it is sealed.
#[inline(never)]
fn blob(slot: &[u8]) -> Result<(&[u8], Option<u32>), SlotError> {
    let (room, seal) = Seal::read(slot).ok_or(SlotError::Empty)?;
    let (length, crc32) = match seal {
        Seal::Opened => return Err(SlotError::Unfinished),
        Seal::Broken => return Err(SlotError::BadSeal),
        Seal::Revoked { .. } => return Err(SlotError::RolledBack),
        Seal::Whole { length, crc32, .. } => (length as usize, Some(crc32)),
        Seal::Blank => {
            let start = room.get(..MAGIC.len()).unwrap_or_default();
            let all = |blank: u8| start.iter().all(|&byte| byte == blank);
            if all(0xff) || all(0) {
                return Err(SlotError::Empty);
            }
            // Without a length, parsing reports what is wrong.
            (policy::stated_length(room).unwrap_or(room.len()), None)
        }
    };
    Ok((room.get(..length).unwrap_or(room), crc32))
}
