//! One reading of the leg's sensors.

/// What the sensors of the leg measured at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Measurement {
    /// Time since the start of the run, ns; it rises from one measurement to the next.
    pub t_ns: u64,
    /// Horizontal velocity of the mass, m/s.
    pub vx_m_s: f32,
    /// Height of the mass above the ground, m.
    pub y_m: f32,
    /// Vertical velocity of the mass, m/s, positive upwards.
    pub vy_m_s: f32,
    /// Whether the foot is on the ground, or the leg length that shows it.
    pub contact: Contact,
    /// Fluid density over that of water, if it is measured; otherwise the controller
    /// estimates it.
    pub density_ratio: Option<f32>,
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
