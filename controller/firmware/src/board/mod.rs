//! What a board must be able to do. Another board is another file here, a
//! feature in `Cargo.toml`, its memory in `build.rs`, and a line below.

#[cfg(any(feature = "mps2-an386", feature = "mps2-an500"))]
mod mps2;
#[cfg(feature = "stm32f405")]
mod stm32f405;

#[cfg(any(feature = "mps2-an386", feature = "mps2-an500"))]
pub(crate) use mps2::Mps2 as Selected;
#[cfg(feature = "stm32f405")]
pub(crate) use stm32f405::Stm32f405 as Selected;

/// A board: clocks, a UART, a tick, and an end.
///
/// The UART's interrupt hands what comes to [`crate::line::received`] and sends
/// what [`crate::line::to_send`] gives, until it gives nothing.
pub(crate) trait Board {
    /// What it is called.
    const NAME: &'static str;

    /// Sets up clocks, pins, UART and the priorities of the interrupts, and
    /// lets them come. Once.
    fn power_up();

    /// Has the UART's interrupt come, to send what waits.
    fn start_sending();

    /// Sends a byte without interrupts, waiting for the UART, though not for
    /// ever; after a crash.
    fn send_polled(byte: u8);

    /// Runs `SysTick` at this rate, Hz; 0 stops it.
    fn set_tick_rate(rate_hz: u32);

    /// The end after a crash: leaves the emulator with this status, or stands
    /// still.
    fn end(status: u8) -> !;
}

/// The flash did not do what was requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FlashError;

/// The flash that the slots lie in.
#[allow(unsafe_code)]
pub(crate) trait FlashChip {
    /// Whether the processor stands still during an erase.
    const ERASE_STALLS: bool;

    /// Erases a slot of so many words.
    ///
    /// # Safety
    /// `start` is the start of a slot, `words` its length, and nothing borrows it.
    unsafe fn erase(start: *mut u32, words: usize) -> Result<(), FlashError>;

    /// Programs a word.
    ///
    /// # Safety
    /// `place` is a word of a slot that nothing borrows.
    unsafe fn program(place: *mut u32, word: u32) -> Result<(), FlashError>;
}

/// Runs `SysTick` from the core's clock at this rate, Hz; 0 stops it.
fn run_systick(core_hz: u32, rate_hz: u32) {
    use cortex_m::peripheral::syst::SystClkSource;
    let mut timer = crate::board::core_peripherals().SYST;
    timer.disable_interrupt();
    timer.disable_counter();
    if let Some(reload) = core_hz.checked_div(rate_hz) {
        timer.set_clock_source(SystClkSource::Core);
        timer.set_reload(reload.saturating_sub(1));
        timer.clear_current();
        timer.enable_interrupt();
        timer.enable_counter();
    }
}

/// The core's own peripherals: `SysTick`, and the priorities of interrupts.
#[allow(unsafe_code)]
fn core_peripherals() -> cortex_m::Peripherals {
    // SAFETY: used by `power_up` and `set_tick_rate` only, both of the main
    // loop: never two at a time.
    unsafe { cortex_m::Peripherals::steal() }
}
