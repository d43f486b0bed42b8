//! Agents flown apex by apex, with what they do at each: what figures 7, 9, 10
//! and 13 share.

use leg_control::actor::Actor;
use leg_control::policy::GainPoint;
use leg_control::velocity::Cascade;
use leg_plant::{Action, Apex, Hopper, Leg, LegParameters, Medium};
use serde::Serialize;

use crate::{FiguresError, Reference};
use trainer::environment::LOWEST_APEX_M;
use trainer::evaluate::act;
use trainer::policy::PackedActor;

/// Where a run starts in figures of which the paper does not say where.
pub(crate) const START: Apex = Apex { vx_m_s: 1.0, y_m: 2.0 };

/// A run: the states at its apexes, and the action taken at each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Flown {
    /// The first is the start; where the leg fell, the last is where from.
    pub(crate) apexes: Vec<Apex>,
    /// One for each apex but, after a run without a fall, the last.
    pub(crate) actions: Vec<Action>,
    /// Whether there was no next apex, or one too low to be a hop.
    pub(crate) fell: bool,
}

impl Flown {
    /// Hops that ended well.
    pub(crate) fn hops(&self) -> usize {
        self.apexes.len() - 1
    }

    /// Velocities of the last apexes, m/s; none after a fall.
    pub(crate) fn last_vx_m_s(&self, count: usize) -> Option<Vec<f64>> {
        let last = &self.apexes[self.apexes.len().saturating_sub(count)..];
        (!self.fell).then(|| last.iter().map(|apex| apex.vx_m_s).collect())
    }
}

/// Flies an actor on the apex map for some hops; `offset` is asked at each apex
/// for what to take from the observed velocity, m/s.
pub(crate) fn fly(
    actor: &Actor<'_>,
    hopper: &Hopper,
    rho: f64,
    start: Apex,
    hops: usize,
    mut offset: impl FnMut(Apex) -> f32,
) -> Flown {
    let mut flown = Flown { apexes: vec![start], ..Flown::default() };
    let mut apex = start;
    for _ in 0..hops {
        let action = act(actor, rho, apex, offset(apex));
        flown.actions.push(action);
        match hopper.hop(apex, action).outcome.next() {
            Some(next) if next.y_m >= LOWEST_APEX_M => apex = next,
            _ => {
                flown.fell = true;
                break;
            }
        }
        flown.apexes.push(apex);
    }
    flown
}

/// The same, asked for a speed under the cascade.
pub(crate) fn follow(
    actor: &Actor<'_>,
    hopper: &Hopper,
    gains: GainPoint,
    set_point_m_s: f32,
    start: Apex,
    hops: usize,
) -> Flown {
    let mut cascade = Cascade::new();
    let rho = f64::from(gains.density_ratio);
    let offset = |apex: Apex| cascade.update(&gains, set_point_m_s, apex.vx_m_s as f32);
    fly(actor, hopper, rho, start, hops, offset)
}

/// Mean, and half the range.
pub(crate) fn mean_and_swing(values: &[f64]) -> (f64, f64) {
    let (low, high) =
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
    (values.iter().sum::<f64>() / values.len() as f64, (high - low) / 2.0)
}

/// The paper's leg with another mass, kg, and spring, N/m.
pub(crate) fn other_leg(mass_kg: f64, stiffness_n_m: f64, medium: Medium) -> Hopper {
    let human: LegParameters = Leg::human().into();
    let leg = Leg::new(LegParameters { mass_kg, stiffness_n_m, ..human });
    Hopper::new(&leg.expect("a mass and a stiffness above 0"), medium)
}

/// An actor of the authors, where their data is at hand.
pub(crate) fn authors_actor(
    reference: Option<&Reference>,
    agent: &str,
) -> Result<Option<PackedActor>, FiguresError> {
    reference.map(|reference| reference.actor(agent)).transpose()
}

/// All of an actor, as an input of a part.
pub(crate) fn identity(frozen: &PackedActor) -> impl Serialize + '_ {
    (frozen.widths.as_slice(), frozen.observation, frozen.action, &frozen.weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_control::policy::{Policy, SHIPPED};
    use trainer::evaluate::hopper;
    use trainer::evaluate::tracking::track;

    #[test]
    fn a_run_is_that_of_the_evaluation() {
        let policy = Policy::parse(SHIPPED).unwrap();
        let actor = policy.actor();
        let gains =
            GainPoint { ki: 0.2, feed_forward: 0.5, limit_m_s: 1.0, ..GainPoint::default() };
        let start = Apex { vx_m_s: 0.0, y_m: 2.0 };
        let run = follow(actor, &hopper(0.0), gains, 1.0, start, 100);
        assert_eq!((run.hops(), run.actions.len(), run.fell), (100, 100, false));
        let expected = track(actor, &[gains].into_iter().collect(), 0.0, 1.0);
        let (mean, swing) = mean_and_swing(&run.last_vx_m_s(20).unwrap());
        assert_eq!((Some(mean), Some(swing)), (expected.mean_v, expected.oscillation));
    }

    #[test]
    fn a_fall_ends_the_run_and_is_said() {
        let policy = Policy::parse(SHIPPED).unwrap();
        let nowhere = Apex { vx_m_s: 200.0, y_m: 1.2 };
        let run = fly(policy.actor(), &hopper(0.0), 0.0, nowhere, 9, |_| 0.0);
        assert!(run.fell && run.hops() < 9 && run.actions.len() == run.apexes.len(), "{run:?}");
        assert_eq!(run.last_vx_m_s(1), None);
    }
}
