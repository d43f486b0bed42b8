//! The control law on an estimate in place of the readings.
//!
//! Readings tell the apex when it passes, and the action is decided then, once. An estimate
//! tells it from soon after lift-off on, and better and better until touchdown. So the
//! action is computed every [`DECIDE_EVERY_NS`] in flight, each time for the same apex and
//! from the same cascade; only once, when the apex has passed, does the cascade advance and
//! the telemetry count it. A command that takes long to the leg then carries an action for
//! this hop all the same.

use super::Controller;
use crate::actor::Observation;
use crate::command::{LegCommand, Status, Telemetry};
use crate::config::Config;
use crate::estimator::{Acted, Estimate, Estimator, Events, Filter};
use crate::gait::{Apex, Followed};
use crate::guard::{Channels, Trusted};
use crate::math::clamp;
use crate::policy::Policy;
use crate::velocity::{Cascade, gains_at};

/// Time between two computations of the action in flight, and from lift-off to the first,
/// ns.
const DECIDE_EVERY_NS: u64 = 20_000_000;

/// The estimator, and what is known of this hop.
#[derive(Clone, Debug)]
pub(super) struct Tracked {
    estimator: Estimator,
    /// The cascade before this hop.
    cascade_before: Cascade,
    /// The apex of this hop, by the last computation of its action.
    apex: Option<Apex>,
    /// Whether it has passed.
    has_passed: bool,
    /// Time of the next computation, ns.
    next_ns: u64,
}

impl Tracked {
    /// Returns an estimator that knows nothing yet, where the configuration asks for one.
    pub(super) fn new(policy: &Policy<'_>, config: &Config) -> Option<Self> {
        Some(Self {
            estimator: Estimator::new(&policy.manifest().leg, config)?,
            cascade_before: Cascade::new(),
            apex: None,
            has_passed: false,
            next_ns: 0,
        })
    }
}

/// When an action is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Moment {
    /// In flight, for an apex ahead or behind.
    InFlight,
    /// The apex has just passed.
    AtApex,
    /// The foot has landed and the apex was not noticed: too late for this hop.
    Landed,
}

impl Controller<'_> {
    /// Returns the estimate at the last measurement; none without an estimator, or before it
    /// has begun.
    #[must_use]
    pub fn estimate(&self) -> Option<Estimate> {
        self.tracked.as_ref().and_then(|tracked| tracked.estimator.estimate())
    }

    /// Takes what the leg does, for the measurement of the next step, in place of the law's own
    /// commands: so the estimate is right also of a leg that another controller moves.
    pub fn follow_acted(&mut self, t_ns: u64, acted: &Acted) {
        self.gait.follow_acted(t_ns, acted);
    }

    /// Forgets the estimate, if there is an estimator. Not inlined: few ticks call it.
    pub(super) fn forget_estimate(&mut self) {
        if self.tracked.is_some() {
            self.begin_estimate();
        }
    }

    /// Begins an estimate anew, where the configuration asks for one.
    #[inline(never)]
    pub(super) fn begin_estimate(&mut self) {
        self.tracked = Tracked::new(&self.policy, &self.config);
    }

    /// Passes the leg of the policy to the estimator.
    pub(super) fn set_leg_of_estimate(&mut self) {
        if let Some(tracked) = &mut self.tracked {
            let leg = &self.policy.manifest().leg;
            tracked.estimator.set_leg(leg, self.config.gravity_m_s2());
        }
    }

    /// Runs a tick with a measurement, by the estimate. Not inlined: a law on the readings
    /// does not pay for it.
    #[inline(never)]
    pub(super) fn advance_estimated(&mut self, measurement: Trusted<'_>) -> Status {
        let Some(tracked) = &mut self.tracked else { return Status::Safe };
        let (m, usable) = (measurement.measurement(), measurement.usable());
        let estimator = &mut tracked.estimator;
        let had_begun = estimator.has_begun();
        let limits = self.config.limits();
        let update = estimator.update(&measurement, &self.gait);
        let Some(events) = update.filter(|events| limits.could_be(events.motion)) else {
            if had_begun {
                self.guard.count_lost_estimate();
                self.forget();
            }
            self.command = LegCommand::SAFE;
            return Status::Safe;
        };
        let Events { edge, suspected, motion: [vx_m_s, y_m, vy_m_s], ay_m_s2, in_stance, .. } =
            events;
        self.gait.follow(&Followed {
            t_ns: m.t_ns,
            vx_m_s,
            y_m,
            vy_m_s,
            ay_m_s2,
            edge,
            suspected,
            touchdown_is_foreseen: events.touchdown_is_foreseen,
        });
        if edge.is_some_and(|edge| !edge.in_stance) {
            tracked.cascade_before = self.cascade.clone();
            (tracked.apex, tracked.has_passed) = (None, false);
            tracked.next_ns = m.t_ns.saturating_add(DECIDE_EVERY_NS);
        }
        // While a touchdown is suspected, the estimate may be one of a leg in stance.
        let is_due = m.t_ns >= tracked.next_ns && !in_stance && suspected.is_none();
        if events.passed_apex || (is_due && events.density_is_known) {
            tracked.next_ns = m.t_ns.saturating_add(DECIDE_EVERY_NS);
            let moment = match (events.passed_apex, edge) {
                (true, Some(edge)) if edge.in_stance => Moment::Landed,
                (true, _) => Moment::AtApex,
                (false, _) => Moment::InFlight,
            };
            let by_model = if in_stance { tracked.apex } else { estimator.apex() };
            let here = events.passed_apex.then_some(Apex { vx_m_s, y_m });
            let apex = by_model.or(here).filter(|apex| (apex.vx_m_s + apex.y_m).is_finite());
            if let Some(apex) = apex {
                let measured = m.density_ratio.filter(|_| usable.has(Channels::DENSITY));
                let density_ratio = measured.unwrap_or(estimator.density_ratio());
                self.decide_estimated(apex, density_ratio, moment);
            }
        }
        self.command = self.gait.command();
        self.checked(Status::Running)
    }

    /// Runs cascade and actor for the apex of this hop. Not inlined: an ordinary tick does
    /// not call it.
    #[inline(never)]
    fn decide_estimated(&mut self, apex: Apex, density_ratio: f32, moment: Moment) {
        if moment != Moment::InFlight {
            self.take_next();
        }
        let Some(tracked) = &mut self.tracked else { return };
        if moment != Moment::InFlight {
            // A second apex without a lift-off between them: in stance.
            if tracked.has_passed {
                tracked.cascade_before = self.cascade.clone();
            }
            tracked.has_passed = true;
        }
        tracked.apex = Some(apex);
        let manifest = self.policy.manifest();
        let density_ratio = clamp(density_ratio, manifest.media.density_ratio);
        let apex_y_m = clamp(apex.y_m, self.config.limits().height_m);
        let gains = gains_at(&manifest.gains, density_ratio);
        let mut cascade = tracked.cascade_before.clone();
        let offset = cascade.update(&gains, self.set_point_m_s, apex.vx_m_s);
        if tracked.has_passed {
            self.cascade = cascade;
        }
        if moment != Moment::Landed {
            let observation =
                Observation { apex_vx_m_s: apex.vx_m_s - offset, apex_y_m, density_ratio };
            self.gait.set_action(self.policy.actor().act(observation));
        }
        if moment != Moment::InFlight {
            self.telemetry = Telemetry {
                apex_vx_m_s: apex.vx_m_s,
                apex_y_m,
                density_ratio: Some(density_ratio),
                velocity_offset_m_s: offset,
                apexes: self.telemetry.apexes.saturating_add(1),
            };
        }
    }
}
