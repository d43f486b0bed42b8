//! How deep the stack went: painted at reset, read where the paint is gone.
//!
//! It lies at the lower end of the RAM (see `memory/`): a stack that grows too
//! deep leaves the RAM and faults, before it could overwrite anything.
#![allow(unsafe_code)]

use core::ptr::addr_of;

use cortex_m_rt::STACK_PAINT_VALUE;

unsafe extern "C" {
    /// Its lowest word: as deep as it may go.
    static _stack_end: u32;
    /// Just above its highest word, where it begins, growing down.
    static _stack_start: u32;
}

fn bottom() -> *const u32 {
    addr_of!(_stack_end)
}

fn top() -> *const u32 {
    addr_of!(_stack_start)
}

/// Room for the stack, bytes.
pub(crate) fn size() -> u32 {
    top().addr().saturating_sub(bottom().addr()) as u32
}

/// Deepest stack since power-up, bytes.
pub(crate) fn used() -> u32 {
    let mut place = bottom();
    // SAFETY: within the stack, all of which was painted before anything ran;
    // volatile, for the stack changes it.
    while place < top() && unsafe { place.read_volatile() } == STACK_PAINT_VALUE {
        place = place.wrapping_add(1);
    }
    top().addr().saturating_sub(place.addr()) as u32
}

/// Whether so many bytes from this address lie in the stack.
pub(crate) fn holds(address: u32, bytes: u32) -> bool {
    let end = (address as usize).saturating_add(bytes as usize);
    address as usize >= bottom().addr() && end <= top().addr()
}
