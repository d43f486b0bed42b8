//! The messages between a leg and its controller, on shared memory and on a
//! serial line alike.
//!
//! They hold only integers and floats: a peer can send any bits, and there must be no
//! bits that are not a value. Copy a message out, let [`crate::wire_controller`] check
//! it, then use it. Every struct is `#[repr(C)]` without padding, which `Pod` checks; sizes
//! are asserted.

use bytemuck::{Pod, Zeroable};

use crate::command::{LegCommand, Status, Telemetry};
use crate::guard::Counts;
#[cfg(feature = "estimator")]
use crate::measurement::{Aged, LegPosture, SpecificImpulse};
use crate::measurement::{Contact, Measurement, Sensors};
use serde::{Deserialize, Serialize};

/// The version of every message here. Raised when any field changes.
pub const WIRE_VERSION: u16 = 2;

/// Bits of [`Header::flags`].
pub mod flags {
    /// Sample: the leg senses whether its foot is loaded; [`IN_CONTACT`] is its reading.
    pub const CONTACT_SENSED: u16 = 1 << 0;
    /// Sample: the foot is on the ground. Means nothing without [`CONTACT_SENSED`].
    pub const IN_CONTACT: u16 = 1 << 1;
    /// Sample: `leg_length_m` is measured.
    pub const LEG_LENGTH_SENSED: u16 = 1 << 2;
    /// Sample: `density_ratio` is measured, and used instead of the estimate.
    pub const DENSITY_SENSED: u16 = 1 << 3;
    /// Sample: the run is over, in good order. Carries no reading and asks for no command.
    pub const END: u16 = 1 << 4;
    /// Sample: `vx_m_s` is measured.
    pub const VX_SENSED: u16 = 1 << 5;
    /// Sample: `y_m` is measured.
    pub const Y_SENSED: u16 = 1 << 6;
    /// Sample: `vy_m_s` is measured.
    pub const VY_SENSED: u16 = 1 << 7;
    /// Sample: velocities and height are measured.
    pub const STATE_SENSED: u16 = VX_SENSED | Y_SENSED | VY_SENSED;
    /// Sample: `sensors.impulse` is measured.
    pub const IMPULSE_SENSED: u16 = 1 << 9;
    /// Sample: `sensors.pitch_rad` is measured.
    pub const PITCH_SENSED: u16 = 1 << 10;
    /// Sample: `sensors.leg_angle_rad` is measured.
    pub const LEG_ANGLE_SENSED: u16 = 1 << 11;
    /// Sample: `sensors.velocity_m_s` is measured.
    pub const VELOCITY_SENSED: u16 = 1 << 12;
    /// Sample: `sensors.height_m` is measured.
    pub const HEIGHT_SENSED: u16 = 1 << 13;
    /// Sample: `sensors.pressure_pa` is measured.
    pub const PRESSURE_SENSED: u16 = 1 << 14;
    /// Sample: `sensors.pitch_rate_rad_s` is measured.
    pub const PITCH_RATE_SENSED: u16 = 1 << 15;
    /// Sample: any of `sensors` is measured.
    pub const ANY_OF_SENSORS: u16 = IMPULSE_SENSED
        | PITCH_SENSED
        | PITCH_RATE_SENSED
        | LEG_ANGLE_SENSED
        | VELOCITY_SENSED
        | HEIGHT_SENSED
        | PRESSURE_SENSED;
    /// Command: the guard has taken over, this is the safe command.
    pub const SAFE: u16 = 1 << 8;
}

/// What every message starts with.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable, Serialize, Deserialize)]
pub struct Header {
    /// [`WIRE_VERSION`] of the sender.
    pub version: u16,
    /// Bits of [`flags`].
    pub flags: u16,
    /// Raised by the leg at each reset: a reply to an earlier run is never taken.
    pub run_id: u32,
    /// Tick number, from 0. A command carries the number of its sample.
    pub seq: u64,
    /// Time of the sample since the run's start, ns.
    pub t_ns: u64,
}

/// What the leg feels at a tick, and the speed that it is asked to keep.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, Serialize, Deserialize)]
pub struct Sample {
    /// Version, flags, run id, tick and time.
    pub header: Header,
    /// Wanted mean horizontal velocity, m/s.
    pub set_point_m_s: f32,
    /// Horizontal velocity of the mass, m/s; read with [`flags::VX_SENSED`].
    pub vx_m_s: f32,
    /// Height of the mass above the ground, m; read with [`flags::Y_SENSED`].
    pub y_m: f32,
    /// Vertical velocity of the mass, m/s; read with [`flags::VY_SENSED`].
    pub vy_m_s: f32,
    /// Length of the leg from foot to mass, m (in flight that of the unloaded
    /// leg, its elongation included); read with [`flags::LEG_LENGTH_SENSED`].
    pub leg_length_m: f32,
    /// Fluid density over that of water; read with [`flags::DENSITY_SENSED`].
    pub density_ratio: f32,
    /// Readings of a leg that does not sense its state itself.
    #[serde(with = "sensors_on_the_line")]
    pub sensors: SensorReadings,
}

