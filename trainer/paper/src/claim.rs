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
    /// The claims of many seeds as one each: a claim holds when it does for at
    /// least half of them, and in part when it does for any. `shown` are those of
    /// the seed that is drawn.
    #[must_use]
    pub fn over_seeds(all: &[Vec<Self>], shown: &[Self]) -> Vec<Self> {
        let each = shown.iter().enumerate().map(|(i, claim)| {
            let holds = all.iter().filter(|claims| claims[i].verdict == Verdict::Holds).count();
            let verdict = if 2 * holds >= all.len() && holds > 0 {
                Verdict::Holds
            } else if holds > 0 || claim.verdict == Verdict::InPart {
                Verdict::InPart
            } else {
                Verdict::Fails
            };
            let measured = format!(
                "so for {holds} of {} seeds; of the one drawn ({}): {}",
                all.len(),
                claim.verdict.words(),
                claim.measured
            );
            Self::new(claim.says.clone(), measured, verdict)
        });
        each.collect()
    }

    /// A claim, with the figures that speak for or against it.
    #[must_use]
    pub fn new(says: impl Into<String>, measured: impl Into<String>, verdict: Verdict) -> Self {
        Self { says: says.into(), measured: measured.into(), verdict }
    }
}

#[cfg(test)]
mod tests {
    use super::Verdict::{Fails, Holds, InPart};
    use super::*;

    #[test]
    fn a_claim_over_seeds_holds_for_half_of_them_and_in_part_for_any() {
        let claim = |verdict| vec![Claim::new("it flies", "3 m", verdict)];
        let over = |verdicts: [Verdict; 4]| {
            let all: Vec<_> = verdicts.map(claim).into();
            Claim::over_seeds(&all, &all[3])[0].clone()
        };
        let half = over([Holds, Fails, Holds, Fails]);
        assert_eq!(half.verdict, Holds);
        assert_eq!(half.measured, "so for 2 of 4 seeds; of the one drawn (does not hold): 3 m");
        assert_eq!(over([Holds, Fails, Fails, Fails]).verdict, InPart);
        assert_eq!(over([Fails, Fails, Fails, InPart]).verdict, InPart);
        assert_eq!(over([InPart, Fails, Fails, Fails]).verdict, Fails);
    }
}
