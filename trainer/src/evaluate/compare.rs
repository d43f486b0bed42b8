//! Comparison of two policies from the same starts.
//!
//! The starts are drawn as [`super::report::Report`] draws them, and each rollouts with both
//! policies, so that the differences between starts cancel. [`super::intervals`] documents
//! the intervals and tests. Tracking and highest speed are deterministic: any difference
//! there is a real one.
//!
//! Statistical power: a survival of 0.998 against 0.997 is detected with probability 0.8
//! from about 40,000 starts where the policies fall independently of each other
//! ((1.96 + 0.84)^2 (0.002 + 0.003) / 0.001^2), or from 64,000 where Holm's adjustment for
//! eight density ratios has its full effect (2.73 for 1.96). Policies that fall from the
//! same starts need fewer. 5,000 starts resolve 0.998 against 0.9946.

use super::intervals::{CONFIDENCE, Estimate, Pairs, holm, mean, median, sign_test};
use super::survival::{Rollout, draw_starts, rollouts};
use super::tracking::{Tracking, highest_speeds, tracking_table};
use super::{DENSITIES, hopper, randomised};
use crate::config::Randomisation;
use leg_control::policy::Policy;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::Serialize;

/// Which of two policies is better by a metric.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The first policy is better.
    ABetter,
    /// The second policy is better.
    BBetter,
    /// The difference is not significant.
    NoDifferenceSeen,
}

/// The direction in which a metric improves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Better {
    More,
    Less,
}

/// A metric of both policies, and its difference from the same starts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Paired {
    /// Estimate for the first policy.
    pub a: Estimate,
    /// Estimate for the second policy.
    pub b: Estimate,
    /// The second minus the first.
    pub difference: Estimate,
    /// Probability of at least such a difference where there is none, before adjustment.
    pub p: f64,
    /// Verdict after Holm's adjustment of `p` over the density ratios.
    pub verdict: Verdict,
}

/// Both policies at one density ratio.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AtDensity {
    /// Density ratio.
    pub rho: f64,
    /// Number of starts that survive with both, with one and with neither.
    pub starts: Pairs,
    /// Share of starts that survive 30 hops.
    pub survive30: Paired,
    /// Median |v| of the survivors after 30 hops, m/s. The difference is the median of the
    /// differences over the starts that survive with both; `None` where fewer than six do.
    pub abs_v_median: Option<Paired>,
    /// Mean over the starts of the reward over 5 steps.
    pub reward5: Paired,
}

/// A set-point at which the two policies differ.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrackingDifference {
    /// Rollout of the first policy.
    pub a: Tracking,
    /// Rollout of the second policy.
    pub b: Tracking,
}

/// Numbers of set-points with a known steady gait.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Tracked {
    /// Set-points tracked.
    pub tracked: usize,
    /// `FailedStarts`.
    pub fell: usize,
    /// All set-points with a known steady gait.
    pub possible: usize,
}

/// The comparison of two policies.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Number of starts at each density ratio.
    pub starts: usize,
    /// Seed of the starts.
    pub seed: u64,
    /// What is randomised in the metrics of random starts; `None` for nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub randomisation: Option<Randomisation>,
    /// Metrics by density ratio, ascending.
    pub densities: Vec<AtDensity>,
    /// Tracking of the first and of the second policy.
    pub tracked: [Tracked; 2],
    /// Set-points with a known steady gait at which the policies differ in tracking or in
    /// falling.
    pub tracking_differs: Vec<TrackingDifference>,
    /// Highest speed of the first and of the second policy by density ratio, m/s.
    pub max_speed: Vec<(f64, [f64; 2])>,
}

/// Returns a metric whose verdict [`judge`] will set.
fn paired(a: Estimate, b: Estimate, difference: Estimate, p: f64) -> Paired {
    Paired { a, b, difference, p, verdict: Verdict::NoDifferenceSeen }
}

/// Sets the verdicts of one metric over all density ratios, by Holm's adjustment. The second
/// item of a row has the sign of the test statistic, because the median may be 0: positive
/// where the second policy has the higher values.
fn judge(rows: &mut [(&mut Paired, f64)], better: Better) {
    let p: Vec<f64> = rows.iter().map(|(row, _)| row.p).collect();
    for ((row, leaning), p) in rows.iter_mut().zip(holm(&p)) {
        row.verdict = match (p < 1.0 - CONFIDENCE, (*leaning > 0.0) == (better == Better::More)) {
            (false, _) => Verdict::NoDifferenceSeen,
            (true, true) => Verdict::BBetter,
            (true, false) => Verdict::ABetter,
        };
    }
}

fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values
}

