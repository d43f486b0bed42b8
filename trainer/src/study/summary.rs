//! The summary of a study over all seeds.

use super::StudyError;
use super::folder::{Folder, SeedReport};
use super::plan::Plan;
use crate::evaluate::goals::{Goal, robust};
use crate::evaluate::metric::{Better, Metric};
use crate::evaluate::survival::quantile;
use leg_process::atomic_file;
use serde::Serialize;

/// The summary of a complete study.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Plan of the study.
    pub plan: Plan,
    /// Results by ascending seed.
    pub seeds: Vec<SeedReport>,
    /// A row for each metric, in the order of [`Metric::all`].
    pub rows: Vec<Row>,
}

/// A metric over all seeds. A seed without a value counts as worse than all others.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The metric.
    pub metric: Metric,
    /// Goal of the metric, where there is one.
    pub goal: Option<Goal>,
    /// Median; `None` where it falls on a seed without a value, as for all values below.
    pub median: Option<f64>,
    /// Quartile towards the worst.
    pub worse_quartile: Option<f64>,
    /// Quartile towards the best.
    pub better_quartile: Option<f64>,
    /// Value and number of the worst seed; the first of equals.
    pub worst: (Option<f64>, u64),
    /// Value and number of the best seed; the first of equals.
    pub best: (Option<f64>, u64),
    /// Share of the seeds that reach the goal.
    pub reached: Option<f64>,
}

impl Row {
    /// Whether the median and the worst seed reach the goal; `None` without a goal.
    #[must_use]
    pub fn met(&self) -> Option<bool> {
        self.goal.map(|goal| goal.reached(self.median) && goal.worst_reached(self.worst.0))
    }

    fn new(metric: Metric, goals: &[Goal], seeds: &[SeedReport]) -> Self {
        let goal = goals.iter().copied().find(|goal| goal.metric == metric);
        // With this sign, lower values are worse.
        let sign = match metric.better() {
            Better::High => 1.0,
            Better::Low => -1.0,
        };
        let value = |seed: &SeedReport| seed.metric(metric).map_or(f64::NEG_INFINITY, |v| sign * v);
        let mut ranked: Vec<(f64, u64)> = seeds.iter().map(|s| (value(s), s.seed)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let sorted: Vec<f64> = ranked.iter().map(|(v, _)| *v).collect();
        // Adding 0 turns -0 into 0.
        let back = |v: f64| v.is_finite().then_some(sign * v + 0.0);
        let at = |share| quantile(&sorted, share).and_then(back);
        let first_of = |worth: f64| {
            let seed = ranked.iter().find(|(v, _)| *v == worth).map_or(0, |(_, seed)| *seed);
            (back(worth), seed)
        };
        let reached = goal.map(|goal| {
            let count = seeds.iter().filter(|s| goal.reached(s.metric(metric))).count();
            count as f64 / seeds.len() as f64
        });
        Self {
            metric,
            goal,
            median: at(0.5),
            worse_quartile: at(0.25),
            better_quartile: at(0.75),
            worst: first_of(sorted.first().copied().unwrap_or(f64::NEG_INFINITY)),
            best: first_of(sorted.last().copied().unwrap_or(f64::NEG_INFINITY)),
            reached,
        }
    }
}

#[derive(Serialize)]
struct CsvRow {
    metric: String,
    unit: &'static str,
    median: Option<f64>,
    worse_quartile: Option<f64>,
    better_quartile: Option<f64>,
    worst: Option<f64>,
    worst_seed: u64,
    best: Option<f64>,
    best_seed: u64,
    goal: Option<f64>,
    goal_of_worst: Option<f64>,
    share_that_reaches: Option<f64>,
    met: Option<bool>,
}

impl Summary {
    /// Summarises results by ascending seed, at least one.
    #[must_use]
    pub fn new(plan: Plan, seeds: Vec<SeedReport>) -> Self {
        let goals = robust();
        let rows = Metric::all().into_iter().map(|f| Row::new(f, &goals, &seeds)).collect();
        Self { plan, seeds, rows }
    }

