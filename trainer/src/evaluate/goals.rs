//! The goals of a policy for every density, and whether a report reaches them.
//!
//! The limits are this project's. For comparison each goal also states the value of the
//! agent published with "Learning to stop" (doi 10.5281/zenodo.4607469) where it was
//! measured here (`trainer/tests/authors.rs`).

use super::DENSITIES;
use super::conditions::{Change, Condition};
use super::metric::{Better, Metric};
use super::report::{Report, number};
use std::fmt;

/// A limit that a metric should reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// The metric.
    pub metric: Metric,
    /// Limit for the median of many seeds and for a policy that is to be shipped: a lower
    /// or an upper one, as [`Metric::better`] has it.
    pub limit: f64,
    /// Limit for the worst seed, where there is one.
    pub worst: Option<f64>,
    /// Value of the published agent, where it was measured.
    pub authors: Option<f64>,
}

impl Goal {
    /// Whether a value of the metric reaches the goal; `None` does not.
    #[must_use]
    pub fn reached(&self, value: Option<f64>) -> bool {
        self.within(self.limit, value)
    }

    /// Whether the worst seed's value reaches its limit; `true` where there is none.
    #[must_use]
    pub fn worst_reached(&self, value: Option<f64>) -> bool {
        self.worst.is_none_or(|limit| self.within(limit, value))
    }

    fn within(&self, limit: f64, value: Option<f64>) -> bool {
        value.is_some_and(|value| match self.metric.better() {
            Better::High => value >= limit,
            Better::Low => value <= limit,
        })
    }

    /// Returns the limit as text, such as `>= 0.998`.
    #[must_use]
    pub fn text(&self) -> String {
        let sign = match self.metric.better() {
            Better::High => ">=",
            Better::Low => "<=",
        };
        format!("{sign} {}", self.limit)
    }
}

/// Returns the goals of a policy for every density, such as the preset `robust` trains.
#[must_use]
pub fn robust() -> Vec<Goal> {
    let goal = |metric, limit| Goal { metric, limit, worst: None, authors: None };
    let beside = |metric, limit, authors| Goal { authors: Some(authors), ..goal(metric, limit) };
    let authors = |rho| match rho {
        0.0 => (Some(0.906), Some(0.181)),
        0.05 => (Some(0.999), Some(0.162)),
        0.1 => (Some(1.0), Some(0.177)),
        0.5 => (Some(0.989), Some(0.148)),
        1.0 => (Some(0.993), Some(0.036)),
        _ => (None, None),
    };
    let stiffness = Metric::Survive30In(Condition::on_land(Change::Stiffness(10_000.0)));
    let mass = Metric::Survive30In(Condition::on_land(Change::Mass(120.0)));
    let mut goals = Vec::new();
    // About 0.9995 is the most: from some starts no action prevents a fall.
    goals.extend(DENSITIES.map(|rho| Goal {
        worst: Some(0.995),
        authors: authors(rho).0,
        ..goal(Metric::Survive30(rho), 0.998)
    }));
    goals.extend(
        DENSITIES
            .map(|rho| Goal { authors: authors(rho).1, ..goal(Metric::AbsVMedian(rho), 0.01) }),
    );
    goals.extend([
        // The published agent with gains that were tuned for it.
        beside(Metric::Tracked, 41.0, 12.0),
        goal(Metric::Falls, 0.0),
        beside(Metric::MaxSpeed(0.0), 15.0, 5.98),
        beside(stiffness, 0.85, 0.39),
        beside(mass, 0.95, 0.70),
    ]);
    goals
}

/// How a report compares with the goals. `Display` prints what is missed.
#[derive(Clone, Debug, PartialEq)]
pub struct Assessment {
    /// Number of goals.
    pub goals: usize,
    /// Goals that are missed, with the report's values.
    pub missed: Vec<(Goal, Option<f64>)>,
}

/// Compares a report with the goals of a policy for every density.
#[must_use]
pub fn assess(report: &Report) -> Assessment {
    let goals = robust();
    let values = goals.iter().map(|goal| (*goal, goal.metric.of(report)));
    let missed = values.filter(|(goal, value)| !goal.reached(*value)).collect();
    Assessment { goals: goals.len(), missed }
}

impl fmt::Display for Assessment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reached = self.goals - self.missed.len();
        write!(f, "Goals of a policy for every density: {reached} of {} reached.", self.goals)?;
        for (goal, value) in &self.missed {
            let value = number(*value, goal.metric.digits());
            write!(f, "\n  missed: {} is {value}, goal {}", goal.metric, goal.text())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{Goal, assess, robust};
    use crate::evaluate::metric::Metric;
    use crate::evaluate::report::Report;
    use leg_control::policy::{Policy, SHIPPED};

    #[test]
    fn every_goal_is_assessed_by_a_metric_of_the_report() {
        let report = Report::new(&Policy::parse(SHIPPED).unwrap(), 50, 1);
        for metric in Metric::all() {
            // No start survives on the softest spring, so it has no median speed.
            let none = metric.key() == "abs_v_median_k_5000";
            assert_eq!(metric.of(&report).is_none(), none, "{metric}");
        }
        let goals = robust();
        assert_eq!(goals.len(), 21);
        assert!(goals.iter().all(|goal| Metric::all().contains(&goal.metric)));
        let assessment = assess(&report);
        assert_eq!(assessment.goals, goals.len());
        assert!(assessment.missed.len() < goals.len(), "{assessment}");
        let empty = Report { survival: vec![], tracking: vec![], ..report };
        assert!(assess(&empty).missed.contains(&(goals[0], None)));
    }

    #[test]
    fn a_limit_is_inclusive_and_follows_the_direction_of_its_metric() {
        let goal = |metric| Goal { metric, limit: 0.5, worst: Some(0.25), authors: None };
        let high = goal(Metric::Survive30(0.0));
        assert!(high.reached(Some(0.5)) && !high.reached(Some(0.4999)));
        assert!(high.worst_reached(Some(0.25)) && !high.worst_reached(None));
        let low = goal(Metric::AbsVMedian(0.0));
        assert!(low.reached(Some(0.5)) && !low.reached(Some(0.5001)) && !low.reached(None));
        assert_eq!((high.text().as_str(), low.text().as_str()), (">= 0.5", "<= 0.5"));
    }
}
