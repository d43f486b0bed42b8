//! The state of the leg, estimated from noisy readings of its velocity and height.
//!
//! A Kalman filter in three blocks: horizontal velocity; height; vertical velocity with the
//! density ratio. Each tick it predicts and then takes the readings that came:
//!
//! ```text
//! flight   x' = f(x) by weight, buoyancy and drag (midpoint rule)
//!          P' = F P F' + Q     F of (vy, rho) = | 1 - 2 cy rho |vy| dt    dt (b - cy vy |vy|) |
//!                                               |          0                      1           |
//! stance   velocities and density as random walks, y' = y + vy dt
//! reading  K = P / (P + R)     x += K (z - x)     P' = K R
//! ```
//!
//! (`model.rs` has the symbols.) The blocks leave out what velocity and height have in
//! common, on purpose: height is measured above the ground under the mass, and uneven
//! ground would pull the velocity along. The spring is not modelled in stance: a filter
//! that knows its stiffness was no better, and one that knows it wrongly is worse.
//!
//! The density is observed through the vertical acceleration in flight. A change of the
//! medium shows as a drift of the innovations of the vertical velocity; a cumulative sum
//! (Page, "Continuous inspection schemes", Biometrika 41, 1954) finds it and reopens the
//! density.
//!
//! `R` is the stated noise, or the measured one where that is larger (`noise.rs`).
//! Constants are those of the human-size leg; lengths scale with the leg's rest length and
//! speeds with its square root, as for dynamically similar legs (Froude).

use super::block::{FIRST_DENSITY, Scalar, Vertical};
use super::contact::{ContactFilter, Edge};
use super::model::{Flight, FlightModel};
use super::noise::{CHANNELS, NoiseMeter};
use super::tracker::ApexTracker;
use super::{Estimate, Events, Filter};
use crate::gait::{self, Apex, Gait};
use crate::guard::{Channels, Trusted};
use crate::leg::LegModel;
use crate::measurement::Measurement;

/// Standard deviations of the leg length by which a loaded leg is shorter than at rest.
const LOADED: f32 = 3.0;

/// The channels in their order.
const VX: usize = 0;
const Y: usize = 1;
const VY: usize = 2;

/// Readings of each channel whose noise is measured before the filter begins.
const FIRST_READINGS: u16 = 4;
/// Variance of a density ratio that is measured.
const MEASURED_DENSITY_VARIANCE: f32 = 1e-4;
/// Variance of the density ratio below which a decision may be made for the first time.
const KNOWN_DENSITY_VARIANCE: f32 = 0.01;
/// Process noise of the velocities in flight, m2/s3, at a rest length of 1 m.
const FLIGHT_NOISE: f32 = 0.05 * 0.05;
/// Process noise of the velocities in stance, m2/s3: the spring accelerates the mass by up
/// to 50 m/s2 for a tenth of a second.
const STANCE_NOISE: f32 = 10.0 * 10.0;
/// Process noise of the height, m2/s, beside that of the velocity: the ground.
const HEIGHT_NOISE: f32 = 0.1 * 0.1;
/// Time over which an error of the velocity shifts the height, s.
const HEIGHT_MEMORY_S: f32 = 1.0;
/// Process noise of the density ratio, 1/s: the shore.
const DENSITY_NOISE: f32 = 0.07 * 0.07;

/// Drift and threshold of the cumulative sums, in standard deviations: false alarms are
/// minutes apart, and a change of the medium from land to water takes some hundredths of a
/// second.
const DRIFT: f32 = 0.5;
const ALARM: f32 = 12.0;

/// Height of the touchdown beside the estimate, m, at a rest length of 1 m, and time of the
/// fall beside it, s, within which a touchdown is likely whatever the variance.
const TOUCHDOWN_MARGIN_M: f32 = 0.05;
const TOUCHDOWN_MARGIN_S: f32 = 0.02;
/// Standard deviations within which something is likely, squared.
const LIKELY: f32 = 3.0 * 3.0;

