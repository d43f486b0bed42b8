//! The gait, tick by tick: where in the hop the leg is, and what it does there.
//!
//! From measurements it finds touchdown, lift-off and the apex (each located between
//! ticks), or it follows an estimator that does ([`crate::estimator`]); and it turns the
//! action of the last apex into the leg's angle and elongation at every tick:
//!
//! - in flight the leg is held at the touchdown angle, unextended; the ramp of
//!   the elongation is armed to pass zero at the predicted touchdown, so that it
//!   starts in the middle of a tick if the foot lands there;
//! - in stance the rest length grows at the action's speed from touchdown on,
//!   up to the leg's limit, and the angle follows the pivoting leg.

use crate::actor::Action;
use crate::command::{LegCommand, UPRIGHT_RAD};
#[cfg(feature = "estimator")]
use crate::estimator::{Acted, Edge};
use crate::geometry::{foot_to_mass, leg_angle_rad};
use crate::guard::Trusted;
use crate::math::sqrt;
use crate::measurement::{Contact, Measurement};
use nalgebra::Vector2;

/// A leg counts as loaded when it is shorter than its rest length by more than
/// this part of it: above the noise of a length sensor, below any real load.
pub(crate) const LENGTH_TOLERANCE: f32 = 1e-4;

/// State at an apex, located between two measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Apex {
    /// Horizontal velocity, m/s.
    pub vx_m_s: f32,
    /// Height above the ground, m.
    pub y_m: f32,
}

/// The motion of the mass at a measurement.
#[derive(Clone, Copy, Debug)]
struct Motion {
    t_ns: u64,
    vx_m_s: f32,
    y_m: f32,
    vy_m_s: f32,
}

impl Motion {
    fn of(measurement: &Measurement) -> Self {
        let &Measurement { t_ns, vx_m_s, y_m, vy_m_s, .. } = measurement;
        Self { t_ns, vx_m_s, y_m, vy_m_s }
    }

    /// Returns the time since the measurement before, s.
    fn seconds_after(&self, before: &Self) -> f32 {
        // At most the longest gap, 1 s: 32 bits are enough, and need no software.
        1e-9 * self.t_ns.saturating_sub(before.t_ns) as u32 as f32
    }
}

/// Returns the time from `earlier_ns` to `later_ns`, s; 0 unless that is later.
fn seconds_between(earlier_ns: u64, later_ns: u64) -> f32 {
    1e-9 * later_ns.saturating_sub(earlier_ns) as f32
}

/// The action in force, with what is computed from it once.
#[derive(Clone, Copy, Debug)]
struct Plan {
    action: Action,
    /// From the foot to the mass when the foot touches flat ground, m.
    touchdown: Vector2<f32>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Flight,
    Stance {
        /// Time of touchdown, ns; the elongation counts from it.
        touchdown_ns: u64,
        /// Elongation speed of this stance, m/s: an action that is set in stance
        /// holds for the next one.
        elongation_speed_m_s: f32,
        /// Horizontal distance from the foot to the mass, m.
        from_foot_m: f32,
    },
}

/// The gait and its memory.
#[derive(Clone, Debug)]
pub struct Gait {
    rest_length_m: f32,
    max_elongation_m: f32,
    phase: Phase,
    plan: Option<Plan>,
    now: Option<Motion>,
    /// Vertical acceleration between the last two measurements in flight, m/s2.
    vertical_accel_m_s2: f32,
    /// Time from the last measurement to the predicted touchdown, s; below 0 where the
    /// foot is thought to have landed.
    time_to_touchdown_s: Option<f32>,
    /// Time of the touchdown that is suspected, ns; only from an estimator.
    landed_ns: Option<u64>,
    /// The motion is that of an estimator.
    is_estimated: bool,
    /// The ramp of the elongation is armed for the touchdown that is predicted.
    touchdown_is_foreseen: bool,
}

