//! The host's end of a serial line to a flashed controller.
//!
//! [`stream`] carries bytes: a serial [`port`], a unix socket or TCP. [`client`]
//! sends messages over it and retransmits them until they are answered, and
//! [`upload`] transfers a policy.
//!
//! [`virtual_board`] is the other end in this process: the code of the flashed
//! controller, with flash in memory.

pub mod client;
mod client_error;
mod earlier;
pub mod identity;
mod line;
pub mod link;
mod noise;
mod pending;
pub mod port;
pub mod stream;
pub mod upload;
pub mod virtual_board;

pub use client::{Client, ClientError, Counts, Received};
pub use identity::{DeviceIdentity, PolicyIdentity};
pub use link::{SerialController, SerialLeg};
pub use noise::Noisy;
pub use stream::{ByteStream, Endpoint, OpenError};
pub use virtual_board::VirtualBoard;

#[cfg(test)]
mod tests;
