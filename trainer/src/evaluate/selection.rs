//! Selection of the best actor of a training, by evaluations on starts of its own.

use super::survival::{Survival, draw_starts, survival};
use super::tracking::{SET_POINTS, Tracking, track};
use super::{DENSITIES, hopper};
use crate::config::Config;
use crate::failed_starts::THIN;
use crate::policy::PackedActor;
use leg_control::actor::Actor;
use leg_control::policy::GainPoint;
use leg_plant::Apex;
use rand::Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The score of an actor in the selection.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Environment steps trained.
    pub steps: u64,
    /// Weighted sum of falls, remaining speed and set-points not tracked; lower is better.
    pub cost: f64,
}

/// The result of an evaluation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluation {
    /// Score of the actor.
    pub score: Score,
    /// Survival at each of [`DENSITIES`].
    pub results: [Survival; DENSITIES.len()],
}

/// The state of a selector in a checkpoint. Its starts follow from the seed.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SelectorState {
    done: u64,
    /// Packed weights of the best actor, and its score.
    best: Option<(Vec<f32>, Score)>,
}

/// Evaluates actors and stores the best.
pub struct Selector {
    evaluations: u64,
    done: u64,
    starts: Vec<Apex>,
    /// Cost of a set-point that is not tracked.
    tracking: f64,
    tolerance: leg_plant::Tolerance,
    best: Option<(PackedActor, Score)>,
    latest: Option<Evaluation>,
}

impl Selector {
    /// Draws the starts of all evaluations.
    pub(crate) fn new(config: &Config, rng: &mut impl Rng) -> Self {
        Self {
            evaluations: config.selection.evaluations,
            done: 0,
            starts: draw_starts(config.selection.starts, rng),
            tracking: config.selection.tracking,
            tolerance: config.episode.tolerance.plant(),
            best: None,
            latest: None,
        }
    }

    /// Whether the next evaluation is due after `steps` of the stage's `all` steps.
    pub(crate) fn is_due(&self, steps: u64, all: u64) -> bool {
        steps * self.evaluations >= (self.done + 1) * all
    }

    /// Evaluates an actor and stores it if it is the best so far.
    pub(crate) fn evaluate(&mut self, packed: PackedActor, steps: u64) {
        self.done += 1;
        let actor = packed.actor();
        let results = DENSITIES.map(|rho| {
            let count = self.starts.len().div_ceil(start_divisor(rho));
            let hopper = hopper(rho).with_tolerance(self.tolerance);
            survival(&actor, &hopper, rho, &self.starts[..count])
        });
        let mut score = Score { steps, cost: cost(&results) };
        if self.tracking > 0.0 {
            score.cost += self.tracking * untracked(&actor);
        }
        if self.best.as_ref().is_none_or(|(_, best)| score.cost < best.cost) {
            self.best = Some((packed, score));
        }
        self.latest = Some(Evaluation { score, results });
    }

    /// Returns the latest evaluation; `None` before the first of this process.
    #[must_use]
    pub fn latest(&self) -> Option<&Evaluation> {
        self.latest.as_ref()
    }

    /// Returns the state to store in a checkpoint.
    #[must_use]
    pub fn state(&self) -> SelectorState {
        let best = self.best.as_ref().map(|(packed, score)| (packed.weights.clone(), *score));
        SelectorState { done: self.done, best }
    }

    /// Restores a state; returns false when its actor has not as many weights as `like`.
    pub(crate) fn restore(&mut self, state: &SelectorState, like: &PackedActor) -> bool {
        self.done = state.done;
        self.best = state
            .best
            .clone()
            .map(|(weights, score)| (PackedActor { weights, ..like.clone() }, score));
        self.best.as_ref().is_none_or(|(packed, _)| packed.weights.len() == like.weights.len())
    }

    /// Returns the best actor so far, with its score.
    pub(crate) fn best(&self) -> Option<(&PackedActor, Score)> {
        self.best.as_ref().map(|(packed, score)| (packed, *score))
    }
}

/// Returns the divisor of the number of starts at a density ratio: falls are rare in dense
/// media.
fn start_divisor(density_ratio: f64) -> usize {
    match density_ratio {
        0.0 => 1,
        rho if rho < THIN => 4,
        _ => 16,
    }
}

/// Returns the cost of an actor, summed over density ratios: the share of falls, plus
/// 0.02 s/m times the median speed of the survivors and 0.002 s/m times their 95 % quantile,
/// each speed at most 1 m/s.
fn cost(results: &[Survival]) -> f64 {
    let one = |r: &Survival| {
        let speed = |v: Option<f64>| v.map_or(1.0, |v| v.min(1.0));
        (1.0 - r.survive30) + 0.02 * speed(r.abs_v_median) + 0.002 * speed(r.abs_v_p95)
    };
    results.iter().map(one).sum()
}

/// Gains with which a set-point is tried: integral, derivative, feed-forward, bound of the
/// offset in m/s. The search for gains finds these often, and would take too long here.
const COMMON_GAINS: [(f32, f32, f32, f32); 5] = [
    (0.2, 0.0, 1.0, 4.0),
    (0.4, 0.3, 1.0, 8.0),
    (0.05, 0.0, 0.0, 2.0),
    (0.7, 0.3, 1.5, 16.0),
    (0.1, 0.0, 0.5, 1.0),
];

/// Returns the sum of the costs of all set-points, each with the best of [`COMMON_GAINS`]:
/// 2 for a fall, from 0.4 to 1 for a set-point that is not tracked, and a tenth of the
/// relative error for one that is.
fn untracked(actor: &Actor<'_>) -> f64 {
    let all: Vec<(f64, f64)> =
        DENSITIES.into_iter().flat_map(|rho| SET_POINTS.map(|v| (rho, v))).collect();
    let costs: Vec<f64> = all.into_par_iter().map(|(rho, v)| least_cost(actor, rho, v)).collect();
    costs.iter().sum()
}

/// Returns the cost of a set-point with the best of [`COMMON_GAINS`]; 0 where no steady gait
/// is known.
fn least_cost(actor: &Actor<'_>, rho: f64, set_point: f64) -> f64 {
    let mut least = f64::INFINITY;
    for (ki, kd, feed_forward, limit_m_s) in COMMON_GAINS {
        let density_ratio = rho as f32;
        let gains = GainPoint { density_ratio, kp: 0.0, ki, kd, feed_forward, limit_m_s };
        let run = track(actor, &[gains].into_iter().collect(), rho, set_point);
        if !run.possible() {
            return 0.0;
        }
        least = least.min(tracking_cost(&run));
        if run.tracked() {
            break;
        }
    }
    least
}

/// Returns the cost of one run, see [`untracked`]. An oscillation of up to 3 % is free.
fn tracking_cost(run: &Tracking) -> f64 {
    let (Some(mean), Some(oscillation)) = (run.mean_v, run.oscillation) else { return 2.0 };
    let relative = |x: f64| x / run.set_point.abs();
    let error = relative((mean - run.set_point).abs()) + (relative(oscillation) - 0.03).max(0.0);
    if run.tracked() { 0.1 * error } else { 0.4 + error.min(0.6) }
}
