//! RAM that plays flash: erased as a whole to ones, programmed from ones to zeros.
#![allow(unsafe_code)]

use controller::serial::message::Slot;
use controller::serial::slots::{FlashFault, PolicyFlash};
use core::ptr::{read_volatile, with_exposed_provenance, with_exposed_provenance_mut};
use core::ptr::{write_bytes, write_volatile};

/// Bytes of a slot.
const SLOT_LEN: usize = 16 * 1024;

/// Two slots in RAM that nothing else uses.
#[derive(Debug)]
pub struct RamFlash {
    addresses: [usize; 2],
}

impl RamFlash {
    /// Slots at these addresses.
    ///
    /// # Safety
    /// At each, [`SLOT_LEN`] bytes of RAM at a multiple of 4, initialised (as all
    /// RAM of an emulator is), that are used through this value only.
    pub unsafe fn at(addresses: [usize; 2]) -> Self {
        Self { addresses }
    }

    fn address(&self, slot: Slot) -> usize {
        let [a, b] = self.addresses;
        match slot {
            Slot::A => a,
            Slot::B => b,
        }
    }
}

impl PolicyFlash for RamFlash {
    fn slot_len(&self) -> usize {
        SLOT_LEN
    }

    fn bytes(&self, slot: Slot) -> &'static [u8] {
        // SAFETY: as `at` was promised; and who writes to the slot keeps no
        // borrow of it, by the contract of `PolicyFlash`.
        unsafe {
            core::slice::from_raw_parts(with_exposed_provenance(self.address(slot)), SLOT_LEN)
        }
    }

    fn erase(&mut self, slot: Slot) -> Result<(), FlashFault> {
        // SAFETY: as `at` was promised.
        unsafe { write_bytes(with_exposed_provenance_mut::<u8>(self.address(slot)), 0xff, SLOT_LEN) }
        Ok(())
    }

    fn program(&mut self, slot: Slot, offset: u32, word: u32) -> Result<(), FlashFault> {
        let offset = offset as usize;
        if !offset.is_multiple_of(4) || offset > SLOT_LEN - 4 {
            return Err(FlashFault);
        }
        let place = with_exposed_provenance_mut::<u32>(self.address(slot) + offset);
        // SAFETY: a whole word within the slot, of which `at` was promised.
        let read_back = unsafe {
            write_volatile(place, read_volatile(place) & word.to_le());
            read_volatile(place)
        };
        if read_back == word.to_le() { Ok(()) } else { Err(FlashFault) }
    }

    fn erase_stalls(&self) -> bool {
        false
    }
}
