//! The crash handler: sends the safe command to the leg and an alarm to the
//! host.
//!
//! It relies on nothing but the UART, by polling, and a few words that were put
//! aside. In the emulator the program then exits, with a status of its own; on
//! silicon it stands still until the next power-up.

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use crate::board::{Board, Selected};

use leg_control::serial::frame::{self, MAX_FRAME};
use leg_control::serial::message::{Alarm, Crash, ToHost};
use leg_control::wire::{Command, Header};

/// Exit status of the emulator after a panic.
const PANIC: u8 = 101;
/// Exit status of the emulator after a fault of the processor.
const HARD_FAULT: u8 = 102;

/// Of the last command: its sequence number on the line, the run id, and tick
/// and time, low and high half each. Single words, as a crash may come between
/// any two of them.
static LAST: [AtomicU32; 6] = [const { AtomicU32::new(0) }; 6];

/// Puts aside what the host needs to accept a safe command.
pub(crate) fn remember(line_seq: u32, command: &Command) {
    let Header { run_id, seq, t_ns, .. } = command.header;
    let words =
        [line_seq, run_id, seq as u32, (seq >> 32) as u32, t_ns as u32, (t_ns >> 32) as u32];
    for (place, word) in LAST.iter().zip(words) {
        place.store(word, Ordering::Relaxed);
    }
}

/// Ends the program after a panic or a fault.
fn break_off(crash: Crash, status: u8) -> ! {
    cortex_m::interrupt::disable();
    let [line_seq, run_id, seq, seq_high, t_ns, t_ns_high] =
        LAST.each_ref().map(|word| word.load(Ordering::Relaxed));
    let whole = |high, low| u64::from(high) << 32 | u64::from(low);
    let command = Command::safe(&Header {
        run_id,
        seq: whole(seq_high, seq),
        t_ns: whole(t_ns_high, t_ns),
        ..Header::default()
    });
    // A frame that was being sent is cut off; the zero in front of the next ends it.
    let command = ToHost::Command { seq: line_seq, command };
    for message in [command, ToHost::Alarm(Alarm::Crash(crash))] {
        let mut out = [0; MAX_FRAME];
        if let Ok(frame) = frame::encode(&message, &mut out) {
            for &byte in frame {
                Selected::send_polled(byte);
            }
        }
    }
    Selected::end(status)
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    let line = info.location().map_or(0, core::panic::Location::line);
    break_off(Crash::Panic { line }, PANIC)
}

#[allow(unsafe_code)]
mod fault {
    use super::{Crash, HARD_FAULT, break_off};
    use crate::stack;

    /// Where the hardware puts the address of the instruction, bytes from the
    /// stack pointer after a fault, and bytes that it puts there in all.
    const PC_AT: u32 = 24;
    const FRAME_LEN: u32 = 32;

    /// Handles every fault of the processor: no other fault handler is enabled.
    ///
    /// The stack may be what has failed, so it begins anew at its top. Floating
    /// point registers that the hardware has yet to save to the old stack are
    /// given up, or the first floating point instruction would fault again.
    // SAFETY: the vector table alone calls it, and it never returns.
    #[unsafe(naked)]
    #[unsafe(no_mangle)]
    unsafe extern "C" fn HardFault() -> ! {
        core::arch::naked_asm!(
            "mrs r0, msp",
            "ldr r1, =_stack_start",
            "msr msp, r1",
            "ldr r1, =0xE000EF34", // FPCCR
            "ldr r2, [r1]",
            "bic r2, r2, #1", // LSPACT
            "str r2, [r1]",
            "b {fault}",
            fault = sym fault,
        )
    }

    /// `stacked` is where the stack was.
    extern "C" fn fault(stacked: u32) -> ! {
        let pc = if stack::holds(stacked, FRAME_LEN) {
            // SAFETY: in the stack, and a multiple of 4 as every stack pointer.
            unsafe { ((stacked + PC_AT) as *const u32).read_volatile() }
        } else {
            0
        };
        break_off(Crash::HardFault { pc }, HARD_FAULT)
    }

    /// Treats an unexpected interrupt or exception as a fault.
    // SAFETY: it never returns.
    #[cortex_m_rt::exception]
    unsafe fn DefaultHandler(_number: i16) -> ! {
        cortex_m::asm::udf()
    }
}

/// In an image for the tests, crashes after some ticks, in the way that the
/// number of the session selects. Otherwise it does nothing.
pub(crate) fn provoke() {
    #[cfg(feature = "provoke")]
    {
        use leg_control::serial::node::NodeHandle;
        /// Ticks before the crash.
        const TICKS: u64 = 300;
        let status = crate::node::NODE.status();
        let (ticks, session) = (status.run.counts.ticks, status.session);
        match session {
            Some(1) if ticks >= TICKS => panic!("as asked for"),
            Some(2) if ticks >= TICKS => cortex_m::asm::udf(),
            Some(3) if ticks >= TICKS => {
                overflow(1);
            }
            _ => {}
        }
    }
}

/// Overflows the stack.
#[cfg(feature = "provoke")]
#[allow(unconditional_recursion)]
#[inline(never)]
fn overflow(depth: u32) -> u32 {
    let frame = core::hint::black_box([depth; 64]);
    overflow(depth + 1) + core::hint::black_box(frame).iter().sum::<u32>()
}
