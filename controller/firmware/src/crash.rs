//! The program breaks off: the leg gets its safe command, the host is told why.
//!
//! Nothing is trusted any more but the UART, by polling, and a few words that
//! were put aside for this. In the emulator the program ends then, with an exit
//! status of its own; on silicon it stands still until the next power-up.

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use controller::control::safe_command;
use controller::serial::frame::{self, MAX_FRAME};
use controller::serial::message::{Alarm, Crash, ToHost};
use controller::wire::{Command, Header};
use cortex_m_rt::ExceptionFrame;

use crate::board::{Board, Selected};

/// Exit status of the emulator after a panic.
const PANIC: u8 = 101;
/// Exit status of the emulator after a fault of the processor.
const HARD_FAULT: u8 = 102;

/// The last command's turn, epoch, and tick, low and high half.
static LAST: [AtomicU32; 4] = [const { AtomicU32::new(0) }; 4];

/// Puts aside what a safe command needs to be taken by the host.
pub(crate) fn remember(turn: u32, command: &Command) {
    let Header { epoch, seq, .. } = command.header;
    for (place, word) in LAST.iter().zip([turn, epoch, seq as u32, (seq >> 32) as u32]) {
        place.store(word, Ordering::Relaxed);
    }
}

/// The panic handler's, and the fault handler's, last act.
fn break_off(crash: Crash, status: u8) -> ! {
    cortex_m::interrupt::disable();
    let [turn, epoch, low, high] = LAST.each_ref().map(|word| word.load(Ordering::Relaxed));
    let seq = u64::from(high) << 32 | u64::from(low);
    let command = safe_command(&Header { epoch, seq, ..Header::default() });
    // What was being sent is cut off; the zero in front of a frame ends it.
    for message in [ToHost::Command { turn, command }, ToHost::Alarm(Alarm::Crash(crash))] {
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
    use super::{Crash, ExceptionFrame, HARD_FAULT, break_off};

    // SAFETY: it never returns, and reads only the frame that it is given.
    #[cortex_m_rt::exception]
    unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
        break_off(Crash::HardFault { pc: frame.pc() }, HARD_FAULT)
    }
}

/// In an image for the tests, breaks off after some ticks; else nothing.
pub(crate) fn provoke() {
    #[cfg(any(feature = "provoke-panic", feature = "provoke-fault"))]
    {
        use controller::serial::pilot::SharedPilot;
        /// Ticks that go well.
        const TICKS: u32 = 300;
        if crate::pilot::PILOT.with(|pilot| pilot.counts().ticks) >= TICKS {
            #[cfg(feature = "provoke-panic")]
            panic!("as asked for");
            #[cfg(feature = "provoke-fault")]
            cortex_m::asm::udf();
        }
    }
}
