//! Which actor of a training to keep: evaluated on starts of its own.

use super::survival::{Survival, draw_starts, survival};
use super::tracking::{SET_POINTS, Tracking, track};
use super::{DENSITIES, hopper};
use crate::config::Config;
use crate::policy::Frozen;
use crate::retry::THIN;
use leg_control::actor::Actor;
use leg_control::policy::GainPoint;
use leg_plant::Apex;
use rand::Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How an actor stood when it was considered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// Environment steps trained.
    pub steps: u64,
    /// Falls, speed that is left, and set-points that are not tracked; lower is better.
    pub cost: f64,
}

/// What an evaluation saw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluation {
    /// In short.
    pub standing: Standing,
    /// At each of [`DENSITIES`].
    pub results: [Survival; DENSITIES.len()],
}

/// A selector as it is kept in a checkpoint. (Its starts follow from the seed.)
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SelectorState {
    done: u64,
    /// Packed weights, and how they stood.
    best: Option<(Vec<f32>, Standing)>,
}

/// Keeps the best actor.
pub struct Selector {
    evaluations: u64,
    done: u64,
    starts: Vec<Apex>,
    /// Cost of a set-point that is not tracked.
    tracking: f64,
    tolerance: leg_plant::Tolerance,
    best: Option<(Frozen, Standing)>,
    latest: Option<Evaluation>,
}

impl Selector {
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

    /// Whether the next evaluation is due after `steps` of `all`.
    pub(crate) fn is_due(&self, steps: u64, all: u64) -> bool {
        steps * self.evaluations >= (self.done + 1) * all
    }

    /// Evaluates an actor and keeps it if it is the best.
    pub(crate) fn consider(&mut self, frozen: Frozen, steps: u64) {
        self.done += 1;
        let actor = frozen.actor();
        let results = DENSITIES.map(|rho| {
            let count = self.starts.len().div_ceil(fewer(rho));
            let hopper = hopper(rho).with_tolerance(self.tolerance);
            survival(&actor, &hopper, rho, &self.starts[..count])
        });
        let mut standing = Standing { steps, cost: cost(&results) };
        if self.tracking > 0.0 {
            standing.cost += self.tracking * untracked(&actor);
        }
        if self.best.as_ref().is_none_or(|(_, best)| standing.cost < best.cost) {
            self.best = Some((frozen, standing));
        }
        self.latest = Some(Evaluation { standing, results });
    }

    /// What the latest evaluation saw; `None` before the first of this process.
    #[must_use]
    pub fn latest(&self) -> Option<&Evaluation> {
        self.latest.as_ref()
    }

    /// How far it is, and what it keeps.
    #[must_use]
    pub fn state(&self) -> SelectorState {
        let best = self.best.as_ref().map(|(frozen, standing)| (frozen.packed.clone(), *standing));
        SelectorState { done: self.done, best }
    }

    /// Goes on from a state; false when its actor is not like `like`.
    pub(crate) fn restore(&mut self, state: &SelectorState, like: &Frozen) -> bool {
        self.done = state.done;
        self.best = state
            .best
            .clone()
            .map(|(packed, standing)| (Frozen { packed, ..like.clone() }, standing));
        self.best.as_ref().is_none_or(|(frozen, _)| frozen.packed.len() == like.packed.len())
    }

    /// The best so far.
    pub(crate) fn best(&self) -> Option<(&Frozen, Standing)> {
        self.best.as_ref().map(|(frozen, standing)| (frozen, *standing))
    }
}

/// Of how many starts one is run at a density: falls are rare in thick media.
fn fewer(density_ratio: f64) -> usize {
    match density_ratio {
        0.0 => 1,
        rho if rho < THIN => 4,
        _ => 16,
    }
}

/// What is wrong with an actor, summed over densities: the share that falls, and
/// 0.02 s/m of the speed that is left of the median, 0.002 of the 95 % survivor.
fn cost(results: &[Survival]) -> f64 {
    let one = |r: &Survival| {
        let left = |v: Option<f64>| v.map_or(1.0, |v| v.min(1.0));
        (1.0 - r.survive30) + 0.02 * left(r.abs_v_median) + 0.002 * left(r.abs_v_p95)
    };
    results.iter().map(one).sum()
}

/// Gains that a set-point is tried with: integral, derivative, feed-forward, bound of
/// the offset in m/s. A few that the search for gains finds often, in the place of it.
const USUAL: [(f32, f32, f32, f32); 5] = [
    (0.2, 0.0, 1.0, 4.0),
    (0.4, 0.3, 1.0, 8.0),
    (0.05, 0.0, 0.0, 2.0),
    (0.7, 0.3, 1.5, 16.0),
    (0.1, 0.0, 0.5, 1.0),
];

/// Set-points that are not tracked with any of the usual gains, counted by how far
/// they are missed: 2 for a fall, from 0.4 to 1 for an error, and a tenth of what is
/// left of it for one that is tracked.
fn untracked(actor: &Actor<'_>) -> f64 {
    let all: Vec<(f64, f64)> =
        DENSITIES.into_iter().flat_map(|rho| SET_POINTS.map(|v| (rho, v))).collect();
    let missed: Vec<f64> = all.into_par_iter().map(|(rho, v)| missed(actor, rho, v)).collect();
    missed.iter().sum()
}

fn missed(actor: &Actor<'_>, rho: f64, set_point: f64) -> f64 {
    let mut least = f64::INFINITY;
    for (ki, kd, feed_forward, limit_m_s) in USUAL {
        let density_ratio = rho as f32;
        let gains = GainPoint { density_ratio, kp: 0.0, ki, kd, feed_forward, limit_m_s };
        let run = track(actor, &[gains].into_iter().collect(), rho, set_point);
        if !run.possible() {
            return 0.0;
        }
        least = least.min(miss(&run));
        if run.tracked() {
            break;
        }
    }
    least
}

/// See [`untracked`]. An oscillation of 3 % is none.
fn miss(run: &Tracking) -> f64 {
    let (Some(mean), Some(oscillation)) = (run.mean_v, run.oscillation) else { return 2.0 };
    let relative = |x: f64| x / run.set_point.abs();
    let error = relative((mean - run.set_point).abs()) + (relative(oscillation) - 0.03).max(0.0);
    if run.tracked() { 0.1 * error } else { 0.4 + error.min(0.6) }
}
