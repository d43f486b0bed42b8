//! Losses of a real leg, each absent by default: damping, the mass of the foot, friction, and a
//! limit of the force of the drive.
//!
//! The paper's leg is a spring without damping on a massless foot that never slips. Without losses
//! the plant computes exactly that, to the last bit. The body's moving mass is `M` (dry and added
//! mass), `l` the leg length, `n` the unit vector from foot to body, `L(t)` the rest length with
//! the elongation, and `k` the stiffness.
//!
//! # Damping
//!
//! A damper `c` lies parallel to the spring, in series with the actuator that elongates the leg:
//!
//! ```text
//! F = k (L - l) + c (L' - l')        M v' = F n + weight, buoyancy and drag
//! ```
//!
//! The foot cannot pull, so the stance ends where `F` turns to 0. A leg that extends does so no
//! later than at its rest length, and without damping exactly there; the leg is then still
//! compressed by `c l' / k`. It counts as relaxed at once in flight.
//!
//! # Mass of the foot
//!
//! The foot `m` moves with the body in flight, where the leg is rigid: the moving mass is `M + m`
//! and the weight that of both, at the place of the body. Buoyancy, drag and added mass are those
//! of the body. A swing of the leg needs no force, as without a mass.
//!
//! At touchdown the ground takes the foot's momentum `m v`. The body feels only the spring, which
//! is not yet compressed, so its velocity does not change, and the energy `m v v / 2` is lost. In
//! stance the foot is at rest. At lift-off the ground gives no impulse, so the momentum of both is
//! that of the body, and then both have one velocity:
//!
//! ```text
//! (M + m) v' = M v        energy lost: M m / (M + m) v v / 2
//! ```
//!
//! This holds along the leg, where the end of the spring's stroke jerks the foot up, and across
//! it, where the swing accelerates the foot and decelerates the body.
//!
//! # Friction
//!
//! The ground carries a horizontal force of at most `mu` times the vertical one, on level ground.
//! On uneven ground the cone stays upright, and a foot that slides keeps its height until it lifts
//! off. In stance the ground carries the force of the leg and the weight of the foot:
//!
//! ```text
//! N = F n_y + m g        T = F n_x        the foot holds while |T| <= mu N
//! m u' = -F n_x - mu N sign(u)            while it slides with the velocity u
//! ```
//!
//! It holds again where `u` passes 0 and `|T| <= mu N`. A lift-off from a slide adds `m u` to the
//! momentum of both. At touchdown the ground's impulse obeys the same cone: of the foot's velocity
//! `u = vx - mu |vy| sign(vx)` remains, or nothing if `|vx| <= mu |vy|`.
//!
//! A foot without a mass has no such slide. The force in the leg acts along the leg, so the forces
//! on the foot balance only while the leg is within the cone, or without force. A leg that would
//! slide along the edge of the cone would be drawn up by the friction, which would then do
//! positive work. Once the leg leaves the cone, such a foot slides out from under the load at once,
//! the energy of the spring is lost, and the stance ends; so does the slide of a foot with a mass
//! as that mass goes to 0.
//!
//! # Force of the drive
//!
//! The drive that elongates the leg is in series with the spring. While the spring's force is above
//! the limit at the start of a tick in stance, the drive stands still: it does not lengthen the leg
//! and is not pushed back. It then goes on at the commanded rate from where it is, so an elongation
//! that was missed stays missed until the leg is in the air, where the drive follows the command.

use crate::leg::{ParameterError, check_within};

/// Losses of a leg, each checked. [`Losses::NONE`], the default, has none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    pub(crate) damping_n_s_m: f64,
    pub(crate) foot_mass_kg: f64,
    /// Coefficient of friction; `None` for a foot that never slips.
    pub(crate) friction: Option<f64>,
    /// Largest spring force against which the drive lengthens the leg; `None` for any.
    pub(crate) drive_force_n: Option<f64>,
}

