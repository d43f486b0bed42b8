//! MPS2 boards with the images AN386 (Cortex-M4F) and AN500 (Cortex-M7), as
//! `qemu-system-arm` emulates them: 25 MHz, CMSDK UART 0, RAM for flash.
//!
//! Registers: Arm DUI 0479C, "Cortex-M System Design Kit", APB UART.
#![allow(unsafe_code)]

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use cortex_m::peripheral::scb::SystemHandler;

use super::FlashError;
use super::{Board, FlashChip, core_peripherals, run_systick};
use crate::line;
use crate::node::{TICK_PRIORITY, UART_PRIORITY};

const CORE_HZ: u32 = 25_000_000;

/// The board.
pub(crate) struct Mps2;

/// Registers of the UART, in words from its base.
#[derive(Clone, Copy)]
#[repr(usize)]
enum Uart {
    Data = 0,
    State = 1,
    Control = 2,
    InterruptClear = 3,
    BaudDivider = 4,
}

const UART_BASE: *mut u32 = 0x4000_4000 as *mut u32;
/// State: there is no room to send.
const TX_FULL: u32 = 1 << 0;
/// State: a byte has come.
const RX_FULL: u32 = 1 << 1;
/// State: a byte has come and found no room. Cleared by writing it.
const RX_OVERRUN: u32 = 1 << 3;
/// Control: transmitter, receiver, and the interrupts of both.
const ENABLE: u32 = 0b1111;
/// Interrupt bits: transmit and receive.
const TX_INTERRUPT: u32 = 1 << 0;
const RX_INTERRUPT: u32 = 1 << 1;
/// The emulator asks for at least 16, and has no wire whose speed it could set.
const BAUD_DIVIDER: u32 = 16;

/// Looks at the UART before it is given up.
const TIMEOUT: u32 = 10_000_000;

impl Uart {
    fn read(self) -> u32 {
        // SAFETY: a register of the UART, which is there on both boards.
        unsafe { UART_BASE.add(self as usize).read_volatile() }
    }

    fn write(self, word: u32) {
        // SAFETY: as above; no register of it touches memory.
        unsafe { UART_BASE.add(self as usize).write_volatile(word) }
    }
}

/// Interrupts of UART 0.
#[derive(Clone, Copy)]
#[repr(u16)]
enum Interrupt {
    Receive = 0,
    Transmit = 1,
}

// SAFETY: these are the numbers of the two interrupts on both boards.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

/// Those that the firmware uses; the others are never enabled.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [extern "C" fn(); 2] = [receive, transmit];

extern "C" fn receive() {
    Uart::InterruptClear.write(RX_INTERRUPT);
    loop {
        let state = Uart::State.read();
        if state & RX_OVERRUN != 0 {
            Uart::State.write(RX_OVERRUN);
            line::overrun();
        }
        if state & RX_FULL == 0 {
            return;
        }
        line::received(Uart::Data.read() as u8);
    }
}

extern "C" fn transmit() {
    Uart::InterruptClear.write(TX_INTERRUPT);
    while Uart::State.read() & TX_FULL == 0 {
        let Some(byte) = line::to_send() else { return };
        Uart::Data.write(byte.into());
    }
}

impl Board for Mps2 {
    #[cfg(feature = "mps2-an386")]
    const NAME: &'static str = "mps2-an386";
    #[cfg(feature = "mps2-an500")]
    const NAME: &'static str = "mps2-an500";

    fn power_up() {
        let mut core = core_peripherals();
        // SAFETY: the ceiling of the node is the tick's priority, and the UART
        // is above it; no lock relies on anything else.
        unsafe {
            core.SCB.set_priority(SystemHandler::SysTick, TICK_PRIORITY);
            for interrupt in [Interrupt::Receive, Interrupt::Transmit] {
                core.NVIC.set_priority(interrupt, UART_PRIORITY);
                NVIC::unmask(interrupt);
            }
        }
        Uart::BaudDivider.write(BAUD_DIVIDER);
        Uart::Control.write(ENABLE);
        // Bytes that came before this are with the emulator, which looks for
        // them again only after a read; and one that is in the register
        // already raises no interrupt.
        let _ = Uart::Data.read();
        NVIC::pend(Interrupt::Receive);
    }

    fn start_sending() {
        NVIC::pend(Interrupt::Transmit);
    }

    #[inline(never)]
    fn send_polled(byte: u8) {
        // Seconds, and not for ever: nobody may be listening.
        if (0..TIMEOUT).any(|_| Uart::State.read() & TX_FULL == 0) {
            Uart::Data.write(byte.into());
        }
    }

    fn set_tick_rate(rate_hz: u32) {
        run_systick(CORE_HZ, rate_hz);
    }

    fn end(status: u8) -> ! {
        semihosting::process::exit(status.into())
    }
}

impl FlashChip for Mps2 {
    const ERASE_STALLS: bool = false;

    unsafe fn erase(start: *mut u32, words: usize) -> Result<(), FlashError> {
        for index in 0..words {
            // SAFETY: a word of the slot; RAM on these boards.
            unsafe { start.add(index).write_volatile(u32::MAX) };
        }
        Ok(())
    }

    unsafe fn program(place: *mut u32, word: u32) -> Result<(), FlashError> {
        // As flash does it: bits only go from 1 to 0.
        // SAFETY: a word of the slot; RAM on these boards.
        unsafe { place.write_volatile(place.read_volatile() & word) };
        Ok(())
    }
}
