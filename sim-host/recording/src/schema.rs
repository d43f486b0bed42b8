//! The messages of a recording, generated from `leg.proto`, and their channels.

use leg_control::{policy, wire};
use prost::{Message, Name};

pub use generated::*;

/// `leg.proto` as a serialised `FileDescriptorSet`: the MCAP schema of every channel.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/leg.fds"));

/// The profile in a recording's MCAP header.
pub const PROFILE: &str = "spring-leg";

/// [`Config::time_mode`] of a run in lock-step.
pub const LOCK_STEP: &str = "lock-step";
/// [`Config::time_mode`] of a run in real time.
pub const REAL_TIME: &str = "real-time";

/// [`End::ending`] of a run that was observed until its leg ended it.
pub const OBSERVED_END: &str = "ended by the leg";

/// [`End::ending`] of a recording that was completed after its recorder was killed.
pub const RECOVERED: &str = "recovered";

#[allow(missing_docs, clippy::pedantic, reason = "generated code")]
mod generated {
    include!(concat!(env!("OUT_DIR"), "/leg.rs"));
}

/// A message type that has a channel.
pub trait Recorded: Message + Name + Default {
    /// The channel of the type.
    const CHANNEL: Channel;
}

macro_rules! channels {
    ($($name:ident = $topic:literal),* $(,)?) => {
        /// A channel of a recording; each carries the message type of its name.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(u8)]
        #[allow(missing_docs, reason = "each is described at its message type")]
        pub enum Channel {
            $($name),*
        }

        impl Channel {
            /// All channels, in the order of their numbers.
            pub const ALL: &[Self] = &[$(Self::$name),*];

            /// Returns the topic of the channel in the file.
            #[must_use]
            pub const fn topic(self) -> &'static str {
                match self {
                    $(Self::$name => $topic),*
                }
            }

            /// Returns the full name of the channel's message type.
            #[must_use]
            pub fn schema(self) -> String {
                match self {
                    $(Self::$name => $name::full_name()),*
                }
            }
        }

        /// A message of any channel.
        #[derive(Clone, Debug, PartialEq)]
        #[allow(missing_docs, reason = "each is described at its message type")]
        pub enum AnyMessage {
            $($name($name)),*
        }

        impl AnyMessage {
            /// Decodes a message of `channel`.
            ///
            /// # Errors
            /// [`prost::DecodeError`] if `bytes` are not of the channel's type.
            pub fn decode(channel: Channel, bytes: &[u8]) -> Result<Self, prost::DecodeError> {
                match channel {
                    $(Channel::$name => $name::decode(bytes).map(Self::$name)),*
                }
            }
        }

        $(impl Recorded for $name {
            const CHANNEL: Channel = Channel::$name;
        })*
    };
}

channels! {
    Sample = "/sample",
    Command = "/command",
    State = "/state",
    Apex = "/apex",
    Event = "/event",
    Policy = "/policy",
    SetPoint = "/set_point",
    Config = "/config",
    Law = "/law",
    Loop = "/loop",
    End = "/end",
    Estimate = "/estimate",
}

impl From<&wire::Sample> for Sample {
    fn from(sample: &wire::Sample) -> Self {
        let wire::Header { version, flags, run_id, seq, t_ns } = sample.header;
        Self {
            version: version.into(),
            flags: flags.into(),
            run_id,
            seq,
            t_ns,
            set_point_m_s: sample.set_point_m_s,
            vx_m_s: sample.vx_m_s,
            y_m: sample.y_m,
            vy_m_s: sample.vy_m_s,
            leg_length_m: sample.leg_length_m,
            density_ratio: sample.density_ratio,
            sensors: SensorReadings::of(&sample.sensors),
        }
    }
}

impl From<&Sample> for wire::Sample {
    fn from(s: &Sample) -> Self {
        Self {
            header: header(s.version, s.flags, s.run_id, s.seq, s.t_ns),
            set_point_m_s: s.set_point_m_s,
            vx_m_s: s.vx_m_s,
            y_m: s.y_m,
            vy_m_s: s.vy_m_s,
            leg_length_m: s.leg_length_m,
            density_ratio: s.density_ratio,
            sensors: s.sensors.as_ref().map(Into::into).unwrap_or_default(),
        }
    }
}

