//! Two slots of flash, a policy in each: what lies where, and which one runs.
//!
//! A slot is a whole number of 4-byte words that are erased together. The blob
//! lies at its start, the *seal* in its last 32 bytes:
//!
//! | word | erased until | then |
//! |---|---|---|
//! | opened | an upload begins | [`OPENED`]: from now on the slot counts only if sealed |
//! | sequence | commit | one more than that of the other slot; higher is newer |
//! | length | commit | of the blob, bytes |
//! | crc32 | commit | the blob's |
//! | seal | commit, as the last word | CRC-32 of the four words before it |
//! | revoked | a roll-back | [`REVOKED`]: never chosen again |
//! | 2 spare | - | - |
//!
//! A word is programmed once after an erase, and the one that decides comes
//! last: power may go between any two words, and the slots still say which
//! policy is the one to run. A slot whose seal is blank holds a blob that came
//! with the flash image, or from a probe: it needs no seal, and is of sequence
//! 0. Blank is all ones, or all zeros, as memory that only plays flash has it.

use super::message::{BlobFault, Slot, SlotFault};
use crate::checksum::{self, crc32};
use crate::policy::{self, MAGIC, ParseError, Policy};

/// Bytes at the end of a slot that are not for the blob.
pub const SEAL_LEN: usize = 32;
/// Mark of a slot that an upload was begun in: `OPEN`.
pub const OPENED: u32 = u32::from_le_bytes(*b"OPEN");
/// Mark of a slot that was rolled back: `BACK`.
pub const REVOKED: u32 = u32::from_le_bytes(*b"BACK");

/// Places of the seal's words, bytes from its start.
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

/// The flash did not take what was to be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashFault;

/// The flash that holds the two slots; a board provides it.
///
/// # Contract
/// Whoever calls [`erase`](Self::erase) or [`program`](Self::program) on a slot
/// sees to it that nothing uses bytes of that slot borrowed before, a policy
/// over them least of all. [`super::desk::Desk`] does so: it touches only the
/// slot whose policy neither runs nor waits for its apex, and keeps no borrow.
pub trait PolicyFlash {
    /// Bytes of a slot, a multiple of 4; the same for both.
    fn slot_len(&self) -> usize;

    /// A whole slot as it is now, at a multiple of 4.
    fn bytes(&self, slot: Slot) -> &'static [u8];

    /// Sets every byte of a slot to 0xff.
    ///
    /// # Errors
    /// [`FlashFault`] when the flash says that it failed.
    fn erase(&mut self, slot: Slot) -> Result<(), FlashFault>;

    /// Writes a word, little-endian, `offset` bytes (a multiple of 4) from the
    /// slot's start. Bits need only go from 1 to 0.
    ///
    /// # Errors
    /// [`FlashFault`] when the flash says that it failed, the place is not in
    /// the slot, or the word does not read back.
    fn program(&mut self, slot: Slot, offset: u32, word: u32) -> Result<(), FlashFault>;

    /// Whether the processor stands still during an erase, ticks and all.
    fn erase_stalls(&self) -> bool;
}

/// Bytes that a slot has for a blob.
pub fn room(flash: &impl PolicyFlash) -> usize {
    flash.slot_len().saturating_sub(SEAL_LEN)
}

/// What a seal says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seal {
    Blank,
    Opened,
    Broken,
    Revoked { sequence: u32 },
    Whole { sequence: u32, length: u32, crc32: u32 },
}

