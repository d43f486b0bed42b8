//! What a policy for every density is to reach, as data.
//!
//! The limits are this project's. Beside them, for comparison, is what the agent
//! published with "Learning to stop" (doi 10.5281/zenodo.4607469) reaches where it
//! was measured here (`trainer/tests/authors.rs`).

use super::DENSITIES;
use super::conditions::{Change, Condition};
use super::report::Report;
use super::tracking::Tracking;
use std::fmt;

/// A figure of a report: one number, or none where it has no meaning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Figure {
    /// Share that survives 30 hops, at this density ratio.
    Survive30(f64),
    /// Median |v| of the survivors, m/s, at this density ratio.
    AbsVMedian(f64),
    /// Set-points tracked, of the 42 with a known steady gait.
    Tracked,
    /// Set-points, of the same, at which the leg fell.
    Falls,
    /// Highest speed, m/s, at this density ratio.
    MaxSpeed(f64),
    /// Share that survives 30 hops in another condition.
    Survive30In(Condition),
    /// Median |v| of the survivors, m/s, in another condition.
    AbsVMedianIn(Condition),
}

impl Figure {
    /// All that a report of everything [`Extent::Land`](super::conditions::Extent) has,
    /// in the order of its tables.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let by_density = |figure: fn(f64) -> Self| DENSITIES.map(figure);
        let conditions = Condition::all(super::conditions::Extent::Land);
        let mut all = by_density(Self::Survive30).to_vec();
        all.extend(by_density(Self::AbsVMedian));
        all.extend([Self::Tracked, Self::Falls]);
        all.extend(by_density(Self::MaxSpeed));
        all.extend(conditions.iter().copied().map(Self::Survive30In));
        all.extend(conditions.into_iter().map(Self::AbsVMedianIn));
        all
    }

    /// Its value in a report; `None` where there is none, such as a speed without
    /// survivors, or a condition that was not evaluated.
    #[must_use]
    pub fn of(&self, report: &Report) -> Option<f64> {
        let survival =
            |rho| report.survival.iter().find(|(at, _)| *at == rho).map(|(_, survival)| survival);
        let elsewhere = |condition| {
            report.elsewhere.iter().find(|e| e.condition == condition).map(|e| &e.survival)
        };
        let possible = || report.tracking.iter().filter(|t| t.possible());
        let count = |f: fn(&Tracking) -> bool| Some(possible().filter(|t| f(t)).count() as f64);
        match *self {
            Self::Survive30(rho) => survival(rho).map(|s| s.survive30),
            Self::AbsVMedian(rho) => survival(rho).and_then(|s| s.abs_v_median),
            Self::Tracked => count(Tracking::tracked),
            Self::Falls => count(|t| t.fell),
            Self::MaxSpeed(rho) => report.max_speed.iter().find(|(at, _)| *at == rho).map(|x| x.1),
            Self::Survive30In(condition) => elsewhere(condition).map(|s| s.survive30),
            Self::AbsVMedianIn(condition) => elsewhere(condition).and_then(|s| s.abs_v_median),
        }
    }

    /// As a column of a CSV file or a key names it.
    #[must_use]
    pub fn key(&self) -> String {
        let on = |condition: &Condition| {
            let change = match condition.change {
                Change::Stiffness(k) => format!("k_{k}"),
                Change::Mass(m) => format!("m_{m}"),
                world @ Change::Gravity(_) => world.to_string(),
            };
            match condition.rho {
                0.0 => change,
                rho => format!("{change}_rho_{rho}"),
            }
        };
        match self {
            Self::Survive30(rho) => format!("survive30_rho_{rho}"),
            Self::AbsVMedian(rho) => format!("abs_v_median_rho_{rho}"),
            Self::Tracked => "tracked".into(),
            Self::Falls => "falls".into(),
            Self::MaxSpeed(rho) => format!("max_speed_rho_{rho}"),
            Self::Survive30In(condition) => format!("survive30_{}", on(condition)),
            Self::AbsVMedianIn(condition) => format!("abs_v_median_{}", on(condition)),
        }
    }

    /// Digits after the point that mean something.
    #[must_use]
    pub fn digits(&self) -> usize {
        match self {
            Self::Survive30(_) | Self::Survive30In(_) => 4,
            Self::AbsVMedian(_) | Self::AbsVMedianIn(_) => 5,
            Self::MaxSpeed(_) => 2,
            // Halves, in medians.
            Self::Tracked | Self::Falls => 1,
        }
    }

    /// Whether more is better.
    #[must_use]
    pub fn better(&self) -> Better {
        match self {
            Self::AbsVMedian(_) | Self::AbsVMedianIn(_) | Self::Falls => Better::Low,
            _ => Better::High,
        }
    }

    /// The unit, empty for shares and counts.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        match self {
            Self::AbsVMedian(_) | Self::AbsVMedianIn(_) | Self::MaxSpeed(_) => "m/s",
            _ => "",
        }
    }
}

/// As tables and CSV columns name it.
impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let on = |condition: &Condition| match condition.rho {
            0.0 => condition.change.to_string(),
            rho => format!("{}, rho {rho}", condition.change),
        };
        match self {
            Self::Survive30(rho) => write!(f, "survive30, rho {rho}"),
            Self::AbsVMedian(rho) => write!(f, "median |v|, rho {rho}"),
            Self::Tracked => write!(f, "tracked of 42"),
            Self::Falls => write!(f, "falls of 42"),
            Self::MaxSpeed(rho) => write!(f, "top speed, rho {rho}"),
            Self::Survive30In(condition) => write!(f, "survive30, {}", on(condition)),
            Self::AbsVMedianIn(condition) => write!(f, "median |v|, {}", on(condition)),
        }
    }
}

