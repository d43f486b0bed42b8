//! Why a run ends early.

use super::collapse::CollapseError;
use crate::train::{DivergenceError, StateError};
use std::io;
use std::path::{Path, PathBuf};

/// Why a run ends early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// It went to infinity.
    #[error(transparent)]
    DivergenceError(#[from] DivergenceError),
    /// It does not learn any more.
    #[error(transparent)]
    Collapsed(#[from] CollapseError),
    /// A file cannot be written.
    #[error("{}: cannot be written: {cause}; name another place with {option}", path.display())]
    Unwritten {
        /// The file.
        path: PathBuf,
        /// The option that names it.
        option: &'static str,
        /// What the system says.
        cause: io::Error,
    },
    /// Another process has the log.
    #[error("{}: another training is writing it; end it, or name another file with --log", .0.display())]
    Busy(PathBuf),
    /// The log is not the one of the checkpoint.
    #[error("{}: {what}, so the training cannot go on from its checkpoint; --restart begins anew", path.display())]
    Log {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// A file is no checkpoint to go on from.
    #[error("{}: {what}; --restart begins anew", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// A checkpoint contradicts itself.
    #[error("{}: {cause}; --restart begins anew", path.display())]
    StateError {
        /// The file.
        path: PathBuf,
        /// How.
        cause: StateError,
    },
}

impl RunError {
    /// Whether what was given cannot be used, rather than that something failed.
    #[must_use]
    pub fn is_input(&self) -> bool {
        matches!(self, Self::Log { .. } | Self::Checkpoint { .. } | Self::StateError { .. })
    }

    /// Whether the training itself is over: going on from its checkpoint would end here again.
    #[must_use]
    pub fn ends_the_training(&self) -> bool {
        matches!(self, Self::DivergenceError(_) | Self::Collapsed(_))
    }

    /// For `map_err`: a file that an option names cannot be written.
    pub(super) fn unwritten(
        path: &Path,
        option: &'static str,
    ) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |cause| Self::Unwritten { path, option, cause }
    }
}
