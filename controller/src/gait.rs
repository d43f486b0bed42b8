//! The gait, tick by tick: where in the hop the leg is, and what it does there.
//!
//! From samples it finds touchdown, lift-off and the apex (each located between
//! ticks), and it turns the action of the last apex into the leg's angle and
//! elongation at every tick:
//!
//! - in flight the leg is held at the touchdown angle, unextended; the ramp of
//!   the elongation is armed to pass zero at the touchdown that is foreseen, so
//!   that it starts in the middle of a tick if the foot lands there;
//! - in stance the rest length grows at the action's speed from touchdown on,
//!   up to the leg's limit, and the angle follows the pivoting leg.

use crate::actor::Action;
use crate::guard::Trusted;
use crate::trig::sin_cos;
use crate::wire::flags;
use micromath::F32Ext;

/// A leg counts as loaded when it is shorter than its rest length by more than
/// this part of it: above the noise of a length sensor, below any real load.
const LENGTH_TOLERANCE: f32 = 1e-4;

/// The leg stands upright when nothing better is known, rad.
pub const UPRIGHT_RAD: f32 = core::f32::consts::FRAC_PI_2;

/// State at an apex, located between two samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Apex {
    /// Horizontal velocity, m/s.
    pub vx_m_s: f32,
    /// Height above the ground, m.
    pub y_m: f32,
}

/// What the leg is to do from this tick to the next; see [`crate::wire::Command`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegTarget {
    /// Angle from the +x axis, rad.
    pub angle_rad: f32,
    /// Elongation at the tick, m; below 0 before touchdown.
    pub elongation_m: f32,
    /// Its rate, m/s.
    pub elongation_rate_m_s: f32,
}

impl LegTarget {
    /// Upright and passive: the spring bears the leg and adds no energy. What
    /// the leg does when the controller does not know better.
    pub const SAFE: Self =
        Self { angle_rad: UPRIGHT_RAD, elongation_m: 0.0, elongation_rate_m_s: 0.0 };
}

/// The motion of the mass at a sample.
#[derive(Clone, Copy, Debug)]
struct Motion {
    t_ns: u64,
    vx_m_s: f32,
    y_m: f32,
    vy_m_s: f32,
}

impl Motion {
    fn of(sample: &Trusted) -> Self {
        let s = sample.sample();
        Self { t_ns: s.header.t_ns, vx_m_s: s.vx_m_s, y_m: s.y_m, vy_m_s: s.vy_m_s }
    }

    fn seconds_since(&self, earlier_ns: u64) -> f32 {
        1e-9 * self.t_ns.saturating_sub(earlier_ns) as f32
    }
}

/// The action in force, with what is computed from it once.
#[derive(Clone, Copy, Debug)]
struct Plan {
    action: Action,
    /// Height of the mass when the foot touches flat ground, m.
    touchdown_y_m: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Flight,
    Stance {
        /// Time of touchdown; the elongation counts from it.
        touchdown_ns: u64,
        /// Elongation speed of this stance, m/s: an action that comes in
        /// stance waits for the next one.
        elongation_speed_m_s: f32,
        /// From the foot to the mass, horizontally, m.
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
    /// Vertical acceleration between the last two samples in flight, m/s2.
    fall_m_s2: f32,
    /// Time to the touchdown foreseen at the last sample, s.
    touchdown_in_s: Option<f32>,
}

impl Gait {
    /// A gait in flight that has seen nothing, for a leg of these lengths.
    #[must_use]
    pub fn new(rest_length_m: f32, max_elongation_m: f32) -> Self {
        Self {
            rest_length_m,
            max_elongation_m,
            phase: Phase::Flight,
            plan: None,
            now: None,
            fall_m_s2: 0.0,
            touchdown_in_s: None,
        }
    }

    /// Goes on with a leg of other lengths; the hop stays where it is.
    pub fn refit(&mut self, rest_length_m: f32, max_elongation_m: f32) {
        self.rest_length_m = rest_length_m;
        self.max_elongation_m = max_elongation_m;
    }

    /// Whether the foot is off the ground.
    #[must_use]
    pub fn in_flight(&self) -> bool {
        self.phase == Phase::Flight
    }

    /// Whether there is an action to go by.
    #[must_use]
    pub fn has_action(&self) -> bool {
        self.plan.is_some()
    }

    /// Takes the action for the flight and stance to come.
    pub fn set_action(&mut self, action: Action) {
        let touchdown_y_m = self.rest_length_m * sin_cos(action.touchdown_angle_rad).0;
        self.plan = Some(Plan { action, touchdown_y_m });
    }

    /// Takes a sample; returns the apex that was passed since the last one.
    pub fn sense(&mut self, sample: &Trusted) -> Option<Apex> {
        let now = Motion::of(sample);
        let before = self.now.replace(now);
        let was_in_flight = self.in_flight();
        let contact = self.is_loaded(sample);
        match (self.phase, contact) {
            (Phase::Flight, true) => self.touch_down(now, before),
            (Phase::Stance { .. }, false) => self.phase = Phase::Flight,
            _ => {}
        }
        let before = before?;
        if self.in_flight() && was_in_flight {
            let dt = now.seconds_since(before.t_ns);
            self.fall_m_s2 = (now.vy_m_s - before.vy_m_s) / dt;
        }
        if !was_in_flight {
            self.pivot(now, before);
        }
        apex_between(before, now)
    }

