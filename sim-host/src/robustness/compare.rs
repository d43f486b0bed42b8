//! Two sweeps side by side: of two policies, or of one policy in two builds.

use std::fmt;

use serde::Serialize;

use super::axes::Media;
use super::report::{Report, Row};
use crate::statistics::{Pairs, unpaired_difference};

/// A sweep beside another one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Name of the other sweep's policy.
    pub policy: String,
    /// One row for each fault, level and medium that both sweeps have.
    pub rows: Vec<ComparedRow>,
}

/// The shares of both sweeps under one fault at one level in one medium.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparedRow {
    /// Name of the axis.
    pub fault: String,
    /// Level of the fault, in the unit of the axis.
    pub level: f64,
    /// Medium of the runs.
    pub media: Media,
    /// Share of this sweep's runs still hopping.
    pub share: f64,
    /// Share of the other sweep's runs still hopping.
    pub other: f64,
    /// This share less the other.
    pub difference: f64,
    /// Newcombe's 95 % interval of the difference.
    pub interval: [f64; 2],
    /// True if both have the same starts and the interval is that of pairs.
    pub is_paired: bool,
}

/// Why two sweeps cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// The other sweep counts other runs as still hopping.
    #[error("it counts runs that hop on after {theirs} hops, and this one after {ours}")]
    Hops {
        /// Hops of this sweep.
        ours: u32,
        /// Hops of the other.
        theirs: u32,
    },
    /// A row of the other sweep contradicts itself.
    #[error(
        "its row {fault}={level} in {media} has {hopping} of {runs} runs hopping, which the runs that fell do not match"
    )]
    Row {
        /// Name of the axis.
        fault: String,
        /// Level of the fault.
        level: String,
        /// Medium of the runs.
        media: &'static str,
        /// Number of runs still hopping.
        hopping: u64,
        /// Number of runs.
        runs: u64,
    },
    /// The sweeps have no row in common.
    #[error("it has no fault, level and medium in common with this sweep")]
    NothingInCommon,
}

impl Comparison {
    /// Compares a sweep with another.
    ///
    /// # Errors
    /// [`CompareError`] if the other sweep is another measurement, or contradicts itself.
    pub fn new(ours: &Report, other: &Report) -> Result<Self, CompareError> {
        if ours.hops != other.hops {
            return Err(CompareError::Hops { ours: ours.hops, theirs: other.hops });
        }
        let mut rows = Vec::new();
        for row in &ours.rows {
            let Some(theirs) = other.rows.iter().find(|theirs| theirs.is_of_the_same_case(row))
            else {
                continue;
            };
            if !theirs.is_consistent() {
                return Err(CompareError::Row {
                    fault: theirs.fault.to_string(),
                    level: theirs.level.to_string(),
                    media: theirs.media.name(),
                    hopping: theirs.hopping,
                    runs: theirs.runs,
                });
            }
            rows.push(ComparedRow::new(row, theirs));
        }
        if rows.is_empty() {
            return Err(CompareError::NothingInCommon);
        }
        Ok(Self { policy: other.policy.clone(), rows })
    }

    /// Returns the row of the same fault, level and medium.
    pub(super) fn row(&self, of: &Row) -> Option<&ComparedRow> {
        let is_same = |row: &&ComparedRow| {
            row.fault == of.fault && row.level == of.level && row.media == of.media
        };
        self.rows.iter().find(is_same)
    }
}

impl ComparedRow {
    fn new(row: &Row, other: &Row) -> Self {
        let pairs = pairs(row, other);
        let interval = match pairs {
            Some(pairs) => pairs.difference(),
            None => unpaired_difference([row.hopping, row.runs], [other.hopping, other.runs]),
        };
        Self {
            fault: row.fault.to_string(),
            level: row.level,
            media: row.media,
            share: row.share(),
            other: other.share(),
            difference: row.share() - other.share(),
            interval,
            is_paired: pairs.is_some(),
        }
    }

    /// Returns true if the interval excludes 0.
    #[must_use]
    pub fn is_significant(&self) -> bool {
        self.interval[0] > 0.0 || self.interval[1] < 0.0
    }
}