    /// Returns the goals that a seed misses.
    pub fn missed(&self, seed: &SeedReport) -> impl Iterator<Item = Goal> {
        let goals = self.rows.iter().filter_map(|row| row.goal);
        goals.filter(|goal| !goal.reached(seed.metric(goal.metric)))
    }

    /// Returns the seed that misses the most goals; of equals the one that falls the most.
    #[must_use]
    pub fn worst(&self) -> Option<&SeedReport> {
        self.seeds.iter().min_by(|a, b| self.rank(a).total_cmp(&self.rank(b)))
    }

    /// Returns the seed that misses the fewest goals; of equals the one that falls the least.
    #[must_use]
    pub fn best(&self) -> Option<&SeedReport> {
        // Reversed, so that `max_by` returns the first of equals.
        self.seeds.iter().rev().max_by(|a, b| self.rank(a).total_cmp(&self.rank(b)))
    }

    /// Returns a rank that counts the goals that are reached, plus half the mean share of
    /// survivors.
    fn rank(&self, seed: &SeedReport) -> f64 {
        let survive: Vec<f64> = self
            .rows
            .iter()
            .filter(|row| matches!(row.metric, Metric::Survive30(_)))
            .map(|row| seed.metric(row.metric).unwrap_or(0.0))
            .collect();
        let mean = survive.iter().sum::<f64>() / survive.len().max(1) as f64;
        // A seed without a policy ranks below all others.
        let policy = if seed.failure.is_some() { -1.0 } else { 0.0 };
        policy + 0.5 * mean - self.missed(seed).count() as f64
    }

    fn summary_csv(&self) -> Result<Vec<u8>, csv::Error> {
        let mut table = csv::Writer::from_writer(Vec::new());
        for row in &self.rows {
            table.serialize(CsvRow {
                metric: row.metric.key(),
                unit: row.metric.unit(),
                median: row.median,
                worse_quartile: row.worse_quartile,
                better_quartile: row.better_quartile,
                worst: row.worst.0,
                worst_seed: row.worst.1,
                best: row.best.0,
                best_seed: row.best.1,
                goal: row.goal.map(|goal| goal.limit),
                goal_of_worst: row.goal.and_then(|goal| goal.worst),
                share_that_reaches: row.reached,
                met: row.met(),
            })?;
        }
        Ok(table.into_inner().expect("rows in memory"))
    }

    fn seeds_csv(&self) -> Result<Vec<u8>, csv::Error> {
        let mut table = csv::Writer::from_writer(Vec::new());
        let head = ["seed", "failure", "best_steps", "goals_missed"].map(String::from);
        let metrics = self.rows.iter().map(|row| row.metric.key());
        table.write_record(head.into_iter().chain(metrics))?;
        for seed in &self.seeds {
            let text = |x: Option<f64>| x.map_or_else(String::new, |x| x.to_string());
            let head = [
                seed.seed.to_string(),
                seed.failure.clone().unwrap_or_default(),
                seed.best_steps.map_or_else(String::new, |n| n.to_string()),
                self.missed(seed).count().to_string(),
            ];
            let metrics = self.rows.iter().map(|row| text(seed.metric(row.metric)));
            table.write_record(head.into_iter().chain(metrics))?;
        }
        Ok(table.into_inner().expect("rows in memory"))
    }

