//! The summary as a table for the terminal.

use super::list;
use super::summary::{Row, Summary};
use crate::config::Length;
use crate::evaluate::metric::Metric;
use std::fmt;

/// Number of missed goals that are named for the worst seed.
const MOST_NAMED: usize = 5;

/// Returns the heading of the group of rows that a metric belongs to.
fn heading(metric: Metric) -> &'static str {
    match metric {
        Metric::Survive30(_) => "still hopping after 30 hops, by density",
        Metric::AbsVMedian(_) | Metric::AbsVMedianIn(_) => "median |v| then, m/s",
        Metric::Tracked | Metric::Falls => "of the 42 set-points with a steady gait",
        Metric::MaxSpeed(_) => "highest speed, m/s",
        Metric::Survive30In(_) => "still hopping, on land with another leg or gravity",
    }
}

fn label(metric: Metric) -> String {
    match metric {
        Metric::Survive30(rho) | Metric::AbsVMedian(rho) | Metric::MaxSpeed(rho) => {
            format!("rho {rho}")
        }
        Metric::Tracked => "tracked".into(),
        Metric::Falls => "fell".into(),
        Metric::Survive30In(condition) | Metric::AbsVMedianIn(condition) => {
            condition.change.to_string()
        }
    }
}

impl Row {
    fn number(&self, value: Option<f64>) -> String {
        let digits = self.metric.digits();
        value.map_or_else(|| "-".into(), |value| format!("{value:.digits$}"))
    }
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let metrics = [self.median, self.worse_quartile, self.better_quartile, self.worst.0]
            .map(|value| self.number(value));
        let [median, worse, better, worst] = metrics;
        write!(
            f,
            "  {:<12}  {median:>9}  {worse:>9} {better:>9}  {worst:>9} {:>7}",
            label(self.metric),
            format!("({})", self.worst.1),
        )?;
        if let (Some(goal), Some(reached), Some(met)) = (self.goal, self.reached, self.met()) {
            let met = if met { "met" } else { "MISSED" };
            write!(f, "  {:<8}  {:>5.0} %  {met}", goal.text(), 100.0 * reached)?;
        }
        Ok(())
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (plan, count) = (&self.plan, self.seeds.len());
        let length: Vec<String> = plan
            .config
            .stages
            .iter()
            .map(|stage| match stage.length {
                Length::Steps(n) => format!("{n} steps"),
                Length::Episodes(n) => format!("{n} episodes"),
            })
            .collect();
        writeln!(
            f,
            "{}: seeds {}, {} each, evaluated from {} unseen starts\n",
            plan.config.preset,
            plan.seeds,
            length.join(" + "),
            plan.eval_starts
        )?;
        writeln!(
            f,
            "                   median      quartiles, worse first   worst  (seed)  goal      reached"
        )?;
        let mut last = None;
        for row in &self.rows {
            let heading = heading(row.metric);
            if last != Some(heading) {
                writeln!(f, "{heading}")?;
                last = Some(heading);
            }
            writeln!(f, "{row}")?;
        }
        let goals = self.rows.iter().filter_map(Row::met);
        let (met, all) = (goals.clone().filter(|&met| met).count(), goals.count());
        let perfect = self.seeds.iter().filter(|s| self.missed(s).next().is_none()).count();
        writeln!(
            f,
            "\nGoals met by the median, and by the worst seed where asked: {met} of {all}."
        )?;
        write!(f, "Seeds that reach every goal: {perfect} of {count}.")?;
        let failed: Vec<u64> =
            self.seeds.iter().filter(|s| s.failure.is_some()).map(|s| s.seed).collect();
        if !failed.is_empty() {
            write!(
                f,
                "\nSeeds that left no policy, counted as missing every goal: {}.",
                list(&failed)
            )?;
        }
        if let Some(best) = self.best() {
            let missed = self.missed(best).count();
            write!(f, "\nBest seed: {}, which misses {missed} of {all} goals.", best.seed)?;
        }
        if let Some(worst) = self.worst() {
            let missed: Vec<String> = self.missed(worst).map(|g| g.metric.to_string()).collect();
            let shown = missed.iter().take(MOST_NAMED).cloned().collect::<Vec<_>>().join("; ");
            let more = if missed.len() > MOST_NAMED { "; and more" } else { "" };
            write!(f, "\nWorst seed: {}, ", worst.seed)?;
            match (&worst.failure, missed.len()) {
                (Some(why), _) => write!(f, "which left no policy: {why}.")?,
                (None, 0) => write!(f, "which reaches every goal, too.")?,
                (None, n) => write!(f, "which misses {n}: {shown}{more}.")?,
            }
        }
        Ok(())
    }
}
