//! The apex map: one hop from an apex to the next.

use serde::{Deserialize, Serialize};

use crate::elongation::Elongation;
use crate::flight::Flight;
use crate::leg::{Leg, ParameterError, check_positive};
use crate::medium::Medium;
use crate::pair::Pair;
use crate::stance::{self, Setting, StanceEnd};
use crate::taylor::{Field, Jet, State};

/// Duration of a flight, s, above which the hop counts as a fall.
pub const MAX_FLIGHT_S: f64 = 20.0;

/// Number of stances after which a hop without an apex counts as a fall.
pub const MAX_STANCES: u8 = 3;

/// Number of parts of an integrator's step at whose ends [`Hopper::friction`] looks.
const SAMPLES: u8 = 8;

/// The state at an apex: the highest point of a hop, where the vertical velocity is 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Apex {
    /// Horizontal velocity.
    pub vx_m_s: f64,
    /// Height of the mass over the ground.
    pub y_m: f64,
}

/// The action for one hop, chosen at its first apex.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Action {
    /// Angle of the leg at touchdown, from the +x axis. Above pi/2 the foot lands ahead of the
    /// mass, towards +x. The paper's `alpha`.
    pub touchdown_angle_rad: f64,
    /// Speed at which the rest length grows from touchdown on; negative values count as 0. The
    /// paper's `r_s`.
    pub elongation_speed_m_s: f64,
}

/// Local error of the stance integrator: the largest velocity that a step may neglect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    pub(crate) velocity_m_s: f64,
}

impl Tolerance {
    /// Keeps every state and time of the golden cases within 1e-8.
    pub const GOLDEN: Self = Self { velocity_m_s: 1e-11 };
    /// Trades accuracy for speed, for training.
    pub const TRAINING: Self = Self { velocity_m_s: 1e-6 };

    /// Creates a tolerance, m/s. Below about 1e-13 rounding errors dominate.
    ///
    /// # Errors
    /// Returns an error if the tolerance is not finite or not above 0.
    pub fn new(velocity_m_s: f64) -> Result<Self, ParameterError> {
        check_positive("tolerance_m_s", velocity_m_s)?;
        Ok(Self { velocity_m_s })
    }
}

impl Default for Tolerance {
    fn default() -> Self {
        Self::GOLDEN
    }
}

/// The course of one hop. Times and places count from its start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hop {
    /// The next apex, or a fall.
    pub outcome: Outcome,
    /// Number of stances begun, at most [`MAX_STANCES`].
    pub stance_phases: u8,
    /// The first touchdown, if there was one.
    pub touchdown: Option<Touchdown>,
    /// Time of the first stance's lift-off, if there was one.
    pub liftoff_t_s: Option<f64>,
}

impl Hop {
    /// Returns the course of a hop before its first stance; a fall until it ends otherwise.
    const fn begun() -> Self {
        Self { outcome: Outcome::Fall, stance_phases: 0, touchdown: None, liftoff_t_s: None }
    }
}

/// A touchdown: the beginning of a stance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touchdown {
    /// Time of the touchdown.
    pub t_s: f64,
    /// Horizontal place of the foot.
    pub foot_x_m: f64,
}

/// The end of a hop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// The hop reached the next apex.
    Apex(NextApex),
    /// The mass reached the ground, the foot could not be swung to the touchdown angle, or a phase
    /// took too long.
    Fall,
}

/// The apex that ends a hop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NextApex {
    /// Time of the apex.
    pub t_s: f64,
    /// Horizontal distance.
    pub x_m: f64,
    /// Horizontal velocity.
    pub vx_m_s: f64,
    /// Height of the mass over the ground.
    pub y_m: f64,
    /// True if the foot was still on the ground.
    pub in_stance: bool,
}

impl Outcome {
    /// Returns the state from which the next hop starts; `None` after a fall.
    #[must_use]
    pub fn next(&self) -> Option<Apex> {
        match self {
            Self::Apex(apex) => Some(Apex { vx_m_s: apex.vx_m_s, y_m: apex.y_m }),
            Self::Fall => None,
        }
    }
}

/// The apex map of a leg in a medium. Its construction takes a few dozen operations.
#[derive(Clone, Copy, Debug)]
pub struct Hopper {
    flight: Flight,
    field: Field,
    rest_length_m: f64,
    max_elongation_m: f64,
    tolerance: Tolerance,
}

