//! The host's end of a serial line to a flashed controller.
//!
//! [`stream`] is the bytes: a serial port, a unix socket or TCP. [`client`]
//! says messages over it until they are answered, [`upload`] brings a policy
//! across, [`commands`] is what the `controller` program does with that, and
//! [`faults`] puts into words what a controller says about itself.
//!
//! [`virtual_board`] is the other end in this process: the flashed
//! controller's own code, without the flash.

pub mod client;
pub mod commands;
pub mod faults;
pub mod identity;
mod line;
pub mod link;
mod noise;
mod pending;
pub mod stream;
pub mod upload;
pub mod virtual_board;

pub use client::{Client, ClientError, Counts, Heard};
pub use identity::{WhichPolicy, Who};
pub use link::{SerialController, SerialLeg};
pub use noise::Noisy;
pub use stream::{ByteStream, Endpoint, OpenError};
pub use virtual_board::VirtualBoard;

#[cfg(test)]
mod tests;
