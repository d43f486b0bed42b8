//! The serial protocol: a control node at one end of a byte stream, its host at
//! the other.
//!
//! [`frame`] carries a message over any stream of bytes, and [`message`]
//! defines the messages. [`node`] runs the control law once a tick.
//! [`handler`] answers requests, and keeps policies in a [`store`], of which
//! [`slots`] is the one in flash. [`endpoint`] joins all of them at a byte
//! stream. None of it performs I/O: a board or a process passes in bytes and
//! ticks. `controller/src/serial/PROTOCOL.md` specifies the protocol.

pub mod endpoint;
pub mod error;
pub mod frame;
pub mod handler;
pub mod message;
pub mod node;
pub mod slots;
pub mod store;

/// The version of the protocol. It is raised whenever the bytes of any message
/// or of the framing change.
pub const PROTOCOL_VERSION: u8 = 3;