/// Returns the speeds of the survivors, and by how much more differences are above 0 than
/// below.
fn speeds(a: &[Rollout], b: &[Rollout]) -> Option<(Paired, f64)> {
    let of = |rollouts: &[Rollout]| sorted(rollouts.iter().filter_map(|r| r.last_abs_v).collect());
    let pairs = a.iter().zip(b).filter_map(|(a, b)| Some(b.last_abs_v? - a.last_abs_v?));
    let differences = sorted(pairs.collect());
    let above = differences.iter().filter(|&&d| d > 0.0).count() as u64;
    let below = differences.iter().filter(|&&d| d < 0.0).count() as u64;
    let (a, b, difference) = (median(&of(a))?, median(&of(b))?, median(&differences)?);
    Some((paired(a, b, difference, sign_test(above, below)), above as f64 - below as f64))
}

/// Returns the rewards, with the normal test of the mean difference.
fn rewards(a: &[Rollout], b: &[Rollout]) -> Paired {
    let of = |rollouts: &[Rollout]| mean(&rollouts.iter().map(|r| r.reward5).collect::<Vec<_>>()).0;
    let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| b.reward5 - a.reward5).collect();
    let (difference, p) = mean(&differences);
    paired(of(a), of(b), difference, p)
}

/// Counts which policies survive each start.
fn survivors(a: &[Rollout], b: &[Rollout]) -> Pairs {
    let mut pairs = Pairs::default();
    for (a, b) in a.iter().zip(b) {
        *match (a.last_abs_v.is_some(), b.last_abs_v.is_some()) {
            (true, true) => &mut pairs.both,
            (true, false) => &mut pairs.only_a,
            (false, true) => &mut pairs.only_b,
            (false, false) => &mut pairs.neither,
        } += 1;
    }
    pairs
}

/// Compares the rollouts of two policies from the same starts, by density ratio.
fn at_densities(rollouts: &[(f64, Vec<Rollout>, Vec<Rollout>)]) -> Vec<AtDensity> {
    let mut leanings = Vec::new();
    let mut rows: Vec<AtDensity> = rollouts
        .iter()
        .map(|(rho, a, b)| {
            let starts = survivors(a, b);
            let survive30 = paired(starts.a(), starts.b(), starts.difference(), starts.p());
            let speeds = speeds(a, b);
            leanings.push(speeds.map_or(0.0, |(_, leaning)| leaning));
            let abs_v_median = speeds.map(|(paired, _)| paired);
            AtDensity { rho: *rho, starts, survive30, abs_v_median, reward5: rewards(a, b) }
        })
        .collect();
    let by_value = |row: Paired| row.difference.value;
    let survive = rows.iter_mut().map(|r| (by_value(r.survive30), &mut r.survive30));
    judge(&mut survive.map(|(d, r)| (r, d)).collect::<Vec<_>>(), Better::More);
    let reward = rows.iter_mut().map(|r| (by_value(r.reward5), &mut r.reward5));
    judge(&mut reward.map(|(d, r)| (r, d)).collect::<Vec<_>>(), Better::More);
    let speed =
        rows.iter_mut().zip(leanings).filter_map(|(r, l)| Some((r.abs_v_median.as_mut()?, l)));
    judge(&mut speed.collect::<Vec<_>>(), Better::Less);
    rows
}

/// Counts the set-points that are tracked, and lists those at which the policies differ.
fn tracking(a: &[Tracking], b: &[Tracking]) -> ([Tracked; 2], Vec<TrackingDifference>) {
    let count = |all: &[Tracking]| {
        let possible = || all.iter().filter(|t| t.possible());
        Tracked {
            tracked: possible().filter(|t| t.tracked()).count(),
            fell: possible().filter(|t| t.fell).count(),
            possible: possible().count(),
        }
    };
    let differ =
        |a: &Tracking, b: &Tracking| a.possible() && (a.tracked(), a.fell) != (b.tracked(), b.fell);
    let differing = a.iter().zip(b).filter(|(a, b)| differ(a, b));
    ([count(a), count(b)], differing.map(|(&a, &b)| TrackingDifference { a, b }).collect())
}

impl Comparison {
    /// Runs two policies from the same `starts` random starts at each density ratio.
    ///
    /// # Panics
    /// If there are no starts.
    #[must_use]
    pub fn new(a: &Policy<'_>, b: &Policy<'_>, starts: usize, seed: u64) -> Self {
        Self::in_worlds(a, b, starts, seed, None)
    }