/// Pairs the runs by their seeds; `None` if a report does not say which fell, or has other seeds.
fn pairs(row: &Row, other: &Row) -> Option<Pairs> {
    let (a, b) = (row.fallen.as_ref()?, other.fallen.as_ref()?);
    if row.runs != other.runs {
        return None;
    }
    let mut pairs = Pairs::default();
    for seed in 0..row.runs {
        let hops = |fallen: &[u64]| fallen.binary_search(&seed).is_err();
        let count = match (hops(a), hops(b)) {
            (true, true) => &mut pairs.both,
            (true, false) => &mut pairs.only_first,
            (false, true) => &mut pairs.only_second,
            (false, false) => &mut pairs.neither,
        };
        *count += 1;
    }
    Some(pairs)
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "Against policy `{}`, where the shares differ", self.policy)?;
        let differing: Vec<_> = self.rows.iter().filter(|row| row.difference != 0.0).collect();
        if !differing.is_empty() {
            writeln!(
                f,
                "\n  {:<19}{:>8}  {:<8}{:>8}{:>10}{:>12}   95 % interval",
                "fault", "level", "medium", "this", "other", "difference"
            )?;
        }
        for row in differing {
            let percent = |share: f64| 100.0 * share;
            let [low, high] = row.interval.map(percent);
            let mark = if row.is_significant() { "  *" } else { "" };
            writeln!(
                f,
                "  {:<19}{:>8}  {:<8}{:>6.0} %{:>8.0} %{:>+10.0} %   {low:+.0} to {high:+.0} %{mark}",
                row.fault,
                row.level,
                row.media.name(),
                percent(row.share),
                percent(row.other),
                percent(row.difference),
            )?;
        }
        let equal = self.rows.iter().filter(|row| row.difference == 0.0).count();
        let paired = if self.rows.iter().all(|row| row.is_paired) {
            "of the same starts, in pairs"
        } else {
            "not all of the same starts: the intervals are those of unrelated runs"
        };
        writeln!(f, "\n  {equal} of {} shares are equal; runs {paired};", self.rows.len())?;
        write!(f, "  * the interval excludes 0, which one in twenty does by chance")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(policy: &str, fallen: Option<Vec<u64>>, hopping: u64) -> Report {
        let row =
            Row { fault: "drop".into(), level: 0.3, media: Media::Land, runs: 10, hopping, fallen };
        Report { policy: policy.to_owned(), hops: 30, runs: 10, rows: vec![row], against: None }
    }

    #[test]
    fn runs_of_the_same_starts_are_compared_in_pairs() {
        let ours = report("a", Some(vec![3]), 9);
        let theirs = report("b", Some(vec![1, 3, 4]), 7);
        let compared = Comparison::new(&ours, &theirs).unwrap();
        let [row] = &compared.rows[..] else { panic!("{compared:?}") };
        let pairs = Pairs { both: 7, only_first: 2, only_second: 0, neither: 1 };
        assert_eq!(row.interval, pairs.difference());
        assert!(row.is_paired && (row.difference - 0.2).abs() < 1e-12 && !row.is_significant());
        let text = compared.to_string();
        assert!(text.contains("Against policy `b`") && text.contains("+20 %"), "{text}");
        assert!(text.contains("0 of 1 shares are equal"), "{text}");
        // A report of a build that did not name the runs that fell.
        let old = report("b", None, 7);
        let compared = Comparison::new(&ours, &old).unwrap();
        assert_eq!(compared.rows[0].interval, unpaired_difference([9, 10], [7, 10]));
        assert!(!compared.rows[0].is_paired && compared.to_string().contains("unrelated runs"));
        let same = Comparison::new(&ours, &ours).unwrap();
        assert!(same.to_string().contains("1 of 1 shares are equal"), "{same}");
    }

    #[test]
    fn refuses_another_measurement_and_a_report_that_contradicts_itself() {
        let ours = report("a", Some(vec![3]), 9);
        let hops = Report { hops: 300, ..ours.clone() };
        assert_eq!(
            Comparison::new(&ours, &hops),
            Err(CompareError::Hops { ours: 30, theirs: 300 })
        );
        let nothing = Report { rows: Vec::new(), ..ours.clone() };
        assert_eq!(Comparison::new(&ours, &nothing), Err(CompareError::NothingInCommon));
        for (fallen, hopping) in
            [(Some(vec![3]), 8), (Some(vec![3, 3]), 8), (Some(vec![10]), 9), (None, 11)]
        {
            let wrong = report("b", fallen, hopping);
            let refused = Comparison::new(&ours, &wrong).unwrap_err().to_string();
            assert!(refused.contains("row drop=0.3 in land"), "{refused}");
        }
    }
}
