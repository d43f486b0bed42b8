//! Bytes on their way between an interrupt and the rest of the program.
//!
//! One side puts in, one side takes out, and neither waits. Written out here,
//! on atomics, as it is then free of unsafe code and can be a plain `static`;
//! `heapless::spsc` must be split into halves that have to be given to an
//! interrupt somehow.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};

/// A queue of up to `N` bytes, `N` a power of two, for one writer and one reader.
#[derive(Debug)]
pub struct Ring<const N: usize> {
    bytes: [AtomicU8; N],
    /// Bytes ever taken out, modulo 2^32; only the reader writes it.
    taken: AtomicUsize,
    /// Bytes ever put in, modulo 2^32; only the writer writes it.
    put: AtomicUsize,
}

impl<const N: usize> Default for Ring<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Ring<N> {
    /// An empty one.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(N.is_power_of_two()) };
        Self {
            bytes: [const { AtomicU8::new(0) }; N],
            taken: AtomicUsize::new(0),
            put: AtomicUsize::new(0),
        }
    }

    /// Whether there is nothing to take out.
    pub fn is_empty(&self) -> bool {
        self.put.load(Ordering::Acquire) == self.taken.load(Ordering::Relaxed)
    }

    /// Writer: puts all of these in, or none and returns false.
    pub fn put(&self, bytes: &[u8]) -> bool {
        let put = self.put.load(Ordering::Relaxed);
        let waiting = put.wrapping_sub(self.taken.load(Ordering::Acquire));
        if bytes.len() > N.saturating_sub(waiting) {
            return false;
        }
        let mut end = put;
        for &byte in bytes {
            if let Some(place) = self.bytes.get(end & (N - 1)) {
                place.store(byte, Ordering::Relaxed);
            }
            end = end.wrapping_add(1);
        }
        self.put.store(end, Ordering::Release);
        true
    }

    /// Reader: takes the next byte out.
    pub fn take(&self) -> Option<u8> {
        let taken = self.taken.load(Ordering::Relaxed);
        if taken == self.put.load(Ordering::Acquire) {
            return None;
        }
        let byte = self.bytes.get(taken & (N - 1))?.load(Ordering::Relaxed);
        self.taken.store(taken.wrapping_add(1), Ordering::Release);
        Some(byte)
    }
}
