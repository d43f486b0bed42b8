//! A controller served in real time, from its first tick to its figures.

use super::super::link::{ControllerLink, LinkError};
use super::control::{ControllerTask, Ends, Law};
use super::drive::{Options, run};
use super::report::LoopReport;
use leg_control::wire::Command;
use leg_process::signals::Stop;

/// What serving came to.
#[derive(Clone, Debug)]
pub struct Served {
    /// What ended it before its time, if anything did.
    pub ended: Result<(), LinkError>,
    /// Samples taken.
    pub samples: u64,
    /// The last command.
    pub last: Command,
    /// The figures of the loop.
    pub report: LoopReport,
}

/// Serves a leg at the other end of `link` by `law`, on this thread, until its
/// farewell or until `stop` is raised. `supervise` is called every 10 ms, beside
/// the loop. The link is let go of before the figures are made.
pub fn serve<L: ControllerLink, W: Law>(
    link: L,
    law: &mut W,
    ends: Ends,
    options: &Options,
    stop: &Stop,
    supervise: impl FnMut() + Send,
) -> Served {
    let mut task = ControllerTask::new(link, law, options.rate_hz, ends);
    let (ended, tally) = run(options, &mut task, stop, supervise);
    let ended = ended.and(if stop.is_raised() { Err(LinkError::Stopped) } else { Ok(()) });
    let (samples, last) = (task.samples(), *task.last_command());
    drop(task);
    Served { ended, samples, last, report: tally.report() }
}
