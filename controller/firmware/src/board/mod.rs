//! What differs from board to board: one file each, and one line here.

use controller::serial::slots::PolicyFlash;

#[cfg(feature = "mps2")]
mod mps2;
#[cfg(feature = "mps2")]
mod ram_flash;
#[cfg(feature = "mps2")]
pub use mps2::Mps2 as This;

/// What the firmware asks of a board.
///
/// Its UART interrupts, at [`crate::ceiling::LINE_PRIORITY`], pass bytes to
/// [`crate::line::received`] and take those to send from
/// [`crate::line::to_send`].
pub trait Board {
    /// As [`controller::serial::message::Identity`] says it.
    const NAME: &'static str;

    /// Its flash.
    type Flash: PolicyFlash;

    /// Clocks, pins, UART and its interrupts. Called once, first of all.
    fn power_up() -> Self;

    /// The processor's clock, which is SysTick's, Hz.
    fn clock_hz(&self) -> u32;

    /// The flash with the two slots.
    fn policy_flash(self) -> Self::Flash;

    /// There is something to send: brings the UART's interrupt about.
    fn start_sending();

    /// Sends a byte by polling, after a crash; false when the UART takes none
    /// within a reasonable time.
    fn send_now(byte: u8) -> bool;

    /// The end, after a crash: the emulator ends with this status, a board
    /// sleeps until power-up.
    fn stop(status: u8) -> !;
}
