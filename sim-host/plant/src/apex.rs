//! The apex map: one hop, from one apex to the next.

use serde::{Deserialize, Serialize};

use super::elongation::Elongation;
use super::flight::Swim;
use super::leg::{Leg, ParameterError, positive};
use super::medium::Medium;
use super::pair::Pair;
use super::stance::{StanceEnd, punt};
use super::taylor::{Field, State};

/// A swim that takes longer than this counts as a fall.
pub const LONGEST_SWIM_S: f64 = 20.0;

/// After this many stances without an apex the leg has fallen.
pub const MOST_STANCES: u8 = 3;

/// The state at an apex, where the vertical velocity is 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Apex {
    /// Horizontal velocity.
    pub vx_m_s: f64,
    /// Height of the mass over the ground.
    pub y_m: f64,
}

/// What the leg does from one apex to the next.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Action {
    /// Angle of the leg at touchdown from the +x axis; over pi/2 the foot lands ahead of the
    /// mass, towards +x.
    pub touchdown_angle_rad: f64,
    /// Speed at which the rest length grows from touchdown on; below 0 counts as 0.
    pub elongation_speed_m_s: f64,
}

/// Local error of the stance integrator: what a step may leave out of a velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    pub(super) velocity_m_s: f64,
}

impl Tolerance {
    /// As accurate as the golden cases ask: 1e-8 on every state and time.
    pub const GOLDEN: Self = Self { velocity_m_s: 1e-11 };
    /// For training, where speed counts.
    pub const TRAINING: Self = Self { velocity_m_s: 1e-6 };

    /// Any other. Below about 1e-13 rounding takes over.
    ///
    /// # Errors
    /// A tolerance that is not finite or not above 0.
    pub fn new(velocity_m_s: f64) -> Result<Self, ParameterError> {
        positive("tolerance", velocity_m_s)?;
        Ok(Self { velocity_m_s })
    }
}

impl Default for Tolerance {
    fn default() -> Self {
        Self::GOLDEN
    }
}

/// One hop as it went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hop {
    /// How it ended.
    pub outcome: Outcome,
    /// Stances begun.
    pub stance_phases: u8,
    /// Where and when the first stance began.
    pub touchdown: Option<Touchdown>,
    /// When the first stance ended in a lift-off, counted from the start.
    pub liftoff_t_s: Option<f64>,
}

/// The beginning of a stance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touchdown {
    /// Time from the start.
    pub t_s: f64,
    /// Place of the foot, counted from the start.
    pub x_foot_m: f64,
}

/// How a hop ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// At the next apex.
    Apex(NextApex),
    /// Without one: the mass reached the ground, or swam or stood for too long.
    Fall,
}

/// The apex that ends a hop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NextApex {
    /// Time from the start.
    pub t_s: f64,
    /// Way made from the start.
    pub x_m: f64,
    /// Horizontal velocity.
    pub vx_m_s: f64,
    /// Height of the mass over the ground.
    pub y_m: f64,
    /// Whether the foot was still down.
    pub in_stance: bool,
}

impl Outcome {
    /// The state from which the next hop starts; `None` after a fall.
    #[must_use]
    pub fn next(&self) -> Option<Apex> {
        match self {
            Self::Apex(apex) => Some(Apex { vx_m_s: apex.vx_m_s, y_m: apex.y_m }),
            Self::Fall => None,
        }
    }
}

/// A leg in a medium, ready to hop. Cheap to make: a few dozen operations.
#[derive(Clone, Copy, Debug)]
pub struct Hopper {
    swim: Swim,
    field: Field,
    rest_length_m: f64,
    max_elongation_m: f64,
    tolerance: Tolerance,
}

impl Hopper {
    /// Puts the leg into the medium.
    #[must_use]
    pub fn new(leg: &Leg, medium: Medium) -> Self {
        let p = leg.parameters();
        let swim = Swim::new(leg, medium);
        Self {
            swim,
            field: Field::new(leg, &swim),
            rest_length_m: p.rest_length_m,
            max_elongation_m: p.max_elongation_m,
            tolerance: Tolerance::default(),
        }
    }

    /// The same at another tolerance.
    #[must_use]
    pub const fn with_tolerance(mut self, tolerance: Tolerance) -> Self {
        self.tolerance = tolerance;
        self
    }

