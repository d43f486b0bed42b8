//! The apex map: one hop from an apex to the next.

use serde::{Deserialize, Serialize};

use crate::elongation::Elongation;
use crate::flight::Flight;
use crate::leg::{Leg, ParameterError, check_positive};
use crate::medium::Medium;
use crate::pair::Pair;
use crate::stance::{self, StanceEnd};
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
        let mut hop = Hop::begun();
        let inputs =
            [start.vx_m_s, start.y_m, action.touchdown_angle_rad, action.elongation_speed_m_s];
        if inputs.iter().all(|x| x.is_finite())
            && let Outcome::Apex(next) = self.simulate(start, action, &mut hop, |_, _| ())
            && [next.t_s, next.x_m, next.vx_m_s, next.y_m].iter().all(|x| x.is_finite())
        {
            hop.outcome = Outcome::Apex(next);
        }
        hop
    }

    /// Returns the coefficient of friction that the ground must have for this hop: the largest
    /// horizontal over vertical force on the foot, which is that of the vector along the leg.
    /// It is a lower bound, from [`SAMPLES`] instants of each step of the integrator; at
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
        let mut hop = Hop::begun();
        match self.simulate(start, action, &mut hop, stances) {
            Outcome::Apex(_) => Some(friction),
            Outcome::Fall => None,
        }
    }

    /// Alternates flights and stances, and records the first stance in `hop`. `observe` is shown
    /// the steps of each stance.
    fn simulate(
        &self,
        start: Apex,
        action: Action,
        hop: &mut Hop,
        mut observe: impl FnMut(&Jet, f64),
    ) -> Outcome {
        let (sin, cos) = libm::sincos(action.touchdown_angle_rad);
        let reach_m = [self.rest_length_m * cos, self.rest_length_m * sin];
        let elongation = Elongation {
            rest_length_m: self.rest_length_m,
            max_m: self.max_elongation_m,
            start_m: 0.0,
            rate_m_s: action.elongation_speed_m_s.max(0.0),
        };
        let (mut t_s, mut x_m, mut y_m) = (0.0, 0.0, start.y_m);
        let (mut vx_m_s, mut descent_m_s) = (start.vx_m_s, 0.0);
        while hop.stance_phases < MAX_STANCES {
            // A leg that is too long for the height cannot be swung through the ground.
            if !(reach_m[1] > 0.0 && y_m >= reach_m[1]) {
                return Outcome::Fall;
            }
            let Some(descent) = self.flight.descend(descent_m_s, y_m - reach_m[1]) else {
                return Outcome::Fall;
            };
            if descent.t_s > MAX_FLIGHT_S {
                return Outcome::Fall;
            }
            t_s += descent.t_s;
            let (distance_m, touchdown_vx_m_s) = self.flight.horizontal(vx_m_s, descent.t_s);
            x_m += distance_m;
            let foot_x_m = x_m - reach_m[0];
            if !foot_x_m.is_finite() {
                return Outcome::Fall;
            }
            hop.stance_phases += 1;
            if hop.stance_phases == 1 {
                hop.touchdown = Some(Touchdown { t_s, foot_x_m });
            }
            let touchdown = State {
                position_m: Pair(reach_m),
                velocity_m_s: Pair([touchdown_vx_m_s, -descent.speed_m_s]),
            };
            let tolerance_m_s = self.tolerance.velocity_m_s;
            let end =
                stance::integrate(&self.field, touchdown, &elongation, tolerance_m_s, &mut observe);
            match end {
                StanceEnd::Fall => return Outcome::Fall,
                StanceEnd::Apex { t_s: stance_s, state } => {
                    return Outcome::Apex(NextApex {
                        t_s: t_s + stance_s,
                        x_m: foot_x_m + state.position_m[0],
                        vx_m_s: state.velocity_m_s[0],
                        y_m: state.position_m[1],
                        in_stance: true,
                    });
                }
                StanceEnd::LiftOff { t_s: stance_s, state } => {
                    t_s += stance_s;
                    if hop.stance_phases == 1 {
                        hop.liftoff_t_s = Some(t_s);
                    }
                    x_m = foot_x_m + state.position_m[0];
                    y_m = state.position_m[1];
                    let vy_m_s = state.velocity_m_s[1];
                    vx_m_s = state.velocity_m_s[0];
                    if vy_m_s >= 0.0 {
                        return self.ascend(t_s, x_m, y_m, vx_m_s, vy_m_s);
                    }
                    descent_m_s = -vy_m_s;
                }
            }
        }
        Outcome::Fall
    }

    /// Computes the apex after a rising lift-off.
    fn ascend(&self, t_s: f64, x_m: f64, y_m: f64, vx_m_s: f64, vy_m_s: f64) -> Outcome {
        match self.flight.ascend(vy_m_s) {
            Some((ascent_s, height_m)) if ascent_s <= MAX_FLIGHT_S => {
                let (distance_m, vx_m_s) = self.flight.horizontal(vx_m_s, ascent_s);
                Outcome::Apex(NextApex {
                    t_s: t_s + ascent_s,
                    x_m: x_m + distance_m,
                    vx_m_s,
                    y_m: y_m + height_m,
                    in_stance: false,
                })
            }
            _ => Outcome::Fall,
        }
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
