//! A value shared by the main loop and SysTick, under a priority ceiling.
#![allow(unsafe_code)]

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m::register::{basepri, basepri_max};

/// Priority of the line's interrupts: they go before everything else, so that
/// no byte is lost to a tick. (The lower the number, the more urgent; the upper
/// four bits count on every board here.)
pub const LINE_PRIORITY: u8 = 0x40;
/// Priority of the tick, and of whoever holds a [`Ceiling`].
pub const TICK_PRIORITY: u8 = 0x80;

/// A value that is used with all interrupts of [`TICK_PRIORITY`] and below held
/// back; those of the line go on.
#[derive(Debug)]
pub struct Ceiling<T> {
    taken: AtomicBool,
    value: UnsafeCell<T>,
}

// SAFETY: `with` hands the value to one context at a time, so moving it between
// contexts, which is what `Send` allows, is all that sharing comes to.
unsafe impl<T: Send> Sync for Ceiling<T> {}

impl<T> Ceiling<T> {
    /// Puts a value under the ceiling.
    pub const fn new(value: T) -> Self {
        Self { taken: AtomicBool::new(false), value: UnsafeCell::new(value) }
    }

    /// Calls `f` with the value, alone with it.
    ///
    /// Called from within itself, or from an interrupt above the ceiling while
    /// the value is in use, it faults: a hole in the program, which ends in the
    /// safe state.
    pub fn with<R>(&self, f: impl FnOnce(&mut T) -> R) -> R {
        let before = basepri::read();
        // Never lowers a ceiling that is there already.
        basepri_max::write(TICK_PRIORITY);
        // One core: whoever could come between load and store is done, value
        // given back, before this goes on.
        if self.taken.load(Ordering::Acquire) {
            cortex_m::asm::udf();
        }
        self.taken.store(true, Ordering::Relaxed);
        // SAFETY: `taken` was false, and is true until the reference is gone,
        // so no other reference is alive and none is made meanwhile.
        let result = f(unsafe { &mut *self.value.get() });
        self.taken.store(false, Ordering::Release);
        // SAFETY: this is the ceiling that was there before; whoever set it
        // expects no less.
        unsafe { basepri::write(before) };
        result
    }
}
