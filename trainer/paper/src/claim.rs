//! Claims of the paper, with what was measured and a verdict.

/// Whether a claim holds for our agents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It holds.
    Holds,
    /// It holds in part; the measurement says which part.
    InPart,
    /// It does not hold; the measurement says why.
    Fails,
}

impl Verdict {
    /// Returns the verdict on a claim that either holds or fails.
    #[must_use]
    pub fn of(holds: bool) -> Self {
        if holds { Self::Holds } else { Self::Fails }
    }

    /// Returns the verdict in words.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::InPart => "holds in part",
            Self::Fails => "does not hold",
        }
    }
}

/// A claim of the paper, tested.
#[derive(Clone, Debug, PartialEq)]
pub struct Claim {
    /// The paper's statement, in our words.
    pub statement: String,
    /// The values that were measured, with their units.
    pub measured: String,
    /// Whether it holds.
    pub verdict: Verdict,
}

impl Claim {
    /// Returns a claim.
    #[must_use]
    pub fn new(
        statement: impl Into<String>,
        measured: impl Into<String>,
        verdict: Verdict,
    ) -> Self {
        Self { statement: statement.into(), measured: measured.into(), verdict }
    }

    /// Combines the claims of many seeds. A claim holds if it holds for at least half of
    /// the seeds, and in part if it holds for any. `shown` are the claims of the seed that
    /// is drawn.
    #[must_use]
    pub fn over_seeds(all: &[Vec<Self>], shown: &[Self]) -> Vec<Self> {
        let combined = shown.iter().enumerate().map(|(i, claim)| {
            let holds = all.iter().filter(|claims| claims[i].verdict == Verdict::Holds).count();
            let verdict = if 2 * holds >= all.len() && holds > 0 {
                Verdict::Holds
            } else if holds > 0 || claim.verdict == Verdict::InPart {
                Verdict::InPart
            } else {
                Verdict::Fails
            };
            let measured = format!(
                "holds for {holds} of {} seeds. The seed drawn ({}): {}",
                all.len(),
                claim.verdict.text(),
                claim.measured
            );
            Self::new(claim.statement.clone(), measured, verdict)
        });
        combined.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::Verdict::{Fails, Holds, InPart};
    use super::*;

    #[test]
    fn a_claim_over_seeds_holds_for_half_of_them_and_in_part_for_any() {
        let claim = |verdict| vec![Claim::new("it hops", "3 m", verdict)];
        let over = |verdicts: [Verdict; 4]| {
            let all: Vec<_> = verdicts.map(claim).into();
            Claim::over_seeds(&all, &all[3])[0].clone()
        };
        let half = over([Holds, Fails, Holds, Fails]);
        assert_eq!(half.verdict, Holds);
        assert_eq!(half.measured, "holds for 2 of 4 seeds. The seed drawn (does not hold): 3 m");
        assert_eq!(over([Holds, Fails, Fails, Fails]).verdict, InPart);
        assert_eq!(over([Fails, Fails, Fails, InPart]).verdict, InPart);
        assert_eq!(over([InPart, Fails, Fails, Fails]).verdict, Fails);
    }
}