/// What a leg feels that does not sense its state itself; see [`Sensors`]. A field is read with
/// its flag.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SensorReadings {
    /// Orientation of the body, rad.
    pub pitch_rad: f32,
    /// Rate of the pitch, rad/s.
    pub pitch_rate_rad_s: f32,
    /// Angle of the leg from the body's +x axis, rad; read with the leg length only.
    pub leg_angle_rad: f32,
    /// Integral of the specific force along the body's x and y axes, 2^-16 m/s; it wraps.
    pub impulse: [i32; 2],
    /// Velocity over the ground, m/s: horizontal, vertical.
    pub velocity_m_s: [f32; 2],
    /// Height above the ground, m.
    pub height_m: f32,
    /// Pressure of the fluid, Pa.
    pub pressure_pa: f32,
    /// Time from the reading of the velocity to that of the sample, ns.
    pub velocity_age_ns: u32,
    /// Time from the reading of the height to that of the sample, ns.
    pub height_age_ns: u32,
    /// Time from the reading of the pressure to that of the sample, ns.
    pub pressure_age_ns: u32,
}

/// On the serial line the readings are an option: of a leg without such sensors, all of whose
/// bits are 0, they take one byte. Of another they are the bytes of the struct, each word with
/// its lowest byte first: a decoder of twelve fields would cost the firmware a kilobyte.
mod sensors_on_the_line {
    use super::SensorReadings;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    const WORDS: usize = size_of::<SensorReadings>() / size_of::<u32>();

    pub(super) fn serialize<S: Serializer>(
        sensors: &SensorReadings,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let words: [u32; WORDS] = bytemuck::cast(*sensors);
        let words = words.map(u32::to_le);
        let is_any = words != [0; WORDS];
        is_any.then_some(bytemuck::bytes_of(&words)).serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<SensorReadings, D::Error> {
        let mut words = [0; WORDS];
        if let Some(bytes) = Option::<&[u8]>::deserialize(deserializer)? {
            let place: &mut [u8] = bytemuck::bytes_of_mut(&mut words);
            if bytes.len() != place.len() {
                return Err(D::Error::custom("readings of 48 bytes"));
            }
            place.copy_from_slice(bytes);
        }
        Ok(bytemuck::cast(words.map(u32::from_le)))
    }
}

/// Returns a reading, or 0 where it is not sensed.
fn sensed_or_zero(reading: f32) -> f32 {
    if reading.is_nan() { 0.0 } else { reading }
}

impl Sample {
    /// Returns the message of a measurement and a set-point, m/s: tick `seq` of run `run_id`.
    #[must_use]
    pub fn new(run_id: u32, seq: u64, measurement: &Measurement, set_point_m_s: f32) -> Self {
        let &Measurement { t_ns, vx_m_s, y_m, vy_m_s, contact, density_ratio, sensors } =
            measurement;
        let (contact_flags, length_m) = match contact {
            Contact::Sensed(true) => (flags::CONTACT_SENSED | flags::IN_CONTACT, None),
            Contact::Sensed(false) => (flags::CONTACT_SENSED, None),
            Contact::LegLength(length_m) => (0, Some(length_m)),
        };
        let Sensors { impulse, pitch_rad, pitch_rate_rad_s, posture, .. } = sensors;
        let Sensors { velocity_m_s, height_m, pressure_pa, .. } = sensors;
        let length_m = posture.map(|posture| posture.length_m).or(length_m);
        let flag = |flag: u16, is_sensed: bool| if is_sensed { flag } else { 0 };
        let sensed = flag(flags::VX_SENSED, !vx_m_s.is_nan())
            | flag(flags::Y_SENSED, !y_m.is_nan())
            | flag(flags::VY_SENSED, !vy_m_s.is_nan())
            | flag(flags::LEG_LENGTH_SENSED, length_m.is_some())
            | flag(flags::DENSITY_SENSED, density_ratio.is_some())
            | flag(flags::IMPULSE_SENSED, impulse.is_some())
            | flag(flags::PITCH_SENSED, pitch_rad.is_some())
            | flag(flags::PITCH_RATE_SENSED, pitch_rate_rad_s.is_some())
            | flag(flags::LEG_ANGLE_SENSED, posture.is_some())
            | flag(flags::VELOCITY_SENSED, velocity_m_s.is_some())
            | flag(flags::HEIGHT_SENSED, height_m.is_some())
            | flag(flags::PRESSURE_SENSED, pressure_pa.is_some());
        Self {
            header: Header {
                version: WIRE_VERSION,
                flags: contact_flags | sensed,
                run_id,
                seq,
                t_ns,
            },
            set_point_m_s,
            vx_m_s: sensed_or_zero(vx_m_s),
            y_m: sensed_or_zero(y_m),
            vy_m_s: sensed_or_zero(vy_m_s),
            leg_length_m: length_m.unwrap_or(0.0),
            density_ratio: density_ratio.unwrap_or(0.0),
            sensors: SensorReadings {
                pitch_rad: pitch_rad.unwrap_or(0.0),
                pitch_rate_rad_s: pitch_rate_rad_s.unwrap_or(0.0),
                leg_angle_rad: posture.map_or(0.0, |posture| posture.angle_rad),
                impulse: impulse.unwrap_or_default().0,
                velocity_m_s: velocity_m_s.map_or([0.0; 2], |aged| aged.value),
                height_m: height_m.map_or(0.0, |aged| aged.value),
                pressure_pa: pressure_pa.map_or(0.0, |aged| aged.value),
                velocity_age_ns: velocity_m_s.map_or(0, |aged| aged.age_ns),
                height_age_ns: height_m.map_or(0, |aged| aged.age_ns),
                pressure_age_ns: pressure_pa.map_or(0, |aged| aged.age_ns),
            },
        }
    }

