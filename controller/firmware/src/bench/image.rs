//! What an image needs beside its main function to run in the emulator.
#![allow(unsafe_code)]

use core::panic::PanicInfo;

/// None is enabled; the linker wants a table that holds something.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [extern "C" fn() -> !; 1] = [unexpected];

extern "C" fn unexpected() -> ! {
    semihosting::process::exit(102)
}

/// A stack that is too deep, above all: without this the image would stand still.
// SAFETY: it never returns, and reads nothing.
#[cortex_m_rt::exception]
unsafe fn HardFault(_: &cortex_m_rt::ExceptionFrame) -> ! {
    semihosting::process::exit(102)
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    semihosting::process::exit(101)
}
