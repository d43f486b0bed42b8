//! Replays a recording: passes its samples to a controller and compares the
//! commands with the recorded ones.
//!
//! In lock-step the controller received every sample, so the same policy must give
//! the same commands bit for bit. In real time it may have missed samples, and the
//! recording does not show which; see `controller`. Where a run in lock-step had faults on its
//! link, they are injected anew; see `faulted`.

mod compare;
mod controller;
mod estimates;
mod faulted;
mod report;
mod source;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use leg_control::estimator::Estimate;
use leg_control::wire_controller::WireController;
use leg_host::recorded::{self, RecordedError, SetPoints, Swap};
use leg_process::policy_file::{PolicyFile, PolicyFileError};

use crate::record::contents::Contents;
use crate::record::read::ReadError;
use crate::record::schema::Channel;

pub use compare::{Difference, difference};
use controller::{Divergence, Gap, ReplayController};
use faulted::{Faulted, Recorded};
pub use report::{ApexComparison, ReplayReport};
pub use source::{Answer, Source};

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Its control law cannot run.
    #[error(transparent)]
    Law(#[from] RecordedError),
    /// The other policy is invalid.
    #[error(transparent)]
    Policy(#[from] PolicyFileError),
    /// No command was compared, so nothing is known of the others.
    #[error("{}: no command was compared: {why}", path.display())]
    NothingCompared {
        /// The recording.
        path: PathBuf,
        /// The cause.
        why: String,
    },
}

/// Replays the recording at `path`; if `other` is given, with that policy.
///
/// # Errors
/// [`ReplayError`] if the recording or the policy cannot be used.
pub fn replay(path: &Path, other: Option<&PolicyFile>) -> Result<ReplayReport, ReplayError> {
    let contents = Contents::of(path)?;
    // What is missing is named in the order in which a recording has it.
    recorded::config(path, &contents)?;
    contents.first()?;
    if contents.commands == 0 {
        return Err(contents.missing("new command of a controller", Channel::Command).into());
    }
    let mut held = VecDeque::new();
    let mut keep = |at, estimate| held.push_back((at, estimate));
    let mut ignore = |_, _| ();
    let observe: Observe<'_> = if contents.has_estimates { &mut keep } else { &mut ignore };
    let mut report = run(path, &contents, other, observe)?;
    // The estimates depend on the commands, which must be the same.
    if report.is_the_same() && other.is_none() {
        estimates::compare(&contents, held, &mut report)?;
    }
    report.finish();
    if report.compared == 0 {
        let why = report.not_compared.unwrap_or_else(|| "it has none to compare".to_owned());
        return Err(ReplayError::NothingCompared { path: path.to_owned(), why });
    }
    Ok(report)
}

/// The estimates of a recording that has none.
#[derive(Clone, Debug, Default)]
pub struct Computed {
    /// Run id and number of the sample, and the estimate after it.
    pub estimates: VecDeque<((u32, u64), Estimate)>,
    /// Why there are none from a tick on, for the user.
    pub ends: Option<String>,
}

/// Computes what the estimator of a recorded controller held after each sample, where it is
/// certain: of those in real time only where the commands tell which samples it received.
///
/// # Errors
/// [`ReplayError`] if the recording cannot be replayed.
pub fn estimates(path: &Path, contents: &Contents) -> Result<Computed, ReplayError> {
    let mut estimates = VecDeque::new();
    let mut observe = |at, estimate| estimates.push_back((at, estimate));
    let report = run(path, contents, None, &mut observe)?;
    let ends = report.first_difference.map(|difference| {
        format!("from tick {} on the commands are not those of this program", difference.tick)
    });
    Ok(Computed { estimates, ends: ends.or(report.not_compared) })
}

/// Takes run id and number of a sample, and the estimate after it.
type Observe<'o> = &'o mut dyn FnMut((u32, u64), Estimate);

fn run(
    path: &Path,
    contents: &Contents,
    other: Option<&PolicyFile>,
    observe: Observe<'_>,
) -> Result<ReplayReport, ReplayError> {
    let config = recorded::config(path, contents)?;
    let first_tick = contents.first()?;
    let blobs = recorded::blobs(contents);
    let mut swaps = match other {
        Some(other) => VecDeque::from([Swap { at: first_tick, policy: Some(other.policy()?) }]),
        None => recorded::policies(path, contents, &blobs)?,
    };
    let Some(Swap { policy: Some(first), .. }) = swaps.pop_front() else {
        return Err(RecordedError::NoPolicy(path.to_owned()).into());
    };
    let faulted = Faulted::of(contents)?;
    let name = first.manifest().name;
    let mut report = ReplayReport::new(path, contents, name, other.is_some(), faulted.is_some())?;
    let set_points = SetPoints::of(&contents.set_points);
    let fresh = WireController::new(first, config);
    let is_other = other.is_some();
    if let Some(faulted) = faulted {
        let law = Recorded { controller: fresh, swaps, set_points: &set_points };
        faulted.follow(contents, law, is_other, &mut report, observe)?;
    } else {
        let controller = ReplayController::new(fresh, swaps, set_points);
        follow(contents, controller, is_other, &mut report, observe)?;
    }
    Ok(report)
}

/// Has `controller` follow the answers of a recording up to the first that it cannot explain, or
/// compares all with its own commands if it runs another policy (`is_other`).
fn follow(
    contents: &Contents,
    mut controller: ReplayController<'_>,
    is_other: bool,
    report: &mut ReplayReport,
    observe: Observe<'_>,
) -> Result<(), ReadError> {
    let mut source = Source::open(contents)?;
    let has_link_faults = faulted::link_faults(contents.config()?).is_some();
    while let Some(answer) = source.next_answer()? {
        if let Some(why) = &answer.gap {
            report.stop(why.clone());
            break;
        }
        if is_other {
            let replayed = controller.command(&answer);
            report.add_other(&answer, &replayed);
            continue;
        }
        match controller.follow(&answer) {
            Ok(continuity) => {
                report.add_same(&answer, continuity);
                if let Some(estimate) = controller.estimate() {
                    let header = &answer.sample.header;
                    observe((header.run_id, header.seq), estimate);
                }
            }
            // Faults on the link that are not injected anew may have caused it.
            Err(Divergence::Different(_)) if has_link_faults => {
                report.stop(format!(
                    "at tick {} it cannot be told whether the command would be the same: faults \
                     were injected on the link of the run, and what they changed is not in the \
                     recording",
                    answer.command.header.seq
                ));
                break;
            }
            Err(Divergence::Different(difference)) => {
                report.add_different(&answer, difference);
                break;
            }
            Err(Divergence::Unknown(Gap { unanswered, ticks: [first, last] })) => {
                report.stop(format!(
                    "at tick {} it cannot be told whether the command would be the same: which of \
                     the {unanswered} samples without a command before tick {last}, from tick \
                     {first} on, the controller received, and when, has too many possibilities to \
                     try them all",
                    answer.command.header.seq
                ));
                break;
            }
            Err(Divergence::NoPolicy { seq }) => {
                report.stop(format!(
                    "at tick {seq} the controller received a policy that the recording does not contain"
                ));
                break;
            }
        }
    }
    Ok(())
}
