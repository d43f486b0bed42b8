//! The messages of a recording, as `leg.proto` has them, and the channels that
//! carry them. A test holds the two together, field by field.
//!
//! Floats are `required`: they are written also when they compare equal to 0,
//! for -0 does too.

use leg_control::wire;
use prost::Message;

/// `leg.proto`, compiled: a `FileDescriptorSet`, the schema of every channel.
pub const DESCRIPTORS: &[u8] = include_bytes!("leg.fds");

/// What a recording's header says it is.
pub const PROFILE: &str = "spring-leg";

/// A channel of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Channel {
    /// [`Sample`].
    Sample,
    /// [`Command`].
    Command,
    /// [`State`].
    State,
    /// [`Apex`].
    Apex,
    /// [`Event`].
    Event,
    /// [`Policy`].
    Policy,
    /// [`Config`].
    Config,
    /// [`Loop`].
    Loop,
    /// [`End`].
    End,
}

impl Channel {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 9] = [
        Self::Sample,
        Self::Command,
        Self::State,
        Self::Apex,
        Self::Event,
        Self::Policy,
        Self::Config,
        Self::Loop,
        Self::End,
    ];

    /// Its name in the file.
    #[must_use]
    pub const fn topic(self) -> &'static str {
        match self {
            Self::Sample => "/sample",
            Self::Command => "/command",
            Self::State => "/state",
            Self::Apex => "/apex",
            Self::Event => "/event",
            Self::Policy => "/policy",
            Self::Config => "/config",
            Self::Loop => "/loop",
            Self::End => "/end",
        }
    }

    /// The type of its messages.
    #[must_use]
    pub const fn schema(self) -> &'static str {
        match self {
            Self::Sample => "leg.Sample",
            Self::Command => "leg.Command",
            Self::State => "leg.State",
            Self::Apex => "leg.Apex",
            Self::Event => "leg.Event",
            Self::Policy => "leg.Policy",
            Self::Config => "leg.Config",
            Self::Loop => "leg.Loop",
            Self::End => "leg.End",
        }
    }
}

/// A message that has a channel of its own.
pub trait Recorded: Message + Default + std::fmt::Debug {
    /// The channel.
    const CHANNEL: Channel;
}

/// What the controller was told at a tick: [`wire::Sample`].
#[derive(Clone, PartialEq, Message)]
pub struct Sample {
    /// [`wire::Header::version`].
    #[prost(uint32, tag = "1")]
    pub version: u32,
    /// [`wire::Header::flags`].
    #[prost(uint32, tag = "2")]
    pub flags: u32,
    /// [`wire::Header::run_id`].
    #[prost(uint32, tag = "3")]
    pub run_id: u32,
    /// [`wire::Header::seq`].
    #[prost(uint64, tag = "4")]
    pub seq: u64,
    /// [`wire::Header::t_ns`].
    #[prost(uint64, tag = "5")]
    pub t_ns: u64,
    /// [`wire::Sample::set_point_m_s`].
    #[prost(float, required, tag = "6")]
    pub set_point_m_s: f32,
    /// [`wire::Sample::vx_m_s`].
    #[prost(float, required, tag = "7")]
    pub vx_m_s: f32,
    /// [`wire::Sample::y_m`].
    #[prost(float, required, tag = "8")]
    pub y_m: f32,
    /// [`wire::Sample::vy_m_s`].
    #[prost(float, required, tag = "9")]
    pub vy_m_s: f32,
    /// [`wire::Sample::leg_length_m`].
    #[prost(float, required, tag = "10")]
    pub leg_length_m: f32,
    /// [`wire::Sample::density_ratio`].
    #[prost(float, required, tag = "11")]
    pub density_ratio: f32,
}