/// What an estimator says at a measurement: velocities, m/s, height, m, and the vertical
/// acceleration in flight, m/s2.
#[cfg(feature = "estimator")]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Followed {
    pub(crate) t_ns: u64,
    pub(crate) vx_m_s: f32,
    pub(crate) y_m: f32,
    pub(crate) vy_m_s: f32,
    pub(crate) ay_m_s2: f32,
    /// A change of the phase.
    pub(crate) edge: Option<Edge>,
    /// A touchdown that is suspected, not proven.
    pub(crate) suspected: Option<Edge>,
    /// Whether the touchdown is foreseen so well that the ramp may be armed for it.
    pub(crate) touchdown_is_foreseen: bool,
}

impl Gait {
    /// Returns a gait in flight, without an action, for a leg of these lengths, m.
    #[must_use]
    pub fn new(rest_length_m: f32, max_elongation_m: f32) -> Self {
        Self {
            rest_length_m,
            max_elongation_m,
            phase: Phase::Flight,
            plan: None,
            now: None,
            vertical_accel_m_s2: 0.0,
            time_to_touchdown_s: None,
            landed_ns: None,
            is_estimated: false,
            touchdown_is_foreseen: true,
        }
    }

    /// Changes the lengths of the leg, m; phase and action stay as they are.
    pub fn set_lengths(&mut self, rest_length_m: f32, max_elongation_m: f32) {
        self.rest_length_m = rest_length_m;
        self.max_elongation_m = max_elongation_m;
    }

    /// Returns whether the foot is off the ground.
    #[must_use]
    pub fn in_flight(&self) -> bool {
        self.phase == Phase::Flight
    }

    /// Returns whether there is an action to follow.
    #[must_use]
    pub fn has_action(&self) -> bool {
        self.plan.is_some()
    }

    /// Sets the action for the next touchdown and stance.
    pub fn set_action(&mut self, action: Action) {
        let touchdown = foot_to_mass(self.rest_length_m, action.touchdown_angle_rad);
        self.plan = Some(Plan { action, touchdown });
    }

    /// Takes a measurement; returns the apex passed since the last one, if any.
    pub fn update(&mut self, measurement: Trusted<'_>) -> Option<Apex> {
        let measurement = measurement.measurement();
        let now = Motion::of(measurement);
        let before = self.now.replace(now);
        let was_in_flight = self.in_flight();
        let contact = self.is_loaded(measurement, LENGTH_TOLERANCE * self.rest_length_m);
        match (self.phase, contact) {
            (Phase::Flight, true) => self.touch_down(now, before),
            (Phase::Stance { .. }, false) => self.phase = Phase::Flight,
            _ => {}
        }
        let before = before?;
        if self.in_flight() && was_in_flight {
            let dt = now.seconds_after(&before);
            self.vertical_accel_m_s2 = (now.vy_m_s - before.vy_m_s) / dt;
        }
        if !was_in_flight {
            self.pivot(now, before);
        }
        apex_between(before, now)
    }

    /// Takes what an estimator says at a measurement, in place of [`Self::update`].
    #[cfg(feature = "estimator")]
    pub(crate) fn follow(&mut self, followed: &Followed) {
        let &Followed { t_ns, vx_m_s, y_m, vy_m_s, ay_m_s2, edge, suspected, .. } = followed;
        self.touchdown_is_foreseen = followed.touchdown_is_foreseen;
        let now = Motion { t_ns, vx_m_s, y_m, vy_m_s };
        let before = self.now.replace(now);
        self.vertical_accel_m_s2 = ay_m_s2;
        self.is_estimated = true;
        match (edge, suspected) {
            (Some(edge), _) => return self.change_phase(edge, false, now, before),
            (None, Some(edge)) => return self.change_phase(edge, true, now, before),
            (None, None) => (),
        }
        self.landed_ns = None;
        if let (Phase::Stance { .. }, Some(before)) = (self.phase, before) {
            self.pivot(now, before);
        }
    }

