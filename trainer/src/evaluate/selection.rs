//! Which actor of a training to keep: evaluated on starts of its own.

use super::survival::{Survival, draw_starts, survival};
use super::{DENSITIES, hopper};
use crate::config::Config;
use crate::policy::Frozen;
use rand::Rng;
use sim_host::plant::Apex;

/// How an actor stood when it was considered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// Environment steps trained.
    pub steps: u64,
    /// Share that falls and speed that is left, summed over densities; lower is better.
    pub cost: f64,
}

/// Keeps the best actor.
pub struct Selector {
    evaluations: u64,
    done: u64,
    starts: Vec<Apex>,
    tolerance: sim_host::plant::Tolerance,
    best: Option<(Frozen, Standing)>,
}

impl Selector {
    pub(crate) fn new(config: &Config, rng: &mut impl Rng) -> Self {
        Self {
            evaluations: config.selection.evaluations,
            done: 0,
            starts: draw_starts(config.selection.starts, rng),
            tolerance: config.episode.tolerance.plant(),
            best: None,
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
