//! The result of the sweep, as a table, CSV and JSON.

use std::fmt::{self, Write as _};

use serde::Serialize;

use super::axes::{AXES, Axis, Media};

/// The result of the sweep. Its JSON form has these fields.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Name of the policy.
    pub policy: String,
    /// Number of hops after which a leg counts as still hopping.
    pub hops: u32,
    /// Number of runs of each row.
    pub runs: u64,
    /// One row for each fault, level and medium.
    pub rows: Vec<Row>,
}

/// The runs under one fault at one level in one medium.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name of the axis.
    pub fault: &'static str,
    /// Level of the fault, in the unit of the axis.
    pub level: f64,
    /// Medium of the runs.
    pub media: Media,
    /// Number of runs.
    pub runs: u64,
    /// Number of runs that were still hopping at the end.
    pub hopping: u64,
}

impl Row {
    /// Returns the share of the runs still hopping, 0 to 1.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.hopping as f64 / self.runs.max(1) as f64
    }

    /// Returns true if the level is no fault.
    pub(super) fn is_none(&self) -> bool {
        AXES.iter().any(|axis| axis.name == self.fault && axis.none == self.level)
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
        let mut text = String::from("fault,level,medium,runs,hopping,share\n");
        for row in &self.rows {
            let Row { fault, level, media, runs, hopping } = row;
            let (medium, share) = (media.name(), row.share());
            // Writing to a string does not fail.
            let _ = writeln!(text, "{fault},{level},{medium},{runs},{hopping},{share}");
        }
        text
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { policy, hops, runs, .. } = self;
        writeln!(f, "Share of {runs} runs still hopping after {hops} hops, policy `{policy}`")?;
        for axis in &AXES {
            write!(f, "\n  {:<10}", axis.name)?;
            axis.levels.iter().try_for_each(|level| write!(f, "{level:>8}"))?;
            writeln!(f, "   {}", axis.unit)?;
            for media in self.media() {
                write!(f, "    {:<8}", media.name())?;
                for row in self.line(axis, media) {
                    write!(f, "{:>6.0} %", 100.0 * row.share())?;
                }
                writeln!(f)?;
            }
        }
        Ok(())
    }
}