    /// Takes what the leg does in place of what the action asks for, of a leg that another
    /// controller moves: the angle of the leg in flight, and the elongation in stance at a time.
    #[cfg(feature = "estimator")]
    pub(crate) fn follow_acted(&mut self, t_ns: u64, acted: &Acted) {
        match &mut self.phase {
            Phase::Flight => {
                if let Some(touchdown_angle_rad) = acted.leg_angle_rad {
                    let elongation_speed_m_s =
                        self.plan.map_or(0.0, |plan| plan.action.elongation_speed_m_s);
                    self.set_action(Action { touchdown_angle_rad, elongation_speed_m_s });
                }
            }
            Phase::Stance { touchdown_ns, elongation_speed_m_s, .. } => {
                let since_s = seconds_between(*touchdown_ns, t_ns);
                if let Some(elongation_m) = acted.elongation_m {
                    // A ramp from touchdown on that is as long now.
                    let speed_m_s = elongation_m / since_s;
                    let is_ramp = (0.0..=f32::MAX).contains(&speed_m_s);
                    *elongation_speed_m_s = if is_ramp { speed_m_s } else { 0.0 };
                }
            }
        }
    }

    /// Changes the phase, or notes that it may have changed. Not inlined: an ordinary tick
    /// does not call it.
    #[cfg(feature = "estimator")]
    #[inline(never)]
    fn change_phase(
        &mut self,
        edge: Edge,
        is_suspected: bool,
        now: Motion,
        before: Option<Motion>,
    ) {
        if !edge.in_stance {
            self.phase = Phase::Flight;
            return;
        }
        // Between the readings by which the foot has landed, where it was predicted.
        let landed_ns = self.landed_ns.unwrap_or_else(|| {
            let predicted_ns = before.zip(self.time_to_touchdown_s).map(|(before, time_s)| {
                // Within 4 s: 32 bits are enough, and need no software.
                let time_s = if time_s < 4.0 { time_s } else { 4.0 };
                before.t_ns.saturating_add(u64::from((1e9 * time_s) as u32))
            });
            predicted_ns.unwrap_or(edge.until_ns).max(edge.after_ns).min(edge.until_ns)
        });
        if is_suspected {
            self.landed_ns = Some(landed_ns);
        } else {
            self.landed_ns = None;
            self.stand(landed_ns, seconds_between(landed_ns, now.t_ns), now);
        }
    }

    /// Returns the height of the mass at which the foot touches flat ground, m.
    #[cfg(feature = "estimator")]
    pub(crate) fn touchdown_y_m(&self) -> f32 {
        self.plan.map_or(self.rest_length_m, |plan| plan.touchdown.y)
    }

    /// Returns what the leg does from the last measurement to the next.
    pub fn command(&mut self) -> LegCommand {
        self.time_to_touchdown_s = None;
        let (Some(plan), Some(now)) = (self.plan, self.now) else {
            return LegCommand::SAFE;
        };
        match self.phase {
            Phase::Flight => {
                self.time_to_touchdown_s = match self.landed_ns {
                    Some(landed_ns) => Some(-seconds_between(landed_ns, now.t_ns)),
                    None => self.predict_touchdown(now, plan.touchdown.y),
                };
                let rate = plan.action.elongation_speed_m_s;
                let (elongation_m, elongation_rate_m_s) =
                    self.time_to_touchdown_s.map_or((0.0, 0.0), |s| self.ramp(-rate * s, rate));
                LegCommand {
                    leg_angle_rad: plan.action.touchdown_angle_rad,
                    elongation_m,
                    elongation_rate_m_s,
                }
            }
            Phase::Stance { touchdown_ns, elongation_speed_m_s, from_foot_m } => {
                let since_s = seconds_between(touchdown_ns, now.t_ns);
                let grown_m = elongation_speed_m_s * since_s;
                let (elongation_m, elongation_rate_m_s) = self.ramp(grown_m, elongation_speed_m_s);
                let leg_angle_rad = leg_angle_rad(Vector2::new(from_foot_m, now.y_m));
                LegCommand { leg_angle_rad, elongation_m, elongation_rate_m_s }
            }
        }
    }

