//! The stance of the tick plant, without losses and with them.

use super::{Body, EventKind, Phase, Tick, TickEvents, TickPlant};
use crate::contact::{Contact, ContactCorner, Forces};
use crate::elongation::{Elongation, Ramp};
use crate::ground::Ground;
use crate::pair::Pair;
use crate::roots::falling_root;
use crate::stance::Segment;
use crate::taylor::{Jet, State};

/// Longest time over which a series is not checked against the cone of friction.
const CONE_CHECK_S: f64 = 1e-3;

/// A part of a stance within a tick, over which the ramp of the elongation has no corner.
struct Part {
    from_s: f64,
    until_s: f64,
    foot_m: [f64; 2],
}

impl Part {
    fn limit_s(&self) -> f64 {
        self.until_s - self.from_s
    }

    /// Returns the time in the tick at which a segment of this length ends.
    fn end_s(&self, segment_s: f64) -> f64 {
        if segment_s == self.limit_s() { self.until_s } else { self.from_s + segment_s }
    }

    fn body(&self, state: &State) -> Body {
        Body {
            x_m: self.foot_m[0] + state.position_m[0],
            vx_m_s: state.velocity_m_s[0],
            y_m: self.foot_m[1] + state.position_m[1],
            vy_m_s: state.velocity_m_s[1],
        }
    }
}

impl TickPlant {
    /// Continues a stance to the end of the tick or the next corner, and returns the time of that.
    pub(super) fn stand<G: Ground>(
        &mut self,
        tick: &Tick<'_, G>,
        from_s: f64,
        foot_m: [f64; 2],
        known_length_m: Option<f64>,
        events: &mut TickEvents,
    ) -> f64 {
        let start = State {
            position_m: Pair([self.body.x_m - foot_m[0], self.body.y_m - foot_m[1]]),
            velocity_m_s: Pair([self.body.vx_m_s, self.body.vy_m_s]),
        };
        let (ramp, corner_s) = tick.elongation.ramp(from_s);
        let part = Part { from_s, until_s: corner_s.min(tick.end_s), foot_m };
        let forces = self.losses.act_in_stance().then(|| self.forces(tick, ramp));
        if let Some(forces) = &forces {
            let contact = Contact {
                body: start,
                foot_x_m: 0.0,
                foot_vx_m_s: self.foot_vx_m_s,
                slips: self.foot_slips,
            };
            if self.losses.damping_n_s_m > 0.0
                || self.foot_vx_m_s != 0.0
                || self.foot_slips
                || forces.margin_m_s2(&contact, 0.0) <= 0.0
            {
                let lands = known_length_m.is_some();
                return self.stand_with_losses(tick, &part, forces, &contact, lands, events);
            }
        }
        let mut jet = Jet::new(0.0);
        let mut segment = Segment::of_one(
            &mut jet,
            &tick.field,
            &start,
            ramp,
            known_length_m,
            part.limit_s(),
            self.tolerance.velocity_m_s,
        );
        let mut corner = if segment.corner.lift_off {
            ContactCorner::LiftOff
        } else if segment.corner.apex {
            ContactCorner::Apex
        } else {
            ContactCorner::Limit
        };
        if let Some(forces) = &forces {
            let margin = |t_s: f64| forces.margin_m_s2(&Contact::holding(jet.at(t_s)), t_s);
            if let Some(t_s) = first_loss(margin, segment.t_s) {
                segment.t_s = t_s;
                segment.state = jet.at(t_s);
                corner = ContactCorner::FootSlips;
            }
        }
        let end = part.body(&segment.state);
        if tick.body_height_over_ground(&end) <= 0.0 {
            let height = |t_s| tick.body_height_over_ground(&part.body(&jet.at(t_s)));
            let t_s = falling_root(height, 0.0, segment.t_s);
            self.fall(from_s + t_s, part.body(&jet.at(t_s)), events);
            return from_s + t_s;
        }
        let t_s = part.end_s(segment.t_s);
        self.body = end;
        self.turn(corner, t_s, events);
        t_s
    }

