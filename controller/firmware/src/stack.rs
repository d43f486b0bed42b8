//! How deep the stack has been: it is painted at reset, and what has lost its
//! paint was used.
#![allow(unsafe_code)]

use core::ptr::{addr_of, read_volatile};
use cortex_m_rt::STACK_PAINT_VALUE;

unsafe extern "C" {
    /// Lowest word of the stack; a place, not a value.
    static _stack_end: u32;
    /// Just above its highest word.
    static _stack_start: u32;
}

/// Bytes of the stack.
#[must_use]
pub fn size() -> u32 {
    (addr_of!(_stack_start) as u32).saturating_sub(addr_of!(_stack_end) as u32)
}

/// Deepest use since power-up, bytes. Reads all that is left: some thousand
/// instructions.
#[must_use]
pub fn used() -> u32 {
    let end = addr_of!(_stack_start);
    let mut word = addr_of!(_stack_end);
    // SAFETY: the linker script sets both symbols to the bounds of the stack, a
    // region of RAM, aligned to words; between them every word can be read, and
    // as volatile it may change meanwhile.
    while word < end && unsafe { read_volatile(word) } == STACK_PAINT_VALUE {
        word = word.wrapping_add(1);
    }
    (end as u32).saturating_sub(word as u32)
}

/// Whether an exception's frame at this address can be read.
#[must_use]
pub fn holds(address: u32, bytes: u32) -> bool {
    let (low, high) = (addr_of!(_stack_end) as u32, addr_of!(_stack_start) as u32);
    address >= low && address.checked_add(bytes).is_some_and(|end| end <= high)
}
