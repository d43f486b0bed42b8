//! The result of the sweep, as a table, CSV and JSON.

use std::borrow::Cow;
use std::fmt::{self, Write as _};

use serde::{Deserialize, Serialize};

use super::axes::{AXES, Axis, Media};
use super::compare::Comparison;

/// The result of the sweep. Its JSON form has these fields.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Name of the policy.
    pub policy: String,
    /// Number of hops after which a leg counts as still hopping.
    pub hops: u32,
    /// Number of runs of each row.
    pub runs: u64,
    /// One row for each fault, level and medium.
    pub rows: Vec<Row>,
    /// Another sweep beside this one, if there is one.
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub against: Option<Comparison>,
}

/// The runs under one fault at one level in one medium.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the axis.
    pub fault: Cow<'static, str>,
    /// Level of the fault, in the unit of the axis.
    pub level: f64,
    /// Medium of the runs.
    pub media: Media,
    /// Number of runs.
    pub runs: u64,
    /// Number of runs that were still hopping at the end.
    pub hopping: u64,
    /// Seeds of the runs that fell, ascending from 0. Reports of earlier builds have none.
    #[serde(default)]
    pub fallen: Option<Vec<u64>>,
}

impl Row {
    /// Returns the share of the runs still hopping, 0 to 1.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.hopping as f64 / self.runs.max(1) as f64
    }

    /// Returns true if the level is no fault.
    pub(super) fn is_none(&self) -> bool {
        AXES.iter().any(|axis| axis.name == self.fault && axis.is_none(self.level))
    }

    /// Returns true if both rows have the same fault, level and medium.
    pub(super) fn is_of_the_same_case(&self, other: &Self) -> bool {
        (&self.fault, self.level, self.media) == (&other.fault, other.level, other.media)
    }

    /// Returns true if the counts of a row that was read agree with each other.
    pub(super) fn is_consistent(&self) -> bool {
        self.runs > 0
            && self.hopping <= self.runs
            && self.fallen.as_ref().is_none_or(|fallen| {
                let fell = self.runs - self.hopping;
                fallen.len() as u64 == fell
                    && fallen.is_sorted_by(|a, b| a < b)
                    && fallen.last().is_none_or(|&seed| seed < self.runs)
            })
    }
}

impl Report {
    /// Returns the media in the order of the sweep.
    pub(super) fn media(&self) -> Vec<Media> {
        let mut media: Vec<Media> = self.rows.iter().map(|row| row.media).collect();
        media.dedup();
        media
    }

    /// Returns the rows of one axis in one medium.
    pub(super) fn line(&self, axis: &Axis, media: Media) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(move |row| row.fault == axis.name && row.media == media)
    }

    /// Returns the rows as CSV.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = String::from("fault,level,medium,runs,hopping,share");
        text.push_str(if self.against.is_some() { ",other,difference,low,high\n" } else { "\n" });
        for row in &self.rows {
            let Row { fault, level, media, runs, hopping, .. } = row;
            let (medium, share) = (media.name(), row.share());
            // Writing to a string does not fail.
            let _ = write!(text, "{fault},{level},{medium},{runs},{hopping},{share}");
            match self.against.as_ref().map(|against| against.row(row)) {
                None => {}
                Some(None) => text.push_str(",,,,"),
                Some(Some(compared)) => {
                    let (other, difference) = (compared.other, compared.difference);
                    let [low, high] = compared.interval;
                    let _ = write!(text, ",{other},{difference},{low},{high}");
                }
            }
            text.push('\n');
        }
        text
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { policy, hops, runs, .. } = self;
        writeln!(f, "Share of {runs} runs still hopping after {hops} hops, policy `{policy}`")?;
        for axis in &AXES {
            write!(f, "\n  {:<19}", axis.name)?;
            axis.levels.iter().try_for_each(|level| write!(f, "{level:>8}"))?;
            writeln!(f, "   {}", axis.unit)?;
            for media in self.media() {
                write!(f, "    {:<17}", media.name())?;
                for row in self.line(axis, media) {
                    write!(f, "{:>6.0} %", 100.0 * row.share())?;
                }
                writeln!(f)?;
            }
        }
        self.against.iter().try_for_each(|against| write!(f, "\n{against}"))
    }
}
