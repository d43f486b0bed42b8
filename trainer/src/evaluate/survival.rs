//! Survival: the share of random starts that keep hopping, and how well they stop.

use super::hop;
use crate::environment::{LOWEST_APEX_M, draw_start};
use leg_control::actor::Actor;
use leg_plant::{Apex, Hopper};
use rand::Rng;
use rayon::prelude::*;

/// Number of hops that a start must survive.
pub const HOPS: u32 = 30;
/// Number of steps whose rewards are summed, as in the paper's episodes.
pub const REWARDED: u32 = 5;
/// Spread of the paper's starts, m/s and m.
const SPREAD: f64 = 3.0;

/// Draws starts as the paper does.
pub fn draw_starts(count: usize, rng: &mut impl Rng) -> Vec<Apex> {
    (0..count).map(|_| draw_start(SPREAD, rng)).collect()
}

/// The outcome of many starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Survival {
    /// Number of starts.
    pub starts: usize,
    /// Share of starts with every apex at or above 1 m over [`HOPS`] hops.
    pub survive30: f64,
    /// Median |v| of the survivors at their last apex, m/s; `None` without survivors.
    pub abs_v_median: Option<f64>,
    /// 95 % quantile of |v| of the survivors at their last apex, m/s.
    pub abs_v_p95: Option<f64>,
    /// Mean over the starts of the sum of log10(1 + 1 / |v|) over the first [`REWARDED`]
    /// steps.
    pub reward5: f64,
}

/// The outcome of one start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rollout {
    /// |v| at the last apex, m/s; `None` if it did not survive.
    pub last_abs_v: Option<f64>,
    /// Sum of log10(1 + 1 / |v|) over the first [`REWARDED`] steps.
    pub reward5: f64,
}

/// Runs one start; `hop` returns the next apex, or `None` after a fall.
pub(super) fn rollout(start: Apex, mut hop: impl FnMut(Apex) -> Option<Apex>) -> Rollout {
    let mut apex = start;
    let mut reward5 = 0.0;
    for step in 0..HOPS {
        let Some(next) = hop(apex) else {
            return Rollout { last_abs_v: None, reward5 };
        };
        if step < REWARDED {
            reward5 += libm::log10(1.0 + 1.0 / next.vx_m_s.abs());
        }
        if next.y_m < LOWEST_APEX_M {
            return Rollout { last_abs_v: None, reward5 };
        }
        apex = next;
    }
    Rollout { last_abs_v: Some(apex.vx_m_s.abs()), reward5 }
}

/// Runs every start; returns the outcomes in the order of the starts.
#[must_use]
pub fn rollouts(
    actor: &Actor<'_>,
    hopper: &Hopper,
    density_ratio: f64,
    starts: &[Apex],
) -> Vec<Rollout> {
    starts
        .par_iter()
        .with_min_len(32)
        .map(|&start| rollout(start, |apex| hop(actor, hopper, density_ratio, apex, 0.0)))
        .collect()
}

/// Runs every start and summarises the outcomes.
#[must_use]
pub fn survival(
    actor: &Actor<'_>,
    hopper: &Hopper,
    density_ratio: f64,
    starts: &[Apex],
) -> Survival {
    summary(&rollouts(actor, hopper, density_ratio, starts))
}

/// Summarises the outcomes of starts.
pub(super) fn summary(rollouts: &[Rollout]) -> Survival {
    let mut speeds: Vec<f64> = rollouts.iter().filter_map(|r| r.last_abs_v).collect();
    speeds.sort_by(f64::total_cmp);
    let count = rollouts.len().max(1) as f64;
    Survival {
        starts: rollouts.len(),
        survive30: speeds.len() as f64 / count,
        abs_v_median: quantile(&speeds, 0.5),
        abs_v_p95: quantile(&speeds, 0.95),
        reward5: rollouts.iter().map(|r| r.reward5).sum::<f64>() / count,
    }
}

/// Returns the quantile of ascending numbers, linear between neighbours; `None` without
/// numbers. `share` is from 0 to 1.
#[must_use]
pub fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let at = share * last as f64;
    let low = at.floor() as usize;
    let high = (low + 1).min(last);
    if at == low as f64 || sorted[low] == sorted[high] {
        // Interpolation would give NaN beside an infinite neighbour.
        return Some(sorted[low]);
    }
    Some(sorted[low] + (sorted[high] - sorted[low]) * (at - low as f64))
}

#[cfg(test)]
mod tests {
    use super::quantile;

    #[test]
    fn quantiles_are_linear_between_neighbours_and_keep_infinity() {
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(quantile(&[3.0], 0.95), Some(3.0));
        assert_eq!(quantile(&[1.0, 2.0, 4.0], 0.5), Some(2.0));
        assert_eq!(quantile(&[1.0, 2.0], 0.25), Some(1.25));
        assert_eq!(quantile(&[1.0, 2.0, f64::INFINITY], 0.5), Some(2.0));
    }
}