impl Seal {
    /// The room for the blob, and the seal behind it.
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
        // Any bit: a mark that was half written when the power went.
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

/// The sequence number in a slot's seal; 0 without one.
#[must_use]
#[inline(never)]
pub fn sequence(slot: &[u8]) -> u32 {
    Seal::read(slot).map_or(0, |(_, seal)| seal.sequence())
}

/// Calls `f` with the policy in a slot, once it has passed every check. With a
/// reference: returned, a policy would lie on a target's stack twice.
///
/// # Errors
/// [`SlotFault`] says why there is none to run.
pub fn policy<'s, R>(slot: &'s [u8], f: impl FnOnce(&Policy<'s>) -> R) -> Result<R, SlotFault> {
    let (blob, sealed) = blob(slot)?;
    match &Policy::parse(blob) {
        Ok(policy) if sealed.is_some_and(|crc32| crc32 != policy.crc32()) => {
            Err(SlotFault::BadSeal)
        }
        Ok(policy) => Ok(f(policy)),
        Err(error) => Err(SlotFault::Blob(fault(error))),
    }
}

/// The bytes of a slot that are to be a blob, and its checksum if it is sealed.
#[inline(never)]
fn blob(slot: &[u8]) -> Result<(&[u8], Option<u32>), SlotFault> {
    let (room, seal) = Seal::read(slot).ok_or(SlotFault::Empty)?;
    let (length, crc32) = match seal {
        Seal::Opened => return Err(SlotFault::Unfinished),
        Seal::Broken => return Err(SlotFault::BadSeal),
        Seal::Revoked { .. } => return Err(SlotFault::RolledBack),
        Seal::Whole { length, crc32, .. } => (length as usize, Some(crc32)),
        Seal::Blank => {
            let start = room.get(..MAGIC.len()).unwrap_or_default();
            let all = |blank: u8| start.iter().all(|&byte| byte == blank);
            if all(0xff) || all(0) {
                return Err(SlotFault::Empty);
            }
            // Without a length in it, parsing says what is wrong.
            (policy::stated_length(room).unwrap_or(room.len()), None)
        }
    };
    Ok((room.get(..length).unwrap_or(room), crc32))
}

/// Checks a blob that is not sealed yet; returns its checksum.
///
/// # Errors
/// [`BlobFault`] says what is wrong with it.
#[inline(never)]
pub fn check(blob: &[u8]) -> Result<u32, BlobFault> {
    match &Policy::parse(blob) {
        Ok(policy) => Ok(policy.crc32()),
        Err(error) => Err(fault(error)),
    }
}

/// Once in an image.
#[inline(never)]
fn fault(error: &ParseError) -> BlobFault {
    (*error).into()
}

/// The slot whose seal has the highest sequence, A if they are the same: its
/// policy is the one to run after power-up, if it passes every check.
pub fn newest(flash: &impl PolicyFlash) -> Slot {
    let [a, b] = Slot::ALL.map(|slot| sequence(flash.bytes(slot)));
    if b > a { Slot::B } else { Slot::A }
}

/// Erases a slot and marks it as one that an upload was begun in.
///
/// The blob that lies there is spoilt first: an erase cut short could leave a
/// blank seal behind a blob that is whole.
///
/// # Errors
/// [`FlashFault`] of the flash.
pub fn open(flash: &mut impl PolicyFlash, slot: Slot) -> Result<(), FlashFault> {
    flash.program(slot, 0, 0)?;
    flash.erase(slot)?;
    program_seal(flash, slot, place::OPENED, OPENED)
}

/// Writes a part of the blob, `offset` bytes (a multiple of 4) from its start;
/// what is missing in the last word is left erased.
///
/// # Errors
/// [`FlashFault`] of the flash, or when the part reaches into the seal.
pub fn write(
    flash: &mut impl PolicyFlash,
    slot: Slot,
    offset: u32,
    bytes: &[u8],
) -> Result<(), FlashFault> {
    if bytes.len().saturating_add(offset as usize) > room(flash) {
        return Err(FlashFault);
    }
    for (index, part) in bytes.chunks(4).enumerate() {
        let mut word = [0xff; 4];
        for (to, &from) in word.iter_mut().zip(part) {
            *to = from;
        }
        flash.program(slot, offset + 4 * index as u32, u32::from_le_bytes(word))?;
    }
    Ok(())
}

/// Seals a slot whose blob is whole: from the last word on it is the newest.
///
/// # Errors
/// [`FlashFault`] of the flash.
pub fn seal(
    flash: &mut impl PolicyFlash,
    slot: Slot,
    length: u32,
    crc32: u32,
) -> Result<(), FlashFault> {
    let sequence = sequence(flash.bytes(slot.other())).saturating_add(1).min(u32::MAX - 1);
    let words = [OPENED, sequence, length, crc32].map(u32::to_le);
    let sum = checksum::crc32(bytemuck::bytes_of(&words));
    program_seal(flash, slot, place::SEQUENCE, sequence)?;
    program_seal(flash, slot, place::LENGTH, length)?;
    program_seal(flash, slot, place::CRC32, crc32)?;
    program_seal(flash, slot, place::SEAL, sum)
}

/// Rolls a slot back: it is never chosen again.
///
/// # Errors
/// [`FlashFault`] of the flash.
pub fn revoke(flash: &mut impl PolicyFlash, slot: Slot) -> Result<(), FlashFault> {
    program_seal(flash, slot, place::REVOKED, REVOKED)
}

#[inline(never)]
fn program_seal(
    flash: &mut impl PolicyFlash,
    slot: Slot,
    place: u32,
    word: u32,
) -> Result<(), FlashFault> {
    let seal_at = room(flash) as u32;
    flash.program(slot, seal_at + place, word)
}
