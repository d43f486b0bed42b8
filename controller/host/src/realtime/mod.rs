//! A control loop that ticks by the machine's monotonic clock.
//!
//! Leg and controller tick by the same clock, each on its own [`TickSchedule`]: a
//! fixed fraction of a period after each multiple of the period, the controller half
//! a period after the leg. Each has half a period for its work, and the two need no
//! messages to stay in step.
//!
//! In each tick the loop sleeps until shortly before the tick's instant, spins to
//! the instant, receives the newest message, computes, and sends. The loop's thread
//! neither allocates nor logs nor locks. It pushes one [`TickStats`] per tick into a
//! wait-free ring, from which the [`StatsThread`] makes histograms, reports and
//! messages. (iceoryx2 0.10 allocates a block of 48 bytes for each message that it
//! sends and frees it in the same call: from the thread's own cache, without a lock
//! or a system call.)
//!
//! # Terms
//!
//! - The *lateness* of a tick is the time from its instant to its start. *Jitter* is
//!   the spread of the lateness. A tick is *late* if its lateness exceeds a tenth of
//!   a period. It starts immediately; the schedule is never shifted.
//! - Ticks whose whole period passes while the loop sleeps are *missed*. The leg then
//!   simulates them all at once under the command in force and sends only the newest
//!   sample. The controller skips them and uses the newest sample.
//! - The *deadline* of a tick is the instant of the next tick. A tick that ends after
//!   it is a deadline miss; the next tick starts immediately.
//! - A tick whose own processor time exceeds a period is an *overrun*: the work was
//!   too long. Any other deadline miss was caused by the machine.
//! - A tick in a run without a message newer than the last one is *stale*. The leg
//!   keeps the command in force, and the controller extrapolates. After
//!   [`LoopOptions::stale_limit_ns`] of silence both use their
//!   safe command until the peer sends again.

pub mod args;
mod clock;
mod controller_task;
mod loop_stats;
mod privileges;
mod report;
mod run;
mod schedule;
mod serve;
mod stats_thread;
mod supervise;
mod tick_stats;
mod ticker;
mod transitions;

pub use clock::{Clock, DEFAULT_SPIN, MonotonicClock};
pub use controller_task::{Control, ControllerTask, Direct, ExitOn};
pub use loop_stats::LoopStats;
pub use privileges::{PRIORITIES, Privileges, allowed_cpus};
pub use report::{HistogramBin, LoopReport, QuantilesUs, with_unit};
pub use run::{LoopOptions, StatsWriter, Task, TickResult, run, run_ticks};
pub use schedule::TickSchedule;
pub use serve::{ServeOutcome, serve};
pub use stats_thread::{LatestReport, StatsThread, TickObserver};
pub use supervise::{LostPeer, supervise_peer};
pub use tick_stats::{LoopCounters, RxStatus, TickStats};
pub use ticker::{Tick, Ticker};

#[cfg(test)]
mod tests;