    /// What to do from the last sample to the next.
    pub fn target(&mut self) -> LegTarget {
        self.touchdown_in_s = None;
        let (Some(plan), Some(now)) = (self.plan, self.now) else {
            return LegTarget::SAFE;
        };
        match self.phase {
            Phase::Flight => {
                self.touchdown_in_s = self.foresee_touchdown(now, plan.touchdown_y_m);
                let rate = plan.action.elongation_speed_m_s;
                let (elongation_m, elongation_rate_m_s) =
                    self.touchdown_in_s.map_or((0.0, 0.0), |s| (-rate * s, rate));
                LegTarget {
                    angle_rad: plan.action.touchdown_angle_rad,
                    elongation_m,
                    elongation_rate_m_s,
                }
            }
            Phase::Stance { touchdown_ns, elongation_speed_m_s, from_foot_m } => {
                let grown_m = elongation_speed_m_s * now.seconds_since(touchdown_ns);
                let (elongation_m, elongation_rate_m_s) = if grown_m < self.max_elongation_m {
                    (grown_m, elongation_speed_m_s)
                } else {
                    (self.max_elongation_m, 0.0)
                };
                // For a hip that must not fight the ground, a few mrad are
                // plenty: micromath's atan2 is within 3 (test below).
                let angle_rad = F32Ext::atan2(now.y_m, from_foot_m);
                LegTarget { angle_rad, elongation_m, elongation_rate_m_s }
            }
        }
    }

    /// The apex that a leg falling freely at this sample has come from, or is
    /// at: same energy, as if without drag. None while it rises or stands.
    #[must_use]
    pub fn apex_behind(&self) -> Option<Apex> {
        let now = self.now.filter(|now| self.in_flight() && now.vy_m_s <= 0.0)?;
        let fallen_m = if self.fall_m_s2 < 0.0 {
            -0.5 * now.vy_m_s * now.vy_m_s / self.fall_m_s2
        } else {
            0.0
        };
        Some(Apex { vx_m_s: now.vx_m_s, y_m: now.y_m + fallen_m })
    }

    fn is_loaded(&self, sample: &Trusted) -> bool {
        if sample.has(flags::CONTACT_SENSED) {
            return sample.has(flags::IN_CONTACT);
        }
        let s = sample.sample();
        let elongation_m = match self.phase {
            Phase::Flight => 0.0,
            Phase::Stance { touchdown_ns, elongation_speed_m_s, .. } => {
                let since_s = 1e-9 * s.header.t_ns.saturating_sub(touchdown_ns) as f32;
                let grown_m = elongation_speed_m_s * since_s;
                if grown_m < self.max_elongation_m { grown_m } else { self.max_elongation_m }
            }
        };
        let rest_m = self.rest_length_m + elongation_m;
        s.leg_length_m < rest_m - LENGTH_TOLERANCE * self.rest_length_m
    }

    fn touch_down(&mut self, now: Motion, before: Option<Motion>) {
        let since_s = before.map_or(0.0, |before| {
            let tick_s = now.seconds_since(before.t_ns);
            match self.touchdown_in_s {
                Some(foreseen) if foreseen < tick_s => tick_s - foreseen,
                // The ground came before it was foreseen: in this very instant,
                // for all that is known.
                _ => 0.0,
            }
        });
        let angle_rad = self.plan.map_or(UPRIGHT_RAD, |p| p.action.touchdown_angle_rad);
        self.phase = Phase::Stance {
            touchdown_ns: now.t_ns.saturating_sub((1e9 * since_s) as u64),
            elongation_speed_m_s: self.plan.map_or(0.0, |p| p.action.elongation_speed_m_s),
            from_foot_m: self.rest_length_m * sin_cos(angle_rad).1 + now.vx_m_s * since_s,
        };
    }

    /// Moves the mass over the foot, while it stands.
    fn pivot(&mut self, now: Motion, before: Motion) {
        if let Phase::Stance { from_foot_m, .. } = &mut self.phase {
            let dt = now.seconds_since(before.t_ns);
            *from_foot_m += 0.5 * (before.vx_m_s + now.vx_m_s) * dt;
        }
    }

    /// Seconds until the falling mass is at the touchdown height, if it ever
    /// is: the root of `h + vy s + a s^2 / 2`, in the form without cancellation.
    fn foresee_touchdown(&self, now: Motion, touchdown_y_m: f32) -> Option<f32> {
        if now.vy_m_s > 0.0 {
            return None;
        }
        let h = now.y_m - touchdown_y_m;
        if h <= 0.0 {
            return Some(0.0);
        }
        let discriminant = now.vy_m_s * now.vy_m_s - 2.0 * self.fall_m_s2 * h;
        if discriminant <= 0.0 {
            return None;
        }
        let s = 2.0 * h / (libm::sqrtf(discriminant) - now.vy_m_s);
        s.is_finite().then_some(s)
    }
}

/// The apex between two samples: where the vertical velocity, taken as linear
/// between them, goes through zero from above.
fn apex_between(before: Motion, now: Motion) -> Option<Apex> {
    if !(before.vy_m_s > 0.0 && now.vy_m_s <= 0.0) {
        return None;
    }
    let part = before.vy_m_s / (before.vy_m_s - now.vy_m_s);
    let dt = now.seconds_since(before.t_ns);
    Some(Apex {
        vx_m_s: before.vx_m_s + part * (now.vx_m_s - before.vx_m_s),
        y_m: before.y_m + 0.5 * before.vy_m_s * part * dt,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fast_atan2_is_good_enough_for_the_hip() {
        let worst = (1..3141)
            .map(|i| i as f32 * 1e-3)
            .map(|a| (F32Ext::atan2(a.sin(), a.cos()) - a).abs())
            .fold(0.0_f32, f32::max);
        assert!(worst < 3e-3, "{worst} rad");
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
