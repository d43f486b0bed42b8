//! The messages with the names of C. The compiler checks that their layout is that of
//! `leg_control::wire`.

use std::mem::offset_of;

use bytemuck::{Pod, Zeroable};
use leg_control::wire::{Command, Header, Sample};

/// Wire version of the messages.
pub const LEG_WIRE_VERSION: u16 = 2;
/// Sample: the leg senses whether its foot is loaded; `LEG_IN_CONTACT` is its reading.
pub const LEG_CONTACT_SENSED: u16 = 1 << 0;
/// Sample: the foot is on the ground.
pub const LEG_IN_CONTACT: u16 = 1 << 1;
/// Sample: `leg_length_m` is measured.
pub const LEG_LENGTH_SENSED: u16 = 1 << 2;
/// Sample: `density_ratio` is measured, and used in place of the estimate.
pub const LEG_DENSITY_SENSED: u16 = 1 << 3;
/// Sample: the run is over; no other flag is set.
pub const LEG_END: u16 = 1 << 4;
/// Sample: `vx_m_s`, `y_m` and `vy_m_s` are measured.
pub const LEG_STATE_SENSED: u16 = 1 << 5 | 1 << 6 | 1 << 7;
/// Command: the safe one.
pub const LEG_SAFE: u16 = 1 << 8;
/// Sample: `impulse` is measured.
pub const LEG_IMPULSE_SENSED: u16 = 1 << 9;
/// Sample: `pitch_rad` is measured.
pub const LEG_PITCH_SENSED: u16 = 1 << 10;
/// Sample: `leg_angle_rad` is measured.
pub const LEG_ANGLE_SENSED: u16 = 1 << 11;
/// Sample: `velocity_m_s` is measured.
pub const LEG_VELOCITY_SENSED: u16 = 1 << 12;
/// Sample: `height_m` is measured.
pub const LEG_HEIGHT_SENSED: u16 = 1 << 13;
/// Sample: `pressure_pa` is measured.
pub const LEG_PRESSURE_SENSED: u16 = 1 << 14;
/// Sample: `pitch_rate_rad_s` is measured.
pub const LEG_PITCH_RATE_SENSED: u16 = 1 << 15;

/// What every message starts with.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct LegHeader {
    /// `LEG_WIRE_VERSION`.
    pub version: u16,
    /// Which readings a sample has, or `LEG_SAFE` of a command.
    pub flags: u16,
    /// Raised by the leg at each restart.
    pub run_id: u32,
    /// Tick of the run, from 0; a command has that of its sample.
    pub seq: u64,
    /// Time since the start of the run, ns.
    pub t_ns: u64,
}

/// What the leg feels at a tick. A field is read with its flag only.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LegSample {
    /// Version, flags, run, tick and time.
    pub header: LegHeader,
    /// Wanted horizontal velocity at the apex, m/s.
    pub set_point_m_s: f32,
    /// Horizontal velocity of the mass, m/s.
    pub vx_m_s: f32,
    /// Height of the mass above the ground, m.
    pub y_m: f32,
    /// Vertical velocity of the mass, m/s.
    pub vy_m_s: f32,
    /// Length of the leg from foot to mass, m; in flight that of the unloaded leg.
    pub leg_length_m: f32,
    /// Density of the medium over that of water.
    pub density_ratio: f32,
    /// Orientation of the body, rad.
    pub pitch_rad: f32,
    /// Rate of the pitch, rad/s.
    pub pitch_rate_rad_s: f32,
    /// Angle of the leg from the body's +x axis, rad; with `LEG_LENGTH_SENSED` only.
    pub leg_angle_rad: f32,
    /// Integral of the specific force along the body's x and y axes, 2^-16 m/s; it wraps.
    pub impulse: [i32; 2],
    /// Velocity over the ground, m/s: horizontal, vertical.
    pub velocity_m_s: [f32; 2],
    /// Height above the ground, m.
    pub height_m: f32,
    /// Pressure of the fluid, Pa.
    pub pressure_pa: f32,
    /// Age of the velocity, ns.
    pub velocity_age_ns: u32,
    /// Age of the height, ns.
    pub height_age_ns: u32,
    /// Age of the pressure, ns.
    pub pressure_age_ns: u32,
}

