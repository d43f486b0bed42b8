//! A recording played again: its samples go to the controller, and its commands
//! are held against those that come.
//!
//! In lock-step the controller has seen every sample, so the same one must give
//! the same commands, to the last bit. In real time it may have missed some,
//! and what it saw is not recorded; see `twin`.

mod compare;
mod report;
mod source;
mod twin;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use leg_control::config::{Config as Law, ConfigError};
use leg_control::policy::{ParseError, Policy};
use leg_control::wire::Command;
use leg_control::wire_controller::WireController;
use leg_process::policy_file::{AlignedBytes, PolicyFile, PolicyFileError};

use crate::record::read::ReadError;
use crate::record::schema::Config;

pub use compare::{Difference, difference};
pub use report::{ApexRow, Report};
pub use source::{Answer, Source, Summary};
use twin::{Swap, Twin};

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// It cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The policy to try is none.
    #[error(transparent)]
    Policy(#[from] PolicyFileError),
    /// The recording has no policy in it.
    #[error(
        "{}: the recording does not have the policy that ran, as when the controller was behind a bridge; --policy FILE names it",
        .0.display()
    )]
    NoPolicy(PathBuf),
    /// A policy in the recording is none.
    #[error("{}: the policy `{name}` in it is not one to run: {cause}", path.display())]
    BadPolicy {
        /// The recording.
        path: PathBuf,
        /// The policy.
        name: String,
        /// Which check it fails.
        cause: ParseError,
    },
    /// It is of another version of the messages.
    #[error("{}: its messages are of version {theirs}, this program's of {ours}; replay it with the release that made it ({release})", path.display())]
    WireVersion {
        /// The recording.
        path: PathBuf,
        /// Its version.
        theirs: u32,
        /// This program's.
        ours: u16,
        /// Version of the program that made it.
        release: String,
    },
    /// Its rate or gravity cannot be.
    #[error("{}: {cause}", path.display())]
    Config {
        /// The recording.
        path: PathBuf,
        /// Which.
        cause: ConfigError,
    },
}

/// Plays the recording at `path` again; with `other`, to that policy.
///
/// # Errors
/// [`ReplayError`] when there is nothing to play.
pub fn replay(path: &Path, other: Option<&PolicyFile>) -> Result<Report, ReplayError> {
    let summary = Summary::of(path)?;
    let law = law(path, &summary.config)?;
    let blobs: Vec<AlignedBytes> =
        summary.policies.iter().map(|policy| policy.blob.as_slice().into()).collect();
    let mut swaps = match other {
        Some(other) => VecDeque::from([Swap { at: summary.first, policy: Some(other.policy()?) }]),
        None => recorded_policies(path, &summary, &blobs)?,
    };
    let Some(Swap { policy: Some(first), .. }) = swaps.pop_front() else {
        return Err(ReplayError::NoPolicy(path.to_owned()));
    };
    let mut report = Report::new(path, &summary, first.manifest().name, other.is_some());
    let mut twin = Twin::new(WireController::new(first, law), swaps);
    let mut source = Source::open(path)?;
    while let Some(answer) = source.next_answer()? {
        if let Some(why) = &answer.gap {
            report.stop(why.clone());
            break;
        }
        if other.is_some() {
            let replayed = twin.answer(&answer);
            report.other(&answer, &replayed);
            continue;
        }
        match twin.follow(&answer) {
            Ok(begun_anew) => report.same(&answer, begun_anew),
            Err(twin::Parted::Different(difference)) => {
                report.different(&answer, difference);
                break;
            }
            Err(twin::Parted::TooManyWays) => {
                report.stop(format!(
                    "by tick {} so many samples had no command that what the controller saw of \
                     them cannot be found out",
                    answer.command.seq
                ));
                break;
            }
            Err(twin::Parted::NoPolicy { seq }) => {
                report.stop(format!(
                    "at tick {seq} the controller was given a policy that the recording does not have"
                ));
                break;
            }
        }
    }
    report.finish(&mut source)?;
    Ok(report)
}

fn law(path: &Path, config: &Config) -> Result<Law, ReplayError> {
    let ours = leg_control::wire::WIRE_VERSION;
    if config.wire_version != u32::from(ours) {
        return Err(ReplayError::WireVersion {
            path: path.to_owned(),
            theirs: config.wire_version,
            ours,
            release: config.sim_host_version.clone(),
        });
    }
    Law::at_rate(config.rate_hz)
        .and_then(|law| law.with_gravity(config.gravity_m_s2))
        .map_err(|cause| ReplayError::Config { path: path.to_owned(), cause })
}

/// The policies in the order in which the controller was given them.
fn recorded_policies<'a>(
    path: &Path,
    summary: &Summary,
    blobs: &'a [AlignedBytes],
) -> Result<VecDeque<Swap<'a>>, ReplayError> {
    let mut swaps = Vec::new();
    for (recorded, blob) in summary.policies.iter().zip(blobs) {
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
    // One that came in the middle of the run says nothing of its beginning.
    if swaps.first().is_none_or(|first| first.at > summary.first) {
        swaps.clear();
    }
    Ok(swaps.into())
}

/// The command in a recorded answer.
fn recorded(answer: &Answer) -> Command {
    Command::from(&answer.command)
}