/// The command in force over a tick: [`wire::Command`], where it acts, and how
/// it came.
#[derive(Clone, PartialEq, Message)]
pub struct Command {
    /// [`wire::Header::version`].
    #[prost(uint32, tag = "1")]
    pub version: u32,
    /// [`wire::Header::flags`].
    #[prost(uint32, tag = "2")]
    pub flags: u32,
    /// [`wire::Header::run_id`].
    #[prost(uint32, tag = "3")]
    pub run_id: u32,
    /// [`wire::Header::seq`], of the sample that it answers.
    #[prost(uint64, tag = "4")]
    pub seq: u64,
    /// [`wire::Header::t_ns`], of the sample that it answers.
    #[prost(uint64, tag = "5")]
    pub t_ns: u64,
    /// [`wire::Command::leg_angle_rad`].
    #[prost(float, required, tag = "6")]
    pub leg_angle_rad: f32,
    /// [`wire::Command::elongation_m`].
    #[prost(float, required, tag = "7")]
    pub elongation_m: f32,
    /// [`wire::Command::elongation_rate_m_s`].
    #[prost(float, required, tag = "8")]
    pub elongation_rate_m_s: f32,
    /// [`wire::Command::apex_vx_m_s`].
    #[prost(float, required, tag = "9")]
    pub apex_vx_m_s: f32,
    /// [`wire::Command::apex_y_m`].
    #[prost(float, required, tag = "10")]
    pub apex_y_m: f32,
    /// [`wire::Command::density_ratio`].
    #[prost(float, required, tag = "11")]
    pub density_ratio: f32,
    /// [`wire::Command::velocity_offset_m_s`].
    #[prost(float, required, tag = "12")]
    pub velocity_offset_m_s: f32,
    /// [`wire::Command::apexes`].
    #[prost(uint32, tag = "13")]
    pub apexes: u32,
    /// [`wire::Command::rejected`].
    #[prost(uint32, tag = "14")]
    pub rejected: u32,
    /// [`wire::Command::reserved`].
    #[prost(uint32, tag = "15")]
    pub reserved: u32,
    /// The tick over which it acts.
    #[prost(uint64, tag = "16")]
    pub tick: u64,
    /// Whether it has come for this tick.
    #[prost(bool, tag = "17")]
    pub is_new: bool,
    /// From sample to command, ns; 0 where nobody waits for it.
    #[prost(uint64, tag = "18")]
    pub round_trip_ns: u64,
}

/// What the leg does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, prost::Enumeration)]
#[repr(i32)]
pub enum Phase {
    /// The foot is in the air.
    Flight = 0,
    /// The foot is on the ground.
    Stance = 1,
    /// The body lies on the ground.
    Fallen = 2,
}

/// The leg as it truly is at the start of a tick.
#[derive(Clone, PartialEq, Message)]
pub struct State {
    /// The tick.
    #[prost(uint64, tag = "1")]
    pub seq: u64,
    /// Place, m.
    #[prost(double, required, tag = "2")]
    pub x_m: f64,
    /// Horizontal velocity, m/s.
    #[prost(double, required, tag = "3")]
    pub vx_m_s: f64,
    /// Height, m.
    #[prost(double, required, tag = "4")]
    pub y_m: f64,
    /// Vertical velocity, m/s.
    #[prost(double, required, tag = "5")]
    pub vy_m_s: f64,
    /// What it does.
    #[prost(enumeration = "Phase", tag = "6")]
    pub phase: i32,
    /// Place of the foot in stance, m; else 0.
    #[prost(double, required, tag = "7")]
    pub foot_x_m: f64,
    /// Height of the foot in stance, m; else 0.
    #[prost(double, required, tag = "8")]
    pub foot_y_m: f64,
    /// Density of the medium over that of water.
    #[prost(double, required, tag = "9")]
    pub density_ratio: f64,
}

/// A highest point of the path, and what the controller made of it.
#[derive(Clone, PartialEq, Message)]
pub struct Apex {
    /// The tick in which it lies.
    #[prost(uint64, tag = "1")]
    pub seq: u64,
    /// Its time, s.
    #[prost(double, required, tag = "2")]
    pub t_s: f64,
    /// Place, m.
    #[prost(double, required, tag = "3")]
    pub x_m: f64,
    /// Height, m.
    #[prost(double, required, tag = "4")]
    pub y_m: f64,
    /// Horizontal velocity, m/s.
    #[prost(double, required, tag = "5")]
    pub vx_m_s: f64,
    /// The velocity asked for, m/s.
    #[prost(double, required, tag = "6")]
    pub set_point_m_s: f64,
    /// The medium's density over that of water.
    #[prost(double, required, tag = "7")]
    pub density_ratio: f64,
    /// Whether the controller has answered it.
    #[prost(bool, tag = "8")]
    pub answered: bool,
    /// The density ratio that its actor was given.
    #[prost(double, required, tag = "9")]
    pub density_estimate: f64,
    /// The horizontal velocity that it has found, m/s.
    #[prost(double, required, tag = "10")]
    pub seen_vx_m_s: f64,
    /// Its offset of the velocity that the actor was given, m/s.
    #[prost(double, required, tag = "11")]
    pub velocity_offset_m_s: f64,
}

/// The kinds of [`Event`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, prost::Enumeration)]
#[repr(i32)]
pub enum EventKind {
    /// Not said.
    Unknown = 0,
    /// The foot came down.
    Touchdown = 1,
    /// The leg reached its rest length.
    LiftOff = 2,
    /// The body came down to the ground.
    Fall = 3,
}

