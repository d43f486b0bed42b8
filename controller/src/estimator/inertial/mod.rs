//! The state of a leg that senses its acceleration, the posture of its leg and contact.
//!
//! Two blocks of four states ([`axis`]), one for each axis of the plane:
//!
//! ```text
//! along x   bias of the accelerometer, tilt t, velocity vx, place dx over the foot
//! along y   bias of the accelerometer, density ratio rho, velocity vy, height y over the foothold
//! ```
//!
//! The tilt is what the orientation is wrong by: a constant turn of accelerometer and leg
//! angle. In every phase the specific force `f` moves the state; the phase decides what
//! corrects it:
//!
//! ```text
//! always    vx' = vx + (fx - t fy - bx) dt          dx' = dx + vx dt
//!           vy' = vy + (fy + t fx - by - g) dt      y'  = y + vy dt
//! stance    lx = dx + t y      ly = y - t dx        leg from foot to mass, by its encoders
//! flight    fy - by = g - w + rho (b - cy vy |vy|)  what the accelerometer feels in free fall
//!           fx = -cx rho vx |vx| + bx + t fy
//! ```
//!
//! (`model.rs` has the symbols.) So the medium is felt at once, by the first reading in
//! flight, and the first stance tells velocities, biases and height, whatever they were before.
//! The tilt shows where velocities before and after a flight disagree. What the two axes have
//! in common (the density in `fx`, the tilt in `ly`) counts as noise of the reading: so there
//! are two small covariances in place of a large one. The spring is not modelled: its force is
//! in the accelerometer's reading, whatever its stiffness.
//!
//! A Doppler log or an echo sounder correct velocity and height at the time of their reading
//! (`history.rs`); the change of the pressure since the flight began is `-1000 g rho` times the
//! change of the height.
//!
//! Where a sensor is missing, the rest carries on: without an accelerometer the flight follows
//! its model, and stance is a random walk under the encoders; without encoders the accelerometer
//! carries the state from flight to flight, and less and less certainly. When a velocity or the
//! height is uncertain by more than [`LOST`], or the height contradicts the encoders in one
//! stance after another, there is no estimate any more, and the leg gets the safe command.

mod axis;
mod flight;
mod force;
mod history;
mod phase;
mod predict;
mod scale_error;
mod scales;
mod slow;
mod stance;

use nalgebra::Vector4;

use super::contact::{ContactFilter, Edge};
use super::factor::{Innovation, Reading};
use super::model::{Flight, FlightModel};
use super::sensor_noise::SensorNoise;
use super::tracker::ApexTracker;
use super::{Estimate, Events, Filter};
use crate::gait::{Apex, Gait};
use crate::guard::{Channels, Trusted};
use crate::leg::LegModel;
use crate::measurement::Measurement;
use axis::{Axis, Use};
use force::{Felt, ForceMeter};
use history::{History, Motion};
use scale_error::ScaleError;
use scales::Scales;

/// Velocity, m/s, and height over the foothold, in rest lengths, at the start, with their
/// deviations.
const FIRST_VELOCITY: [f32; 2] = [0.0, 1.0];
const FIRST_HEIGHT: [f32; 2] = [1.5, 0.7];
/// Density ratio at the start, and its variance.
const FIRST_DENSITY: [f32; 2] = [0.5, 0.25];
/// Variance of the density ratio below which a decision may be made for the first time.
const KNOWN_DENSITY_VARIANCE: f32 = 0.01;
/// Shortening from which on the leg is loaded whatever the contact reading, in rest lengths.
const SURELY_LOADED: f32 = 0.03;

/// Deviation of the time of the touchdown up to which it counts as foreseen, s.
const FORESEEN_S: f32 = 0.02;

/// Variances of velocity, m2/s2, and height, m2, beyond which the state is lost.
const LOST: [f32; 2] = [2.0 * 2.0, 2.0 * 2.0];
/// Stances in a row that contradict the state after which it is lost.
const CONTRADICTIONS: u8 = 4;

