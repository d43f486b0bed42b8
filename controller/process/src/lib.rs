//! Process-level services that every program of this workspace uses:
//!
//! - [`signals`]: a stop flag raised by SIGINT, SIGTERM and SIGHUP.
//! - [`stdout`]: printing that tolerates a closed pipe.
//! - [`atomic_file`]: output files that appear complete or not at all.
//! - [`policy_file`]: policy blobs read into suitably aligned memory.

pub mod atomic_file;
pub mod policy_file;
pub mod signals;
pub mod stdout;

pub use signals::Stop;
