//! The control law of a recording: its configuration, its policies, and its set-points.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use leg_control::config::{Config, ConfigError};
use leg_control::policy::{ParseError, Policy};
use leg_control::serial::node::SessionParams;
use leg_control::wire::{Command, Header, Sample};
use leg_control::wire_controller::WireController;
use leg_process::policy_file::AlignedBytes;
use leg_recording::contents::Contents;
use leg_recording::read::ReadError;
use leg_recording::schema::{Channel, SetPoint};
use leg_recording::versions::READABLE;

use crate::law;

/// Why the law of a recording cannot run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordedError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
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
    #[error("{}: its messages have version {theirs}, this program reads versions {} to {}; use the release that made it ({release})", path.display(), READABLE.start(), READABLE.end())]
    WireVersion {
        /// The recording.
        path: PathBuf,
        /// Its version.
        theirs: u32,
        /// Version of the program that made it.
        release: String,
    },
    /// Its control law is not known.
    #[error("{}: {cause}; use the release that made it", path.display())]
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

/// Returns what both sides of a recorded run agreed on.
///
/// # Errors
/// [`RecordedError`] if the recording has no configuration, or one that this program does not
/// know.
pub fn session(path: &Path, contents: &Contents) -> Result<SessionParams, RecordedError> {
    let config = contents.config()?;
    if !READABLE.contains(&config.wire_version) {
        return Err(RecordedError::WireVersion {
            path: path.to_owned(),
            theirs: config.wire_version,
            release: config.sim_host_version.clone(),
        });
    }
    let usual = SessionParams::default();
    let (estimator, stale_limit_ns) = match contents.laws.as_slice() {
        [] => (usual.estimator, usual.stale_limit_ns.into()),
        [recorded] => {
            let unknown = |cause| RecordedError::Law { path: path.to_owned(), cause };
            (law::of_recording(recorded).map_err(unknown)?, recorded.stale_limit_ns)
        }
        more => return Err(contents.merged(format!("it has {} control laws", more.len())).into()),
    };
    Ok(SessionParams {
        rate_hz: config.rate_hz,
        gravity_m_s2: config.gravity_m_s2,
        // What does not fit is out of range.
        stale_limit_ns: u32::try_from(stale_limit_ns).unwrap_or(u32::MAX),
        estimator,
    })
}

/// Returns the configuration of a recorded law.
///
/// # Errors
/// [`RecordedError`] if it is missing, not known, or out of range.
pub fn config(path: &Path, contents: &Contents) -> Result<Config, RecordedError> {
    let out_of_range = |cause| RecordedError::Config { path: path.to_owned(), cause };
    session(path, contents)?.config().map_err(out_of_range)
}

/// Returns the policy files of a recording in memory, for [`policies`].
#[must_use]
pub fn blobs(contents: &Contents) -> Vec<AlignedBytes> {
    contents.policies.iter().map(|policy| policy.blob.as_slice().into()).collect()
}

/// A policy that the controller received before a tick.
#[derive(Clone, Debug)]
pub struct Swap<'a> {
    /// Run id and tick.
    pub at: (u32, u64),
    /// `None` if the recording does not contain the policy.
    pub policy: Option<Policy<'a>>,
}

/// Returns the policies in the order in which the controller received them; none if the first is
/// not in the recording.
///
/// # Errors
/// [`RecordedError`] if one is invalid.
pub fn policies<'a>(
    path: &Path,
    contents: &Contents,
    blobs: &'a [AlignedBytes],
) -> Result<VecDeque<Swap<'a>>, RecordedError> {
    let mut swaps = Vec::new();
    for (recorded, blob) in contents.policies.iter().zip(blobs) {
        let policy = if recorded.blob.is_empty() {
            None
        } else {
            let policy = Policy::parse(blob.as_slice()).map_err(|cause| {
                let name = recorded.name.clone();
                RecordedError::BadPolicy { path: path.to_owned(), name, cause }
            })?;
            Some(policy)
        };
        swaps.push(Swap { at: (recorded.run_id, recorded.seq), policy });
    }
    swaps.sort_by_key(|swap| swap.at);
    // Without the policy of the first tick the law cannot start.
    let first_tick = contents.first()?;
    if swaps.first().is_none_or(|first| first.at > first_tick || first.policy.is_none()) {
        swaps.clear();
    }
    Ok(swaps.into())
}

/// The set-points of requests to the controller, each from a tick on, by run id and tick.
#[derive(Clone, Debug, Default)]
pub struct SetPoints(Vec<((u32, u64), Option<f32>)>);

impl SetPoints {
    /// Returns the set-points of a recording.
    #[must_use]
    pub fn of(recorded: &[SetPoint]) -> Self {
        let mut all: Vec<_> = recorded
            .iter()
            .map(|s| ((s.run_id, s.seq), s.is_set.then_some(s.set_point_m_s)))
            .collect();
        all.sort_by_key(|(at, _)| *at);
        Self(all)
    }

    /// Returns the set-point in place of that in the sample with this header, m/s.
    #[must_use]
    pub fn at(&self, header: &Header) -> Option<f32> {
        let now = (header.run_id, header.seq);
        let count = self.0.partition_point(|(at, _)| *at <= now);
        self.0[..count].last()?.1
    }

    /// Runs one tick as the recorded controller did, or one without a sample, after the sample
    /// with the header `last`.
    pub fn tick(
        &self,
        controller: &mut WireController<'_>,
        sample: Option<&Sample>,
        last: &Header,
    ) -> Command {
        let header = sample.map_or(last, |sample| &sample.header);
        let set_point_m_s = self.at(header).or(sample.map(|sample| sample.set_point_m_s));
        controller.tick_at(sample, set_point_m_s)
    }
}
