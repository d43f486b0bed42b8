//! The controller on a host: links to a leg, and the `controller` process.
//!
//! Everything above [`link`] sees only the [`Link`] trait; a fault injector, a
//! recorder or a probe wraps one link and is another. Below it are the
//! transports: [`memory`] within a process, [`shm`] between two (iceoryx2
//! shared memory). All pass the same [`conformance`] suite.
//!
//! Two processes find each other by the name of a [`domain`], in which each
//! plays one [`card::Role`]; questions and orders from beside the loop come to
//! its [`desk`]. A controller that is flashed is reached over a
//! [`serial`] line.

pub mod bench;
pub mod card;
pub mod cli;
pub mod desk;
pub mod domain;
#[cfg(test)]
mod fixture;
pub mod flash;

pub mod link;
pub mod memory;
pub mod office;
pub mod operated;
pub mod patient;
mod payload;
pub mod realtime;
pub mod serial;
pub mod serve;
pub mod shelf;
pub mod shm;
pub mod socket;
mod wait;

pub use card::{Pace, Role, Terms};
pub use desk::Desk;
pub use domain::Domain;
pub use link::{ControllerLink, LegLink, Link, LinkError};
pub use payload::{Message, Shared};
