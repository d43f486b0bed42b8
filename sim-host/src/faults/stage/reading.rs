//! The readings of a sample, for the faults of sensors.

use leg_control::wire::{Sample, flags};

/// A reading of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// `vx_m_s`.
    Vx,
    /// `y_m`.
    Y,
    /// `vy_m_s`.
    Vy,
    /// `leg_length_m`.
    LegLength,
    /// `density_ratio`.
    Density,
    /// `sensors.leg_angle_rad`.
    LegAngle,
    /// `sensors.pitch_rad`.
    Pitch,
    /// `sensors.pitch_rate_rad_s`.
    PitchRate,
    /// The first of `sensors.velocity_m_s`.
    VelocityX,
    /// The second of `sensors.velocity_m_s`.
    VelocityY,
    /// `sensors.height_m`.
    Height,
    /// `sensors.pressure_pa`.
    Pressure,
    /// The first of `sensors.impulse`.
    ImpulseX,
    /// The second of `sensors.impulse`.
    ImpulseY,
}

/// Where a reading is in its sample.
#[derive(Debug)]
pub(super) enum Slot<'a> {
    /// A value.
    Value(&'a mut f32),
    /// A sum, which wraps, in counts of `SpecificImpulse::UNIT_M_S`.
    Sum(&'a mut i32),
}

impl Reading {
    /// Number of readings.
    pub(super) const COUNT: usize = 14;

    /// The readings of the state and of the leg's length.
    pub const MOTION: &'static [Self] = &[Self::Vx, Self::Y, Self::Vy, Self::LegLength];

    /// Returns the flag of a sample that has the reading.
    #[must_use]
    pub fn flag(self) -> u16 {
        match self {
            Self::Vx => flags::VX_SENSED,
            Self::Y => flags::Y_SENSED,
            Self::Vy => flags::VY_SENSED,
            Self::LegLength => flags::LEG_LENGTH_SENSED,
            Self::Density => flags::DENSITY_SENSED,
            Self::LegAngle => flags::LEG_ANGLE_SENSED,
            Self::Pitch => flags::PITCH_SENSED,
            Self::PitchRate => flags::PITCH_RATE_SENSED,
            Self::VelocityX | Self::VelocityY => flags::VELOCITY_SENSED,
            Self::Height => flags::HEIGHT_SENSED,
            Self::Pressure => flags::PRESSURE_SENSED,
            Self::ImpulseX | Self::ImpulseY => flags::IMPULSE_SENSED,
        }
    }

    /// Returns whether a sample has the reading.
    pub(super) fn is_in(self, sample: &Sample) -> bool {
        sample.header.flags & self.flag() != 0
    }

    pub(super) fn of(self, sample: &mut Sample) -> Slot<'_> {
        Slot::Value(match self {
            Self::Vx => &mut sample.vx_m_s,
            Self::Y => &mut sample.y_m,
            Self::Vy => &mut sample.vy_m_s,
            Self::LegLength => &mut sample.leg_length_m,
            Self::Density => &mut sample.density_ratio,
            Self::LegAngle => &mut sample.sensors.leg_angle_rad,
            Self::Pitch => &mut sample.sensors.pitch_rad,
            Self::PitchRate => &mut sample.sensors.pitch_rate_rad_s,
            Self::VelocityX => &mut sample.sensors.velocity_m_s[0],
            Self::VelocityY => &mut sample.sensors.velocity_m_s[1],
            Self::Height => &mut sample.sensors.height_m,
            Self::Pressure => &mut sample.sensors.pressure_pa,
            Self::ImpulseX => return Slot::Sum(&mut sample.sensors.impulse[0]),
            Self::ImpulseY => return Slot::Sum(&mut sample.sensors.impulse[1]),
        })
    }

    /// Copies the reading from one sample to another.
    pub(super) fn copy(self, mut from: Sample, to: &mut Sample) {
        match (self.of(&mut from), self.of(to)) {
            (Slot::Value(from), Slot::Value(to)) => *to = *from,
            (Slot::Sum(from), Slot::Sum(to)) => *to = *from,
            _ => unreachable!("a reading has the same place in every sample"),
        }
    }

    /// Takes the reading out of a sample.
    pub(super) fn remove(self, sample: &mut Sample) {
        sample.header.flags &= !self.flag();
        match self.of(sample) {
            Slot::Value(value) => *value = 0.0,
            Slot::Sum(sum) => *sum = 0,
        }
    }
}