    /// Runs two policies as [`Self::new`] does; with a randomisation, each start in the same world
    /// for both. Tracking and highest speed are those of the exact world.
    ///
    /// # Panics
    /// If there are no starts, or the randomisation does not pass its check.
    #[must_use]
    pub fn in_worlds(
        a: &Policy<'_>,
        b: &Policy<'_>,
        starts: usize,
        seed: u64,
        randomisation: Option<&Randomisation>,
    ) -> Self {
        assert!(starts > 0, "nothing to compare without starts");
        let drawn = draw_starts(starts, &mut Pcg64::seed_from_u64(seed));
        let both = DENSITIES.map(|rho| {
            let of = |policy: &Policy<'_>| match randomisation {
                None => rollouts(policy.actor(), &hopper(rho), rho, &drawn),
                Some(worlds) => randomised::rollouts(policy.actor(), worlds, rho, &drawn, seed),
            };
            (rho, of(a), of(b))
        });
        let table = |policy: &Policy<'_>| tracking_table(policy.actor(), &policy.manifest().gains);
        let speeds = |policy: &Policy<'_>| highest_speeds(policy.actor(), &policy.manifest().gains);
        let (tracked, tracking_differs) = tracking(&table(a), &table(b));
        let max_speed = speeds(a).into_iter().zip(speeds(b));
        Self {
            starts,
            seed,
            randomisation: randomisation.cloned(),
            densities: at_densities(&both),
            tracked,
            tracking_differs,
            max_speed: max_speed.map(|((rho, a), (_, b))| (rho, [a, b])).collect(),
        }
    }

    /// Returns the comparison as one JSON object.
    ///
    /// # Panics
    /// Never: every number has a JSON form.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("numbers have a JSON form")
    }

    /// Returns every metric that comes from random starts.
    pub fn metrics(&self) -> impl Iterator<Item = &Paired> {
        self.densities.iter().flat_map(|d| {
            [Some(&d.survive30), d.abs_v_median.as_ref(), Some(&d.reward5)].into_iter().flatten()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rollout(last_abs_v: Option<f64>, reward5: f64) -> Rollout {
        Rollout { last_abs_v, reward5 }
    }

    #[test]
    fn a_verdict_names_the_better_policy_only_where_they_differ() {
        // Of 1,000 starts B survives 30 more, stops better and has the same rewards.
        let reward = |i: u32| f64::from(i % 7);
        let a: Vec<Rollout> = (0..1_000)
            .map(|i| rollout((i >= 30).then_some(0.02 + 1e-6 * f64::from(i)), reward(i)))
            .collect();
        let b: Vec<Rollout> = (0..1_000)
            .map(|i| rollout(Some(0.01 + 1e-6 * f64::from(i)), reward(i + i % 2 * 7)))
            .collect();
        let rows = at_densities(&[(0.0, a.clone(), b.clone()), (1.0, b, a)]);
        let starts = rows[0].starts;
        assert_eq!((starts.both, starts.only_a, starts.only_b, starts.neither), (970, 0, 30, 0));
        assert_eq!(rows[0].survive30.verdict, Verdict::BBetter);
        assert_eq!(rows[1].survive30.verdict, Verdict::ABetter);
        let speed = rows[0].abs_v_median.unwrap();
        assert!((speed.difference.value + 0.01).abs() < 1e-12, "{speed:?}");
        assert_eq!(speed.verdict, Verdict::BBetter, "less is better");
        assert_eq!(rows[1].abs_v_median.unwrap().verdict, Verdict::ABetter);
        assert_eq!(rows[0].reward5.verdict, Verdict::NoDifferenceSeen);
        assert_eq!(rows[0].reward5.p, 1.0);
    }

    #[test]
    fn a_verdict_is_adjusted_for_the_number_of_density_ratios() {
        // p is 2^-5 alone, and 8 times that among eight.
        let fell = |count: u32| -> Vec<Rollout> {
            (0..200).map(|i| rollout((i >= count).then_some(0.1), 1.0)).collect()
        };
        let one = (0.0, fell(6), fell(0));
        let rows = at_densities(std::slice::from_ref(&one));
        let alone = rows[0].survive30;
        assert!((alone.p - 0.03125).abs() < 1e-12, "{alone:?}");
        assert_eq!(alone.verdict, Verdict::BBetter);
        let mut eight = vec![one];
        eight.extend((1..8).map(|i| (f64::from(i), fell(0), fell(0))));
        let rows = at_densities(&eight);
        let among = rows[0].survive30;
        assert_eq!((among.p, among.verdict), (alone.p, Verdict::NoDifferenceSeen));
    }

    #[test]
    fn the_median_speed_is_none_without_survivors() {
        let fell = vec![rollout(None, 0.0); 100];
        let rows = at_densities(&[(0.0, fell.clone(), fell)]);
        assert_eq!(rows[0].abs_v_median, None);
        assert_eq!(rows[0].survive30.verdict, Verdict::NoDifferenceSeen);
    }
}
