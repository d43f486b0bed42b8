//! The serial line between the interrupts of the UART and the program.

use crate::board::{Board, This};
use crate::ring::Ring;
use core::sync::atomic::{AtomicU32, Ordering};

/// Two of the longest frames, and more of the usual ones: a flash that stands
/// still for a word, or a blob that is being checked, loses nothing.
const RECEIVED: usize = 512;
const TO_SEND: usize = 512;

static INCOMING: Ring<RECEIVED> = Ring::new();
static OUTGOING: Ring<TO_SEND> = Ring::new();
static LOST: AtomicU32 = AtomicU32::new(0);

/// UART interrupt: a byte came.
pub fn received(byte: u8) {
    if !INCOMING.put(&[byte]) {
        lost();
    }
}

/// UART interrupt: a byte came and could not be kept.
pub fn lost() {
    // Only that interrupt counts, so nothing comes between.
    LOST.store(LOST.load(Ordering::Relaxed).saturating_add(1), Ordering::Relaxed);
}

/// UART interrupt: the next byte to send.
pub fn to_send() -> Option<u8> {
    OUTGOING.take()
}

/// UART interrupt: whether nothing is left to send.
pub fn is_sent() -> bool {
    OUTGOING.is_empty()
}

/// Main loop: the next byte that came.
pub fn next() -> Option<u8> {
    INCOMING.take()
}

/// Bytes that came and could not be kept, since power-up.
pub fn lost_bytes() -> u32 {
    LOST.load(Ordering::Relaxed)
}

/// Main loop: sleeps until there is something to do, unless a byte is there.
pub fn sleep() {
    // With interrupts masked none can come between the look and the sleep; one
    // that is pending ends the sleep all the same, and runs right after.
    cortex_m::interrupt::free(|_| {
        if INCOMING.is_empty() {
            cortex_m::asm::wfi();
        }
    });
}

/// The way out, of which there is one: its holder alone puts frames in.
#[derive(Debug)]
pub struct Sender {
    unsent: u32,
}

impl Sender {
    /// Not to be called twice; [`crate::shared`] has the one.
    pub(crate) const fn new() -> Self {
        Self { unsent: 0 }
    }

    /// Sends a frame, whole or not at all: without room it is counted and gone.
    pub fn send(&mut self, frame: &[u8]) {
        if OUTGOING.put(frame) {
            This::start_sending();
        } else {
            self.unsent = self.unsent.saturating_add(1);
        }
    }

    /// Frames that found no room, since power-up.
    #[must_use]
    pub fn unsent(&self) -> u32 {
        self.unsent
    }
}
