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

use leg_control::config::{Config as ControlConfig, ConfigError};
use leg_control::policy::{ParseError, Policy};
use leg_control::serial::node::SessionParams;
use leg_control::wire_controller::WireController;
use leg_process::policy_file::{AlignedBytes, PolicyFile, PolicyFileError};

use crate::record::contents::Contents;
use crate::record::read::ReadError;
use crate::record::schema::Channel;
use crate::record::versions::READABLE;

pub use compare::{Difference, difference};
use controller::{Divergence, ReplayController, SetPoints, Swap};
use faulted::Faulted;
pub use report::{ApexComparison, ReplayReport};
pub use source::{Answer, Source};

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The other policy is invalid.
    #[error(transparent)]
    Policy(#[from] PolicyFileError),
    /// The recording contains no policy.
    #[error(
        "{} contains no policy that ran from its first tick (topic {}), as when the controller was \
         behind a bridge, or another program has removed it",
        .0.display(),
        Channel::Policy.topic()
    )]
    NoPolicy(PathBuf),
    /// A policy in the recording is invalid.
    #[error("{}: the policy `{name}` in it cannot run: {cause}", path.display())]
    BadPolicy {
        /// The recording.
        path: PathBuf,
        /// The policy's name.
        name: String,
        /// The check that it fails.
        cause: ParseError,
    },
    /// The recording has another version of the messages.
    #[error("{}: its messages have version {theirs}, this program reads versions {} to {}; replay it with the release that made it ({release})", path.display(), READABLE.start(), READABLE.end())]
    WireVersion {
        /// The recording.
        path: PathBuf,
        /// Its version.
        theirs: u32,
        /// Version of the program that made it.
        release: String,
    },
    /// No command was compared, so nothing is known of the others.
    #[error("{}: no command was compared: {why}", path.display())]
    NothingCompared {
        /// The recording.
        path: PathBuf,
        /// The cause.
        why: String,
    },
    /// Its control law is not known.
    #[error("{}: {cause}; replay it with the release that made it", path.display())]
    Law {
        /// The recording.
        path: PathBuf,
        /// What is not known.
        cause: String,
    },
    /// Its rate, gravity, stale limit or noise is out of range.
    #[error("{}: {cause}", path.display())]
    Config {
        /// The recording.
        path: PathBuf,
        /// The cause.
        cause: ConfigError,
    },
}

/// Replays the recording at `path`; if `other` is given, with that policy.
///
/// # Errors
/// [`ReplayError`] if the recording or the policy cannot be used.
pub fn replay(path: &Path, other: Option<&PolicyFile>) -> Result<ReplayReport, ReplayError> {
    let contents = Contents::of(path)?;
    let config = control_config(path, &contents)?;
    let first_tick = contents.first()?;
    if contents.commands == 0 {
        return Err(contents.missing("new command of a controller", Channel::Command).into());
    }
    let blobs: Vec<AlignedBytes> =
        contents.policies.iter().map(|policy| policy.blob.as_slice().into()).collect();
    let mut swaps = match other {
        Some(other) => VecDeque::from([Swap { at: first_tick, policy: Some(other.policy()?) }]),
        None => recorded_policies(path, &contents, &blobs)?,
    };
    let Some(Swap { policy: Some(first), .. }) = swaps.pop_front() else {
        return Err(ReplayError::NoPolicy(path.to_owned()));
    };
    let faulted = Faulted::of(&contents)?;
    let name = first.manifest().name;
    let mut report = ReplayReport::new(path, &contents, name, other.is_some(), faulted.is_some())?;
    let set_points = SetPoints::of(&contents.set_points);
    let fresh = WireController::new(first, config);
    let without_state = fresh.clone();
    if let Some(faulted) = faulted {
        faulted.follow(&contents, fresh, swaps, &set_points, other.is_some(), &mut report)?;
    } else {
        let controller = ReplayController::new(fresh, swaps, set_points);
        follow(&contents, controller, other.is_some(), &mut report)?;
    }
    // The estimates depend on the commands, which must be the same.
    if report.is_the_same() && other.is_none() {
        estimates::compare(&contents, without_state, &mut report)?;
    }
    finished(report, path)
}

/// Has `controller` follow the answers of a recording up to the first that it cannot explain, or
/// compares all with its own commands if it runs another policy (`is_other`).
fn follow(
    contents: &Contents,
    mut controller: ReplayController<'_>,
    is_other: bool,
    report: &mut ReplayReport,
) -> Result<(), ReadError> {
    let mut source = Source::open(contents)?;
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
            Ok(continuity) => report.add_same(&answer, continuity),
            Err(Divergence::Different(difference)) => {
                report.add_different(&answer, difference);
                break;
            }
            Err(Divergence::TooManyCandidates) => {
                report.stop(format!(
                    "by tick {} so many samples had no command that it cannot be determined \
                     which of them the controller received",
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

fn finished(mut report: ReplayReport, path: &Path) -> Result<ReplayReport, ReplayError> {
    report.finish();
    if report.compared == 0 {
        let why = report.not_compared.unwrap_or_else(|| "it has none to compare".to_owned());
        return Err(ReplayError::NothingCompared { path: path.to_owned(), why });
    }
    Ok(report)
}

fn control_config(path: &Path, contents: &Contents) -> Result<ControlConfig, ReplayError> {
    let config = contents.config()?;
    if !READABLE.contains(&config.wire_version) {
        return Err(ReplayError::WireVersion {
            path: path.to_owned(),
            theirs: config.wire_version,
            release: config.sim_host_version.clone(),
        });
    }
    let usual = SessionParams::default();
    let (estimator, stale_limit_ns) = match contents.laws.as_slice() {
        [] => (usual.estimator, usual.stale_limit_ns.into()),
        [law] => {
            let unknown = |cause| ReplayError::Law { path: path.to_owned(), cause };
            (leg_host::law::of_recording(law).map_err(unknown)?, law.stale_limit_ns)
        }
        more => return Err(contents.merged(format!("it has {} control laws", more.len())).into()),
    };
    SessionParams {
        rate_hz: config.rate_hz,
        gravity_m_s2: config.gravity_m_s2,
        // What does not fit is out of range.
        stale_limit_ns: u32::try_from(stale_limit_ns).unwrap_or(u32::MAX),
        estimator,
    }
    .config()
    .map_err(|cause| ReplayError::Config { path: path.to_owned(), cause })
}

/// Returns the policies in the order in which the controller received them.
fn recorded_policies<'a>(
    path: &Path,
    contents: &Contents,
    blobs: &'a [AlignedBytes],
) -> Result<VecDeque<Swap<'a>>, ReplayError> {
    let mut swaps = Vec::new();
    for (recorded, blob) in contents.policies.iter().zip(blobs) {
        let policy = if recorded.blob.is_empty() {
            None
        } else {
            let policy = Policy::parse(blob.as_slice()).map_err(|cause| {
                let name = recorded.name.clone();
                ReplayError::BadPolicy { path: path.to_owned(), name, cause }
            })?;
            Some(policy)
        };
        swaps.push(Swap { at: (recorded.run_id, recorded.seq), policy });
    }
    swaps.sort_by_key(|swap| swap.at);
    // Without the policy of the first tick the replay cannot start.
    let first_tick = contents.first()?;
    if swaps.first().is_none_or(|first| first.at > first_tick) {
        swaps.clear();
    }
    Ok(swaps.into())
}
