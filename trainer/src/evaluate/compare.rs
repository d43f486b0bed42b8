//! Two policies from the same starts, side by side.
//!
//! The starts are drawn as [`super::report::Report`] draws them, and every one is run
//! with both policies: what differs between starts falls out of the difference.
//! [`super::intervals`] says how intervals and tests are computed. Tracking and
//! highest speed have nothing random in them: there, any difference is one.
//!
//! What a number of starts can show: to see a survival of 0.998 against 0.997 with
//! a chance of 0.8, where the two fall independently of each other, takes some
//! 40,000 starts ((1.96 + 0.84)^2 (0.002 + 0.003) / 0.001^2), and 64,000 where Holm's
//! adjustment for eight densities bites fully (2.73 for 1.96). Policies that fall from
//! the same starts need fewer. 5,000 starts resolve 0.998 against 0.9946.

use super::intervals::{CONFIDENCE, Estimate, Pairs, holm, mean, median, sign_test};
use super::survival::{Run, draw_starts, runs};
use super::tracking::{Tracking, highest_speeds, tracking_table};
use super::{DENSITIES, hopper};
use leg_control::policy::Policy;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::Serialize;

/// Which of the two is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The first.
    ABetter,
    /// The second.
    BBetter,
    /// What is seen may well be chance.
    NoDifferenceSeen,
}

/// Which way is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Better {
    More,
    Less,
}

/// A figure of both policies, and by how much they differ from the same starts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Paired {
    /// Of the first.
    pub a: Estimate,
    /// Of the second.
    pub b: Estimate,
    /// Of the second less the first.
    pub difference: Estimate,
    /// How likely at least such a difference is where there is none; by itself.
    pub p: f64,
    /// After Holm's adjustment of `p` over the densities.
    pub verdict: Verdict,
}

/// Both policies at one density.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AtDensity {
    /// Density ratio.
    pub rho: f64,
    /// What became of the starts: survived with both, with one, with neither.
    pub starts: Pairs,
    /// Share that survives 30 hops.
    pub survive30: Paired,
    /// Median |v| after 30 hops of those that survive, m/s; the difference is the
    /// median of the differences from starts that survive with both. `None` where
    /// fewer than six do.
    pub abs_v_median: Option<Paired>,
    /// Mean reward over 5 steps.
    pub reward5: Paired,
}

/// A set-point that the two do not follow alike.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrackingDiffers {
    /// The first.
    pub a: Tracking,
    /// The second.
    pub b: Tracking,
}

/// Set-points with a known steady gait: how many are followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Tracked {
    /// Tracked.
    pub tracked: usize,
    /// Fallen.
    pub fell: usize,
    /// In all.
    pub possible: usize,
}

/// Everything about two policies.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// At each density.
    pub starts: usize,
    /// Of the starts.
    pub seed: u64,
    /// By density, lowest first.
    pub densities: Vec<AtDensity>,
    /// Of the first and of the second.
    pub tracked: [Tracked; 2],
    /// Set-points with a known steady gait that one tracks and one does not, or that
    /// make one fall and one not.
    pub tracking_differs: Vec<TrackingDiffers>,
    /// By density: of the first and of the second, m/s.
    pub max_speed: Vec<(f64, [f64; 2])>,
}

/// A verdict yet to be adjusted.
fn paired(a: Estimate, b: Estimate, difference: Estimate, p: f64) -> Paired {
    Paired { a, b, difference, p, verdict: Verdict::NoDifferenceSeen }
}

/// Gives each its verdict, of all as one question. `leaning` is how many pairs more
/// favour the second: the sign is the test's, where a median may be 0.
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

/// Speeds that are left, and how many more of the differences are above 0 than below.
fn speeds(a: &[Run], b: &[Run]) -> Option<(Paired, f64)> {
    let of = |runs: &[Run]| sorted(runs.iter().filter_map(|r| r.last_abs_v).collect());
    let pairs = a.iter().zip(b).filter_map(|(a, b)| Some(b.last_abs_v? - a.last_abs_v?));
    let differences = sorted(pairs.collect());
    let above = differences.iter().filter(|&&d| d > 0.0).count() as u64;
    let below = differences.iter().filter(|&&d| d < 0.0).count() as u64;
    let (a, b, difference) = (median(&of(a))?, median(&of(b))?, median(&differences)?);
    Some((paired(a, b, difference, sign_test(above, below)), above as f64 - below as f64))
}

