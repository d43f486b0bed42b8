//! All sensors of a leg, tick by tick.

use std::collections::VecDeque;

use leg_control::measurement::SpecificImpulse;
use leg_control::wire::{Header, Sample, flags};

use super::accelerometer::Accelerometer;
use super::catalog::Figures;
use super::channel::Channel;
use super::contact::ContactSwitch;
use super::delivery::Delivery;
use super::figure::{Quantity, Sensor};
use super::rng;

/// Pressure of the standard atmosphere at sea level (ISO 2533), Pa.
const ATMOSPHERE_PA: f64 = 101_325.0;
const WATER_KG_M3: f64 = 1000.0;

/// The true state at a tick, and what happened since the tick before.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    /// Ticks since the sensors were turned on; rises from call to call.
    pub tick: u64,
    /// Velocity of the mass, m/s: horizontal, vertical.
    pub velocity_m_s: [f64; 2],
    /// Height of the mass over the ground under it, m.
    pub height_m: f64,
    /// Height of the mass over 0, m.
    pub y_m: f64,
    /// Whether the foot is on the ground.
    pub is_on_ground: bool,
    /// Length of the leg, m.
    pub leg_length_m: f64,
    /// Angle of the leg from the +x axis, rad.
    pub leg_angle_rad: f64,
    /// Pitch of the body, rad, positive where it leans back.
    pub pitch_rad: f64,
    /// Rate of the pitch, rad/s.
    pub pitch_rate_rad_s: f64,
    /// Change of the velocity since the tick before less that by gravity, m/s.
    pub impulse_m_s: [f64; 2],
    /// Gravity, m/s2.
    pub gravity_m_s2: f64,
    /// Fluid density over that of water.
    pub density_ratio: f64,
}

/// A sensor of `N` channels that are read together.
#[derive(Debug)]
struct Model<const N: usize> {
    channels: [Channel; N],
    delivery: Delivery<[f64; N]>,
    min_density: f64,
}

impl<const N: usize> Model<N> {
    fn new(figures: &Figures, sensor: Sensor, run_rate_hz: u32, seed: u64) -> Option<Self> {
        let delivery = Delivery::new(figures, sensor, run_rate_hz, rng(seed, sensor, 7))?;
        let rate_hz = figures.of(sensor, Quantity::Rate).min(run_rate_hz.into());
        let channel = |i| Channel::new(figures, sensor, rate_hz, rng(seed, sensor, i as u64));
        Some(Self {
            channels: std::array::from_fn(channel),
            delivery,
            min_density: figures.of(sensor, Quantity::MinDensity),
        })
    }

    /// Returns the reading that arrives at a tick and its age, ns, if one does; `size` is that of
    /// which a share is noise.
    fn read(&mut self, truth: &Truth, values: [f64; N], size: f64) -> Option<([f32; N], u32)> {
        let Self { channels, delivery, min_density } = self;
        let works = truth.density_ratio >= *min_density;
        let read = || {
            let mut reading = values;
            for (channel, value) in channels.iter_mut().zip(&mut reading) {
                *value = channel.read(*value, size);
            }
            works.then_some(reading)
        };
        let aged = delivery.pass(truth.tick, read)?;
        Some((aged.value.map(|value| value as f32), aged.age_ns))
    }

    fn clear(&mut self) {
        self.delivery.clear();
    }
}

/// The sensors of a leg.
#[derive(Debug)]
pub struct SensorModels {
    tick_s: f64,
    surface_m: f64,
    state: Option<Model<3>>,
    contact: Option<ContactSwitch>,
    leg_length: Option<Model<1>>,
    leg_angle: Option<Model<1>>,
    accelerometer: Accelerometer,
    impulse: Option<Delivery<SpecificImpulse>>,
    gyro: Option<Model<1>>,
    pitch: Option<Model<1>>,
    velocity: Option<Model<2>>,
    height: Option<Model<1>>,
    pressure: Option<Model<1>>,
    /// Samples of the last ticks that are not sent yet, oldest first.
    late: VecDeque<Sample>,
    late_ticks: usize,
}

impl SensorModels {
    /// Creates the sensors of a run of this rate and seed, and draws their biases.
    #[must_use]
    pub fn new(figures: &Figures, rate_hz: u32, seed: u64) -> Self {
        let accelerometer = Sensor::Accelerometer;
        let late_s = figures.of(Sensor::Sample, Quantity::Latency);
        let late_ticks = libm::round(late_s * f64::from(rate_hz)) as usize;
        Self {
            tick_s: 1.0 / f64::from(rate_hz),
            surface_m: figures.of(Sensor::Pressure, Quantity::Surface),
            state: Model::new(figures, Sensor::State, rate_hz, seed),
            contact: ContactSwitch::new(figures, rate_hz, rng(seed, Sensor::Contact, 0)),
            leg_length: Model::new(figures, Sensor::LegLength, rate_hz, seed),
            leg_angle: Model::new(figures, Sensor::LegAngle, rate_hz, seed),
            accelerometer: Accelerometer::new(figures, rate_hz, seed),
            impulse: Delivery::new(figures, accelerometer, rate_hz, rng(seed, accelerometer, 7)),
            gyro: Model::new(figures, Sensor::Gyro, rate_hz, seed),
            pitch: Model::new(figures, Sensor::Pitch, rate_hz, seed),
            velocity: Model::new(figures, Sensor::Velocity, rate_hz, seed),
            height: Model::new(figures, Sensor::Height, rate_hz, seed),
            pressure: Model::new(figures, Sensor::Pressure, rate_hz, seed),
            late: VecDeque::with_capacity(late_ticks + 1),
            late_ticks,
        }
    }