    /// Returns elongation, m, and rate, m/s, of a ramp that has grown to `grown_m`.
    fn ramp(&self, grown_m: f32, rate_m_s: f32) -> (f32, f32) {
        if grown_m < self.max_elongation_m {
            (grown_m, rate_m_s)
        } else {
            (self.max_elongation_m, 0.0)
        }
    }

    /// Returns the apex from which a leg that falls freely at this measurement has come:
    /// of the same energy, as if without drag. None while it rises or stands.
    #[must_use]
    pub fn apex_behind(&self) -> Option<Apex> {
        let now = self.now.filter(|now| self.in_flight() && now.vy_m_s <= 0.0)?;
        let fallen_m = if self.vertical_accel_m_s2 < 0.0 {
            -0.5 * now.vy_m_s * now.vy_m_s / self.vertical_accel_m_s2
        } else {
            0.0
        };
        Some(Apex { vx_m_s: now.vx_m_s, y_m: now.y_m + fallen_m })
    }

    /// Returns whether a measurement shows a loaded foot: where it has the leg length only,
    /// a leg that is shorter than its rest length by more than `tolerance_m`.
    pub(crate) fn is_loaded(&self, measurement: &Measurement, tolerance_m: f32) -> bool {
        let length_m = match measurement.contact {
            Contact::Sensed(is_loaded) => return is_loaded,
            Contact::LegLength(length_m) => length_m,
        };
        length_m < self.rest_m(measurement.t_ns) - tolerance_m
    }

    /// Returns the rest length of the unextended leg, m.
    #[cfg(feature = "estimator")]
    pub(crate) fn rest_length_m(&self) -> f32 {
        self.rest_length_m
    }

    /// Returns the rest length of the leg with its elongation at a time, m.
    pub(crate) fn rest_m(&self, t_ns: u64) -> f32 {
        let elongation_m = match self.phase {
            Phase::Flight => 0.0,
            Phase::Stance { touchdown_ns, elongation_speed_m_s, .. } => {
                let grown_m = elongation_speed_m_s * seconds_between(touchdown_ns, t_ns);
                if grown_m < self.max_elongation_m { grown_m } else { self.max_elongation_m }
            }
        };
        self.rest_length_m + elongation_m
    }

    fn touch_down(&mut self, now: Motion, before: Option<Motion>) {
        let since_s = before.map_or(0.0, |before| {
            let tick_s = now.seconds_after(&before);
            match self.time_to_touchdown_s {
                Some(predicted) if predicted < tick_s => tick_s - predicted,
                // Touchdown came earlier than predicted: take this measurement's time.
                _ => 0.0,
            }
        });
        // At most the longest gap, 1 s: 32 bits are enough, and need no software.
        let touchdown_ns = now.t_ns.saturating_sub(u64::from((1e9 * since_s) as u32));
        self.stand(touchdown_ns, since_s, now);
    }

    /// Begins a stance, `since_s` after its touchdown.
    fn stand(&mut self, touchdown_ns: u64, since_s: f32, now: Motion) {
        let (touchdown, elongation_speed_m_s) = match self.plan {
            Some(plan) => (plan.touchdown, plan.action.elongation_speed_m_s),
            None => (foot_to_mass(self.rest_length_m, UPRIGHT_RAD), 0.0),
        };
        self.phase = Phase::Stance {
            touchdown_ns,
            elongation_speed_m_s,
            from_foot_m: touchdown.x + now.vx_m_s * since_s,
        };
    }

    /// Moves the mass over the foot, while the foot stands.
    fn pivot(&mut self, now: Motion, before: Motion) {
        if let Phase::Stance { from_foot_m, .. } = &mut self.phase {
            let dt = now.seconds_after(&before);
            *from_foot_m += 0.5 * (before.vx_m_s + now.vx_m_s) * dt;
        }
    }