/// Which way is up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    /// More is better.
    High,
    /// Less is better.
    Low,
}

/// What a figure is to reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Which.
    pub figure: Figure,
    /// By the median of many seeds, and by a policy that is to be shipped: at least
    /// or at most, as the figure has it.
    pub limit: f64,
    /// By the worst seed, where that is asked for.
    pub worst: Option<f64>,
    /// What the published agent reaches, where it was measured.
    pub authors: Option<f64>,
}

impl Goal {
    /// Whether a value of the figure reaches the goal; none does not.
    #[must_use]
    pub fn reached(&self, value: Option<f64>) -> bool {
        self.within(self.limit, value)
    }

    /// Whether the worst seed's value is good enough.
    #[must_use]
    pub fn worst_reached(&self, value: Option<f64>) -> bool {
        self.worst.is_none_or(|limit| self.within(limit, value))
    }

    fn within(&self, limit: f64, value: Option<f64>) -> bool {
        value.is_some_and(|value| match self.figure.better() {
            Better::High => value >= limit,
            Better::Low => value <= limit,
        })
    }

    /// The limit as text, such as `>= 0.998`.
    #[must_use]
    pub fn text(&self) -> String {
        let sign = match self.figure.better() {
            Better::High => ">=",
            Better::Low => "<=",
        };
        format!("{sign} {}", self.limit)
    }
}

/// The goals of a policy for every density, such as the preset `robust` makes.
#[must_use]
pub fn robust() -> Vec<Goal> {
    let goal = |figure, limit| Goal { figure, limit, worst: None, authors: None };
    let beside = |figure, limit, authors| Goal { authors: Some(authors), ..goal(figure, limit) };
    let authors = |rho| match rho {
        0.0 => (Some(0.906), Some(0.181)),
        0.05 => (Some(0.999), Some(0.162)),
        0.1 => (Some(1.0), Some(0.177)),
        0.5 => (Some(0.989), Some(0.148)),
        1.0 => (Some(0.993), Some(0.036)),
        _ => (None, None),
    };
    let stiffness = Figure::Survive30In(Condition::on_land(Change::Stiffness(10_000.0)));
    let mass = Figure::Survive30In(Condition::on_land(Change::Mass(120.0)));
    let mut goals = Vec::new();
    // About 0.9995 is the most: some starts nothing can catch.
    goals.extend(DENSITIES.map(|rho| Goal {
        worst: Some(0.995),
        authors: authors(rho).0,
        ..goal(Figure::Survive30(rho), 0.998)
    }));
    goals.extend(
        DENSITIES
            .map(|rho| Goal { authors: authors(rho).1, ..goal(Figure::AbsVMedian(rho), 0.01) }),
    );
    goals.extend([
        // With gains tuned for it.
        beside(Figure::Tracked, 41.0, 12.0),
        goal(Figure::Falls, 0.0),
        beside(Figure::MaxSpeed(0.0), 15.0, 5.98),
        beside(stiffness, 0.85, 0.39),
        beside(mass, 0.95, 0.70),
    ]);
    goals
}

/// How many of the goals a report reaches.
#[must_use]
pub fn reached(goals: &[Goal], report: &Report) -> usize {
    goals.iter().filter(|goal| goal.reached(goal.figure.of(report))).count()
}

#[cfg(test)]
mod tests {
    use super::{Figure, Goal, reached, robust};
    use crate::evaluate::report::Report;
    use leg_control::policy::{Policy, SHIPPED};

    #[test]
    fn goals_look_at_figures_of_a_report() {
        let report = Report::new(&Policy::parse(SHIPPED).unwrap(), 50, 1);
        for figure in Figure::all() {
            // No leg with so soft a spring is left to have a speed.
            let none = figure.key() == "abs_v_median_k_5000";
            assert_eq!(figure.of(&report).is_none(), none, "{figure}");
        }
        let goals = robust();
        assert_eq!(goals.len(), 21);
        assert!(goals.iter().all(|goal| Figure::all().contains(&goal.figure)));
        let count = reached(&goals, &report);
        assert!((1..=goals.len()).contains(&count), "{count}");
        let nothing = Report { survival: vec![], tracking: vec![], ..report };
        assert!(!goals[0].reached(goals[0].figure.of(&nothing)));
    }

    #[test]
    fn a_limit_is_reached_from_its_own_side() {
        let goal = |figure| Goal { figure, limit: 0.5, worst: Some(0.25), authors: None };
        let high = goal(Figure::Survive30(0.0));
        assert!(high.reached(Some(0.5)) && !high.reached(Some(0.4999)));
        assert!(high.worst_reached(Some(0.25)) && !high.worst_reached(None));
        let low = goal(Figure::AbsVMedian(0.0));
        assert!(low.reached(Some(0.5)) && !low.reached(Some(0.5001)) && !low.reached(None));
        assert_eq!((high.text().as_str(), low.text().as_str()), (">= 0.5", "<= 0.5"));
    }
}
