//! When the program breaks off: the leg in its safe state, the reason said, and
//! the end.
#![allow(unsafe_code)]

use crate::board::{Board, This};
use crate::stack;
use controller::control::safe_command;
use controller::serial::frame;
use controller::serial::message::{Alarm, Crash, ToHost};
use controller::wire::{Command, Header, WIRE_VERSION};
use core::convert::Infallible;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m_rt::exception;

/// Exit status of the emulator after a panic.
pub const PANIC_STATUS: u8 = 101;
/// Exit status of the emulator after a fault.
pub const FAULT_STATUS: u8 = 102;

/// The last turn answered, and the header of its command: words, as a crash may
/// come between any two of them.
static TURN: AtomicU32 = AtomicU32::new(0);
static EPOCH: AtomicU32 = AtomicU32::new(0);
static SEQ: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];
static T_NS: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];

/// Notes which command was sent last, for the safe one that may have to follow.
pub fn note(turn: u32, header: &Header) {
    let store = |place: &[AtomicU32; 2], value: u64| {
        let [low, high] = place;
        low.store(value as u32, Ordering::Relaxed);
        high.store((value >> 32) as u32, Ordering::Relaxed);
    };
    TURN.store(turn, Ordering::Relaxed);
    EPOCH.store(header.epoch, Ordering::Relaxed);
    store(&SEQ, header.seq);
    store(&T_NS, header.t_ns);
}

fn last_safe_command() -> (u32, Command) {
    let load = |[low, high]: &[AtomicU32; 2]| {
        u64::from(high.load(Ordering::Relaxed)) << 32 | u64::from(low.load(Ordering::Relaxed))
    };
    let header = Header {
        version: WIRE_VERSION,
        flags: 0,
        epoch: EPOCH.load(Ordering::Relaxed),
        seq: load(&SEQ),
        t_ns: load(&T_NS),
    };
    (TURN.load(Ordering::Relaxed), safe_command(&header))
}

/// Says it by polling: interrupts, rings and locks may be in any state. The
/// zero in front of the frame ends whatever was being sent.
fn end(crash: Crash, status: u8) -> ! {
    cortex_m::interrupt::disable();
    let (turn, command) = last_safe_command();
    // A line that takes nothing more cannot be told anything.
    let _ = frame::send(&mut Polling, &ToHost::Command { turn, command });
    let _ = frame::send(&mut Polling, &ToHost::Alarm(Alarm::Crash(crash)));
    This::stop(status)
}

/// The line by polling.
struct Polling;

impl embedded_io::ErrorType for Polling {
    type Error = Infallible;
}

impl embedded_io::Write for Polling {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        Ok(bytes.iter().take_while(|&&byte| This::send_now(byte)).count())
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    end(Crash::Panic { line: info.location().map_or(0, core::panic::Location::line) }, PANIC_STATUS)
}

/// Every fault ends here, as no other fault handler is enabled.
///
/// The stack may be what has failed, so it begins anew at its top; and the
/// floating-point state that the hardware meant to save on it is dropped, else
/// the first floating-point instruction would fault again.
#[unsafe(naked)]
#[unsafe(no_mangle)]
unsafe extern "C" fn HardFault() -> ! {
    core::arch::naked_asm!(
        "mrs r0, msp",
        "ldr r1, =_stack_start",
        "msr msp, r1",
        "ldr r1, =0xe000ef34", // FPCCR
        "ldr r2, [r1]",
        "bic r2, r2, #1", // LSPACT
        "str r2, [r1]",
        "b {fault}",
        fault = sym fault,
    )
}

/// `frame` is where the hardware put eight words, the seventh the address of
/// the instruction, if it could.
extern "C" fn fault(frame: u32) -> ! {
    let pc = if stack::holds(frame, 32) {
        // SAFETY: within the stack, and aligned, as the hardware aligns it.
        unsafe { core::ptr::read_volatile((frame + 24) as *const u32) }
    } else {
        0
    };
    end(Crash::HardFault { pc }, FAULT_STATUS)
}

/// An exception that nobody expects.
#[exception]
unsafe fn DefaultHandler(_number: i16) {
    cortex_m::asm::udf()
}
