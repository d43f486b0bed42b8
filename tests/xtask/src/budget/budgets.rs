//! The committed budgets, and the comparison of what was measured with them.

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::Path;

/// Growth over the committed value that still passes, percent.
const TOLERANCE_PERCENT: f64 = 2.0;

const HEADER: &str = "\
# Costs of the firmware. `cargo xtask budget` measures them anew and fails where one
# has grown by more than 2 % over `committed`, or over `at_most`;
# `cargo xtask budget --accept` writes what it measured into `committed`.

";

/// A measured value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Measured {
    /// The name, such as `inference`.
    pub(super) metric: String,
    /// The unit, such as `instructions`.
    pub(super) unit: &'static str,
    /// The value, in that unit.
    pub(super) value: u64,
}

/// A budget in the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    metric: String,
    unit: String,
    /// The value that was last accepted.
    committed: u64,
    /// The limit that no change may exceed, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    at_most: Option<u64>,
}

/// The file `budgets.toml`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Budgets {
    #[serde(default)]
    budget: Vec<Entry>,
}

/// A measured value and its budget.
struct Row<'a> {
    measured: &'a Measured,
    entry: Option<&'a Entry>,
}

impl Budgets {
    /// Reads the file.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("cannot read {}", path.display()))?;
        toml::from_str(&text).with_context(|| format!("{} is malformed", path.display()))
    }

    /// Writes a file with the measured values as budgets and the limits of this one.
    pub(super) fn accept(&self, measured: &[Measured], path: &Path) -> Result<()> {
        let accepted = |m: &Measured| Entry {
            metric: m.metric.clone(),
            unit: m.unit.to_owned(),
            committed: m.value,
            at_most: self.entry(m).and_then(|e| e.at_most),
        };
        let budgets = Self { budget: measured.iter().map(accepted).collect() };
        let text = HEADER.to_owned() + &toml::to_string(&budgets)?;
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Returns a table of the measured values beside their budgets.
    pub(super) fn table(&self, measured: &[Measured]) -> String {
        let rows: Vec<_> = self.rows(measured).map(|row| row.to_string()).collect();
        format!(
            "{:<34} {:<12} {:>9} {:>9} {:>8} {:>9}\n{}",
            "metric",
            "unit",
            "measured",
            "committed",
            "change",
            "at most",
            rows.join("\n")
        )
    }

    /// Fails if a value exceeds its budget, or if a value or a budget lacks the other.
    pub(super) fn check(&self, measured: &[Measured]) -> Result<()> {
        let mut errors: Vec<_> = self.rows(measured).filter_map(|row| row.error()).collect();
        let unmeasured = |e: &&Entry| !measured.iter().any(|m| e.is_of(m));
        for entry in self.budget.iter().filter(unmeasured) {
            errors.push(format!("{}, {}: in the file, but not measured", entry.metric, entry.unit));
        }
        if errors.is_empty() {
            return Ok(());
        }
        bail!(
            "{}\nMake it smaller, or accept it with `cargo xtask budget --accept` and give the reason in \
             the commit",
            errors.join("\n")
        )
    }

    fn rows<'a>(&'a self, measured: &'a [Measured]) -> impl Iterator<Item = Row<'a>> {
        measured.iter().map(|measured| Row { measured, entry: self.entry(measured) })
    }

    fn entry(&self, measured: &Measured) -> Option<&Entry> {
        self.budget.iter().find(|entry| entry.is_of(measured))
    }
}

impl Entry {
    fn is_of(&self, measured: &Measured) -> bool {
        self.metric == measured.metric && self.unit == measured.unit
    }
}

impl Row<'_> {
    fn change_percent(&self) -> Option<f64> {
        let committed = self.entry?.committed as f64;
        Some(100.0 * (self.measured.value as f64 - committed) / committed)
    }

    /// Returns why the value is not accepted, `None` if it is.
    fn error(&self) -> Option<String> {
        let Measured { metric, unit, value } = self.measured;
        let Some(entry) = self.entry else {
            return Some(format!("{metric}: {value} {unit}, and no budget for it"));
        };
        if let Some(most) = entry.at_most.filter(|most| value > most) {
            return Some(format!("{metric}: {value} {unit}, at most {most} are allowed"));
        }
        let change = self.change_percent().filter(|change| *change > TOLERANCE_PERCENT)?;
        Some(format!(
            "{metric}: {value} {unit}, {change:.1} % over {}; {TOLERANCE_PERCENT} % are allowed",
            entry.committed
        ))
    }
}

impl fmt::Display for Row<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Measured { metric, unit, value } = self.measured;
        let or_dash = |x: Option<u64>| x.map_or("-".to_owned(), |x| x.to_string());
        let committed = or_dash(self.entry.map(|e| e.committed));
        let change = self.change_percent().map_or("-".to_owned(), |c| format!("{c:+.1} %"));
        let most = or_dash(self.entry.and_then(|e| e.at_most));
        write!(f, "{metric:<34} {unit:<12} {value:>9} {committed:>9} {change:>8} {most:>9}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(value: u64) -> Measured {
        Measured { metric: "inference".to_owned(), unit: "instructions", value }
    }

    fn budgets(committed: u64, at_most: Option<u64>) -> Budgets {
        let (metric, unit) = ("inference".to_owned(), "instructions".to_owned());
        Budgets { budget: vec![Entry { metric, unit, committed, at_most }] }
    }

    #[test]
    fn growth_beyond_two_percent_or_the_goal_fails() {
        assert!(budgets(1000, None).check(&[measured(1020)]).is_ok());
        assert!(budgets(1000, None).check(&[measured(500)]).is_ok());
        let error = budgets(1000, None).check(&[measured(1021)]).unwrap_err().to_string();
        assert!(error.contains("inference: 1021 instructions, 2.1 % over 1000"), "{error}");
        let error = budgets(1000, Some(1005)).check(&[measured(1006)]).unwrap_err().to_string();
        assert!(error.contains("at most 1005"), "{error}");
    }

    #[test]
    fn a_value_without_a_budget_and_a_budget_without_a_value_fail() {
        let error = Budgets::default().check(&[measured(1)]).unwrap_err().to_string();
        assert!(error.contains("no budget for it"), "{error}");
        let error = budgets(1, None).check(&[]).unwrap_err().to_string();
        assert!(error.contains("not measured"), "{error}");
    }

    #[test]
    fn accepting_keeps_the_limits() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("budgets.toml");
        budgets(1000, Some(2000)).accept(&[measured(1500)], &path).unwrap();
        assert_eq!(Budgets::read(&path).unwrap(), budgets(1500, Some(2000)));
    }
}
