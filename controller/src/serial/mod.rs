//! The controller at the far end of a byte stream: what a flashed controller
//! and its host say to each other, and what the controller does about it.
//!
//! [`frame`] carries a message over any stream of bytes, [`message`] says what
//! the messages are, [`slots`] keeps two policies in flash, [`pilot`] runs the
//! control law once a tick, [`desk`] answers everything else, and [`station`]
//! is all of them behind one byte. All of it is free of I/O: a board gives it
//! bytes and ticks. The protocol is written down
//! in `controller/src/serial/PROTOCOL.md`.

pub mod desk;
pub mod frame;
pub mod message;
pub mod pilot;
pub mod slots;
pub mod station;

/// The protocol spoken here: raised whenever the bytes of any message or of
/// the framing change.
pub const PROTOCOL_VERSION: u8 = 1;