    /// Writes `summary.csv`, `seeds.csv` and the picture `svg` as `summary.svg` into a folder.
    ///
    /// # Errors
    /// [`StudyError::File`] when a file cannot be written.
    pub fn write(&self, folder: &Folder, svg: &str) -> Result<(), StudyError> {
        let table = |csv: Result<Vec<u8>, csv::Error>| csv.expect("rows in memory");
        for (name, content) in [
            ("summary.csv", table(self.summary_csv())),
            ("seeds.csv", table(self.seeds_csv())),
            ("summary.svg", svg.as_bytes().to_vec()),
        ] {
            let file = folder.path().join(name);
            atomic_file::write(&file, &content).map_err(StudyError::file(&file))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{Row, Summary};
    use crate::evaluate::goals::robust;
    use crate::evaluate::metric::Metric;
    use crate::preset::Preset;
    use crate::study::folder::SeedReport;
    use crate::study::plan::Plan;

    /// A seed with the same survival and stopping speed everywhere, and a number of tracked
    /// set-points.
    fn seed(seed: u64, survive30: f64, abs_v: Option<f64>, tracked: f64) -> SeedReport {
        let value = |metric: &Metric| match metric {
            Metric::Survive30(_) | Metric::Survive30In(_) => Some(survive30),
            Metric::AbsVMedian(_) | Metric::AbsVMedianIn(_) => abs_v,
            Metric::Tracked => Some(tracked),
            Metric::Falls => Some(0.0),
            Metric::MaxSpeed(_) => Some(16.0),
        };
        let metrics = Metric::all().iter().map(|f| (f.key(), value(f))).collect();
        let fingerprint = String::new();
        SeedReport { seed, fingerprint, failure: None, best_steps: None, metrics, evaluation: None }
    }

    fn summary() -> Summary {
        let plan = Plan::new(Preset::Robust.config(), "4..8".parse().unwrap(), 100, 1);
        let mut diverged = seed(6, 0.0, None, 0.0);
        diverged.metrics.clear();
        diverged.failure = Some("training diverged".into());
        let seeds = vec![
            seed(4, 0.999, Some(0.01), 41.0),
            seed(5, 0.998, Some(0.02), 42.0),
            diverged,
            seed(7, 1.0, None, 41.0),
        ];
        Summary::new(plan, seeds)
    }

    fn row(summary: &Summary, metric: Metric) -> &Row {
        summary.rows.iter().find(|row| row.metric == metric).unwrap()
    }

    #[test]
    fn a_seed_without_a_value_ranks_as_the_worst() {
        let summary = summary();
        let survive = row(&summary, Metric::Survive30(0.3));
        assert_eq!((survive.worst, survive.best), ((None, 6), (Some(1.0), 7)));
        assert_eq!(survive.median, Some(f64::midpoint(0.998, 0.999)));
        assert_eq!((survive.reached, survive.met()), (Some(0.75), Some(false)));
        let v = row(&summary, Metric::AbsVMedian(0.3));
        // The values are 0.01, 0.02, none and none.
        assert_eq!((v.worst, v.best, v.median), ((None, 6), (Some(0.01), 4), None));
        assert_eq!((v.better_quartile, v.reached), (Some(0.0175), Some(0.25)));
        let falls = row(&summary, Metric::Falls);
        assert_eq!((falls.median, falls.best), (Some(0.0), (Some(0.0), 4)));
        assert!(falls.median.unwrap().is_sign_positive());
    }

    #[test]
    fn the_worst_and_best_seeds_follow_from_the_goals_they_miss() {
        let summary = summary();
        assert_eq!(summary.worst().unwrap().seed, 6);
        assert_eq!(summary.best().unwrap().seed, 4);
        let missed: Vec<usize> =
            summary.seeds.iter().map(|seed| summary.missed(seed).count()).collect();
        assert_eq!(missed, [0, 8, robust().len(), 8]);
    }

    #[test]
    fn the_tables_have_a_row_for_each_metric_and_seed() {
        let summary = summary();
        let csv = String::from_utf8(summary.summary_csv().unwrap()).unwrap();
        assert_eq!(csv.lines().count(), 1 + Metric::all().len());
        let seeds = String::from_utf8(summary.seeds_csv().unwrap()).unwrap();
        assert_eq!(seeds.lines().count(), 5);
        assert!(seeds.contains("\n6,training diverged,,21,,,"), "{seeds}");
        let text = summary.to_string();
        assert!(text.contains("Worst seed: 6"), "{text}");
        assert!(text.contains("training diverged"), "{text}");
    }
}