    /// Returns the readings that the flags declare; `None` when neither contact nor leg
    /// length is among them. A contact reading is taken before a leg length. Without the
    /// feature `estimator`, whose laws alone read them, [`Measurement::sensors`] is empty.
    #[must_use]
    #[inline]
    pub fn measurement(&self) -> Option<Measurement> {
        let mut measurement = self.measurement_of_state(self.contact()?);
        self.complete(&mut measurement);
        Some(measurement)
    }

    /// Returns how the leg senses contact, if it does.
    #[inline]
    pub(crate) fn contact(&self) -> Option<Contact> {
        if self.has(flags::CONTACT_SENSED) {
            Some(Contact::Sensed(self.has(flags::IN_CONTACT)))
        } else if self.has(flags::LEG_LENGTH_SENSED) {
            Some(Contact::LegLength(self.leg_length_m))
        } else {
            None
        }
    }

    /// Returns the readings of a leg that senses its state and has no other sensors, and this
    /// one of contact; [`Self::complete`] makes of it those of any leg.
    #[inline]
    pub(crate) fn measurement_of_state(&self, contact: Contact) -> Measurement {
        Measurement {
            t_ns: self.header.t_ns,
            vx_m_s: self.vx_m_s,
            y_m: self.y_m,
            vy_m_s: self.vy_m_s,
            contact,
            density_ratio: self.has(flags::DENSITY_SENSED).then_some(self.density_ratio),
            sensors: Sensors::default(),
        }
    }

    /// Adds to a [`Self::measurement_of_state`] what the flags declare beyond it, and removes
    /// what they do not. Apart and in place, so that the usual leg pays for one test.
    #[inline]
    pub(crate) fn complete(&self, measurement: &mut Measurement) {
        if self.header.flags & (flags::STATE_SENSED | flags::ANY_OF_SENSORS) != flags::STATE_SENSED
        {
            self.add_sensors(measurement);
        }
    }

    /// Sets the sensors of a measurement, and its state channels that are not sensed to NaN.
    #[inline(never)]
    fn add_sensors(&self, measurement: &mut Measurement) {
        for (flag, reading) in [
            (flags::VX_SENSED, &mut measurement.vx_m_s),
            (flags::Y_SENSED, &mut measurement.y_m),
            (flags::VY_SENSED, &mut measurement.vy_m_s),
        ] {
            if !self.has(flag) {
                *reading = f32::NAN;
            }
        }
        // Without an estimator nothing reads them.
        #[cfg(feature = "estimator")]
        {
            measurement.sensors = self.sensors();
        }
    }

