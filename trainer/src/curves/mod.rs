//! Learning curves from the logs of trainings.
//!
//! [`log`] reads the logs, [`smooth`] reduces the runs of a group to one curve with its spread,
//! and [`picture`] draws the curves.

pub mod log;
pub mod picture;
pub mod smooth;

/// The horizontal axis of the curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum By {
    /// Environment steps
    Steps,
    /// Episodes
    Episodes,
}

impl By {
    /// Returns the unit of the axis.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::Steps => "steps",
            Self::Episodes => "episodes",
        }
    }
}

/// The position of zero on the horizontal axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Zero {
    /// Start of the training
    Start,
    /// Start of the last stage; earlier stages are at negative positions
    LastStage,
}
