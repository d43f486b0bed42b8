//! Which actor of a training to keep: evaluated on starts of its own.

use super::survival::{Survival, draw_starts, survival};
use super::{DENSITIES, hopper};
use crate::config::Config;
use crate::policy::Frozen;
use rand::Rng;
use serde::{Deserialize, Serialize};
use sim_host::plant::Apex;

/// How an actor stood when it was considered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// Environment steps trained.
    pub steps: u64,
    /// Share that falls and speed that is left, summed over densities; lower is better.
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
    tolerance: sim_host::plant::Tolerance,
    best: Option<(Frozen, Standing)>,
    latest: Option<Evaluation>,
}

impl Selector {
    pub(crate) fn new(config: &Config, rng: &mut impl Rng) -> Self {
        Self {
            evaluations: config.selection.evaluations,
            done: 0,
            starts: draw_starts(config.selection.starts, rng),
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
            survival(&actor, &hopper(rho).with_tolerance(self.tolerance), rho, &self.starts)
        });
        let standing = Standing { steps, cost: cost(&results) };
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

/// What is wrong with an actor, summed over densities: the share that falls, and
/// a tenth of the speed, in m/s, that is left of the median and of the 95 % survivor.
fn cost(results: &[Survival]) -> f64 {
    let one = |r: &Survival| {
        let left = |v: Option<f64>| v.map_or(1.0, |v| v.min(10.0) / 10.0);
        (1.0 - r.survive30) + left(r.abs_v_median) + left(r.abs_v_p95)
    };
    results.iter().map(one).sum()
}
