//! ARM's MPS2 boards as QEMU emulates them: AN386 with a Cortex-M4F, AN500 with
//! a Cortex-M7.
//!
//! Both have their RAM at the same addresses, five CMSDK UARTs and a clock of
//! 25 MHz. Sources: ARM DAI 0386 and DAI 0500, and DDI 0479 for the UART.
#![allow(unsafe_code)]

use super::Board;
use super::ram_flash::RamFlash;
use crate::ceiling::LINE_PRIORITY;
use crate::line;
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use tock_registers::interfaces::{Readable, Writeable};
use tock_registers::registers::ReadWrite;
use tock_registers::{register_bitfields, register_structs};

#[cfg(all(feature = "mps2-an386", feature = "mps2-an500"))]
compile_error!("two boards: pass --no-default-features with any but mps2-an386");

/// Of processor, SysTick and UART.
const CLOCK_HZ: u32 = 25_000_000;
/// The emulator takes any; 16 is the least that the UART does.
const BAUD_DIVISOR: u32 = 16;

register_structs! {
    /// CMSDK UART, DDI 0479 table 4-1.
    Uart {
        (0x00 => data: ReadWrite<u32>),
        (0x04 => state: ReadWrite<u32, STATE::Register>),
        (0x08 => control: ReadWrite<u32, CONTROL::Register>),
        /// Reads which are pending, clears those written as 1.
        (0x0c => interrupt: ReadWrite<u32, INTERRUPT::Register>),
        (0x10 => baud_divisor: ReadWrite<u32>),
        (0x14 => @END),
    }
}

register_bitfields![u32,
    STATE [
        TX_FULL OFFSET(0) NUMBITS(1) [],
        RX_FULL OFFSET(1) NUMBITS(1) [],
        RX_OVERRUN OFFSET(3) NUMBITS(1) []
    ],
    CONTROL [
        TX_ENABLE OFFSET(0) NUMBITS(1) [],
        RX_ENABLE OFFSET(1) NUMBITS(1) [],
        TX_INTERRUPT OFFSET(2) NUMBITS(1) [],
        RX_INTERRUPT OFFSET(3) NUMBITS(1) []
    ],
    INTERRUPT [
        TX OFFSET(0) NUMBITS(1) [],
        RX OFFSET(1) NUMBITS(1) []
    ]
];

fn uart() -> &'static Uart {
    // SAFETY: UART 0 lies here on both boards, for good, and its registers are
    // as the structure says; they may be used from any context.
    unsafe { &*(0x4000_4000 as *const Uart) }
}

/// Interrupts of UART 0.
#[derive(Clone, Copy)]
enum Irq {
    Receive = 0,
    Send = 1,
}

// SAFETY: the numbers are those of the board, and below those of its table.
unsafe impl InterruptNumber for Irq {
    fn number(self) -> u16 {
        self as u16
    }
}

/// The vectors of the interrupts that are enabled.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [unsafe extern "C" fn(); 2] = [receive, send];

extern "C" fn receive() {
    let uart = uart();
    // First: a byte that comes from now on brings the interrupt about again.
    uart.interrupt.write(INTERRUPT::RX::SET);
    while uart.state.is_set(STATE::RX_FULL) {
        line::received(uart.data.get() as u8);
    }
    if uart.state.is_set(STATE::RX_OVERRUN) {
        uart.state.write(STATE::RX_OVERRUN::SET);
        line::lost();
    }
}

/// Also brought about by software, when there is something to send.
extern "C" fn send() {
    let uart = uart();
    uart.interrupt.write(INTERRUPT::TX::SET);
    while !uart.state.is_set(STATE::TX_FULL) {
        let Some(byte) = line::to_send() else { break };
        uart.data.set(u32::from(byte));
    }
}

/// Either board.
pub struct Mps2 {
    flash: RamFlash,
}

impl Board for Mps2 {
    #[cfg(feature = "mps2-an386")]
    const NAME: &'static str = "mps2-an386";
    #[cfg(feature = "mps2-an500")]
    const NAME: &'static str = "mps2-an500";

    type Flash = RamFlash;

    fn power_up() -> Self {
        let uart = uart();
        uart.baud_divisor.set(BAUD_DIVISOR);
        uart.control.write(
            CONTROL::TX_ENABLE::SET
                + CONTROL::RX_ENABLE::SET
                + CONTROL::TX_INTERRUPT::SET
                + CONTROL::RX_INTERRUPT::SET,
        );
        for irq in [Irq::Receive, Irq::Send] {
            // SAFETY: `Peripherals::take` has no say in the NVIC's priority of
            // these two, which nobody else sets; both handlers share nothing
            // but rings, each as its only reader or writer.
            unsafe {
                (*NVIC::PTR).ipr.get(irq as usize).inspect(|ipr| ipr.write(LINE_PRIORITY));
                NVIC::unmask(irq);
            }
        }
        // A byte that the UART held before raises nothing by itself.
        NVIC::pend(Irq::Receive);
        // SAFETY: the linker script keeps this RAM free, and there is one board.
        Self { flash: unsafe { RamFlash::at([0x10_0000, 0x10_4000]) } }
    }

    fn clock_hz(&self) -> u32 {
        CLOCK_HZ
    }

    fn policy_flash(self) -> RamFlash {
        self.flash
    }

    fn start_sending() {
        NVIC::pend(Irq::Send);
    }

    fn send_now(byte: u8) -> bool {
        // At any baud rate worth the name a byte is gone by then.
        let is_free = (0..1_000_000).any(|_| !uart().state.is_set(STATE::TX_FULL));
        if is_free {
            uart().data.set(u32::from(byte));
        }
        is_free
    }

    fn stop(status: u8) -> ! {
        semihosting::process::exit(i32::from(status))
    }
}
