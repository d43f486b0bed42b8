//! Process-level services that every program of this workspace uses:
//!
//! - [`check_apart`]: an output file that would replace an input.
//! - [`chain`]: an error with its causes as one sentence.
//! - [`signals`]: a stop flag raised by signals; the limit of file sizes as an error.
//! - [`stdout`]: printing that tolerates a closed pipe.
//! - [`remedy`]: what helps against an error of the system.
//! - [`stderr`]: printing that a full disk does not stop.
//! - [`atomic_file`]: output files that appear complete or not at all.
//! - [`policy_file`]: policy blobs read into suitably aligned memory.
//! - [`program`]: the running program, to start it again.
//! - [`rounded`]: numbers for output.

mod apart;
pub mod atomic_file;
mod chain;
pub mod policy_file;
pub mod program;
pub mod remedy;
mod rounded;
pub mod signals;
pub mod stderr;
pub mod stdout;

pub use apart::check_apart;
pub use chain::chain;
pub use rounded::rounded;
pub use signals::Stop;