fn rewards(a: &[Run], b: &[Run]) -> Paired {
    let of = |runs: &[Run]| mean(&runs.iter().map(|r| r.reward5).collect::<Vec<_>>()).0;
    let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| b.reward5 - a.reward5).collect();
    let (difference, p) = mean(&differences);
    paired(of(a), of(b), difference, p)
}

fn survivors(a: &[Run], b: &[Run]) -> Pairs {
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

/// At every density, by what two policies' runs from the same starts came to.
fn at_densities(runs: &[(f64, Vec<Run>, Vec<Run>)]) -> Vec<AtDensity> {
    let mut leanings = Vec::new();
    let mut rows: Vec<AtDensity> = runs
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

/// Which set-points with a known gait are followed, and by which only.
fn tracking(a: &[Tracking], b: &[Tracking]) -> ([Tracked; 2], Vec<TrackingDiffers>) {
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
    ([count(a), count(b)], differing.map(|(&a, &b)| TrackingDiffers { a, b }).collect())
}

impl Comparison {
    /// Runs two policies from `starts` starts at each density, the same for both.
    ///
    /// # Panics
    /// If there are no starts.
    #[must_use]
    pub fn new(a: &Policy<'_>, b: &Policy<'_>, starts: usize, seed: u64) -> Self {
        assert!(starts > 0, "nothing to compare without starts");
        let drawn = draw_starts(starts, &mut Pcg64::seed_from_u64(seed));
        let both = DENSITIES.map(|rho| {
            let of = |policy: &Policy<'_>| runs(policy.actor(), &hopper(rho), rho, &drawn);
            (rho, of(a), of(b))
        });
        let table = |policy: &Policy<'_>| tracking_table(policy.actor(), &policy.manifest().gains);
        let speeds = |policy: &Policy<'_>| highest_speeds(policy.actor(), &policy.manifest().gains);
        let (tracked, tracking_differs) = tracking(&table(a), &table(b));
        let max_speed = speeds(a).into_iter().zip(speeds(b));
        Self {
            starts,
            seed,
            densities: at_densities(&both),
            tracked,
            tracking_differs,
            max_speed: max_speed.map(|((rho, a), (_, b))| (rho, [a, b])).collect(),
        }
    }

    /// As one JSON object.
    ///
    /// # Panics
    /// Never: every number has a JSON form.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("numbers have a JSON form")
    }

    /// Every figure that comes from random starts.
    pub fn figures(&self) -> impl Iterator<Item = &Paired> {
        self.densities.iter().flat_map(|d| {
            [Some(&d.survive30), d.abs_v_median.as_ref(), Some(&d.reward5)].into_iter().flatten()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(last_abs_v: Option<f64>, reward5: f64) -> Run {
        Run { last_abs_v, reward5 }
    }

    #[test]
    fn what_differs_is_seen_and_what_does_not_is_not() {
        // B survives where A falls in 30 of 1,000, stops better, earns the same.
        let reward = |i: u32| f64::from(i % 7);
        let a: Vec<Run> = (0..1_000)
            .map(|i| run((i >= 30).then_some(0.02 + 1e-6 * f64::from(i)), reward(i)))
            .collect();
        let b: Vec<Run> = (0..1_000)
            .map(|i| run(Some(0.01 + 1e-6 * f64::from(i)), reward(i + i % 2 * 7)))
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
    fn eight_densities_are_one_question() {
        // p = 2^-5 by itself, 8 times that among eight.
        let fell = |count: u32| -> Vec<Run> {
            (0..200).map(|i| run((i >= count).then_some(0.1), 1.0)).collect()
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
    fn without_survivors_there_is_no_speed() {
        let fell = vec![run(None, 0.0); 100];
        let rows = at_densities(&[(0.0, fell.clone(), fell)]);
        assert_eq!(rows[0].abs_v_median, None);
        assert_eq!(rows[0].survive30.verdict, Verdict::NoDifferenceSeen);
    }
}
