//! The serial line: two rings, fed and drained by the UART's interrupts.

use core::sync::atomic::{AtomicU32, Ordering};

use crate::board::{Board, Selected};
use crate::pilot;
use crate::ring::Ring;

/// Two of the longest frames: one is worked on while the next comes in.
static INCOMING: Ring<512> = Ring::new();
/// A reply and a live command, and some.
static OUTGOING: Ring<512> = Ring::new();
static LOST: AtomicU32 = AtomicU32::new(0);
static UNSENT: AtomicU32 = AtomicU32::new(0);

/// Bytes that came too fast to be kept.
pub(crate) fn lost() -> u32 {
    LOST.load(Ordering::Relaxed)
}

/// Frames that found no room to be sent.
pub(crate) fn unsent() -> u32 {
    UNSENT.load(Ordering::Relaxed)
}

/// For the UART's interrupt: a byte that came.
pub(crate) fn received(byte: u8) {
    if !INCOMING.push(byte) {
        count(&LOST);
    }
}

/// For the UART's interrupt: a byte that was overrun before it was read.
pub(crate) fn overrun() {
    count(&LOST);
}

/// For the UART's interrupt: the byte to send next.
pub(crate) fn to_send() -> Option<u8> {
    OUTGOING.pop()
}

/// Sends a frame, whole or not at all; never waits. Once in an image.
#[inline(never)]
pub(crate) fn send(frame: &[u8]) {
    // The tick's interrupt sends too: one frame at a time.
    pilot::exclude_ticks(|| {
        if OUTGOING.room() < frame.len() {
            count(&UNSENT);
            return;
        }
        for &byte in frame {
            OUTGOING.push(byte);
        }
    });
    Selected::start_sending();
}

/// The next byte, asleep until it comes.
pub(crate) fn wait_for_byte() -> u8 {
    loop {
        if let Some(byte) = INCOMING.pop() {
            return byte;
        }
        // Masked between the last look and the sleep: an interrupt in between
        // still wakes the core, and is taken once the mask is off.
        cortex_m::interrupt::free(|_| {
            if INCOMING.room() == INCOMING_ROOM {
                cortex_m::asm::wfi();
            }
        });
    }
}

/// Room of the empty ring.
const INCOMING_ROOM: usize = 511;

fn count(counter: &AtomicU32) {
    counter.store(counter.load(Ordering::Relaxed).saturating_add(1), Ordering::Relaxed);
}