/// The filter.
#[derive(Clone, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "facts that do not depend on each other")]
pub(crate) struct InertialFilter {
    model: FlightModel,
    scales: Scales,
    noise: SensorNoise,
    t_ns: Option<u64>,
    has_begun: bool,
    density_is_known: bool,
    horizontal: Axis,
    vertical: Axis,
    scale_error: ScaleError,
    /// Variance of the horizontal velocity, m2/s2, and those of the states along y for a known
    /// scale error, at the last measurement.
    vx_variance: f32,
    variances: Vector4<f32>,
    force: ForceMeter,
    /// The last reading of the accelerometer in this flight.
    last_felt: Option<Felt>,
    /// Whether the last reading corrected the state along y.
    is_turn_of_y: bool,
    /// Tick of the lap over which noise is added to biases, tilt and density; duration of this lap
    /// and the last, s.
    lap_tick: u8,
    lap_s: [f32; 2],
    innovation: Innovation,
    contact: ContactFilter,
    tracker: ApexTracker,
    history: History,
    /// Whether a reading of velocity, height, pressure or density has ever come.
    has_slow_sensors: bool,
    /// Time of the last touchdown, ns.
    landed_ns: u64,
    /// Pressure, Pa, and height, m, at the first reading of this flight, and its time, ns.
    first_pressure: Option<(f32, f32, u64)>,
    /// Whether the leg was clearly shorter than at rest, or its length unknown.
    is_pressed: bool,
    /// Time for which nothing but the medium has pushed the mass, s.
    falls_for_s: f32,
    /// Whether this stance contradicts the state along y, and how many in a row did.
    contradicts: bool,
    contradictions: u8,
}

impl Filter for InertialFilter {
    fn has_begun(&self) -> bool {
        self.has_begun
    }

    #[inline]
    fn update(&mut self, measurement: &Trusted<'_>, gait: &Gait) -> Option<Events> {
        let (m, usable) = (measurement.measurement(), measurement.usable());
        self.take(m, usable, gait.rest_m(m.t_ns), gait.touchdown_y_m())
    }

    fn density_ratio(&self) -> f32 {
        self.vertical.parameter
    }

    fn apex(&self) -> Option<Apex> {
        let [vx_m_s, y_m, vy_m_s] = self.motion();
        let density_ratio = self.density_ratio();
        let apex = self.model.at_apex(Flight { vx_m_s, y_m, vy_m_s, density_ratio })?;
        Some(Apex { vx_m_s: apex.vx_m_s, y_m: apex.y_m })
    }
}

impl InertialFilter {
    /// Returns a filter that knows nothing yet.
    pub(crate) fn new(
        leg: &LegModel,
        gravity_m_s2: f32,
        tick_ns: u64,
        noise: &SensorNoise,
    ) -> Self {
        let square = |x: f32| x * x;
        let bias = [0.0, square(noise.acceleration_bias_m_s2)];
        let velocity = [FIRST_VELOCITY[0], square(FIRST_VELOCITY[1])];
        let height = FIRST_HEIGHT.map(|lengths| lengths * leg.rest_length_m);
        let tilt = [0.0, square(noise.pitch_rad)];
        Self {
            model: FlightModel::new(leg, gravity_m_s2),
            scales: Scales::new(leg, gravity_m_s2, noise),
            noise: *noise,
            t_ns: None,
            has_begun: false,
            density_is_known: false,
            horizontal: Axis::new([bias, tilt, velocity, [0.0, 1.0]]),
            vertical: Axis::new([bias, FIRST_DENSITY, velocity, [height[0], square(height[1])]]),
            scale_error: ScaleError::new(noise.acceleration_scale),
            vx_variance: velocity[1],
            variances: Vector4::new(bias[1], FIRST_DENSITY[1], velocity[1], square(height[1])),
            force: ForceMeter::default(),
            last_felt: None,
            is_turn_of_y: false,
            lap_tick: 0,
            lap_s: [0.0; 2],
            innovation: Innovation::default(),
            contact: ContactFilter::new(tick_ns),
            tracker: ApexTracker::new(),
            history: History::default(),
            has_slow_sensors: false,
            landed_ns: 0,
            first_pressure: None,
            is_pressed: true,
            falls_for_s: 0.0,
            contradicts: false,
            contradictions: 0,
        }
    }

    /// Changes the leg and gravity of the model; the state stays.
    pub(crate) fn set_leg(&mut self, leg: &LegModel, gravity_m_s2: f32) {
        self.model = FlightModel::new(leg, gravity_m_s2);
        self.scales = Scales::new(leg, gravity_m_s2, &self.noise);
    }