impl Estimate {
    /// Converts the estimate that the controller holds after the sample of tick `seq`.
    #[must_use]
    pub fn at_tick(seq: u64, estimate: &leg_control::estimator::Estimate) -> Self {
        // Destructured, so that the compiler reports a new field.
        let leg_control::estimator::Estimate {
            t_ns,
            in_stance,
            vx_m_s,
            y_m,
            vy_m_s,
            density_ratio,
            vx_variance,
            y_variance,
            vy_variance,
            density_variance,
            innovation,
        } = *estimate;
        Self {
            seq,
            t_ns,
            in_stance,
            vx_m_s,
            y_m,
            vy_m_s,
            density_ratio,
            vx_variance_m2_s2: vx_variance,
            y_variance_m2: y_variance,
            vy_variance_m2_s2: vy_variance,
            density_variance,
            innovation,
        }
    }
}

impl From<&Estimate> for leg_control::estimator::Estimate {
    fn from(e: &Estimate) -> Self {
        Self {
            t_ns: e.t_ns,
            in_stance: e.in_stance,
            vx_m_s: e.vx_m_s,
            y_m: e.y_m,
            vy_m_s: e.vy_m_s,
            density_ratio: e.density_ratio,
            vx_variance: e.vx_variance_m2_s2,
            y_variance: e.y_variance_m2,
            vy_variance: e.vy_variance_m2_s2,
            density_variance: e.density_variance,
            innovation: e.innovation,
        }
    }
}

impl Estimate {
    /// Returns whether every bit is the same, also that of a zero or a NaN.
    #[must_use]
    pub fn has_the_bits_of(&self, other: &Self) -> bool {
        // Every floating-point field is encoded.
        self.encode_to_vec() == other.encode_to_vec()
    }
}

impl Policy {
    /// Describes a policy that the controller receives before tick `seq`.
    #[must_use]
    pub fn of(blob: &[u8], policy: &policy::Policy<'_>, run_id: u32, seq: u64) -> Self {
        let crc32 = blob.last_chunk().copied().map_or(0, u32::from_le_bytes);
        let name = policy.manifest().name.to_owned();
        Self { name, crc32, blob: blob.to_vec(), run_id, seq }
    }
}

impl End {
    /// Describes a run of which `ticks` are left, because its recorder was killed.
    #[must_use]
    pub fn recovered(ticks: u64) -> Self {
        Self { ending: RECOVERED.to_owned(), ticks, ..Self::default() }
    }

    /// Describes a run that ended with an error.
    #[must_use]
    pub fn broken_off(cause: &impl std::fmt::Display) -> Self {
        Self { ending: cause.to_string(), ..Self::default() }
    }
}

impl SensorReadings {
    /// Converts readings; `None` if all bits are 0, as of a leg without such sensors.
    fn of(readings: &wire::SensorReadings) -> Option<Self> {
        let wire::SensorReadings { impulse: [impulse_x, impulse_y], .. } = *readings;
        let [velocity_x_m_s, velocity_y_m_s] = readings.velocity_m_s;
        let is_empty = bytemuck::bytes_of(readings).iter().all(|&byte| byte == 0);
        (!is_empty).then_some(Self {
            pitch_rad: readings.pitch_rad,
            pitch_rate_rad_s: readings.pitch_rate_rad_s,
            leg_angle_rad: readings.leg_angle_rad,
            impulse_x,
            impulse_y,
            velocity_x_m_s,
            velocity_y_m_s,
            height_m: readings.height_m,
            pressure_pa: readings.pressure_pa,
            velocity_age_ns: readings.velocity_age_ns,
            height_age_ns: readings.height_age_ns,
            pressure_age_ns: readings.pressure_age_ns,
        })
    }
}

impl From<&SensorReadings> for wire::SensorReadings {
    fn from(r: &SensorReadings) -> Self {
        Self {
            pitch_rad: r.pitch_rad,
            pitch_rate_rad_s: r.pitch_rate_rad_s,
            leg_angle_rad: r.leg_angle_rad,
            impulse: [r.impulse_x, r.impulse_y],
            velocity_m_s: [r.velocity_x_m_s, r.velocity_y_m_s],
            height_m: r.height_m,
            pressure_pa: r.pressure_pa,
            velocity_age_ns: r.velocity_age_ns,
            height_age_ns: r.height_age_ns,
            pressure_age_ns: r.pressure_age_ns,
        }
    }
}

impl Command {
    /// Converts a command that is in force during `tick`.
    #[must_use]
    pub fn in_force(tick: u64, command: &wire::Command, is_new: bool, round_trip_ns: u64) -> Self {
        let wire::Header { version, flags, run_id, seq, t_ns } = command.header;
        Self {
            version: version.into(),
            flags: flags.into(),
            run_id,
            seq,
            t_ns,
            leg_angle_rad: command.leg_angle_rad,
            elongation_m: command.elongation_m,
            elongation_rate_m_s: command.elongation_rate_m_s,
            apex_vx_m_s: command.apex_vx_m_s,
            apex_y_m: command.apex_y_m,
            density_ratio: command.density_ratio,
            velocity_offset_m_s: command.velocity_offset_m_s,
            apexes: command.apexes,
            rejected: command.rejected,
            set_points_refused: command.set_points_refused,
            tick,
            is_new,
            round_trip_ns,
        }
    }
}