    /// One hop: the first local maximum of the height after the start.
    ///
    /// Total: a start that is not finite, or no higher than the ground, is a fall, and so are
    /// an action that is not finite and a motion that overflows.
    #[must_use]
    pub fn hop(&self, start: Apex, action: Action) -> Hop {
        let mut hop =
            Hop { outcome: Outcome::Fall, stance_phases: 0, touchdown: None, liftoff_t_s: None };
        let inputs =
            [start.vx_m_s, start.y_m, action.touchdown_angle_rad, action.elongation_speed_m_s];
        if inputs.iter().all(|x| x.is_finite())
            && let Outcome::Apex(next) = self.follow(start, action, &mut hop)
            && [next.t_s, next.x_m, next.vx_m_s, next.y_m].iter().all(|x| x.is_finite())
        {
            hop.outcome = Outcome::Apex(next);
        }
        hop
    }

    /// Alternates flights and stances; notes the first stance in `hop`.
    fn follow(&self, start: Apex, action: Action, hop: &mut Hop) -> Outcome {
        let (sin, cos) = libm::sincos(action.touchdown_angle_rad);
        let reach_m = [self.rest_length_m * cos, self.rest_length_m * sin];
        let elongation = Elongation {
            rest_length_m: self.rest_length_m,
            max_m: self.max_elongation_m,
            start_m: 0.0,
            rate_m_s: action.elongation_speed_m_s.max(0.0),
        };
        let (mut t_s, mut x_m, mut y_m) = (0.0, 0.0, start.y_m);
        let (mut vx_m_s, mut sinking_m_s) = (start.vx_m_s, 0.0);
        while hop.stance_phases < MOST_STANCES {
            // A leg that is too long for the height cannot be swung through the ground.
            if !(reach_m[1] > 0.0 && y_m >= reach_m[1]) {
                return Outcome::Fall;
            }
            let Some(drop) = self.swim.drop(sinking_m_s, y_m - reach_m[1]) else {
                return Outcome::Fall;
            };
            if drop.t_s > LONGEST_SWIM_S {
                return Outcome::Fall;
            }
            t_s += drop.t_s;
            let (way_m, touchdown_vx_m_s) = self.swim.horizontal(vx_m_s, drop.t_s);
            x_m += way_m;
            let x_foot_m = x_m - reach_m[0];
            if !x_foot_m.is_finite() {
                return Outcome::Fall;
            }
            hop.stance_phases += 1;
            if hop.stance_phases == 1 {
                hop.touchdown = Some(Touchdown { t_s, x_foot_m });
            }
            let touchdown = State {
                place_m: Pair(reach_m),
                velocity_m_s: Pair([touchdown_vx_m_s, -drop.speed_m_s]),
            };
            let end = punt(&self.field, touchdown, &elongation, self.tolerance.velocity_m_s);
            match end {
                StanceEnd::Fall => return Outcome::Fall,
                StanceEnd::Apex { t_s: stance_s, state } => {
                    return Outcome::Apex(NextApex {
                        t_s: t_s + stance_s,
                        x_m: x_foot_m + state.place_m[0],
                        vx_m_s: state.velocity_m_s[0],
                        y_m: state.place_m[1],
                        in_stance: true,
                    });
                }
                StanceEnd::LiftOff { t_s: stance_s, state } => {
                    t_s += stance_s;
                    if hop.stance_phases == 1 {
                        hop.liftoff_t_s = Some(t_s);
                    }
                    x_m = x_foot_m + state.place_m[0];
                    y_m = state.place_m[1];
                    let vy_m_s = state.velocity_m_s[1];
                    vx_m_s = state.velocity_m_s[0];
                    if vy_m_s >= 0.0 {
                        return self.climb(t_s, x_m, y_m, vx_m_s, vy_m_s);
                    }
                    sinking_m_s = -vy_m_s;
                }
            }
        }
        Outcome::Fall
    }

    /// From a rising lift-off to the apex.
    fn climb(&self, t_s: f64, x_m: f64, y_m: f64, vx_m_s: f64, vy_m_s: f64) -> Outcome {
        match self.swim.climb(vy_m_s) {
            Some((climb_s, height_m)) if climb_s <= LONGEST_SWIM_S => {
                let (way_m, vx_m_s) = self.swim.horizontal(vx_m_s, climb_s);
                Outcome::Apex(NextApex {
                    t_s: t_s + climb_s,
                    x_m: x_m + way_m,
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
    /// The accelerations of a leg that swims as `swim`.
    pub(super) fn new(leg: &Leg, swim: &Swim) -> Self {
        let p = leg.parameters();
        Self {
            spring_per_s2: p.stiffness_n_m / (p.mass_kg + p.added_mass_kg),
            drag_per_m: Pair([swim.drag_x_per_m, swim.drag_y_per_m]),
            net_gravity_m_s2: swim.net_gravity_m_s2,
        }
    }
}