/// The noise of the readings as the user states it: standard deviations.
///
/// The filter measures the noise too, and reckons with the larger one. So a stated noise is
/// a lower bound; it need not be known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StateNoise {
    /// Of both velocities, m/s.
    pub velocity_m_s: f32,
    /// Of the height, m.
    pub height_m: f32,
    /// Of the leg length, m; counts only where it stands in for a contact reading.
    pub leg_length_m: f32,
}

impl Default for StateNoise {
    /// Returns 0.01 m/s, 0.01 m, and 1 mm of leg length.
    fn default() -> Self {
        Self { velocity_m_s: 0.01, height_m: 0.01, leg_length_m: 1e-3 }
    }
}

impl StateNoise {
    /// Returns whether every deviation is from 1e-4 to 1e3.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let Self { velocity_m_s, height_m, leg_length_m } = *self;
        [velocity_m_s, height_m, leg_length_m].iter().all(|x| (1e-4..=1e3).contains(x))
    }
}

/// Process noise and margins of this leg.
#[derive(Clone, Copy, Debug)]
struct Scales {
    flight_noise: f32,
    stance_noise: f32,
    height_noise: f32,
    touchdown_margin_m: f32,
}

/// Replaces the readings that are not usable by NaN. Apart: few ticks call it.
#[inline(never)]
fn leave_out(readings: &mut [f32; CHANNELS], usable: Channels) {
    for (reading, channel) in readings.iter_mut().zip([Channels::VX, Channels::Y, Channels::VY]) {
        *reading = if usable.has(channel) { *reading } else { f32::NAN };
    }
}

impl Scales {
    fn new(rest_length_m: f32) -> Self {
        Self {
            flight_noise: FLIGHT_NOISE * rest_length_m,
            stance_noise: STANCE_NOISE * rest_length_m,
            height_noise: HEIGHT_NOISE * rest_length_m * rest_length_m,
            touchdown_margin_m: TOUCHDOWN_MARGIN_M * rest_length_m,
        }
    }
}

/// The filter.
#[derive(Clone, Debug)]
pub(crate) struct StateFilter {
    model: FlightModel,
    scales: Scales,
    /// Stated deviation of the leg length, m.
    leg_length_m: f32,
    /// Time without a reading of a channel after which there is no estimate, s.
    stale_s: f32,
    t_ns: Option<u64>,
    has_begun: bool,
    density_is_known: bool,
    vx: Scalar,
    y: Scalar,
    vertical: Vertical,
    innovation: f32,
    /// Cumulative sums of the innovations of the vertical velocity, upwards and downwards.
    sums: [f32; 2],
    noise: NoiseMeter,
    /// Motion by the model since the flight began.
    flown: [f32; CHANNELS],
    /// Time since the last reading, s.
    missing_s: [f32; CHANNELS],
    contact: ContactFilter,
    tracker: ApexTracker,
}

impl Filter for StateFilter {
    fn has_begun(&self) -> bool {
        self.has_begun
    }

    #[inline]
    fn update(&mut self, measurement: &Trusted<'_>, gait: &Gait) -> Option<Events> {
        let (m, usable) = (measurement.measurement(), measurement.usable());
        let is_loaded = usable.has(Channels::CONTACT).then(|| {
            let tolerance_m =
                (LOADED * self.leg_length_m).max(gait::LENGTH_TOLERANCE * gait.rest_length_m());
            gait.is_loaded(m, tolerance_m)
        });
        self.take(m, usable, is_loaded, gait.touchdown_y_m())
    }

    fn density_ratio(&self) -> f32 {
        self.vertical.density_ratio
    }

    fn apex(&self) -> Option<Apex> {
        let [vx_m_s, y_m, vy_m_s] = self.motion();
        let density_ratio = self.density_ratio();
        let apex = self.model.at_apex(Flight { vx_m_s, y_m, vy_m_s, density_ratio })?;
        Some(Apex { vx_m_s: apex.vx_m_s, y_m: apex.y_m })
    }
}

