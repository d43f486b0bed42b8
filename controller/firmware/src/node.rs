//! The control node, shared between the main loop and the tick's interrupt.
//!
//! Whoever uses it first raises the base priority to that of the tick: ticks
//! wait meanwhile, and the UART, which is more urgent, does not. This is the
//! immediate priority ceiling protocol, with one resource.
#![allow(unsafe_code)]

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::register::basepri;
use leg_control::serial::node::{ControlNode, SharedNode};

/// Priority of the tick's interrupt, and the ceiling of the node. A lower number
/// is more urgent.
pub(crate) const TICK_PRIORITY: u8 = 0x80;
/// Priority of the UART's interrupts.
pub(crate) const UART_PRIORITY: u8 = 0x40;

/// The node of this board.
pub(crate) static NODE: Ceiling =
    Ceiling { is_free: AtomicBool::new(false), node: UnsafeCell::new(MaybeUninit::uninit()) };

/// A node that one context at a time can use.
pub(crate) struct Ceiling {
    is_free: AtomicBool,
    // Not an `Option`: its empty state is not all zeros, and would be kept in flash.
    node: UnsafeCell<MaybeUninit<ControlNode<'static>>>,
}

// SAFETY: the node is reached only by `power_up`, once and before any interrupt
// is on, and by `with`, where no tick can begin. The UART's interrupts and the
// faults never reach it; `with` does not nest (see there).
unsafe impl Sync for Ceiling {}

impl Ceiling {
    /// Makes the node. Call it once, before the interrupts are on.
    pub(crate) fn power_up(&self) {
        // SAFETY: the first thing that main does; nothing else runs yet.
        unsafe { (*self.node.get()).write(ControlNode::new()) };
        self.is_free.store(true, Ordering::Release);
    }
}

impl SharedNode for Ceiling {
    fn with<R>(&self, f: impl FnOnce(&mut ControlNode<'static>) -> R) -> R {
        exclude_ticks(|| {
            if !self.is_free.load(Ordering::Acquire) {
                // A call within a call, or before power-up: to the safe state.
                cortex_m::asm::udf();
            }
            // No exchange needed: no context that reads it can come in between.
            self.is_free.store(false, Ordering::Relaxed);
            // SAFETY: it was written by `power_up` (`is_free` was true), no other
            // context has it (`is_free` is false now), and no tick begins.
            let result = f(unsafe { (*self.node.get()).assume_init_mut() });
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
    // SAFETY: restores the value read above.
    unsafe { basepri::write(before) };
    result
}
