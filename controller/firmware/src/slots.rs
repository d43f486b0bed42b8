//! The policy flash of a board: the region that the linker sets aside for the
//! two slots, as [`embedded_storage`] and [`MappedFlash`] see it.
#![allow(unsafe_code)]

use core::marker::PhantomData;
use core::ptr::addr_of_mut;

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use leg_control::serial::slots::MappedFlash;

use crate::board::{FlashChip, FlashError};

unsafe extern "C" {
    /// The start of slot A. Slot B lies right behind it.
    static mut __slot_a: u32;
    /// Its address is the length of a slot, bytes.
    static mut __slot_len: u32;
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

/// Both slots of a board.
#[derive(Debug)]
pub(crate) struct PolicyFlash<B>(PhantomData<B>);

impl<B: FlashChip> PolicyFlash<B> {
    pub(crate) const fn new() -> Self {
        Self(PhantomData)
    }

    fn start() -> *mut u32 {
        addr_of_mut!(__slot_a)
    }

    fn slot_len() -> usize {
        addr_of_mut!(__slot_len).addr()
    }
}

impl<B: FlashChip> ErrorType for PolicyFlash<B> {
    type Error = FlashError;
}

impl<B: FlashChip> ReadNorFlash for PolicyFlash<B> {
    const READ_SIZE: usize = 4;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        for (index, to) in bytes.iter_mut().enumerate() {
            let at = offset as usize + index;
            if at >= self.capacity() {
                return Err(FlashError);
            }
            // SAFETY: a byte of the slots; volatile, as it was just written.
            *to = unsafe { Self::start().cast::<u8>().add(at).read_volatile() };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        2 * Self::slot_len()
    }
}

impl<B: FlashChip> NorFlash for PolicyFlash<B> {
    const WRITE_SIZE: usize = 4;
    // The board knows the sector; the store erases whole slots.
    const ERASE_SIZE: usize = 4;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let words = to.saturating_sub(from) as usize / 4;
        if to as usize > self.capacity() || !from.is_multiple_of(4) {
            return Err(FlashError);
        }
        // SAFETY: a whole slot, which nothing borrows (contract of `MappedFlash`).
        unsafe { B::erase(Self::start().add(from as usize / 4), words) }
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        if !offset.is_multiple_of(4) || offset as usize + bytes.len() > self.capacity() {
            return Err(FlashError);
        }
        for (index, word) in bytes.as_chunks().0.iter().enumerate() {
            // SAFETY: a word of a slot, which nothing borrows (contract of
            // `MappedFlash`).
            unsafe {
                let place = Self::start().add(offset as usize / 4 + index);
                B::program(place, u32::from_le_bytes(*word))?;
            }
        }
        Ok(())
    }
}

impl<B: FlashChip> MappedFlash for PolicyFlash<B> {
    const ERASE_STALLS: bool = B::ERASE_STALLS;

    fn mapped(&self) -> &'static [u8] {
        // SAFETY: memory that the linker script sets aside for this, aligned to
        // a sector, readable at any time. It changes only by `erase` and `write`,
        // whose callers make sure that no borrow is in use.
        unsafe { core::slice::from_raw_parts(Self::start().cast(), self.capacity()) }
    }
}