impl StateFilter {
    /// Returns a filter that knows nothing yet.
    pub(crate) fn new(
        leg: &LegModel,
        gravity_m_s2: f32,
        tick_ns: u64,
        stale_ns: u64,
        stated: &StateNoise,
    ) -> Self {
        let velocity = stated.velocity_m_s * stated.velocity_m_s;
        let height = stated.height_m * stated.height_m;
        Self {
            model: FlightModel::new(leg, gravity_m_s2),
            scales: Scales::new(leg.rest_length_m),
            leg_length_m: stated.leg_length_m,
            // At most a second: 32 bits are enough, and need no software.
            stale_s: 1e-9 * stale_ns as u32 as f32,
            t_ns: None,
            has_begun: false,
            density_is_known: false,
            vx: Scalar::default(),
            y: Scalar::default(),
            vertical: Vertical::default(),
            innovation: 0.0,
            sums: [0.0; 2],
            noise: NoiseMeter::new(tick_ns, [velocity, height, velocity]),
            flown: [0.0; CHANNELS],
            missing_s: [0.0; CHANNELS],
            contact: ContactFilter::new(tick_ns),
            tracker: ApexTracker::new(),
        }
    }

    /// Changes the leg and gravity of the model; the state stays.
    pub(crate) fn set_leg(&mut self, leg: &LegModel, gravity_m_s2: f32) {
        self.model = FlightModel::new(leg, gravity_m_s2);
        self.scales = Scales::new(leg.rest_length_m);
    }

    /// Takes a measurement and whether it shows a loaded foot, where it shows that; the leg
    /// would touch down at a height of `touchdown_y_m`. Returns none while there is no
    /// estimate: before it has begun, or after a channel was missing for too long.
    #[inline]
    fn take(
        &mut self,
        measurement: &Measurement,
        usable: Channels,
        is_loaded: Option<bool>,
        touchdown_y_m: f32,
    ) -> Option<Events> {
        let &Measurement { t_ns, vx_m_s, y_m, vy_m_s, density_ratio, .. } = measurement;
        let mut readings = [vx_m_s, y_m, vy_m_s];
        let is_whole = usable.has(Channels::MOTION);
        if !is_whole {
            leave_out(&mut readings, usable);
        }
        let dt_s =
            self.t_ns.map_or(0.0, |before_ns| 1e-9 * t_ns.saturating_sub(before_ns) as u32 as f32);
        self.t_ns = Some(t_ns);
        self.noise.push(readings, dt_s);
        if !self.has_begun {
            self.begin(readings);
            if let Some(is_loaded) = is_loaded {
                self.contact.update(t_ns, is_loaded, || true);
            }
            return None;
        }
        self.predict(dt_s);
        if is_whole {
            self.missing_s = [0.0; CHANNELS];
            self.correct(readings);
        } else {
            self.correct_in_part(readings, dt_s)?;
        }
        if let Some(density_ratio) = density_ratio.filter(|_| usable.has(Channels::DENSITY)) {
            self.vertical.set_density(density_ratio, MEASURED_DENSITY_VARIANCE);
        }
        Some(self.find_events(t_ns, is_loaded, touchdown_y_m))
    }

    /// Returns the estimate; none before it has begun, nor while a number is not finite: a
    /// leg whose model overflows has such states, until the readings replace them.
    pub(crate) fn estimate(&self) -> Option<Estimate> {
        let t_ns = self.t_ns.filter(|_| self.has_begun)?;
        let Self { vx, y, vertical, innovation, .. } = *self;
        let density_variance = vertical.density_variance();
        let states = vx.value + y.value + vertical.vy_m_s + vertical.density_ratio;
        let variances = vx.variance + y.variance + vertical.vy_variance + density_variance;
        (states + variances).is_finite().then_some(Estimate {
            t_ns,
            in_stance: self.in_stance(),
            vx_m_s: vx.value,
            y_m: y.value,
            vy_m_s: vertical.vy_m_s,
            density_ratio: vertical.density_ratio,
            vx_variance: vx.variance,
            y_variance: y.variance,
            vy_variance: vertical.vy_variance,
            density_variance,
            innovation,
        })
    }

