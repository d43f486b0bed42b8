//! The serial line: two queues of bytes between the UART's interrupts and the
//! rest of the program.
#![allow(unsafe_code)]

use core::sync::atomic::{AtomicU32, Ordering};

use heapless::spsc::{Consumer, Producer, Queue};

use crate::board::{Board, Selected};
use crate::half::Half;
use crate::node;

/// Room for two of the longest frames each, and more: one frame is worked on
/// while the next comes in; a live command goes out behind a reply.
const LEN: usize = 512;

/// From the UART's interrupt to the main loop.
static RECEIVED: Half<Producer<'static, u8>> = Half::new();
static TO_READ: Half<Consumer<'static, u8>> = Half::new();
/// From the main loop and the tick, which exclude each other, to the UART's
/// interrupt.
static TO_SEND: Half<Producer<'static, u8>> = Half::new();
static SENDING: Half<Consumer<'static, u8>> = Half::new();

static LOST: AtomicU32 = AtomicU32::new(0);
static UNSENT: AtomicU32 = AtomicU32::new(0);

/// A queue of bytes.
pub(crate) type Bytes = Queue<u8, LEN>;

/// Splits the two queues. Call it before the interrupts are on.
pub(crate) fn power_up(incoming: &'static mut Bytes, outgoing: &'static mut Bytes) {
    let (received, to_read) = incoming.split();
    let (to_send, sending) = outgoing.split();
    // SAFETY: no interrupt is on yet.
    unsafe {
        RECEIVED.put(received);
        TO_READ.put(to_read);
        TO_SEND.put(to_send);
        SENDING.put(sending);
    }
}

/// Returns the number of bytes that came too fast to be kept.
pub(crate) fn lost() -> u32 {
    LOST.load(Ordering::Relaxed)
}

/// Returns the number of frames without room to be sent.
pub(crate) fn unsent() -> u32 {
    UNSENT.load(Ordering::Relaxed)
}

/// Takes a byte from the UART. Only its interrupt calls this.
pub(crate) fn received(byte: u8) {
    // SAFETY: `power_up` ran before the interrupts were on; those of the UART have
    // one priority, so they exclude each other.
    let taken = unsafe { RECEIVED.with(|queue| queue.enqueue(byte)) };
    if taken.is_err() {
        count(&LOST);
    }
}

/// Counts a byte that was overrun before the UART's interrupt read it.
pub(crate) fn overrun() {
    count(&LOST);
}

/// Returns the byte to send next. Only the UART's interrupt calls this.
pub(crate) fn to_send() -> Option<u8> {
    // SAFETY: as in `received`.
    unsafe { SENDING.with(Consumer::dequeue) }
}

/// Sends a frame, whole or not at all; never waits.
///
/// Not inlined, so that the image has it once for the main loop and the tick.
#[inline(never)]
pub(crate) fn send(frame: &[u8]) {
    node::exclude_ticks(|| {
        // SAFETY: the main loop and the tick exclude each other here, both after
        // `power_up`.
        let sent = unsafe { TO_SEND.with(|queue| put(queue, frame)) };
        if !sent {
            count(&UNSENT);
        }
    });
    Selected::start_sending();
}

/// Puts all of these bytes into a queue; or none, and returns false.
fn put(queue: &mut Producer<'_, u8>, bytes: &[u8]) -> bool {
    let fits = bytes.len() <= queue.capacity().saturating_sub(queue.len());
    fits && bytes.iter().all(|&byte| queue.enqueue(byte).is_ok())
}

/// Waits, asleep, for the next byte, and returns it. Only the main loop calls
/// this.
pub(crate) fn wait_for_byte() -> u8 {
    loop {
        // SAFETY: only the main loop is the consumer, after `power_up`.
        if let Some(byte) = unsafe { TO_READ.with(Consumer::dequeue) } {
            return byte;
        }
        // Masked between the last look and the sleep: an interrupt in between
        // still wakes the core, and runs once the mask is off.
        cortex_m::interrupt::free(|_| {
            // SAFETY: only the main loop is the consumer.
            if unsafe { TO_READ.with(|queue| queue.is_empty()) } {
                cortex_m::asm::wfi();
            }
        });
    }
}

fn count(counter: &AtomicU32) {
    counter.store(counter.load(Ordering::Relaxed).saturating_add(1), Ordering::Relaxed);
}