    /// Continues a stance with damping or a foot that slides.
    fn stand_with_losses<G: Ground>(
        &mut self,
        tick: &Tick<'_, G>,
        part: &Part,
        forces: &Forces,
        start: &Contact,
        lands: bool,
        events: &mut TickEvents,
    ) -> f64 {
        let segment = forces.integrate(start, lands, part.limit_s(), self.tolerance.velocity_m_s);
        let t_s = part.end_s(segment.t_s);
        let body = part.body(&segment.state.body);
        if tick.body_height_over_ground(&body) <= 0.0 {
            self.fall(t_s, body, events);
            return t_s;
        }
        self.body = body;
        self.foot_vx_m_s = segment.state.foot_vx_m_s;
        self.slid_m += segment.state.foot_x_m.abs();
        let [foot_x_m, foot_y_m] = part.foot_m;
        self.phase = Phase::Stance { foot_x_m: foot_x_m + segment.state.foot_x_m, foot_y_m };
        self.turn(segment.corner, t_s, events);
        t_s
    }

    /// Returns the elongation over a tick of a drive that stands still above this spring force.
    pub(super) fn within_drive_force(
        &mut self,
        commanded: Elongation,
        limit_n: f64,
        dt_s: f64,
    ) -> Elongation {
        if !matches!(self.phase, Phase::Stance { .. }) {
            self.missed_elongation_m = 0.0;
            return commanded;
        }
        let elongation =
            Elongation { start_m: commanded.start_m - self.missed_elongation_m, ..commanded };
        let p = self.leg.parameters();
        let force_n = p.stiffness_n_m * (self.unloaded_length_m - self.leg_length_m());
        let lengthens_m = elongation.ramp(dt_s).0.length_m - self.unloaded_length_m;
        if force_n > limit_n && lengthens_m > 0.0 {
            self.missed_elongation_m += lengthens_m;
            let start_m = self.unloaded_length_m - p.rest_length_m;
            return Elongation { start_m, rate_m_s: 0.0, ..elongation };
        }
        elongation
    }

    /// Reports the corner at which a segment ended, and lifts off if it is that.
    fn turn(&mut self, corner: ContactCorner, t_s: f64, events: &mut TickEvents) {
        self.foot_slips = false;
        match corner {
            ContactCorner::FootSlips if self.losses.foot_mass_kg > 0.0 => self.foot_slips = true,
            // A massless foot slides out from under the load at once.
            ContactCorner::LiftOff | ContactCorner::FootSlips => {
                self.phase = Phase::Flight;
                self.clear_angle_rad = None;
                self.take_up_the_foot();
                events.push(EventKind::LiftOff, t_s, self.body);
            }
            ContactCorner::Apex => events.push(EventKind::Apex, t_s, self.body),
            ContactCorner::Limit | ContactCorner::FootStops => {}
        }
    }

    /// Shares the momentum of body and foot between both.
    fn take_up_the_foot(&mut self) {
        let foot_mass_kg = self.losses.foot_mass_kg;
        if foot_mass_kg > 0.0 {
            let body_kg = self.moving_mass_kg();
            let both_kg = body_kg + foot_mass_kg;
            let foot_kg_m_s = foot_mass_kg * self.foot_vx_m_s;
            self.body.vx_m_s = (body_kg * self.body.vx_m_s + foot_kg_m_s) / both_kg;
            self.body.vy_m_s = body_kg * self.body.vy_m_s / both_kg;
        }
        self.foot_vx_m_s = 0.0;
    }

    /// Returns the moving mass of the body in stance, kg.
    fn moving_mass_kg(&self) -> f64 {
        let p = self.leg.parameters();
        p.mass_kg + p.added_mass_kg
    }

    fn forces<G>(&self, tick: &Tick<'_, G>, ramp: Ramp) -> Forces {
        let mass_kg = self.moving_mass_kg();
        Forces {
            field: tick.field,
            ramp,
            damping_per_s: self.losses.damping_n_s_m / mass_kg,
            friction: self.losses.friction,
            foot_share: self.losses.foot_mass_kg / mass_kg,
            gravity_m_s2: tick.gravity_m_s2,
        }
    }
}

/// Returns the first time up to `end_s` at which a margin that is above 0 at the start is lost. A
/// loss for less than [`CONE_CHECK_S`] may go unnoticed.
fn first_loss(margin: impl Fn(f64) -> f64, end_s: f64) -> Option<f64> {
    let checks = libm::ceil(end_s / CONE_CHECK_S).max(1.0);
    let (mut i, mut from_s) = (1.0, 0.0);
    while i <= checks {
        let until_s = if i == checks { end_s } else { end_s * i / checks };
        if margin(until_s) <= 0.0 {
            return Some(falling_root(margin, from_s, until_s));
        }
        from_s = until_s;
        i += 1.0;
    }
    None
}