    /// Returns horizontal velocity, height and vertical velocity, m/s and m.
    fn motion(&self) -> [f32; CHANNELS] {
        [self.vx.value, self.y.value, self.vertical.vy_m_s]
    }

    /// Returns the vertical acceleration in flight, m/s2.
    fn ay_m_s2(&self) -> f32 {
        self.model.ay_m_s2(self.vertical.vy_m_s, self.vertical.density_ratio)
    }

    /// Returns whether the foot is on the ground.
    fn in_stance(&self) -> bool {
        self.contact.in_stance()
    }

    /// Returns the touchdown that the last contact readings may be the beginning of.
    fn suspected_touchdown(&self) -> Option<Edge> {
        self.contact.suspected().filter(|edge| edge.in_stance)
    }

    /// Begins at these readings, once the noise is known.
    #[inline(never)]
    fn begin(&mut self, readings: [f32; CHANNELS]) {
        let [vx, y, vy] = readings;
        if !self.noise.has_compared(FIRST_READINGS) || readings.iter().any(|x| x.is_nan()) {
            return;
        }
        let [vx_variance, y_variance, vy_variance] = self.noise.variance();
        self.vx = Scalar::new(vx, vx_variance);
        self.y = Scalar::new(y, y_variance);
        self.vertical = Vertical::new([vy, vy_variance], FIRST_DENSITY);
        self.has_begun = true;
    }

    fn predict(&mut self, dt_s: f32) {
        let Self { model, scales, vx, y, vertical, .. } = self;
        let density_noise = DENSITY_NOISE * dt_s;
        y.variance += (scales.height_noise + HEIGHT_MEMORY_S * vertical.vy_variance) * dt_s;
        if self.contact.in_stance() {
            let noise = scales.stance_noise * dt_s;
            y.value += vertical.vy_m_s * dt_s;
            vx.variance += noise;
            vertical.walk(noise, density_noise);
            return;
        }
        let noise = scales.flight_noise * dt_s;
        let (vy_m_s, density_ratio) = (vertical.vy_m_s, vertical.density_ratio);
        let a = 1.0 + dt_s * model.ay_by_vy(vy_m_s, density_ratio);
        let b = dt_s * model.ay_by_density(vy_m_s);
        vertical.propagate([a, b], noise, density_noise);
        let a = 1.0 + dt_s * model.ax_by_vx(vx.value, density_ratio);
        vx.variance = a * a * vx.variance + noise;
        let before = Flight { vx_m_s: vx.value, y_m: y.value, vy_m_s, density_ratio };
        let mut flight = before;
        model.advance(&mut flight, dt_s);
        (vx.value, y.value, vertical.vy_m_s) = (flight.vx_m_s, flight.y_m, flight.vy_m_s);
        self.flown[VX] += flight.vx_m_s - before.vx_m_s;
        self.flown[Y] += flight.y_m - before.y_m;
        self.flown[VY] += flight.vy_m_s - before.vy_m_s;
    }

    /// Takes readings of every channel.
    fn correct(&mut self, [vx, y, vy]: [f32; CHANNELS]) {
        let [vx_variance, y_variance, vy_variance] = self.noise.variance();
        let uses_vx = self.vx.update(vx, vx_variance);
        let uses_y = self.y.update(y, y_variance);
        let uses_vy = self.correct_vy(vy, vy_variance);
        if uses_vx && uses_y && uses_vy && !self.in_stance() {
            let [flown_vx, flown_y, flown_vy] = self.flown;
            self.noise.push_in_flight([vx - flown_vx, y - flown_y, vy - flown_vy]);
        }
    }

