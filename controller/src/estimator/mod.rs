//! The state of the leg, estimated from what its sensors read.
//!
//! Two filters, for two kinds of leg, behind one interface: `state.rs` for legs that sense
//! their velocity and height, however noisily; `inertial/` for legs that sense neither, but
//! their acceleration, posture and contact. Both tell motion, density ratio, touchdown,
//! lift-off and apex.

mod block;
mod contact;
mod factor;
mod inertial;
mod model;
mod noise;
#[cfg(test)]
mod random;
mod sensor_noise;
mod state;
mod tracker;

use crate::config::{Config, Estimation};
use crate::gait::{Apex, Gait};
use crate::guard::Trusted;
use crate::leg::LegModel;

pub(crate) use contact::Edge;
use inertial::InertialFilter;
pub use sensor_noise::SensorNoise;
use state::StateFilter;
pub use state::StateNoise;

/// The estimate at the last measurement, with its variances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Time of the measurement, ns.
    pub t_ns: u64,
    /// Whether the foot is on the ground.
    pub in_stance: bool,
    /// Horizontal velocity, m/s.
    pub vx_m_s: f32,
    /// Height above the ground, m.
    pub y_m: f32,
    /// Vertical velocity, m/s.
    pub vy_m_s: f32,
    /// Density ratio; not clamped to any range.
    pub density_ratio: f32,
    /// Variance of the horizontal velocity, m2/s2.
    pub vx_variance: f32,
    /// Variance of the height, m2.
    pub y_variance: f32,
    /// Variance of the vertical velocity, m2/s2.
    pub vy_variance: f32,
    /// Variance of the density ratio.
    pub density_variance: f32,
    /// Innovation of the last vertical reading in flight that was used (velocity or specific
    /// force), in standard deviations: of mean 0 and variance 1 where the filter is consistent.
    pub innovation: f32,
}

/// What a leg does that another controller moves, as far as it is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Acted {
    /// Angle of the leg from the +x axis for which it is held in flight, rad.
    pub leg_angle_rad: Option<f32>,
    /// Extension of the spring's rest length in stance, m; up to that of the policy's leg.
    pub elongation_m: Option<f32>,
}

/// What happened since the measurement before, and the state at it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "facts that do not depend on each other")]
pub(crate) struct Events {
    /// The foot touched down or lifted off.
    pub(crate) edge: Option<Edge>,
    /// The touchdown that the last contact readings may be the beginning of.
    pub(crate) suspected: Option<Edge>,
    /// The apex of this hop is behind; once a hop.
    pub(crate) passed_apex: bool,
    /// Whether the foot is on the ground.
    pub(crate) in_stance: bool,
    /// Whether the density was ever known well enough for a decision.
    pub(crate) density_is_known: bool,
    /// Whether the touchdown is foreseen well enough to arm the elongation for it.
    pub(crate) touchdown_is_foreseen: bool,
    /// Horizontal velocity, m/s, height, m, and vertical velocity, m/s.
    pub(crate) motion: [f32; 3],
    /// Vertical acceleration in flight, m/s2.
    pub(crate) ay_m_s2: f32,
}

/// A filter of either kind.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no allocator")]
pub(crate) enum Estimator {
    /// For velocity and height.
    State(StateFilter),
    /// For raw sensors.
    Inertial(InertialFilter),
}

/// Calls a method of the filter, whichever it is.
macro_rules! either {
    ($estimator:expr, $filter:ident => $call:expr) => {
        match $estimator {
            Estimator::State($filter) => $call,
            Estimator::Inertial($filter) => $call,
        }
    };
}

impl Estimator {
    /// Returns a filter that knows nothing yet; none where the readings are the state.
    pub(crate) fn new(leg: &LegModel, config: &Config) -> Option<Self> {
        let (gravity_m_s2, tick_ns) = (config.gravity_m_s2(), config.tick_ns());
        Some(match config.estimation() {
            Estimation::Readings => return None,
            Estimation::StateChannels(noise) => {
                let stale_ns = config.stale_limit_ns();
                Self::State(StateFilter::new(leg, gravity_m_s2, tick_ns, stale_ns, noise))
            }
            Estimation::Inertial(noise) => {
                Self::Inertial(InertialFilter::new(leg, gravity_m_s2, tick_ns, noise))
            }
        })
    }

    /// Changes the leg and gravity of the model; the state stays.
    pub(crate) fn set_leg(&mut self, leg: &LegModel, gravity_m_s2: f32) {
        either!(self, filter => filter.set_leg(leg, gravity_m_s2));
    }

    /// Returns the estimate; none before it has begun, nor while a number is not finite.
    pub(crate) fn estimate(&self) -> Option<Estimate> {
        either!(self, filter => filter.estimate())
    }
}

/// What the control law asks of a filter.
pub(crate) trait Filter {
    /// Returns whether there is an estimate.
    fn has_begun(&self) -> bool;

    /// Takes a measurement of a leg in this gait. Returns none while there is no estimate.
    fn update(&mut self, measurement: &Trusted<'_>, gait: &Gait) -> Option<Events>;

    /// Returns the density ratio; not clamped to any range.
    fn density_ratio(&self) -> f32;

    /// Returns the apex of this flight, behind or ahead; none where the model does not lead to
    /// one within a second.
    fn apex(&self) -> Option<Apex>;
}

impl Filter for Estimator {
    fn has_begun(&self) -> bool {
        either!(self, filter => filter.has_begun())
    }

    #[inline]
    fn update(&mut self, measurement: &Trusted<'_>, gait: &Gait) -> Option<Events> {
        either!(self, filter => filter.update(measurement, gait))
    }

    fn density_ratio(&self) -> f32 {
        either!(self, filter => filter.density_ratio())
    }

    fn apex(&self) -> Option<Apex> {
        either!(self, filter => filter.apex())
    }
}
