//! What is claimed, what was measured, and whether it holds.

use serde::Serialize;

/// Whether a claim holds for our agents.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// It does.
    Holds,
    /// In part: the measurement says in which.
    InPart,
    /// It does not: the measurement says why.
    Fails,
}

impl Verdict {
    /// The verdict on what is either so or not.
    #[must_use]
    pub fn of(holds: bool) -> Self {
        if holds { Self::Holds } else { Self::Fails }
    }

    /// In words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::InPart => "holds in part",
            Self::Fails => "does not hold",
        }
    }
}

/// A claim of the paper, put to the test.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claim {
    /// What the paper says.
    pub says: String,
    /// What was measured, in figures with their units.
    pub measured: String,
    /// Whether it holds.
    pub verdict: Verdict,
}

impl Claim {
    /// A claim, with the figures that speak for or against it.
    #[must_use]
    pub fn new(says: impl Into<String>, measured: impl Into<String>, verdict: Verdict) -> Self {
        Self { says: says.into(), measured: measured.into(), verdict }
    }
}