/// What the leg is to do from its sample's tick to the next, and why.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LegCommand {
    /// Version, flags, and run, tick and time of the answered sample.
    pub header: LegHeader,
    /// Angle of the leg from the +x axis, rad; above pi/2 the foot is ahead of the mass.
    pub leg_angle_rad: f32,
    /// Elongation of the spring's rest length at the tick, m; below 0: not begun yet.
    pub elongation_m: f32,
    /// Its rate, m/s; the leg follows the ramp from 0 to its largest elongation.
    pub elongation_rate_m_s: f32,
    /// Horizontal velocity at the last apex, m/s.
    pub apex_vx_m_s: f32,
    /// Height of the last apex, m.
    pub apex_y_m: f32,
    /// Density ratio that the actor was given at the last apex.
    pub density_ratio: f32,
    /// The cascade's offset of the observed velocity, m/s.
    pub velocity_offset_m_s: f32,
    /// Apexes since the run's start.
    pub apexes: u32,
    /// Samples rejected since the run's start.
    pub rejected: u32,
    /// Set-points refused since the run's start.
    pub set_points_refused: u32,
}

/// Checks that fields are where those of another struct are.
macro_rules! assert_same_places {
    ($ours:ty = $theirs:ty: $($our:ident = $($their:ident).+),+ $(,)?) => {
        const _: () = {
            assert!(size_of::<$ours>() == size_of::<$theirs>());
            assert!(align_of::<$ours>() == align_of::<$theirs>());
            $(assert!(offset_of!($ours, $our) == offset_of!($theirs, $($their).+));)+
        };
    };
}

assert_same_places!(LegHeader = Header: version = version, flags = flags, run_id = run_id,
    seq = seq, t_ns = t_ns);
assert_same_places!(LegSample = Sample: header = header, set_point_m_s = set_point_m_s,
    vx_m_s = vx_m_s, y_m = y_m, vy_m_s = vy_m_s, leg_length_m = leg_length_m,
    density_ratio = density_ratio, pitch_rad = sensors.pitch_rad,
    pitch_rate_rad_s = sensors.pitch_rate_rad_s, leg_angle_rad = sensors.leg_angle_rad,
    impulse = sensors.impulse, velocity_m_s = sensors.velocity_m_s,
    height_m = sensors.height_m, pressure_pa = sensors.pressure_pa,
    velocity_age_ns = sensors.velocity_age_ns, height_age_ns = sensors.height_age_ns,
    pressure_age_ns = sensors.pressure_age_ns);
assert_same_places!(LegCommand = Command: header = header, leg_angle_rad = leg_angle_rad,
    elongation_m = elongation_m, elongation_rate_m_s = elongation_rate_m_s,
    apex_vx_m_s = apex_vx_m_s, apex_y_m = apex_y_m, density_ratio = density_ratio,
    velocity_offset_m_s = velocity_offset_m_s, apexes = apexes, rejected = rejected,
    set_points_refused = set_points_refused);

#[cfg(test)]
mod tests {
    use super::*;
    use leg_control::wire::{WIRE_VERSION, flags};

    #[test]
    fn the_constants_are_those_of_the_messages() {
        assert_eq!(LEG_WIRE_VERSION, WIRE_VERSION);
        for (ours, theirs) in [
            (LEG_CONTACT_SENSED, flags::CONTACT_SENSED),
            (LEG_IN_CONTACT, flags::IN_CONTACT),
            (LEG_LENGTH_SENSED, flags::LEG_LENGTH_SENSED),
            (LEG_DENSITY_SENSED, flags::DENSITY_SENSED),
            (LEG_END, flags::END),
            (LEG_STATE_SENSED, flags::STATE_SENSED),
            (LEG_SAFE, flags::SAFE),
            (LEG_IMPULSE_SENSED, flags::IMPULSE_SENSED),
            (LEG_PITCH_SENSED, flags::PITCH_SENSED),
            (LEG_ANGLE_SENSED, flags::LEG_ANGLE_SENSED),
            (LEG_VELOCITY_SENSED, flags::VELOCITY_SENSED),
            (LEG_HEIGHT_SENSED, flags::HEIGHT_SENSED),
            (LEG_PRESSURE_SENSED, flags::PRESSURE_SENSED),
            (LEG_PITCH_RATE_SENSED, flags::PITCH_RATE_SENSED),
        ] {
            assert_eq!(ours, theirs);
        }
    }
}
