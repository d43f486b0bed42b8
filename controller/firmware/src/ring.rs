//! A ring of bytes between an interrupt and the main loop.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};

/// Holds up to `N - 1` bytes; `N` is a power of two. One side pushes, one pops.
///
/// Of atomics, so that it is safe code and needs no splitting into halves; on
/// one core a relaxed atomic is an ordinary load or store, and the order of the
/// two is kept by release and acquire.
pub(crate) struct Ring<const N: usize> {
    bytes: [AtomicU8; N],
    /// Bytes pushed and popped ever, modulo the range of `usize`.
    pushed: AtomicUsize,
    popped: AtomicUsize,
}

impl<const N: usize> Ring<N> {
    pub(crate) const fn new() -> Self {
        const { assert!(N.is_power_of_two()) };
        Self {
            bytes: [const { AtomicU8::new(0) }; N],
            pushed: AtomicUsize::new(0),
            popped: AtomicUsize::new(0),
        }
    }

    /// Bytes that find room now.
    pub(crate) fn room(&self) -> usize {
        let pushed = self.pushed.load(Ordering::Relaxed);
        N - 1 - pushed.wrapping_sub(self.popped.load(Ordering::Acquire)).min(N - 1)
    }

    /// Adds a byte; false when there is no room.
    pub(crate) fn push(&self, byte: u8) -> bool {
        let pushed = self.pushed.load(Ordering::Relaxed);
        match self.bytes.get(pushed % N) {
            Some(place) if self.room() > 0 => {
                place.store(byte, Ordering::Relaxed);
                self.pushed.store(pushed.wrapping_add(1), Ordering::Release);
                true
            }
            _ => false,
        }
    }

    /// Takes the oldest byte.
    pub(crate) fn pop(&self) -> Option<u8> {
        let popped = self.popped.load(Ordering::Relaxed);
        if popped == self.pushed.load(Ordering::Acquire) {
            return None;
        }
        let byte = self.bytes.get(popped % N)?.load(Ordering::Relaxed);
        self.popped.store(popped.wrapping_add(1), Ordering::Release);
        Some(byte)
    }
}
