//! The leg controller on Linux: links between processes, the real-time loop, the
//! serial client, and the `controller` program.
//!
//! The modules form layers; each uses only those above it in this list:
//!
//! 1. [`link`]: the [`Link`] trait, its errors, and what both sides must agree on.
//!    A fault injector, a recorder or a probe wraps one link and is a link itself.
//! 2. [`memory`]: links within a process. [`discovery`] and [`shm`]: how two
//!    processes find each other, and links between them over iceoryx2 shared memory.
//! 3. [`reconnect`]: a shared-memory link that survives the loss of its peer.
//! 4. [`realtime`]: a control loop that ticks by the monotonic clock.
//! 5. [`node_loop`], [`node_server`] and [`server`]: the control node of the
//!    controller process, its requests and its socket. [`serial`]: the client of a
//!    control node. [`json_socket`]: JSON requests to the simulator.
//!
//! All transports pass the conformance suite in `sim-host/tests/conformance.rs`.
// `println!` and `eprintln!` panic when the output is on a full disk; see `leg_process`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod bench;
pub mod cli;
pub mod discovery;
pub mod estimate;
#[cfg(test)]
mod fixture;
pub mod flash;
pub mod json_socket;
pub mod law;
pub mod link;
pub mod memory;
mod memory_store;
pub mod node_loop;
pub mod node_server;
pub mod policy_cache;
pub mod realtime;
pub mod reconnect;
pub mod recorded;

mod safe_state;
pub mod serial;
pub mod serve;
pub mod server;
pub mod shm;
pub mod socket;
pub mod socket_server;
pub mod status;

pub use discovery::Domain;
pub use link::{ControllerLink, LegLink, Link, LinkError, Role, SessionParams, TimeMode};