impl Hopper {
    /// Creates the apex map at [`Tolerance::GOLDEN`].
    #[must_use]
    pub fn new(leg: &Leg, medium: Medium) -> Self {
        let p = leg.parameters();
        let flight = Flight::new(leg, medium);
        Self {
            flight,
            field: Field::new(leg, &flight),
            rest_length_m: p.rest_length_m,
            max_elongation_m: p.max_elongation_m,
            tolerance: Tolerance::default(),
        }
    }

    /// Sets the tolerance.
    #[must_use]
    pub const fn with_tolerance(mut self, tolerance: Tolerance) -> Self {
        self.tolerance = tolerance;
        self
    }

    /// Computes one hop, which ends at the first local maximum of the height after the start.
    ///
    /// The function is total. A start or an action that is not finite, a start at or below the
    /// ground and a motion that overflows are falls.
    #[must_use]
    pub fn hop(&self, start: Apex, action: Action) -> Hop {
        self.simulate(start, action, |_, _| ())
    }

    /// Returns the coefficient of friction that the ground must have for this hop: the largest
    /// horizontal over vertical force on the foot, which is that of the vector along the leg.
    /// It is a lower bound, from nine instants of each step of the integrator; at
    /// touchdown and lift-off it is exact. `None` if the hop is a fall.
    #[must_use]
    pub fn friction(&self, start: Apex, action: Action) -> Option<f64> {
        let mut friction: f64 = 0.0;
        let stances = |jet: &Jet, duration_s: f64| {
            for sample in 0..=SAMPLES {
                let Pair([x_m, y_m]) =
                    jet.at(duration_s * f64::from(sample) / f64::from(SAMPLES)).position_m;
                friction = friction.max(x_m.abs() / y_m);
            }
        };
        match self.simulate(start, action, stances).outcome {
            Outcome::Apex(_) => Some(friction),
            Outcome::Fall => None,
        }
    }

    /// Alternates flights and stances. `observe` is shown the steps of each stance.
    fn simulate(&self, start: Apex, action: Action, mut observe: impl FnMut(&Jet, f64)) -> Hop {
        let setting = self.setting(action);
        let (mut course, mut next) = self.begin(start, action);
        loop {
            match next {
                Next::Stance(touchdown) => {
                    let end = stance::integrate(&setting, touchdown, &mut observe);
                    next = self.resume(&mut course, end);
                }
                Next::End(outcome) => return course.end(outcome),
            }
        }
    }

    /// Returns what all segments of the stances of a hop share.
    pub(crate) fn setting(&self, action: Action) -> Setting {
        let elongation = Elongation {
            rest_length_m: self.rest_length_m,
            max_m: self.max_elongation_m,
            start_m: 0.0,
            rate_m_s: action.elongation_speed_m_s.max(0.0),
        };
        Setting { field: self.field, elongation, tolerance_m_s: self.tolerance.velocity_m_s }
    }

    /// Begins a hop, and computes the flight to the first touchdown.
    pub(crate) fn begin(&self, start: Apex, action: Action) -> (Course, Next) {
        let (sin, cos) = libm::sincos(action.touchdown_angle_rad);
        let reach_m = [self.rest_length_m * cos, self.rest_length_m * sin];
        let mut course = Course { hop: Hop::begun(), reach_m, t_s: 0.0, foot_x_m: 0.0 };
        let inputs =
            [start.vx_m_s, start.y_m, action.touchdown_angle_rad, action.elongation_speed_m_s];
        let next = if inputs.iter().all(|x| x.is_finite()) {
            let apex = State {
                position_m: Pair([0.0, start.y_m]),
                velocity_m_s: Pair([start.vx_m_s, 0.0]),
            };
            self.descend(&mut course, &apex)
        } else {
            Next::End(Outcome::Fall)
        };
        (course, next)
    }

