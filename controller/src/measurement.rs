//! One reading of the leg's sensors.

/// What the sensors of the leg measured at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Measurement {
    /// Time since the start of the run, ns; it rises from one measurement to the next.
    pub t_ns: u64,
    /// Horizontal velocity of the mass, m/s; NaN where it is not sensed.
    pub vx_m_s: f32,
    /// Height of the mass above the ground, m; NaN where it is not sensed.
    pub y_m: f32,
    /// Vertical velocity of the mass, m/s, positive upwards; NaN where it is not sensed.
    pub vy_m_s: f32,
    /// Whether the foot is on the ground, or the leg length that shows it.
    pub contact: Contact,
    /// Fluid density over that of water, if it is measured; otherwise the controller
    /// estimates it.
    pub density_ratio: Option<f32>,
    /// Readings of a leg that does not sense its state itself.
    pub sensors: Sensors,
}

/// How the leg finds out whether its foot is on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Contact {
    /// A contact or force sensor: true while the foot is loaded.
    Sensed(bool),
    /// No such sensor, but the length of the leg from foot to mass, m: the foot counts
    /// as loaded while the leg is shorter than its rest length (in flight the length is
    /// that of the unloaded leg, its elongation included).
    LegLength(f32),
}

/// Readings of an inertial sensor, of the leg's joints, and of slow sensors of motion: each
/// where the leg has it and a reading has come since the measurement before.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sensors {
    /// Accelerometer.
    pub impulse: Option<SpecificImpulse>,
    /// Orientation of the body, rad, positive where it leans back (from +x to +y): between the
    /// axes of accelerometer and leg angle, and the level. Without it they count as level.
    pub pitch_rad: Option<f32>,
    /// Rate of the pitch, rad/s: a gyroscope's.
    pub pitch_rate_rad_s: Option<f32>,
    /// Joints of the leg.
    pub posture: Option<LegPosture>,
    /// Velocity over the ground, horizontal and vertical, m/s, such as that of a Doppler log.
    pub velocity_m_s: Option<Aged<[f32; 2]>>,
    /// Height of the mass above the ground, m, such as that of an echo sounder.
    pub height_m: Option<Aged<f32>>,
    /// Pressure of the fluid at the mass, Pa; only its changes count.
    pub pressure_pa: Option<Aged<f32>>,
}

/// The integral of the specific force (what an accelerometer feels: acceleration less
/// gravity) since any instant, along the body's x and y axes, in units of [`Self::UNIT_M_S`].
///
/// A sum, so that a lost message costs nothing; in integers that wrap, so that it never
/// grows coarse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SpecificImpulse(pub [i32; 2]);

impl SpecificImpulse {
    /// The unit, m/s: 2^-16.
    pub const UNIT_M_S: f32 = 1.0 / 65_536.0;

    /// Returns the specific impulse since an earlier reading, m/s, at most 32,768.
    #[must_use]
    pub fn since(self, earlier: Self) -> [f32; 2] {
        let ([x, y], [x0, y0]) = (self.0, earlier.0);
        [x.wrapping_sub(x0), y.wrapping_sub(y0)].map(|count| Self::UNIT_M_S * count as f32)
    }
}

/// Length and angle of the leg by its joints' encoders.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LegPosture {
    /// Length from foot to mass, m.
    pub length_m: f32,
    /// Angle from the body's +x axis, rad, as that of a command.
    pub angle_rad: f32,
}

/// A reading that was taken before the time of its measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Aged<T> {
    /// The reading.
    pub value: T,
    /// How long before, ns.
    pub age_ns: u32,
}