    /// Returns the readings of [`Self::sensors`] that the flags declare.
    #[cfg(feature = "estimator")]
    fn sensors(&self) -> Sensors {
        let readings = &self.sensors;
        let has_posture = self.has(flags::LEG_LENGTH_SENSED | flags::LEG_ANGLE_SENSED);
        Sensors {
            impulse: self.has(flags::IMPULSE_SENSED).then_some(SpecificImpulse(readings.impulse)),
            pitch_rad: self.has(flags::PITCH_SENSED).then_some(readings.pitch_rad),
            pitch_rate_rad_s: self
                .has(flags::PITCH_RATE_SENSED)
                .then_some(readings.pitch_rate_rad_s),
            posture: has_posture.then_some(LegPosture {
                length_m: self.leg_length_m,
                angle_rad: readings.leg_angle_rad,
            }),
            velocity_m_s: self
                .has(flags::VELOCITY_SENSED)
                .then_some(Aged { value: readings.velocity_m_s, age_ns: readings.velocity_age_ns }),
            height_m: self
                .has(flags::HEIGHT_SENSED)
                .then_some(Aged { value: readings.height_m, age_ns: readings.height_age_ns }),
            pressure_pa: self
                .has(flags::PRESSURE_SENSED)
                .then_some(Aged { value: readings.pressure_pa, age_ns: readings.pressure_age_ns }),
        }
    }

    /// Returns whether the leg senses that its foot is on the ground.
    #[must_use]
    pub fn is_in_contact(&self) -> bool {
        self.has(flags::IN_CONTACT)
    }

    /// Returns whether this message ends the run: [`flags::END`] and no other flag, so that
    /// a single flipped bit in a sample with readings does not.
    #[must_use]
    pub fn ends_the_run(&self) -> bool {
        self.header.flags == flags::END
    }

    /// Returns whether every flag of `flags` is set.
    fn has(&self, flags: u16) -> bool {
        self.header.flags & flags == flags
    }
}

/// What the leg is to do from its sample's tick to the next, and why.
///
/// The angle is held by the swinging leg. The spring's rest length is
/// `r0 + clamp(elongation_m + elongation_rate_m_s * s, 0, dr)`, `s` seconds
/// after the tick: a ramp that may start inside a tick, from below zero.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, Serialize, Deserialize)]
pub struct Command {
    /// Version, flags, run id, and the tick and time of the answered sample.
    pub header: Header,
    /// Leg angle from the +x axis, rad; the foot is ahead of the mass above pi/2.
    pub leg_angle_rad: f32,
    /// Elongation set-point at the tick, m (may be below 0: not begun yet).
    pub elongation_m: f32,
    /// Rate of the elongation set-point, m/s.
    pub elongation_rate_m_s: f32,
    /// Telemetry: horizontal velocity at the last apex, m/s.
    pub apex_vx_m_s: f32,
    /// Telemetry: height of the last apex, m.
    pub apex_y_m: f32,
    /// Telemetry: density ratio that the actor was given at the last apex.
    pub density_ratio: f32,
    /// Telemetry: the cascade's offset of the observed velocity, m/s.
    pub velocity_offset_m_s: f32,
    /// Telemetry: apexes since the run's start.
    pub apexes: u32,
    /// Telemetry: samples rejected by the guard since the run's start.
    pub rejected: u32,
    /// Telemetry: set-points refused by the guard since the run's start.
    pub set_points_refused: u32,
}

impl Command {
    /// Returns the message of what the controller computed for the sample with this header.
    #[must_use]
    pub fn new(
        header: &Header,
        command: &LegCommand,
        status: Status,
        telemetry: &Telemetry,
        counts: &Counts,
    ) -> Self {
        let flags = if status.is_safe() { flags::SAFE } else { 0 };
        Self {
            header: Header { version: WIRE_VERSION, flags, ..*header },
            leg_angle_rad: command.leg_angle_rad,
            elongation_m: command.elongation_m,
            elongation_rate_m_s: command.elongation_rate_m_s,
            apex_vx_m_s: telemetry.apex_vx_m_s,
            apex_y_m: telemetry.apex_y_m,
            density_ratio: telemetry.density_ratio.unwrap_or(0.0),
            velocity_offset_m_s: telemetry.velocity_offset_m_s,
            apexes: telemetry.apexes,
            rejected: counts.rejected(),
            set_points_refused: counts.set_points_refused,
        }
    }

    /// Returns the safe command ([`LegCommand::SAFE`]), as the answer to the sample with
    /// this header: what a leg follows that no controller commands.
    #[must_use]
    pub fn safe(header: &Header) -> Self {
        let LegCommand { leg_angle_rad, elongation_m, elongation_rate_m_s } = LegCommand::SAFE;
        Self {
            header: Header { version: WIRE_VERSION, flags: flags::SAFE, ..*header },
            leg_angle_rad,
            elongation_m,
            elongation_rate_m_s,
            ..Self::default()
        }
    }

    /// Returns whether this is the safe command: the guard has taken over.
    #[must_use]
    pub fn is_safe(&self) -> bool {
        self.header.flags & flags::SAFE != 0
    }
}

const _: () = assert!(size_of::<Header>() == 24);
const _: () = assert!(size_of::<SensorReadings>() == 48);
const _: () = assert!(size_of::<Sample>() == 96);
const _: () = assert!(size_of::<Command>() == 64);
