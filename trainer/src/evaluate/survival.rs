//! Survival: the share of random starts that keep hopping, and how well they stop.

use super::actions::act_all;
use crate::environment::{LOWEST_APEX_M, draw_start};
use leg_control::actor::Actor;
use leg_lanes::{Job, hops};
use leg_plant::{Apex, Hopper};
use leg_simd::Isa;
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

/// One start under way.
#[derive(Clone, Copy, Debug)]
struct Course {
    apex: Apex,
    hops: u32,
    rollout: Rollout,
}

impl Course {
    fn begun(start: Apex) -> Self {
        Self { apex: start, hops: 0, rollout: Rollout { last_abs_v: None, reward5: 0.0 } }
    }

    /// Goes on to the next apex, which is `None` after a fall; returns whether there is another
    /// hop.
    fn goes_on(&mut self, next: Option<Apex>) -> bool {
        let Some(next) = next else { return false };
        if self.hops < REWARDED {
            self.rollout.reward5 += libm::log10(1.0 + 1.0 / next.vx_m_s.abs());
        }
        if next.y_m < LOWEST_APEX_M {
            return false;
        }
        self.apex = next;
        self.hops += 1;
        if self.hops == HOPS {
            self.rollout.last_abs_v = Some(next.vx_m_s.abs());
        }
        self.hops < HOPS
    }
}

/// Runs one start; `hop` returns the next apex, or `None` after a fall.
pub(super) fn rollout(start: Apex, mut hop: impl FnMut(Apex) -> Option<Apex>) -> Rollout {
    let mut course = Course::begun(start);
    while course.goes_on(hop(course.apex)) {}
    course.rollout
}

/// Fewest and most starts that a thread runs side by side. Fewer would leave lanes idle at the
/// end of each hop, more would not fit the cache.
const TOGETHER: [usize; 2] = [32, 256];

/// Runs every start; returns the outcomes in the order of the starts.
#[must_use]
pub fn rollouts(
    actor: &Actor<'_>,
    hopper: &Hopper,
    density_ratio: f64,
    starts: &[Apex],
) -> Vec<Rollout> {
    let share = starts.len().div_ceil(rayon::current_num_threads());
    starts
        .par_chunks(share.clamp(TOGETHER[0], TOGETHER[1]))
        .flat_map_iter(|starts| side_by_side(Isa::best(), actor, hopper, density_ratio, starts))
        .collect()
}

/// Runs starts side by side, a hop of each at a time.
fn side_by_side(
    isa: Isa,
    actor: &Actor<'_>,
    hopper: &Hopper,
    density_ratio: f64,
    starts: &[Apex],
) -> Vec<Rollout> {
    let mut courses: Vec<Course> = starts.iter().map(|&start| Course::begun(start)).collect();
    let mut under_way: Vec<usize> = (0..starts.len()).collect();
    while !under_way.is_empty() {
        let apexes = under_way.iter().map(|&i| courses[i].apex);
        let shown = apexes.clone().map(|apex| [apex.vx_m_s, apex.y_m, density_ratio]);
        let actions = act_all(isa, actor, &shown.collect::<Vec<_>>());
        let jobs: Vec<Job<'_>> =
            apexes.zip(actions).map(|(start, action)| Job { hopper, start, action }).collect();
        let mut hops = hops(isa, &jobs).into_iter();
        under_way.retain(|&i| {
            let next = hops.next().and_then(|hop| hop.outcome.next());
            courses[i].goes_on(next)
        });
    }
    courses.into_iter().map(|course| course.rollout).collect()
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
    use super::{Rollout, draw_starts, quantile, rollout, side_by_side};
    use crate::evaluate::{DENSITIES, hop, hopper};
    use leg_control::policy::{Policy, SHIPPED};
    use leg_plant::Tolerance;
    use leg_simd::Isa;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    #[test]
    fn starts_side_by_side_end_as_one_after_the_other() {
        let policy = Policy::parse(SHIPPED).unwrap();
        let mut starts = draw_starts(100, &mut Pcg64::seed_from_u64(7));
        // Some that no action saves.
        starts.iter_mut().step_by(9).for_each(|apex| apex.vx_m_s *= 20.0);
        let mut fell = 0;
        for rho in DENSITIES {
            for tolerance in [Tolerance::GOLDEN, Tolerance::TRAINING] {
                let hopper = hopper(rho).with_tolerance(tolerance);
                let one =
                    |&start| rollout(start, |apex| hop(policy.actor(), &hopper, rho, apex, 0.0));
                let expected: Vec<Rollout> = starts.iter().map(one).collect();
                fell += expected.iter().filter(|rollout| rollout.last_abs_v.is_none()).count();
                for isa in Isa::ALL.into_iter().filter(|isa| isa.available()) {
                    let found = side_by_side(isa, policy.actor(), &hopper, rho, &starts);
                    assert_eq!(found, expected, "{rho}, {isa:?}");
                }
            }
        }
        assert!(fell > 0);
    }

    #[test]
    fn quantiles_are_linear_between_neighbours_and_keep_infinity() {
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(quantile(&[3.0], 0.95), Some(3.0));
        assert_eq!(quantile(&[1.0, 2.0, 4.0], 0.5), Some(2.0));
        assert_eq!(quantile(&[1.0, 2.0], 0.25), Some(1.25));
        assert_eq!(quantile(&[1.0, 2.0, f64::INFINITY], 0.5), Some(2.0));
    }
}