    /// Takes a measurement of a leg whose rest length, elongation included, is `rest_m`, and
    /// which would touch down at a height of `touchdown_y_m`. Returns none while there is no
    /// estimate: at the first measurement, or when the state is lost.
    #[inline]
    fn take(
        &mut self,
        measurement: &Measurement,
        usable: Channels,
        rest_m: f32,
        touchdown_y_m: f32,
    ) -> Option<Events> {
        let t_ns = measurement.t_ns;
        // At most a second: 32 bits are enough, and need no software.
        let dt_s =
            self.t_ns.map_or(0.0, |before_ns| 1e-9 * t_ns.saturating_sub(before_ns) as u32 as f32);
        self.t_ns = Some(t_ns);
        let push = self.force.push(&measurement.sensors, usable, self.scale_error.value, dt_s);
        if !self.has_begun {
            self.has_begun = true;
            return None;
        }
        self.predict(push, dt_s);
        self.add_slow_noise(dt_s);
        let posture = measurement.sensors.posture.filter(|_| usable.has(Channels::POSTURE));
        let felt = push.and_then(|push| push.felt);
        let excess_m_s2 = felt.map(|felt| self.excess_m_s2(felt));
        if !self.contact.in_stance() {
            self.correct_in_flight(felt, touchdown_y_m);
        } else if let Some(posture) = posture {
            self.correct_in_stance(posture, excess_m_s2, rest_m);
        }
        self.correct_by_slow_sensors(measurement, usable);
        self.vx_variance = self.horizontal.factor.velocity_variance();
        self.variances = self.vertical.factor.variances();
        let shortened_m = posture.map(|posture| rest_m - posture.length_m);
        let pressed_from_m = SURELY_LOADED * self.scales.rest_length_m;
        self.is_pressed = shortened_m.is_none_or(|m| m > pressed_from_m);
        let by_contact = self.loaded_by_contact(measurement.contact, usable, rest_m);
        let is_loaded = self.is_loaded(by_contact, shortened_m, excess_m_s2, dt_s);
        let events = self.find_events(t_ns, is_loaded, touchdown_y_m, posture);
        if self.has_slow_sensors {
            self.history.push(self.motion_now(t_ns));
        }
        self.is_lost().then(|| self.has_begun = false).map_or(Some(events), |()| None)
    }

    /// Returns the estimate; none before it has begun, nor while a number is not finite.
    pub(crate) fn estimate(&self) -> Option<Estimate> {
        let t_ns = self.t_ns.filter(|_| self.has_begun)?;
        let Self { horizontal, vertical, innovation, .. } = self;
        let x = horizontal.factor.variances();
        let y = vertical.factor.variances() + self.scale_error.variances();
        (horizontal.is_finite() && vertical.is_finite()).then_some(Estimate {
            t_ns,
            in_stance: self.in_stance(),
            vx_m_s: horizontal.velocity_m_s,
            y_m: vertical.position_m,
            vy_m_s: vertical.velocity_m_s,
            density_ratio: vertical.parameter,
            vx_variance: x.z,
            y_variance: y.w,
            vy_variance: y.z,
            density_variance: y.y,
            innovation: innovation.deviations(),
        })
    }

    /// Corrects the states along y, and the scale error with them.
    #[inline]
    fn correct_vertical(&mut self, reading: &Reading) -> Use {
        let use_of_it = self.vertical.correct(reading);
        if let Use::Taken(correction) = &use_of_it {
            self.scale_error.correct(reading, correction, &mut self.vertical);
        }
        use_of_it
    }

    /// Returns horizontal velocity, height and vertical velocity, m/s and m.
    fn motion(&self) -> [f32; 3] {
        let Self { horizontal, vertical, .. } = self;
        [horizontal.velocity_m_s, vertical.position_m, vertical.velocity_m_s]
    }

    /// Returns the vertical acceleration in flight, m/s2.
    fn ay_m_s2(&self) -> f32 {
        self.model.ay_m_s2(self.vertical.velocity_m_s, self.vertical.parameter)
    }

    /// Returns whether the foot is on the ground.
    fn in_stance(&self) -> bool {
        self.contact.in_stance()
    }

    /// Returns the touchdown that the last contact readings may be the beginning of.
    fn suspected_touchdown(&self) -> Option<Edge> {
        self.contact.suspected().filter(|edge| edge.in_stance)
    }

    /// Returns whether the time of the next touchdown is known within some hundredths of a
    /// second.
    fn touchdown_is_foreseen(&self) -> bool {
        let vy_m_s = self.vertical.velocity_m_s;
        let within_m = FORESEEN_S * vy_m_s.abs().max(self.scales.rest_length_m);
        self.variances.w < within_m * within_m
    }

    fn motion_now(&self, t_ns: u64) -> Motion {
        let [vx_m_s, y_m, vy_m_s] = self.motion();
        Motion { t_ns, vx_m_s, vy_m_s, y_m }
    }

    fn is_lost(&self) -> bool {
        let [velocity, height] = LOST;
        let y = &self.variances;
        // A NaN is not below.
        let is_known = self.vx_variance <= velocity && y.z <= velocity && y.w <= height;
        !is_known || self.contradictions >= CONTRADICTIONS
    }
}

#[cfg(test)]
mod tests;