impl Losses {
    /// A spring without damping on a massless foot that never slips.
    pub const NONE: Self =
        Self { damping_n_s_m: 0.0, foot_mass_kg: 0.0, friction: None, drive_force_n: None };
    /// Largest damping, N s/m.
    pub const MAX_DAMPING_N_S_M: f64 = 1000.0;
    /// Least mass of a foot that is not massless, kg. A lighter one slides within microseconds.
    pub const MIN_FOOT_MASS_KG: f64 = 0.001;
    /// Largest mass of the foot, kg.
    pub const MAX_FOOT_MASS_KG: f64 = 10.0;
    /// Least coefficient of friction.
    pub const MIN_FRICTION: f64 = 0.05;
    /// Largest coefficient of friction.
    pub const MAX_FRICTION: f64 = 2.0;
    /// Largest limit of the drive's force, N.
    pub const MAX_DRIVE_FORCE_N: f64 = 100_000.0;

    /// Sets the damping along the leg, N s/m.
    ///
    /// # Errors
    /// Returns an error if it is not within 0 and [`Losses::MAX_DAMPING_N_S_M`].
    pub fn with_damping(self, damping_n_s_m: f64) -> Result<Self, ParameterError> {
        check_within("damping_n_s_m", damping_n_s_m, [0.0, Self::MAX_DAMPING_N_S_M])?;
        Ok(Self { damping_n_s_m, ..self })
    }

    /// Sets the mass of the foot, kg; 0 for a massless one.
    ///
    /// # Errors
    /// Returns an error if it is neither 0 nor within [`Losses::MIN_FOOT_MASS_KG`] and
    /// [`Losses::MAX_FOOT_MASS_KG`].
    pub fn with_foot_mass(self, foot_mass_kg: f64) -> Result<Self, ParameterError> {
        if foot_mass_kg != 0.0 {
            let range = [Self::MIN_FOOT_MASS_KG, Self::MAX_FOOT_MASS_KG];
            check_within("foot_mass_kg", foot_mass_kg, range)?;
        }
        Ok(Self { foot_mass_kg, ..self })
    }

    /// Sets the coefficient of friction, the largest horizontal force over the vertical one.
    ///
    /// # Errors
    /// Returns an error if it is not within [`Losses::MIN_FRICTION`] and
    /// [`Losses::MAX_FRICTION`].
    pub fn with_friction(self, friction: f64) -> Result<Self, ParameterError> {
        check_within("friction", friction, [Self::MIN_FRICTION, Self::MAX_FRICTION])?;
        Ok(Self { friction: Some(friction), ..self })
    }

    /// Sets the largest force of the spring against which the drive lengthens the leg, N.
    ///
    /// # Errors
    /// Returns an error if it is not within 0 and [`Losses::MAX_DRIVE_FORCE_N`].
    pub fn with_drive_force(self, drive_force_n: f64) -> Result<Self, ParameterError> {
        check_within("drive_force_n", drive_force_n, [0.0, Self::MAX_DRIVE_FORCE_N])?;
        Ok(Self { drive_force_n: Some(drive_force_n), ..self })
    }

    /// Returns the damping, N s/m.
    #[must_use]
    pub const fn damping_n_s_m(&self) -> f64 {
        self.damping_n_s_m
    }

    /// Returns the mass of the foot, kg.
    #[must_use]
    pub const fn foot_mass_kg(&self) -> f64 {
        self.foot_mass_kg
    }

    /// Returns the coefficient of friction; `None` for a foot that never slips.
    #[must_use]
    pub const fn friction(&self) -> Option<f64> {
        self.friction
    }

    /// Returns true if a stance may differ from that of a leg without losses. The mass of a foot
    /// that holds acts only at the ends of a stance.
    pub(crate) const fn act_in_stance(&self) -> bool {
        self.damping_n_s_m > 0.0 || self.friction.is_some()
    }

    /// Returns the velocity that the foot keeps at a touchdown with this velocity, m/s.
    pub(crate) fn foot_after_touchdown_m_s(&self, vx_m_s: f64, vy_m_s: f64) -> f64 {
        match self.friction {
            Some(friction) if self.foot_mass_kg > 0.0 => {
                let kept_m_s = vx_m_s.abs() - friction * vy_m_s.abs();
                kept_m_s.max(0.0).copysign(vx_m_s)
            }
            _ => 0.0,
        }
    }
}
