//! Stance with losses: the equations of [`crate::losses`], integrated step by step.
//!
//! A leg without damping whose foot holds obeys the equations of [`crate::stance`], and is
//! integrated there. The right-hand side here depends on the rate of the leg length, and has the
//! motion of the foot, so it has a method of its own: Dormand and Prince's pair of orders 5 and 4
//! (J. Comp. Appl. Math. 6, 1980) with steps that keep the error of the velocities below the
//! tolerance. The state inside a step is that of a shorter step from the same start, which is no
//! less accurate; events are roots of functions of it.

use libm::sqrt;

use crate::elongation::Ramp;
use crate::pair::Pair;
use crate::roots::falling_root;
use crate::taylor::{Field, State};

/// State of a stance with losses, relative to a fixed place on the ground.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    pub(crate) body: State,
    pub(crate) foot_x_m: f64,
    pub(crate) foot_vx_m_s: f64,
    /// The force on the foot has just left the cone of friction. The margin of the force is 0
    /// then but for rounding, which must not decide whether the foot holds.
    pub(crate) slips: bool,
}

/// Values that are constant over one segment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Forces {
    pub(crate) field: Field,
    pub(crate) ramp: Ramp,
    /// Damping per moving mass of the body.
    pub(crate) damping_per_s: f64,
    pub(crate) friction: Option<f64>,
    /// Mass of the foot over the moving mass of the body.
    pub(crate) foot_share: f64,
    pub(crate) gravity_m_s2: f64,
}

/// The event that ends a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ContactCorner {
    /// No event: the limit of the step or of the time.
    Limit,
    /// The mass stops rising.
    Apex,
    /// The leg carries no more load.
    LiftOff,
    /// The force on the foot leaves the cone of friction.
    FootSlips,
    /// A foot that slides stops.
    FootStops,
}

/// End of a segment.
pub(crate) struct ContactSegment {
    pub(crate) t_s: f64,
    pub(crate) state: Contact,
    pub(crate) corner: ContactCorner,
}

/// What the foot does during a segment: it holds, or slides with a velocity of this sign.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Footing {
    Holds,
    Slides(f64),
}

/// Position, velocity, and place and velocity of the foot.
type Numbers = [f64; 6];

