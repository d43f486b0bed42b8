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
use crate::measurement::{Contact, Measurement};
use serde::{Deserialize, Serialize};

/// The version of every message here. Raised when any field changes.
pub const WIRE_VERSION: u16 = 1;

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
    /// Horizontal velocity of the mass, m/s.
    pub vx_m_s: f32,
    /// Height of the mass above the ground, m.
    pub y_m: f32,
    /// Vertical velocity of the mass, m/s.
    pub vy_m_s: f32,
    /// Length of the leg from foot to mass, m (in flight that of the unloaded
    /// leg, its elongation included); read with [`flags::LEG_LENGTH_SENSED`].
    pub leg_length_m: f32,
    /// Fluid density over that of water; read with [`flags::DENSITY_SENSED`].
    pub density_ratio: f32,
}

impl Sample {
    /// Returns the message of a measurement and a set-point, m/s: tick `seq` of run `run_id`.
    #[must_use]
    pub fn new(run_id: u32, seq: u64, measurement: &Measurement, set_point_m_s: f32) -> Self {
        let &Measurement { t_ns, vx_m_s, y_m, vy_m_s, contact, density_ratio } = measurement;
        let (contact_flags, leg_length_m) = match contact {
            Contact::Sensed(true) => (flags::CONTACT_SENSED | flags::IN_CONTACT, 0.0),
            Contact::Sensed(false) => (flags::CONTACT_SENSED, 0.0),
            Contact::LegLength(length_m) => (flags::LEG_LENGTH_SENSED, length_m),
        };
        let density_flag = if density_ratio.is_some() { flags::DENSITY_SENSED } else { 0 };
        Self {
            header: Header {
                version: WIRE_VERSION,
                flags: contact_flags | density_flag,
                run_id,
                seq,
                t_ns,
            },
            set_point_m_s,
            vx_m_s,
            y_m,
            vy_m_s,
            leg_length_m,
            density_ratio: density_ratio.unwrap_or(0.0),
        }
    }

    /// Returns the readings that the flags declare; `None` when neither contact nor leg
    /// length is among them. A contact reading is taken before a leg length.
    #[must_use]
    #[inline]
    pub fn measurement(&self) -> Option<Measurement> {
        let contact = if self.has(flags::CONTACT_SENSED) {
            Contact::Sensed(self.has(flags::IN_CONTACT))
        } else if self.has(flags::LEG_LENGTH_SENSED) {
            Contact::LegLength(self.leg_length_m)
        } else {
            return None;
        };
        Some(Measurement {
            t_ns: self.header.t_ns,
            vx_m_s: self.vx_m_s,
            y_m: self.y_m,
            vy_m_s: self.vy_m_s,
            contact,
            density_ratio: self.has(flags::DENSITY_SENSED).then_some(self.density_ratio),
        })
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

    fn has(&self, flag: u16) -> bool {
        self.header.flags & flag != 0
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
const _: () = assert!(size_of::<Sample>() == 48);
const _: () = assert!(size_of::<Command>() == 64);
