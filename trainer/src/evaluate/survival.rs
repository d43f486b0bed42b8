//! From random starts: how many keep hopping, and how well they stop.

use super::hop;
use crate::environment::{LOWEST_APEX_M, draw_start};
use leg_control::actor::Actor;
use leg_plant::{Apex, Hopper};
use rand::Rng;
use rayon::prelude::*;

/// Hops that a start must survive.
pub const HOPS: u32 = 30;
/// Steps whose rewards are added up, as in the paper's episodes.
pub const REWARDED: u32 = 5;
/// Spread of the paper's starts, m/s and m.
const SPREAD: f64 = 3.0;

/// Starts as the paper draws them.
pub fn draw_starts(count: usize, rng: &mut impl Rng) -> Vec<Apex> {
    (0..count).map(|_| draw_start(SPREAD, rng)).collect()
}

/// What became of many starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Survival {
    /// Starts.
    pub starts: usize,
    /// Share still hopping, every apex at or above 1 m, after [`HOPS`] hops.
    pub survive30: f64,
    /// Of the survivors at their last apex: median |v|, m/s. `None` without survivors.
    pub abs_v_median: Option<f64>,
    /// The same, at 95 %.
    pub abs_v_p95: Option<f64>,
    /// Mean sum of log10(1 + 1 / |v|) over the first [`REWARDED`] steps.
    pub reward5: f64,
}

/// What became of one start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run {
    /// |v| at the last apex, m/s; `None` if it did not survive.
    pub last_abs_v: Option<f64>,
    /// Sum of log10(1 + 1 / |v|) over the first [`REWARDED`] steps.
    pub reward5: f64,
}

fn run(actor: &Actor<'_>, hopper: &Hopper, density_ratio: f64, start: Apex) -> Run {
    let mut apex = start;
    let mut reward5 = 0.0;
    for step in 0..HOPS {
        let Some(next) = hop(actor, hopper, density_ratio, apex, 0.0) else {
            return Run { last_abs_v: None, reward5 };
        };
        if step < REWARDED {
            reward5 += libm::log10(1.0 + 1.0 / next.vx_m_s.abs());
        }
        if next.y_m < LOWEST_APEX_M {
            return Run { last_abs_v: None, reward5 };
        }
        apex = next;
    }
    Run { last_abs_v: Some(apex.vx_m_s.abs()), reward5 }
}

/// What becomes of every start, in their order.
#[must_use]
pub fn runs(actor: &Actor<'_>, hopper: &Hopper, density_ratio: f64, starts: &[Apex]) -> Vec<Run> {
    starts
        .par_iter()
        .with_min_len(32)
        .map(|&start| run(actor, hopper, density_ratio, start))
        .collect()
}

/// Runs every start and sums up.
#[must_use]
pub fn survival(
    actor: &Actor<'_>,
    hopper: &Hopper,
    density_ratio: f64,
    starts: &[Apex],
) -> Survival {
    let runs = runs(actor, hopper, density_ratio, starts);
    let mut speeds: Vec<f64> = runs.iter().filter_map(|r| r.last_abs_v).collect();
    speeds.sort_by(f64::total_cmp);
    let count = starts.len().max(1) as f64;
    Survival {
        starts: starts.len(),
        survive30: speeds.len() as f64 / count,
        abs_v_median: quantile(&speeds, 0.5),
        abs_v_p95: quantile(&speeds, 0.95),
        reward5: runs.iter().map(|r| r.reward5).sum::<f64>() / count,
    }
}

/// The quantile of sorted numbers, linear between neighbours.
#[must_use]
pub fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let at = share * last as f64;
    let low = at.floor() as usize;
    let high = (low + 1).min(last);
    if at == low as f64 || sorted[low] == sorted[high] {
        // Also where a neighbour is infinite.
        return Some(sorted[low]);
    }
    Some(sorted[low] + (sorted[high] - sorted[low]) * (at - low as f64))
}

#[cfg(test)]
mod tests {
    use super::quantile;

    #[test]
    fn quantiles() {
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(quantile(&[3.0], 0.95), Some(3.0));
        assert_eq!(quantile(&[1.0, 2.0, 4.0], 0.5), Some(2.0));
        assert_eq!(quantile(&[1.0, 2.0], 0.25), Some(1.25));
        assert_eq!(quantile(&[1.0, 2.0, f64::INFINITY], 0.5), Some(2.0));
    }
}
