//! Learning curves: from the logs of trainings to a picture.
//!
//! [`log`] reads what a training wrote, [`smooth`] turns the runs of a group into
//! one curve with its spread, [`picture`] draws the curves.

pub mod log;
pub mod picture;
pub mod smooth;

/// What the curves are drawn over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum By {
    /// Environment steps
    Steps,
    /// Episodes
    Episodes,
}

impl By {
    /// Its unit, as a word.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::Steps => "steps",
            Self::Episodes => "episodes",
        }
    }
}

/// Where the curves' zero lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Zero {
    /// Where the training begins
    Start,
    /// Where its last stage begins: what came before lies to the left of zero
    LastStage,
}
