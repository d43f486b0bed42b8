//! The pilot, shared between the main loop and the tick's interrupt.
//!
//! Whoever uses it raises the base priority to that of the tick first: ticks
//! wait meanwhile, and the UART, which is more urgent, does not. This is the
//! priority ceiling protocol, for one resource.
#![allow(unsafe_code)]

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, Ordering};

use leg_control::serial::pilot::{Pilot, SharedPilot};
use cortex_m::register::basepri;

/// Priority of the tick's interrupt; lower is more urgent.
pub(crate) const TICK_PRIORITY: u8 = 0x80;
/// Priority of the UART's interrupts.
pub(crate) const UART_PRIORITY: u8 = 0x40;

/// The one pilot.
pub(crate) static PILOT: Ceiling =
    Ceiling { is_free: AtomicBool::new(false), pilot: UnsafeCell::new(MaybeUninit::uninit()) };

/// A pilot that one context at a time can use.
pub(crate) struct Ceiling {
    is_free: AtomicBool,
    // Not an `Option`: its empty state is not all zeros, and would be kept in flash.
    pilot: UnsafeCell<MaybeUninit<Pilot<'static>>>,
}

// SAFETY: the pilot is reached only by `power_up`, once and before any interrupt
// is on, and by `with`, where no tick can begin. The UART's interrupts and the
// faults never reach it; `with` does not nest (see there).
unsafe impl Sync for Ceiling {}

impl Ceiling {
    /// Puts the pilot in its place. Once, before the interrupts are on.
    pub(crate) fn power_up(&self) {
        // SAFETY: the first thing that main does; nothing else runs yet.
        unsafe { (*self.pilot.get()).write(Pilot::new()) };
        self.is_free.store(true, Ordering::Release);
    }
}

impl SharedPilot for Ceiling {
    fn with<R>(&self, f: impl FnOnce(&mut Pilot<'static>) -> R) -> R {
        exclude_ticks(|| {
            if !self.is_free.load(Ordering::Acquire) {
                // A call within a call, or before power-up: to the safe state.
                cortex_m::asm::udf();
            }
            // No exchange needed: nobody who looks at it can come in between.
            self.is_free.store(false, Ordering::Relaxed);
            // SAFETY: it was written by `power_up` (`is_free` was true), nobody
            // else has it (`is_free` is false now), and no tick begins.
            let result = f(unsafe { (*self.pilot.get()).assume_init_mut() });
            self.is_free.store(true, Ordering::Release);
            result
        })
    }
}

/// Runs `f` while no tick can begin.
pub(crate) fn exclude_ticks<R>(f: impl FnOnce() -> R) -> R {
    let before = basepri::read();
    // SAFETY: masking interrupts is harmless to memory; undone below.
    unsafe { basepri::write(TICK_PRIORITY) };
    let result = f();
    // SAFETY: as it was.
    unsafe { basepri::write(before) };
    result
}
