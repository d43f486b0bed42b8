//! The two policy slots, where the linker has put them.
#![allow(unsafe_code)]

use core::marker::PhantomData;
use core::ptr::addr_of_mut;

use leg_control::serial::message::Slot;
use leg_control::serial::slots::{FlashFault, PolicyFlash};

use crate::board::FlashChip;

unsafe extern "C" {
    static mut __slot_a: u32;
    static mut __slot_b: u32;
    /// Its address is the length of a slot, bytes.
    static mut __slot_len: u32;
}

/// The slots of a board.
pub(crate) struct Slots<B>(PhantomData<B>);

impl<B: FlashChip> Slots<B> {
    pub(crate) const fn new() -> Self {
        Self(PhantomData)
    }
}

fn start(slot: Slot) -> *mut u32 {
    match slot {
        Slot::A => addr_of_mut!(__slot_a),
        Slot::B => addr_of_mut!(__slot_b),
    }
}

impl<B: FlashChip> PolicyFlash for Slots<B> {
    fn slot_len(&self) -> usize {
        addr_of_mut!(__slot_len).addr()
    }

    fn bytes(&self, slot: Slot) -> &'static [u8] {
        // SAFETY: memory that the linker script sets aside for this, aligned to
        // a sector, readable at any time. It changes only by `erase` and
        // `program`, whose callers see to it that no borrow is in use.
        unsafe { core::slice::from_raw_parts(start(slot).cast(), self.slot_len()) }
    }

    fn erase(&mut self, slot: Slot) -> Result<(), FlashFault> {
        // SAFETY: a whole slot, that nothing borrows (the trait's contract).
        unsafe { B::erase(start(slot), self.slot_len() / 4) }?;
        let is_blank = self.bytes(slot).iter().all(|&byte| byte == 0xff);
        if is_blank { Ok(()) } else { Err(FlashFault) }
    }

    #[inline(never)]
    fn program(&mut self, slot: Slot, offset: u32, word: u32) -> Result<(), FlashFault> {
        let index = offset as usize / 4;
        if !offset.is_multiple_of(4) || index >= self.slot_len() / 4 {
            return Err(FlashFault);
        }
        // SAFETY: a word of the slot, that nothing borrows (the trait's contract).
        let found = unsafe {
            let place = start(slot).add(index);
            B::program(place, word)?;
            place.read_volatile()
        };
        if found == word { Ok(()) } else { Err(FlashFault) }
    }

    fn erase_stalls(&self) -> bool {
        B::ERASE_STALLS
    }
}