/// Stages of the method after the first: the weights of the slopes before each.
const STAGES: [&[f64]; 6] = [
    &[1.0 / 5.0],
    &[3.0 / 40.0, 9.0 / 40.0],
    &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
    &[19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0],
    &[9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0],
    &[35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];

/// Times of the stages as shares of the step.
const TIMES: [f64; 6] = [1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];

/// Weights of the slopes in the difference of both orders.
const ERROR: [f64; 7] = [
    71.0 / 57600.0,
    0.0,
    -71.0 / 16695.0,
    71.0 / 1920.0,
    -17253.0 / 339_200.0,
    22.0 / 525.0,
    -1.0 / 40.0,
];

/// Number of tries for the length of a step; a state that is not finite needs all of them.
const MAX_TRIES: u32 = 40;

impl Contact {
    /// Creates the state of a leg whose foot holds at the place to which it is relative.
    pub(crate) fn holding(body: State) -> Self {
        Self { body, foot_x_m: 0.0, foot_vx_m_s: 0.0, slips: false }
    }

    fn numbers(&self) -> Numbers {
        let State { position_m: p, velocity_m_s: v } = self.body;
        [p[0], p[1], v[0], v[1], self.foot_x_m, self.foot_vx_m_s]
    }

    fn of([x, y, vx, vy, foot_x_m, foot_vx_m_s]: Numbers) -> Self {
        let body = State { position_m: Pair([x, y]), velocity_m_s: Pair([vx, vy]) };
        Self { body, foot_x_m, foot_vx_m_s, slips: false }
    }

    /// Returns the vector from the foot to the body, m.
    fn leg_m(&self) -> Pair {
        self.body.position_m - Pair([self.foot_x_m, 0.0])
    }

    /// Returns the velocity of the body relative to the foot, m/s.
    fn velocity_of_leg(&self) -> Pair {
        self.body.velocity_m_s - Pair([self.foot_vx_m_s, 0.0])
    }
}

impl Forces {
    /// Integrates from `start` to the first corner, or one step, at most for `limit_s`.
    ///
    /// `lands` tells that the foot touches down at the start, where the leg has its rest length
    /// up to rounding.
    pub(crate) fn integrate(
        &self,
        start: &Contact,
        lands: bool,
        limit_s: f64,
        tolerance_m_s: f64,
    ) -> ContactSegment {
        let ends_at = |t_s: f64, state: Contact, corner| ContactSegment { t_s, state, corner };
        let leg = start.leg_m();
        let closing = leg.dot(start.velocity_of_leg()) < self.ramp.rate_m_s * sqrt(leg.dot(leg));
        let loaded = self.load_m_s2(start, 0.0) > 0.0 || (lands && closing);
        if !loaded {
            return ends_at(0.0, *start, ContactCorner::LiftOff);
        }
        let footing = if start.foot_vx_m_s != 0.0 {
            Footing::Slides(1.0_f64.copysign(start.foot_vx_m_s))
        } else if !start.slips && self.margin_m_s2(start, 0.0) > 0.0 {
            Footing::Holds
        } else if self.foot_share > 0.0 {
            Footing::Slides(1.0_f64.copysign(-leg[0]))
        } else {
            return ends_at(0.0, *start, ContactCorner::LiftOff);
        };
        let (step_s, end) = self.step_within(start, footing, limit_s, tolerance_m_s);
        // A slide that begins must leave rest; at the very edge of the cone rounding may forbid it.
        if let Footing::Slides(sign) = footing
            && start.foot_vx_m_s == 0.0
            && sign * end.foot_vx_m_s <= 0.0
        {
            let (step_s, end) = self.step_within(start, Footing::Holds, limit_s, tolerance_m_s);
            return self.first_corner(start, Footing::Holds, step_s, end, false);
        }
        self.first_corner(start, footing, step_s, end, true)
    }

    /// Returns the first corner of a step, or its end.
    fn first_corner(
        &self,
        start: &Contact,
        footing: Footing,
        step_s: f64,
        end: Contact,
        watches_the_cone: bool,
    ) -> ContactSegment {
        let at = |t_s: f64| Contact::of(self.step(start, footing, t_s).0);
        let mut first = ContactSegment { t_s: step_s, state: end, corner: ContactCorner::Limit };
        let mut consider = |value: &dyn Fn(&Contact, f64) -> f64, corner: ContactCorner| {
            if value(&first.state, first.t_s) <= 0.0 {
                let t_s = falling_root(|t_s| value(&at(t_s), t_s), 0.0, first.t_s);
                first = ContactSegment { t_s, state: at(t_s), corner };
            }
        };
        consider(&|state, t_s| self.load_m_s2(state, t_s), ContactCorner::LiftOff);
        match footing {
            Footing::Holds if watches_the_cone => {
                consider(&|state, t_s| self.margin_m_s2(state, t_s), ContactCorner::FootSlips);
            }
            Footing::Slides(sign) if start.foot_vx_m_s != 0.0 => {
                consider(&|state, _| sign * state.foot_vx_m_s, ContactCorner::FootStops);
            }
            _ => {}
        }
        if start.body.velocity_m_s[1] > 0.0 {
            consider(&|state, _| state.body.velocity_m_s[1], ContactCorner::Apex);
        }
        match first.corner {
            ContactCorner::FootStops => first.state.foot_vx_m_s = 0.0,
            ContactCorner::Apex => first.state.body.velocity_m_s[1] = 0.0,
            _ => {}
        }
        first
    }

    /// Returns the force in the leg per moving mass of the body, positive where it pushes.
    fn load_m_s2(&self, state: &Contact, t_s: f64) -> f64 {
        let leg = state.leg_m();
        let length_m = sqrt(leg.dot(leg));
        let rest_m = self.ramp.length_m + self.ramp.rate_m_s * t_s;
        let rate_m_s = leg.dot(state.velocity_of_leg()) / length_m;
        self.field.spring_per_s2 * (rest_m - length_m)
            + self.damping_per_s * (self.ramp.rate_m_s - rate_m_s)
    }

    /// Returns how much horizontal force the ground could carry beyond that of the leg, per moving
    /// mass of the body; infinity for a foot that never slips.
    pub(crate) fn margin_m_s2(&self, state: &Contact, t_s: f64) -> f64 {
        let Some(friction) = self.friction else { return f64::INFINITY };
        let leg = state.leg_m();
        let within = friction * leg[1] - leg[0].abs();
        if self.foot_share > 0.0 {
            let load = self.load_m_s2(state, t_s).max(0.0) / sqrt(leg.dot(leg));
            within * load + friction * self.foot_share * self.gravity_m_s2
        } else {
            // Of a massless foot only the direction of the leg counts, also before it is loaded.
            within
        }
    }

    fn slope(&self, numbers: &Numbers, footing: Footing, t_s: f64) -> Numbers {
        let state = Contact::of(*numbers);
        let leg = state.leg_m();
        let direction = leg.scaled(1.0 / sqrt(leg.dot(leg)));
        let load = self.load_m_s2(&state, t_s);
        let v = state.body.velocity_m_s;
        let resisted = self.field.drag_per_m * v * Pair([v[0].abs(), v[1].abs()]);
        let acceleration =
            direction.scaled(load) - resisted - Pair([0.0, self.field.net_gravity_m_s2]);
        let foot = match footing {
            Footing::Holds => [0.0, 0.0],
            Footing::Slides(sign) => {
                let held = self.friction.unwrap_or(0.0)
                    * (direction[1] * load / self.foot_share + self.gravity_m_s2);
                [state.foot_vx_m_s, -direction[0] * load / self.foot_share - sign * held]
            }
        };
        [v[0], v[1], acceleration[0], acceleration[1], foot[0], foot[1]]
    }

    /// Returns the state after one step of `step_s` and the largest error of its velocities, m/s.
    fn step(&self, start: &Contact, footing: Footing, step_s: f64) -> (Numbers, f64) {
        let start = start.numbers();
        let mut slopes = [[0.0; 6]; 7];
        slopes[0] = self.slope(&start, footing, 0.0);
        let mut at = start;
        for (stage, (weights, time)) in STAGES.iter().zip(TIMES).enumerate() {
            at = start;
            for (weight, slope) in weights.iter().zip(&slopes) {
                for (number, rate) in at.iter_mut().zip(slope) {
                    *number += step_s * weight * rate;
                }
            }
            slopes[stage + 1] = self.slope(&at, footing, time * step_s);
        }
        let mut worst: f64 = 0.0;
        for i in [2, 3, 5] {
            let error: f64 =
                ERROR.iter().zip(&slopes).map(|(weight, slope)| weight * slope[i]).sum();
            let error = (step_s * error).abs() / at[i].abs().max(1.0);
            // `max` would pass over an error that is not a number.
            worst = if error <= worst { worst } else { error };
        }
        (at, worst)
    }

    /// Takes the longest step up to `limit_s` that keeps to the tolerance.
    fn step_within(
        &self,
        start: &Contact,
        footing: Footing,
        limit_s: f64,
        tolerance_m_s: f64,
    ) -> (f64, Contact) {
        let mut step_s = limit_s;
        for _ in 0..MAX_TRIES {
            let (end, error_m_s) = self.step(start, footing, step_s);
            if error_m_s <= tolerance_m_s {
                return (step_s, Contact::of(end));
            }
            let factor = 0.9 * libm::pow(tolerance_m_s / error_m_s, 0.2);
            step_s *= if factor.is_finite() { factor.clamp(0.1, 0.9) } else { 0.1 };
        }
        (step_s, Contact::of(self.step(start, footing, step_s).0))
    }
}
