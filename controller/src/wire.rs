//! The messages between a leg and its controller, on shared memory and on a
//! serial line alike.
//!
//! Only integers and floats: a peer can send any bits, and there must be no
//! bits that are not a value. Copy a message out, let the guard check it, then
//! use it. Every struct is `#[repr(C)]` without padding; sizes are asserted.

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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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
    /// Whether it ends the run: [`flags::END`] and no other flag, so that one bit
    /// turned over in a sample that has readings does not.
    #[must_use]
    pub fn ends_the_run(&self) -> bool {
        self.header.flags == flags::END
    }
}

/// What the leg is to do from its sample's tick to the next, and why.
///
/// The angle is held by the swinging leg. The spring's rest length is
/// `r0 + clamp(elongation_m + elongation_rate_m_s * s, 0, dr)`, `s` seconds
/// after the tick: a ramp that may start inside a tick, from below zero.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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
    /// Always 0.
    pub reserved: u32,
}

const _: () = assert!(size_of::<Header>() == 24);
const _: () = assert!(size_of::<Sample>() == 48);
const _: () = assert!(size_of::<Command>() == 64);
