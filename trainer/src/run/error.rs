//! The errors of a training run.

use super::collapse::CollapseError;
use crate::train::{DivergenceError, StateError};
use leg_process::remedy;
use std::io;
use std::path::{Path, PathBuf};

/// The purpose of a file that a run writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A checkpoint beside the policy.
    Checkpoint,
    /// The log.
    Log,
    /// TensorBoard events.
    Events,
}

/// The reason why a run ends early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The training diverged.
    #[error(transparent)]
    Diverged(#[from] DivergenceError),
    /// The training collapsed.
    #[error(transparent)]
    Collapsed(#[from] CollapseError),
    /// A file cannot be written.
    #[error("{}: cannot be written: {cause}", path.display())]
    Unwritten {
        /// Path of the file.
        path: PathBuf,
        /// Purpose of the file.
        purpose: Purpose,
        /// Error of the system.
        cause: io::Error,
    },
    /// Another process holds the lock of the log.
    #[error("{}: another training is writing it", .0.display())]
    Busy(PathBuf),
    /// The log does not belong to the checkpoint.
    #[error("{}: {what}, so the training cannot resume from its checkpoint", path.display())]
    Log {
        /// Path of the log.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// The log has rows of another training that was interrupted.
    #[error("{}: these are the rows of {}", path.display(), owner(checkpoint.as_deref()))]
    OtherLog {
        /// Path of the log.
        path: PathBuf,
        /// Checkpoint of that training; `None` when none is beside the files.
        checkpoint: Option<PathBuf>,
    },
    /// A file is not a checkpoint that can be resumed.
    #[error("{}: {what}", path.display())]
    Checkpoint {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// The state in a checkpoint does not fit its configuration.
    #[error("{}: {cause}", path.display())]
    State {
        /// Path of the checkpoint.
        path: PathBuf,
        /// The part that does not fit.
        cause: StateError,
    },
}

/// Describes the training that rows belong to.
fn owner(checkpoint: Option<&Path>) -> String {
    match checkpoint {
        Some(path) => {
            format!("another training, which its checkpoint {} continues", path.display())
        }
        None => "a training that was interrupted and left no checkpoint".into(),
    }
}

impl RunError {
    /// Whether the input is at fault, rather than the system or the training.
    #[must_use]
    pub fn is_input(&self) -> bool {
        matches!(
            self,
            Self::Log { .. } | Self::OtherLog { .. } | Self::Checkpoint { .. } | Self::State { .. }
        )
    }

    /// Whether the path of a file to write cannot be that of a file, whoever writes it.
    #[must_use]
    pub fn is_wrong_path(&self) -> bool {
        matches!(self, Self::Unwritten { cause, .. } if remedy::is_wrong_path(cause))
    }

    /// Whether resuming from the checkpoint would end the same way.
    #[must_use]
    pub fn ends_the_training(&self) -> bool {
        matches!(self, Self::Diverged(_) | Self::Collapsed(_))
    }

    /// Returns a function for `map_err` that makes an error of a file that cannot be written.
    pub(super) fn unwritten(
        path: &Path,
        purpose: Purpose,
    ) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |cause| Self::Unwritten { path, purpose, cause }
    }
}
