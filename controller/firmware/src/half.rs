//! One half of a queue, in a static, for the context that owns it.
#![allow(unsafe_code)]

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

/// A half of a queue. It is not there until [`Half::put`].
pub(crate) struct Half<T>(UnsafeCell<MaybeUninit<T>>);

// SAFETY: `put` and `with` require that one context at a time calls them.
unsafe impl<T: Send> Sync for Half<T> {}

impl<T> Half<T> {
    pub(crate) const fn new() -> Self {
        Self(UnsafeCell::new(MaybeUninit::uninit()))
    }

    /// Puts the half in its place.
    ///
    /// # Safety
    /// Before the interrupts are on.
    pub(crate) unsafe fn put(&self, half: T) {
        // SAFETY: nothing else runs yet.
        unsafe { (*self.0.get()).write(half) };
    }

    /// Calls `f` with the half.
    ///
    /// # Safety
    /// The half is there, and no other call is under way: all callers run in one
    /// context, or exclude each other.
    pub(crate) unsafe fn with<R>(&self, f: impl FnOnce(&mut T) -> R) -> R {
        // SAFETY: it is initialised and no other reference exists, as the caller
        // promises.
        f(unsafe { (*self.0.get()).assume_init_mut() })
    }
}
