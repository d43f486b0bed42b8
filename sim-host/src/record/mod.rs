//! Records a run to an MCAP file and reads it back.
//!
//! ```text
//! loop -- RecordTap --> ring --> feeder thread --> pipe --> writer process --> run.mcap
//! ```
//!
//! The loop copies a record of fixed size into a lock-free ring at each tick. A
//! thread converts the records to the messages of [`schema`] (`leg.proto` of leg-recording), and
//! a separate process writes them to `run.mcap.part`, which it renames to
//! `run.mcap` once the file is complete. If the run is killed, the writer still
//! completes the file, up to a tenth of a second before the run's end; if the
//! writer dies, the run continues without it.
//!
//! When the ring is full, a run in real time drops and counts records and a run
//! in lock-step waits ([`OnFull`]). Replay and plot read a recording by
//! [`contents`].

mod change_poller;
pub mod config;
mod display;
mod feeder;
mod file;
mod observed;
mod pipe;
mod recorder;
pub mod recover;
mod tap;
mod translate;
mod writer_process;

pub use leg_recording::{contents, read, schema, versions};

pub use change_poller::ChangePoller;
pub(crate) use observed::{LiveMessages, ObservedRun, now_unix_ns, topics};
pub use recorder::{RecordError, RecordOptions, RecordSink, RecordSummary, Recorder};
pub(crate) use tap::TickCopy;
pub use tap::{OnFull, RecordTap};
pub use writer_process::main as writer_process;
