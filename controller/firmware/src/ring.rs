//! A ring of bytes between an interrupt and the main loop.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};

/// Holds up to `N` bytes, a power of two. One side puts in, one takes out.
///
/// Of atomics, so that it is safe code and needs no splitting into halves; on
/// one core a relaxed atomic is an ordinary load or store, and the order of the
/// two is kept by release and acquire.
pub(crate) struct Ring<const N: usize> {
    bytes: [AtomicU8; N],
    /// Bytes put in and taken out ever, modulo the range of `usize`.
    put: AtomicUsize,
    taken: AtomicUsize,
}

impl<const N: usize> Ring<N> {
    pub(crate) const fn new() -> Self {
        const { assert!(N.is_power_of_two()) };
        Self {
            bytes: [const { AtomicU8::new(0) }; N],
            put: AtomicUsize::new(0),
            taken: AtomicUsize::new(0),
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.put.load(Ordering::Acquire) == self.taken.load(Ordering::Relaxed)
    }

    /// Puts all of these in; or none, and returns false, when there is no room.
    pub(crate) fn put(&self, bytes: &[u8]) -> bool {
        let start = self.put.load(Ordering::Relaxed);
        let waiting = start.wrapping_sub(self.taken.load(Ordering::Acquire));
        if bytes.len() > N.saturating_sub(waiting) {
            return false;
        }
        let mut end = start;
        for &byte in bytes {
            if let Some(place) = self.bytes.get(end % N) {
                place.store(byte, Ordering::Relaxed);
            }
            end = end.wrapping_add(1);
        }
        self.put.store(end, Ordering::Release);
        true
    }

    /// Takes the oldest byte.
    pub(crate) fn take(&self) -> Option<u8> {
        let taken = self.taken.load(Ordering::Relaxed);
        if taken == self.put.load(Ordering::Acquire) {
            return None;
        }
        let byte = self.bytes.get(taken % N)?.load(Ordering::Relaxed);
        self.taken.store(taken.wrapping_add(1), Ordering::Release);
        Some(byte)
    }
}
