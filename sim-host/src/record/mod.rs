//! Recordings: a run as a file, to look at, to replay, to plot.
//!
//! ```text
//! loop ── Tap ──▶ ring ──▶ clerk, a thread ──▶ pipe ──▶ recorder, a process ──▶ run.mcap
//! ```
//!
//! The loop copies each tick, a fixed size, into a ring that nobody locks. A
//! thread turns it into the messages of [`schema`] (`leg.proto`), and a process
//! of its own writes them as an MCAP file, beside its place until it is
//! finished. So a run that is killed leaves a whole file, up to a tenth of a
//! second before its end; and if the recorder dies, the run goes on.
//!
//! In real time a ring that is full drops rows and counts them; in lock-step,
//! where time waits, the run does ([`OnFull`]). Replay, plot and other readers
//! see a recording by [`read`].

mod child;
mod clerk;
pub mod config;
mod pipe;
mod policies;
pub mod read;
mod recorder;
pub mod schema;
mod tap;
mod translate;

pub use child::main as recorder;
pub use policies::PolicyWatch;
pub use recorder::{Notes, RecordError, Recorded, Recorder};
pub use tap::{OnFull, Tap};
