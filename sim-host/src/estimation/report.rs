//! The result of the study, as a table and as JSON.

use std::fmt;

use serde::Serialize;

use super::cases::Case;
use super::run::Played;
use crate::robustness::Media;
use crate::statistics::{mean_square_bounds, wilson};

/// The result of the study. Its JSON form has these fields.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Name of the policy.
    pub policy: String,
    /// Whether the control law had an estimator.
    pub estimated: bool,
    /// Number of runs of each row.
    pub runs: u64,
    /// One row for each case and medium.
    pub rows: Vec<Row>,
}

/// The runs of one case in one medium.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name of the case.
    pub case: &'static str,
    /// Medium of the runs.
    pub media: Media,
    /// Apexes after which a leg counts as still hopping.
    pub hops: u32,
    /// Number of runs.
    pub runs: u64,
    /// Number of runs that were still hopping at the end.
    pub hopping: u64,
    /// Wilson's 95 % interval of the share.
    pub interval: [f64; 2],
    /// Least share that is expected with the estimator.
    pub goal: f64,
    /// Apexes in all runs.
    pub apexes: u64,
    /// Apexes for which there was another number of decisions than one.
    pub miscounted: u64,
    /// Mean distance of the velocity at the apex from the set-point, m/s.
    pub tracking_m_s: f64,
    /// Root mean square of the error at the apex: velocity, m/s, height, m, density ratio.
    pub rms: [f64; 3],
    /// Mean square of the innovations of the vertical velocity in flight, in standard
    /// deviations.
    pub innovations_squared: f64,
    /// Mean square of the errors of vx, y, vy and density in flight, in standard deviations.
    pub errors_squared: [f64; 4],
    /// Mean of the same over the runs at the apex in the middle of each, and their number.
    pub middle_errors_squared: [f64; 4],
    /// Number of runs with an estimate at that apex.
    pub middle_runs: u64,
}

impl Row {
    pub(super) fn of(case: &Case, media: Media, played: &[Played]) -> Self {
        let sum = |of: &dyn Fn(&Played) -> f64| played.iter().map(of).sum::<f64>();
        let mean = |total: f64, count: f64| if count > 0.0 { total / count } else { 0.0 };
        let hopping = played.iter().filter(|run| run.apexes >= case.hops).count() as u64;
        let errors = sum(&|run| run.errors.len() as f64);
        let square = |i: usize| sum(&|run| run.errors.iter().map(|e| e[i] * e[i]).sum());
        let ticks = sum(&|run| run.innovations[1]);
        let middle_runs = played.iter().filter(|run| run.middle.is_some()).count() as u64;
        Self {
            case: case.name,
            media,
            hops: case.hops,
            runs: played.len() as u64,
            hopping,
            interval: wilson(hopping, played.len() as u64),
            goal: case.goal,
            apexes: played.iter().map(|run| u64::from(run.apexes)).sum(),
            miscounted: played.iter().map(|run| u64::from(run.miscounted)).sum(),
            tracking_m_s: mean(
                sum(&|run| run.tracking_m_s.iter().sum()),
                sum(&|run| run.tracking_m_s.len() as f64),
            ),
            rms: [0, 1, 2].map(|i| mean(square(i), errors).sqrt()),
            innovations_squared: mean(sum(&|run| run.innovations[0]), ticks),
            errors_squared: [0, 1, 2, 3]
                .map(|i: usize| mean(sum(&|run| run.errors_squared[i]), ticks)),
            middle_errors_squared: [0, 1, 2, 3].map(|i: usize| {
                mean(sum(&|run| run.middle.map_or(0.0, |squares| squares[i])), middle_runs as f64)
            }),
            middle_runs,
        }
    }

    /// Returns the share of the runs still hopping, 0 to 1.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.hopping as f64 / self.runs.max(1) as f64
    }

    /// Returns whether the share is the expected one.
    #[must_use]
    pub fn reaches_its_goal(&self) -> bool {
        self.share() >= self.goal
    }
}

impl Report {
    /// Writes how far the errors agree with their variances: by one apex of each run, for the
    /// errors of a run depend on each other.
    fn write_consistency(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let measured: Vec<&Row> = self.rows.iter().filter(|row| row.middle_runs >= 10).collect();
        if measured.is_empty() {
            return Ok(());
        }
        writeln!(
            f,
            "\nConsistency: mean over the runs of the squared error over its variance, at the apex in \
             the middle of\neach run. +: above the 95 % bounds, too sure of itself; -: below them, more \
             careful than it need be.\n\n  {:<19}{:<7}{:>7}{:>8}{:>8}{:>9}   95 % bounds",
            "case", "medium", "vx", "y", "vy", "density"
        )?;
        for row in measured {
            let [low, high] = mean_square_bounds(row.middle_runs);
            let [vx, y, vy, density] = row.middle_errors_squared.map(|mean| {
                let mark = if mean > high {
                    "+"
                } else if mean < low {
                    "-"
                } else {
                    " "
                };
                format!("{mean:.2}{mark}")
            });
            writeln!(
                f,
                "  {:<19}{:<7}{vx:>7}{y:>8}{vy:>8}{density:>9}   {low:.2} to {high:.2}",
                row.case,
                row.media.name()
            )?;
        }
        Ok(())
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { policy, runs, estimated, .. } = self;
        let by = if *estimated { "by the estimate" } else { "by the readings" };
        writeln!(f, "{runs} runs of each case, 0.5 m/s, policy `{policy}`, {by}\n")?;
        writeln!(
            f,
            "  {:<19}{:<7}{:>5}{:>9}  {:<15}{:>6}{:>6}{:>8}   {:<24}{:>5}   nees: vx, y, vy, density",
            "case",
            "medium",
            "hops",
            "hopping",
            "95 % interval",
            "goal",
            "not 1",
            "|error|",
            "rms: vx, y, density",
            "nis"
        )?;
        for row in &self.rows {
            let missed = if row.reaches_its_goal() { "" } else { "  below its goal" };
            let [low, high] = row.interval;
            let [vx, y, density] = row.rms;
            writeln!(
                f,
                "  {:<19}{:<7}{:>5}{:>7.1} %  {:<15}{:>6}{:>6}{:>8.4}   {:<24}{:>5.2}   {}{missed}",
                row.case,
                row.media.name(),
                row.hops,
                100.0 * row.share(),
                format!("{:.1} to {:.1} %", 100.0 * low, 100.0 * high),
                row.goal,
                row.miscounted,
                row.tracking_m_s,
                format!("{vx:.4}  {y:.4}  {density:.4}"),
                row.innovations_squared,
                row.errors_squared.map(|nees| format!("{nees:.2}")).join("  "),
            )?;
        }
        writeln!(
            f,
            "\n  not 1: apexes without exactly one decision; |error|: mean distance of the velocity at\n  \
             the apex from the set-point, m/s; rms: errors at the apex, m/s, m; nis: mean square of\n  \
             the innovations along y in flight in standard deviations, 1 for a consistent filter; nees:\n  \
             the same of the errors of the estimate; both 0 where samples come late: not measured"
        )?;
        self.write_consistency(f)
    }
}
