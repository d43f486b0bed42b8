//! The metrics of a report: each is one number.

use super::DENSITIES;
use super::conditions::{Change, Condition, Extent};
use super::report::Report;
use super::tracking::Tracking;
use std::fmt;

/// A metric of a report, and where it is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Metric {
    /// Share of starts that survive 30 hops at this density ratio.
    Survive30(f64),
    /// Median |v| of the survivors at this density ratio, m/s.
    AbsVMedian(f64),
    /// Set-points tracked, of the 42 with a known steady gait.
    Tracked,
    /// Set-points of the same 42 at which the leg fell.
    Falls,
    /// Highest speed at this density ratio, m/s.
    MaxSpeed(f64),
    /// Share of starts that survive 30 hops with another leg or gravity.
    Survive30In(Condition),
    /// Median |v| of the survivors with another leg or gravity, m/s.
    AbsVMedianIn(Condition),
}

impl Metric {
    /// Returns every metric of a report with [`Extent::Land`], in the order of its tables.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let by_density = |metric: fn(f64) -> Self| DENSITIES.map(metric);
        let conditions = Condition::all(Extent::Land);
        let mut all = by_density(Self::Survive30).to_vec();
        all.extend(by_density(Self::AbsVMedian));
        all.extend([Self::Tracked, Self::Falls]);
        all.extend(by_density(Self::MaxSpeed));
        all.extend(conditions.iter().copied().map(Self::Survive30In));
        all.extend(conditions.into_iter().map(Self::AbsVMedianIn));
        all
    }

    /// Returns the metric's value in a report; `None` where it has none, such as a speed
    /// without survivors or a condition that was not evaluated.
    #[must_use]
    pub fn of(&self, report: &Report) -> Option<f64> {
        let survival =
            |rho| report.survival.iter().find(|(at, _)| *at == rho).map(|(_, survival)| survival);
        let in_condition = |condition| {
            report.conditions.iter().find(|c| c.condition == condition).map(|c| &c.survival)
        };
        let possible = || report.tracking.iter().filter(|t| t.possible());
        let count = |f: fn(&Tracking) -> bool| Some(possible().filter(|t| f(t)).count() as f64);
        match *self {
            Self::Survive30(rho) => survival(rho).map(|s| s.survive30),
            Self::AbsVMedian(rho) => survival(rho).and_then(|s| s.abs_v_median),
            Self::Tracked => count(Tracking::tracked),
            Self::Falls => count(|t| t.fell),
            Self::MaxSpeed(rho) => report.max_speed.iter().find(|(at, _)| *at == rho).map(|x| x.1),
            Self::Survive30In(condition) => in_condition(condition).map(|s| s.survive30),
            Self::AbsVMedianIn(condition) => in_condition(condition).and_then(|s| s.abs_v_median),
        }
    }

    /// Returns the metric's name in CSV columns and JSON keys.
    #[must_use]
    pub fn key(&self) -> String {
        let suffix = |condition: &Condition| {
            let change = match condition.change {
                Change::Stiffness(k) => format!("k_{k}"),
                Change::Mass(m) => format!("m_{m}"),
                gravity @ Change::Gravity(_) => gravity.to_string(),
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
            Self::Survive30In(condition) => format!("survive30_{}", suffix(condition)),
            Self::AbsVMedianIn(condition) => format!("abs_v_median_{}", suffix(condition)),
        }
    }

    /// Returns the number of decimal places that tables print.
    #[must_use]
    pub fn digits(&self) -> usize {
        match self {
            Self::Survive30(_) | Self::Survive30In(_) => 4,
            Self::AbsVMedian(_) | Self::AbsVMedianIn(_) => 5,
            Self::MaxSpeed(_) => 2,
            // A median of counts may end in a half.
            Self::Tracked | Self::Falls => 1,
        }
    }

    /// Returns which values are better.
    #[must_use]
    pub fn better(&self) -> Better {
        match self {
            Self::AbsVMedian(_) | Self::AbsVMedianIn(_) | Self::Falls => Better::Low,
            _ => Better::High,
        }
    }

    /// Returns the unit; empty for shares and counts.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        match self {
            Self::AbsVMedian(_) | Self::AbsVMedianIn(_) | Self::MaxSpeed(_) => "m/s",
            _ => "",
        }
    }
}

/// The metric's name in tables.
impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let suffix = |condition: &Condition| match condition.rho {
            0.0 => condition.change.to_string(),
            rho => format!("{}, rho {rho}", condition.change),
        };
        match self {
            Self::Survive30(rho) => write!(f, "survive30, rho {rho}"),
            Self::AbsVMedian(rho) => write!(f, "median |v|, rho {rho}"),
            Self::Tracked => write!(f, "tracked of 42"),
            Self::Falls => write!(f, "falls of 42"),
            Self::MaxSpeed(rho) => write!(f, "top speed, rho {rho}"),
            Self::Survive30In(condition) => write!(f, "survive30, {}", suffix(condition)),
            Self::AbsVMedianIn(condition) => write!(f, "median |v|, {}", suffix(condition)),
        }
    }
}

/// The direction in which a metric improves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    /// Higher values are better.
    High,
    /// Lower values are better.
    Low,
}