/// What happened to the leg, and where its mass was.
#[derive(Clone, PartialEq, Message)]
pub struct Event {
    /// The tick in which it lies.
    #[prost(uint64, tag = "1")]
    pub seq: u64,
    /// Its time, s.
    #[prost(double, required, tag = "2")]
    pub t_s: f64,
    /// What it was.
    #[prost(enumeration = "EventKind", tag = "3")]
    pub kind: i32,
    /// Place, m.
    #[prost(double, required, tag = "4")]
    pub x_m: f64,
    /// Horizontal velocity, m/s.
    #[prost(double, required, tag = "5")]
    pub vx_m_s: f64,
    /// Height, m.
    #[prost(double, required, tag = "6")]
    pub y_m: f64,
    /// Vertical velocity, m/s.
    #[prost(double, required, tag = "7")]
    pub vy_m_s: f64,
    /// Place of the foot at a touchdown, m; else 0.
    #[prost(double, required, tag = "8")]
    pub foot_x_m: f64,
    /// Height of the foot at a touchdown, m; else 0.
    #[prost(double, required, tag = "9")]
    pub foot_y_m: f64,
}

/// A policy that the controller runs, whole.
#[derive(Clone, PartialEq, Message)]
pub struct Policy {
    /// Its name.
    #[prost(string, tag = "1")]
    pub name: String,
    /// The checksum at its end.
    #[prost(uint32, tag = "2")]
    pub crc32: u32,
    /// The file; empty when the recorder did not get hold of it.
    #[prost(bytes = "vec", tag = "3")]
    pub blob: Vec<u8>,
    /// The run.
    #[prost(uint32, tag = "4")]
    pub run_id: u32,
    /// The tick before which the controller was given it; it takes over at the
    /// next apex.
    #[prost(uint64, tag = "5")]
    pub seq: u64,
}

/// What was played, and by what.
#[derive(Clone, PartialEq, Message)]
pub struct Config {
    /// The scenario, file and flags together, as a file for `--scenario`.
    #[prost(string, tag = "1")]
    pub scenario_toml: String,
    /// The version of this program.
    #[prost(string, tag = "2")]
    pub sim_host_version: String,
    /// [`wire::WIRE_VERSION`].
    #[prost(uint32, tag = "3")]
    pub wire_version: u32,
    /// Ticks a second.
    #[prost(uint32, tag = "4")]
    pub rate_hz: u32,
    /// Gravity as the controller is told it, m/s2.
    #[prost(float, required, tag = "5")]
    pub gravity_m_s2: f32,
    /// `lock-step` or `real-time`.
    #[prost(string, tag = "6")]
    pub pace: String,
    /// How the program was called.
    #[prost(string, repeated, tag = "7")]
    pub command_line: Vec<String>,
    /// Wall clock at the start, ns from 1970-01-01, UTC.
    #[prost(uint64, tag = "8")]
    pub started_unix_ns: u64,
}

/// How the leg's loop kept time.
#[derive(Clone, PartialEq, Message)]
pub struct Loop {
    /// The tick.
    #[prost(uint64, tag = "1")]
    pub seq: u64,
    /// Its beginning after its time, ns.
    #[prost(int64, tag = "2")]
    pub lateness_ns: i64,
    /// How long it took, ns.
    #[prost(uint64, tag = "3")]
    pub tick_ns: u64,
    /// Age of the sample that its command answers, ns.
    #[prost(uint64, tag = "4")]
    pub sample_age_ns: u64,
    /// From that sample to its command, ns.
    #[prost(uint64, tag = "5")]
    pub round_trip_ns: u64,
    /// What was out of order in it: 1 no new command, 2 a safe command in force.
    #[prost(uint32, tag = "6")]
    pub flags: u32,
}

/// What the run came to.
#[derive(Clone, PartialEq, Message)]
pub struct End {
    /// Why it ended.
    #[prost(string, tag = "1")]
    pub ending: String,
    /// Ticks played.
    #[prost(uint64, tag = "2")]
    pub ticks: u64,
    /// Hash of every state and command, hexadecimal.
    #[prost(string, tag = "3")]
    pub state_hash: String,
    /// Ticks and events that the recorder had no room for.
    #[prost(uint64, tag = "4")]
    pub dropped: u64,
}

macro_rules! recorded {
    ($($name:ident),*) => {
        $(impl Recorded for $name {
            const CHANNEL: Channel = Channel::$name;
        })*
    };
}

recorded!(Sample, Command, State, Apex, Event, Policy, Config, Loop, End);

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
        }
    }
}

impl Command {
    /// A command in force over `tick`.
    #[must_use]
    pub fn over(tick: u64, command: &wire::Command, is_new: bool, round_trip_ns: u64) -> Self {
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
            reserved: command.reserved,
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
            reserved: c.reserved,
        }
    }
}

fn header(version: u32, flags: u32, run_id: u32, seq: u64, t_ns: u64) -> wire::Header {
    wire::Header { version: version as u16, flags: flags as u16, run_id, seq, t_ns }
}

#[cfg(test)]
mod tests;