    /// Returns the seconds until the mass falls to the touchdown height, if it ever does: the
    /// root of `h + vy s + a s^2 / 2`, in the form without cancellation. From readings none
    /// while the mass rises; from an estimate then too, so that the ramp is armed in time
    /// over a slow link.
    fn predict_touchdown(&self, now: Motion, touchdown_y_m: f32) -> Option<f32> {
        let rises = now.vy_m_s > 0.0;
        if (rises && !self.is_estimated) || !self.touchdown_is_foreseen {
            return None;
        }
        let h = now.y_m - touchdown_y_m;
        if h <= 0.0 && !rises {
            return Some(0.0);
        }
        let discriminant = now.vy_m_s * now.vy_m_s - 2.0 * self.vertical_accel_m_s2 * h;
        if discriminant <= 0.0 {
            return None;
        }
        let s = 2.0 * h / (sqrt(discriminant) - now.vy_m_s);
        // Below 0: behind, where the medium carries the mass.
        (0.0..=f32::MAX).contains(&s).then_some(s)
    }
}

/// Returns the apex between two measurements: where the vertical velocity, taken as
/// linear between them, goes through zero from above.
fn apex_between(before: Motion, now: Motion) -> Option<Apex> {
    if !(before.vy_m_s > 0.0 && now.vy_m_s <= 0.0) {
        return None;
    }
    let part = before.vy_m_s / (before.vy_m_s - now.vy_m_s);
    let dt = now.seconds_after(&before);
    Some(Apex {
        vx_m_s: before.vx_m_s + part * (now.vx_m_s - before.vx_m_s),
        y_m: before.y_m + 0.5 * before.vy_m_s * part * dt,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With the law's own commands a leg that another controller moves has a wrong rest length.
    #[cfg(feature = "estimator")]
    #[test]
    fn what_the_leg_did_takes_the_place_of_what_was_commanded() {
        let mut gait = Gait::new(1.0, 0.1);
        let acted = |leg_angle_rad, elongation_m| Acted { leg_angle_rad, elongation_m };
        let action = Action { touchdown_angle_rad: 1.8, elongation_speed_m_s: 0.5 };
        gait.set_action(action);
        gait.follow_acted(0, &acted(Some(1.6), Some(0.05)));
        assert!((gait.touchdown_y_m() - libm::sinf(1.6)).abs() < 1e-5, "held at another angle");
        assert_eq!(gait.rest_m(0), 1.0, "elongation begins at touchdown");

        let motion = Motion { t_ns: 1_000_000_000, vx_m_s: 0.0, y_m: 1.0, vy_m_s: -1.0 };
        gait.stand(motion.t_ns, 0.0, motion);
        let at = |ms: u64| motion.t_ns + ms * 1_000_000;
        assert!((gait.rest_m(at(40)) - 1.02).abs() < 1e-6, "as commanded");
        for (ms, elongation_m, rest_m) in
            [(40, 0.05, 1.05), (41, 0.0, 1.0), (42, 0.3, 1.1), (43, -0.1, 1.0), (0, 0.05, 1.0)]
        {
            gait.follow_acted(at(ms), &acted(None, Some(elongation_m)));
            let found = gait.rest_m(at(ms));
            assert!((found - rest_m).abs() < 1e-6, "{found} for {elongation_m} m");
        }
    }

    #[test]
    fn an_apex_is_located_between_ticks() {
        let at = |t_ns, vx_m_s, y_m, vy_m_s| Motion { t_ns, vx_m_s, y_m, vy_m_s };
        // Free fall of 10 m/s2 through an apex of 2 m, a quarter of a tick late.
        let tick_s = 1e-3_f32;
        let y = |t: f32| 2.0 - 5.0 * t * t;
        let (t0, t1) = (-0.25 * tick_s, 0.75 * tick_s);
        let apex =
            apex_between(at(0, 1.0, y(t0), -10.0 * t0), at(1_000_000, 1.1, y(t1), -10.0 * t1))
                .unwrap();
        assert!((apex.vx_m_s - 1.025).abs() < 1e-6);
        assert!((apex.y_m - 2.0).abs() < 1e-6);
        assert_eq!(apex_between(at(0, 0.0, 2.0, -0.1), at(1, 0.0, 2.0, -0.2)), None);
    }
}
