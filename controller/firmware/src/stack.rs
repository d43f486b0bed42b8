//! How deep the stack went: painted at power-up, read where the paint is gone.
#![allow(unsafe_code)]

use core::ptr::addr_of_mut;

/// A word that nobody pushes by chance.
const PAINT: u32 = 0x5AFE_57AC;
/// Bytes below the stack pointer left alone: the painter's own frame.
const MARGIN: usize = 256;

unsafe extern "C" {
    /// The end of the static variables: as deep as the stack may go.
    static mut __sheap: u32;
    /// Where the stack begins, growing down.
    static mut _stack_start: u32;
}

fn bottom() -> *mut u32 {
    addr_of_mut!(__sheap)
}

fn top() -> *mut u32 {
    addr_of_mut!(_stack_start)
}

/// Room for the stack, bytes.
pub(crate) fn size() -> u32 {
    top().addr().saturating_sub(bottom().addr()) as u32
}

/// Paints what is free now. The first thing that main does.
pub(crate) fn paint() {
    let mut place = bottom();
    let end = cortex_m::register::msp::read() as usize - MARGIN;
    while place.addr() < end {
        // SAFETY: from the end of the static variables to well below the stack
        // pointer: RAM that nothing uses yet.
        unsafe {
            place.write_volatile(PAINT);
            place = place.add(1);
        }
    }
}

/// Deepest stack since power-up, bytes.
pub(crate) fn used() -> u32 {
    let mut place = bottom();
    // SAFETY: RAM between the static variables and the stack's start, which was
    // written by `paint` or by the stack; volatile, for the stack changes it.
    while place < top() && unsafe { place.read_volatile() } == PAINT {
        place = unsafe { place.add(1) };
    }
    top().addr().saturating_sub(place.addr()) as u32
}