    /// Takes readings of which some are missing. Returns none, and forgets the state, where
    /// one has been missing for too long.
    #[inline(never)]
    fn correct_in_part(&mut self, readings: [f32; CHANNELS], dt_s: f32) -> Option<()> {
        for (missing_s, reading) in self.missing_s.iter_mut().zip(readings) {
            *missing_s = if reading.is_nan() { *missing_s + dt_s } else { 0.0 };
        }
        if self.missing_s.iter().any(|&missing_s| missing_s > self.stale_s) {
            self.has_begun = false;
            return None;
        }
        let [vx, y, vy] = readings;
        let [vx_variance, y_variance, vy_variance] = self.noise.variance();
        if !vx.is_nan() {
            self.vx.update(vx, vx_variance);
        }
        if !y.is_nan() {
            self.y.update(y, y_variance);
        }
        if !vy.is_nan() {
            self.correct_vy(vy, vy_variance);
        }
        Some(())
    }

    /// Takes a reading of the vertical velocity; returns whether it was used.
    #[inline]
    fn correct_vy(&mut self, reading: f32, variance: f32) -> bool {
        let Some(innovation) = self.vertical.update(reading, variance) else { return false };
        if !self.in_stance() {
            self.innovation = innovation;
            self.watch_medium(innovation);
        }
        true
    }

    /// Adds an innovation in standard deviations to the cumulative sums.
    fn watch_medium(&mut self, deviations: f32) {
        let [up, down] = self.sums;
        // A NaN becomes 0.
        let positive = |x: f32| if x > 0.0 { x } else { 0.0 };
        let (up, down) = (positive(up + deviations - DRIFT), positive(down - deviations - DRIFT));
        self.sums = [up, down];
        if up > ALARM || down > ALARM {
            self.sums = [0.0; 2];
            self.vertical.set_density(self.vertical.density_ratio, FIRST_DENSITY[1]);
        }
    }

    fn find_events(&mut self, t_ns: u64, is_loaded: Option<bool>, touchdown_y_m: f32) -> Events {
        let Self { y, vertical, scales, .. } = *self;
        let (vy_m_s, vy_variance) = (vertical.vy_m_s, vertical.vy_variance);
        let was_in_stance = self.in_stance();
        let is_likely = || {
            let vy_may_be_zero = vy_m_s * vy_m_s < LIKELY * vy_variance;
            if was_in_stance {
                return vy_m_s >= 0.0 || vy_may_be_zero;
            }
            let margin_m = scales.touchdown_margin_m + TOUCHDOWN_MARGIN_S * vy_m_s.abs();
            let beyond_m = (y.value - touchdown_y_m).abs() - margin_m;
            (vy_m_s <= 0.0 || vy_may_be_zero)
                && (beyond_m < 0.0 || beyond_m * beyond_m < LIKELY * y.variance)
        };
        let edge = is_loaded.and_then(|is_loaded| self.contact.update(t_ns, is_loaded, is_likely));
        if edge.is_some() {
            self.noise.end_flight();
            self.flown = [0.0; CHANNELS];
            self.sums = [0.0; 2];
        }
        self.density_is_known |= vertical.density_variance() < KNOWN_DENSITY_VARIANCE;
        let passed_apex = self.density_is_known
            && self.tracker.update([vy_m_s, vy_variance], edge.map(|edge| edge.in_stance));
        Events {
            edge,
            suspected: self.suspected_touchdown(),
            passed_apex,
            in_stance: self.in_stance(),
            density_is_known: self.density_is_known,
            touchdown_is_foreseen: true,
            motion: self.motion(),
            ay_m_s2: self.ay_m_s2(),
        }
    }
}

#[cfg(test)]
#[path = "state_tests.rs"]
mod tests;
