//! Runs of an agent from apex to apex, for figures 7, 9, 10 and 13.

use leg_control::actor::Actor;
use leg_control::policy::GainPoint;
use leg_control::velocity::Cascade;
use leg_plant::{Action, Apex, Hopper, Leg, LegParameters, Medium};
use serde::Serialize;

use crate::{FiguresError, Reference};
use trainer::environment::LOWEST_APEX_M;
use trainer::evaluate::act;
use trainer::policy::PackedActor;

/// The start of a run in figures for which the paper gives none.
pub(crate) const START: Apex = Apex { vx_m_s: 1.0, y_m: 2.0 };

/// A run: the states at its apexes, and the action at each.
#[derive(Clone, Debug, Default)]
pub(crate) struct ApexRun {
    /// The first is the start. After a fall, the last is the apex before it.
    pub(crate) apexes: Vec<Apex>,
    /// One for each apex, except the last of a run without a fall.
    pub(crate) actions: Vec<Action>,
    /// True if the last action led to no apex, or to one too low to count as a hop.
    pub(crate) fell: bool,
}

impl ApexRun {
    /// Returns the number of hops without a fall.
    pub(crate) fn hops(&self) -> usize {
        self.apexes.len() - 1
    }

    /// Returns the velocities of the last apexes, m/s, or `None` after a fall.
    pub(crate) fn last_vx_m_s(&self, count: usize) -> Option<Vec<f64>> {
        let last = &self.apexes[self.apexes.len().saturating_sub(count)..];
        (!self.fell).then(|| last.iter().map(|apex| apex.vx_m_s).collect())
    }
}

/// Runs an actor on the apex map for some hops. At each apex, `offset` returns the
/// velocity to subtract from the observed one, m/s.
pub(crate) fn run_policy(
    actor: &Actor<'_>,
    hopper: &Hopper,
    rho: f64,
    start: Apex,
    hops: usize,
    mut offset: impl FnMut(Apex) -> f32,
) -> ApexRun {
    let mut run = ApexRun { apexes: vec![start], ..ApexRun::default() };
    let mut apex = start;
    for _ in 0..hops {
        let action = act(actor, rho, apex, offset(apex));
        run.actions.push(action);
        match hopper.hop(apex, action).outcome.next() {
            Some(next) if next.y_m >= LOWEST_APEX_M => apex = next,
            _ => {
                run.fell = true;
                break;
            }
        }
        run.apexes.push(apex);
    }
    run
}

/// Runs an actor at a set-point under the velocity cascade.
pub(crate) fn run_cascade(
    actor: &Actor<'_>,
    hopper: &Hopper,
    gains: GainPoint,
    set_point_m_s: f32,
    start: Apex,
    hops: usize,
) -> ApexRun {
    let mut cascade = Cascade::new();
    let rho = f64::from(gains.density_ratio);
    let offset = |apex: Apex| cascade.update(&gains, set_point_m_s, apex.vx_m_s as f32);
    run_policy(actor, hopper, rho, start, hops, offset)
}

/// Returns the mean, and half the range.
pub(crate) fn mean_and_amplitude(values: &[f64]) -> (f64, f64) {
    let (low, high) =
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
    (values.iter().sum::<f64>() / values.len() as f64, (high - low) / 2.0)
}

/// Returns the paper's leg with another mass, kg, and stiffness, N/m, in a medium.
pub(crate) fn leg_with(mass_kg: f64, stiffness_n_m: f64, medium: Medium) -> Hopper {
    let human: LegParameters = Leg::human().into();
    let leg = Leg::new(LegParameters { mass_kg, stiffness_n_m, ..human });
    Hopper::new(&leg.expect("a mass and a stiffness above 0"), medium)
}

/// Reads an actor of the authors, if their data was found.
pub(crate) fn authors_actor(
    reference: Option<&Reference>,
    agent: &str,
) -> Result<Option<PackedActor>, FiguresError> {
    reference.map(|reference| reference.actor(agent)).transpose()
}

/// Returns everything that an actor depends on, as an input of a cached step.
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
    fn agrees_with_the_evaluation() {
        let policy = Policy::parse(SHIPPED).unwrap();
        let actor = policy.actor();
        let gains =
            GainPoint { ki: 0.2, feed_forward: 0.5, limit_m_s: 1.0, ..GainPoint::default() };
        let start = Apex { vx_m_s: 0.0, y_m: 2.0 };
        let run = run_cascade(actor, &hopper(0.0), gains, 1.0, start, 100);
        assert_eq!((run.hops(), run.actions.len(), run.fell), (100, 100, false));
        let expected = track(actor, &[gains].into_iter().collect(), 0.0, 1.0);
        let (mean, amplitude) = mean_and_amplitude(&run.last_vx_m_s(20).unwrap());
        assert_eq!((Some(mean), Some(amplitude)), (expected.mean_v, expected.oscillation));
    }

    #[test]
    fn ends_a_run_at_a_fall_and_reports_it() {
        let policy = Policy::parse(SHIPPED).unwrap();
        let nowhere = Apex { vx_m_s: 200.0, y_m: 1.2 };
        let run = run_policy(policy.actor(), &hopper(0.0), 0.0, nowhere, 9, |_| 0.0);
        assert!(run.fell && run.hops() < 9 && run.actions.len() == run.apexes.len(), "{run:?}");
        assert_eq!(run.last_vx_m_s(1), None);
    }
}