    /// Forgets the readings under way, before the leg is put back to its start. Biases, and the
    /// sum of the accelerometer, stay.
    pub fn clear(&mut self) {
        self.state.iter_mut().for_each(Model::clear);
        self.contact.iter_mut().for_each(ContactSwitch::clear);
        let single = [
            &mut self.leg_length,
            &mut self.leg_angle,
            &mut self.gyro,
            &mut self.pitch,
            &mut self.height,
            &mut self.pressure,
        ];
        single.into_iter().flatten().for_each(Model::clear);
        self.impulse.iter_mut().for_each(Delivery::clear);
        self.velocity.iter_mut().for_each(Model::clear);
        self.late.clear();
    }

    /// Returns the sample that is sent in the tick in which `sample` was read: the same, unless
    /// samples are late. A late one has the readings and the time of the tick that it was read
    /// in, and the number of the tick that it is sent in. Before the first there is none with
    /// readings.
    pub fn sent(&mut self, sample: Sample) -> Sample {
        self.late.push_back(sample);
        let header = sample.header;
        if self.late.len() <= self.late_ticks {
            let none = Header { flags: 0, ..header };
            return Sample { header: none, ..Sample::default() };
        }
        let read = self.late.pop_front().unwrap_or(sample);
        Sample { header: Header { seq: header.seq, ..read.header }, ..read }
    }

    /// Writes the readings of a tick, and their flags, into a sample that has none.
    pub fn read(&mut self, truth: &Truth, sample: &mut Sample) {
        self.read_state(truth, sample);
        self.read_leg(truth, sample);
        self.read_inertial(truth, sample);
        self.read_slow(truth, sample);
    }

    fn read_state(&mut self, truth: &Truth, sample: &mut Sample) {
        let [vx_m_s, vy_m_s] = truth.velocity_m_s;
        let state = [vx_m_s, truth.height_m, vy_m_s];
        if let Some(model) = &mut self.state
            && let Some((reading, _)) = model.read(truth, state, 0.0)
        {
            [sample.vx_m_s, sample.y_m, sample.vy_m_s] = reading;
            sample.header.flags |= flags::STATE_SENSED;
        }
    }

    fn read_leg(&mut self, truth: &Truth, sample: &mut Sample) {
        if let Some(switch) = &mut self.contact {
            sample.header.flags |= flags::CONTACT_SENSED;
            if switch.read(truth.tick, truth.is_on_ground) {
                sample.header.flags |= flags::IN_CONTACT;
            }
        }
        if let Some(model) = &mut self.leg_length
            && let Some(([reading], _)) = model.read(truth, [truth.leg_length_m], 0.0)
        {
            sample.leg_length_m = reading;
            sample.header.flags |= flags::LEG_LENGTH_SENSED;
        }
        let of_body_rad = truth.leg_angle_rad - truth.pitch_rad;
        if let Some(model) = &mut self.leg_angle
            && let Some(([reading], _)) = model.read(truth, [of_body_rad], 0.0)
        {
            sample.sensors.leg_angle_rad = reading;
            sample.header.flags |= flags::LEG_ANGLE_SENSED;
        }
    }

    fn read_inertial(&mut self, truth: &Truth, sample: &mut Sample) {
        if let Some(delivery) = &mut self.impulse {
            self.accelerometer.add(truth.impulse_m_s, truth.pitch_rad, self.tick_s);
            let sum = self.accelerometer.sum();
            if let Some(reading) = delivery.pass(truth.tick, || Some(sum)) {
                sample.sensors.impulse = reading.value.0;
                sample.header.flags |= flags::IMPULSE_SENSED;
            }
        }
        if let Some(model) = &mut self.gyro
            && let Some(([reading], _)) = model.read(truth, [truth.pitch_rate_rad_s], 0.0)
        {
            sample.sensors.pitch_rate_rad_s = reading;
            sample.header.flags |= flags::PITCH_RATE_SENSED;
        }
        if let Some(model) = &mut self.pitch
            && let Some(([reading], _)) = model.read(truth, [truth.pitch_rad], 0.0)
        {
            sample.sensors.pitch_rad = reading;
            sample.header.flags |= flags::PITCH_SENSED;
        }
    }

    fn read_slow(&mut self, truth: &Truth, sample: &mut Sample) {
        let [vx_m_s, vy_m_s] = truth.velocity_m_s;
        if let Some(model) = &mut self.velocity
            && let Some((reading, age_ns)) =
                model.read(truth, truth.velocity_m_s, libm::hypot(vx_m_s, vy_m_s))
        {
            (sample.sensors.velocity_m_s, sample.sensors.velocity_age_ns) = (reading, age_ns);
            sample.header.flags |= flags::VELOCITY_SENSED;
        }
        if let Some(model) = &mut self.height
            && let Some(([reading], age_ns)) = model.read(truth, [truth.height_m], truth.height_m)
        {
            (sample.sensors.height_m, sample.sensors.height_age_ns) = (reading, age_ns);
            sample.header.flags |= flags::HEIGHT_SENSED;
        }
        let depth_m = (self.surface_m - truth.y_m).max(0.0);
        let pressure_pa =
            ATMOSPHERE_PA + WATER_KG_M3 * truth.density_ratio * truth.gravity_m_s2 * depth_m;
        if let Some(model) = &mut self.pressure
            && let Some(([reading], age_ns)) = model.read(truth, [pressure_pa], 0.0)
        {
            (sample.sensors.pressure_pa, sample.sensors.pressure_age_ns) = (reading, age_ns);
            sample.header.flags |= flags::PRESSURE_SENSED;
        }
    }
}
