//! Serving a leg in real time.

use leg_control::wire::Command;
use leg_process::Stop;

use super::controller_task::{Control, ControllerTask, ExitOn};
use super::report::LoopReport;
use super::run::{LoopOptions, run};
use crate::link::{ControllerLink, LinkError};

/// The result of serving a leg.
#[derive(Clone, Debug)]
pub struct ServeOutcome {
    /// Ok if the run ended, or the error that ended the loop early.
    pub ended: Result<(), LinkError>,
    /// Number of samples received.
    pub samples: u64,
    /// The last command.
    pub last: Command,
    /// Report on the loop.
    pub report: LoopReport,
}

/// Answers the leg at the other end of `link` with the commands of `control`, on this
/// thread, until its run ends or `stop` is raised.
///
/// `supervise` is called every 10 ms on another thread. The link is dropped before
/// the report is made.
pub fn serve<L: ControllerLink, K: Control>(
    link: L,
    control: &mut K,
    exit_on: ExitOn,
    options: &LoopOptions,
    stop: &Stop,
    supervise: impl FnMut() + Send,
) -> ServeOutcome {
    let mut task = ControllerTask::new(link, control, options.rate_hz, exit_on);
    let (ended, stats) = run(options, &mut task, stop, supervise);
    let ended = ended.and(if stop.is_raised() { Err(LinkError::Stopped) } else { Ok(()) });
    let (samples, last) = (task.samples(), *task.last_command());
    drop(task);
    ServeOutcome { ended, samples, last, report: stats.report() }
}