    /// Continues a hop after a stance.
    pub(crate) fn resume(&self, course: &mut Course, end: StanceEnd) -> Next {
        match end {
            StanceEnd::Fall => Next::End(Outcome::Fall),
            StanceEnd::Apex { t_s, state } => Next::End(Outcome::Apex(NextApex {
                t_s: course.t_s + t_s,
                x_m: course.foot_x_m + state.position_m[0],
                vx_m_s: state.velocity_m_s[0],
                y_m: state.position_m[1],
                in_stance: true,
            })),
            StanceEnd::LiftOff { t_s, mut state } => {
                course.t_s += t_s;
                if course.hop.stance_phases == 1 {
                    course.hop.liftoff_t_s = Some(course.t_s);
                }
                state.position_m[0] += course.foot_x_m;
                if state.velocity_m_s[1] >= 0.0 {
                    Next::End(self.ascend(course.t_s, &state))
                } else if course.hop.stance_phases < MAX_STANCES {
                    self.descend(course, &state)
                } else {
                    Next::End(Outcome::Fall)
                }
            }
        }
    }

    /// Computes the flight from a body that does not rise to the next touchdown. Positions of
    /// `body` count from the start of the hop and the ground.
    fn descend(&self, course: &mut Course, body: &State) -> Next {
        let [reach_x_m, reach_y_m] = course.reach_m;
        let [x_m, y_m] = body.position_m.0;
        let [vx_m_s, vy_m_s] = body.velocity_m_s.0;
        // A leg that is too long for the height cannot be swung through the ground.
        if !(reach_y_m > 0.0 && y_m >= reach_y_m) {
            return Next::End(Outcome::Fall);
        }
        let Some(descent) = self.flight.descend(-vy_m_s, y_m - reach_y_m) else {
            return Next::End(Outcome::Fall);
        };
        if descent.t_s > MAX_FLIGHT_S {
            return Next::End(Outcome::Fall);
        }
        course.t_s += descent.t_s;
        let (distance_m, touchdown_vx_m_s) = self.flight.horizontal(vx_m_s, descent.t_s);
        course.foot_x_m = x_m + distance_m - reach_x_m;
        if !course.foot_x_m.is_finite() {
            return Next::End(Outcome::Fall);
        }
        course.hop.stance_phases += 1;
        if course.hop.stance_phases == 1 {
            course.hop.touchdown = Some(Touchdown { t_s: course.t_s, foot_x_m: course.foot_x_m });
        }
        Next::Stance(State {
            position_m: Pair(course.reach_m),
            velocity_m_s: Pair([touchdown_vx_m_s, -descent.speed_m_s]),
        })
    }

    /// Computes the apex after a rising lift-off at `t_s`.
    fn ascend(&self, t_s: f64, body: &State) -> Outcome {
        let [vx_m_s, vy_m_s] = body.velocity_m_s.0;
        match self.flight.ascend(vy_m_s) {
            Some((ascent_s, height_m)) if ascent_s <= MAX_FLIGHT_S => {
                let (distance_m, vx_m_s) = self.flight.horizontal(vx_m_s, ascent_s);
                Outcome::Apex(NextApex {
                    t_s: t_s + ascent_s,
                    x_m: body.position_m[0] + distance_m,
                    vx_m_s,
                    y_m: body.position_m[1] + height_m,
                    in_stance: false,
                })
            }
            _ => Outcome::Fall,
        }
    }
}

/// A hop under way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Course {
    hop: Hop,
    /// Vector from the foot to the body at touchdown.
    reach_m: [f64; 2],
    /// Time of the latest touchdown or lift-off.
    t_s: f64,
    /// Place of the foot at the latest touchdown.
    foot_x_m: f64,
}

/// What follows in a hop.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Next {
    /// A stance from this touchdown.
    Stance(State),
    /// The end of the hop.
    End(Outcome),
}

impl Course {
    /// Returns the hop with its outcome. A motion that overflowed is a fall.
    pub(crate) fn end(self, outcome: Outcome) -> Hop {
        let finite = match outcome {
            Outcome::Apex(next) => {
                [next.t_s, next.x_m, next.vx_m_s, next.y_m].iter().all(|x| x.is_finite())
            }
            Outcome::Fall => true,
        };
        Hop { outcome: if finite { outcome } else { Outcome::Fall }, ..self.hop }
    }
}

impl Field {
    /// Creates the vector field of a leg with this ballistic motion.
    pub(crate) fn new(leg: &Leg, flight: &Flight) -> Self {
        let p = leg.parameters();
        Self {
            spring_per_s2: p.stiffness_n_m / (p.mass_kg + p.added_mass_kg),
            drag_per_m: Pair([flight.drag_x_per_m, flight.drag_y_per_m]),
            net_gravity_m_s2: flight.net_gravity_m_s2,
        }
    }
}
