//! The flashed controller, in the emulator, over its real serial line.
//!
//! These tests are skipped where the emulator is not installed (`cargo xtask setup`
//! installs it). They are short here; `LEG_HIL_TICKS=100000` makes them long, as
//! `cargo xtask soak` does.

mod bad_samples;
mod board;
mod crashes;
mod estimated;
mod identity;
mod line;
mod live;
mod policies;
mod uploads;