impl From<&Command> for wire::Command {
    fn from(c: &Command) -> Self {
        Self {
            header: header(c.version, c.flags, c.run_id, c.seq, c.t_ns),
            leg_angle_rad: c.leg_angle_rad,
            elongation_m: c.elongation_m,
            elongation_rate_m_s: c.elongation_rate_m_s,
            apex_vx_m_s: c.apex_vx_m_s,
            apex_y_m: c.apex_y_m,
            density_ratio: c.density_ratio,
            velocity_offset_m_s: c.velocity_offset_m_s,
            apexes: c.apexes,
            rejected: c.rejected,
            set_points_refused: c.set_points_refused,
        }
    }
}

fn header(version: u32, flags: u32, run_id: u32, seq: u64, t_ns: u64) -> wire::Header {
    wire::Header { version: version as u16, flags: flags as u16, run_id, seq, t_ns }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keeps_every_bit_of_zeros_and_nans() {
        for bits in [0, 0x8000_0000, 0x7fc0_0001, 0xffa1_2345, 0x7f80_0000, 1] {
            let x = f32::from_bits(bits);
            let sample = wire::Sample { vx_m_s: x, density_ratio: x, ..wire::Sample::default() };
            let decoded = Sample::decode(&*Sample::from(&sample).encode_to_vec()).unwrap();
            let decoded = wire::Sample::from(&decoded);
            assert_eq!(decoded.vx_m_s.to_bits(), bits);
            assert_eq!(decoded.density_ratio.to_bits(), bits);
            let sensors = wire::SensorReadings { height_m: x, ..Default::default() };
            let sample = wire::Sample { sensors, ..wire::Sample::default() };
            let decoded = Sample::decode(&*Sample::from(&sample).encode_to_vec()).unwrap();
            assert_eq!(decoded.sensors.is_some(), bits != 0);
            assert_eq!(wire::Sample::from(&decoded).sensors.height_m.to_bits(), bits);
            let estimate = Estimate { vy_m_s: x, innovation: x, ..Estimate::default() };
            let decoded = Estimate::decode(&*estimate.encode_to_vec()).unwrap();
            assert_eq!([decoded.vy_m_s, decoded.innovation].map(f32::to_bits), [bits; 2]);
        }
        let state = State { x_m: -0.0, ..State::default() };
        let decoded = State::decode(&*state.encode_to_vec()).unwrap();
        assert_eq!(decoded.x_m.to_bits(), (-0.0_f64).to_bits());
    }

    #[test]
    fn keeps_every_field_of_the_wire_messages() {
        let header = header(1, 2, 3, u64::MAX, 5);
        let command = wire::Command {
            header,
            leg_angle_rad: 6.5,
            elongation_m: -7.5,
            elongation_rate_m_s: 8.5,
            apex_vx_m_s: 9.5,
            apex_y_m: 10.5,
            density_ratio: 11.5,
            velocity_offset_m_s: 12.5,
            apexes: 13,
            rejected: 14,
            set_points_refused: 15,
        };
        let recorded = Command::in_force(9, &command, false, 0);
        let decoded = Command::decode(&*recorded.encode_to_vec()).unwrap();
        assert_eq!(wire::Command::from(&decoded), command);
        let sample = wire::Sample {
            header,
            set_point_m_s: 6.5,
            vx_m_s: f32::MIN_POSITIVE,
            y_m: 8.5,
            vy_m_s: f32::INFINITY,
            leg_length_m: 10.5,
            density_ratio: 11.5,
            sensors: wire::SensorReadings {
                pitch_rad: 12.5,
                pitch_rate_rad_s: -13.5,
                leg_angle_rad: 14.5,
                impulse: [i32::MIN, i32::MAX],
                velocity_m_s: [15.5, f32::NEG_INFINITY],
                height_m: 17.5,
                pressure_pa: 18.5,
                velocity_age_ns: u32::MAX,
                height_age_ns: 20,
                pressure_age_ns: 21,
            },
        };
        let decoded = Sample::decode(&*Sample::from(&sample).encode_to_vec()).unwrap();
        assert_eq!(wire::Sample::from(&decoded), sample);
    }
}
