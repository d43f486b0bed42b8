//! The names of sensors and of the figures that describe them.

use std::fmt;

/// A sensor of the simulated leg.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {
    /// The sample as a whole, with whatever sensors the leg has.
    Sample,
    /// Velocities and height as the leg's state: `vx_m_s`, `y_m` and `vy_m_s` of a sample.
    State,
    /// Contact switch of the foot.
    Contact,
    /// Encoder of the leg's length.
    LegLength,
    /// Encoder of the leg's angle.
    LegAngle,
    /// Accelerometer in the body, whose readings the leg sums up.
    Accelerometer,
    /// Gyroscope of the body's pitch.
    Gyro,
    /// Orientation of the body, from an attitude reference.
    Pitch,
    /// Doppler velocity log.
    Velocity,
    /// Echo sounder for the height above the ground.
    Height,
    /// Pressure gauge.
    Pressure,
}

impl Sensor {
    /// The sensors in the order of the lists.
    pub const ALL: [Self; 11] = [
        Self::Sample,
        Self::State,
        Self::Contact,
        Self::LegLength,
        Self::LegAngle,
        Self::Accelerometer,
        Self::Gyro,
        Self::Pitch,
        Self::Velocity,
        Self::Height,
        Self::Pressure,
    ];

    /// Returns the name that users type.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::State => "state",
            Self::Contact => "contact",
            Self::LegLength => "leg-length",
            Self::LegAngle => "leg-angle",
            Self::Accelerometer => "accelerometer",
            Self::Gyro => "gyro",
            Self::Pitch => "pitch",
            Self::Velocity => "velocity",
            Self::Height => "height",
            Self::Pressure => "pressure",
        }
    }

    /// Returns what it measures.
    #[must_use]
    pub fn about(self) -> &'static str {
        match self {
            Self::Sample => "all readings of a tick, with their stamp",
            Self::State => "velocities and height: vx, y and vy of a sample",
            Self::Contact => "contact switch of the foot",
            Self::LegLength => "encoder of the leg's length",
            Self::LegAngle => "encoder of the leg's angle from the body",
            Self::Accelerometer => "specific force in body axes, of which a sample has the sum",
            Self::Gyro => "rate of the body's pitch",
            Self::Pitch => "orientation of the body, from an attitude reference",
            Self::Velocity => "Doppler velocity log (DVL): velocity over the ground",
            Self::Height => "echo sounder: height above the ground",
            Self::Pressure => "pressure of the fluid",
        }
    }

    /// Returns the unit of its reading.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::State => "m/s, m",
            Self::Sample | Self::Contact => "",
            Self::LegLength | Self::Height => "m",
            Self::LegAngle | Self::Pitch => "rad",
            Self::Accelerometer => "m/s2",
            Self::Gyro => "rad/s",
            Self::Velocity => "m/s",
            Self::Pressure => "Pa",
        }
    }
}

/// What a figure says about its sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Readings per second; 0: the leg has no such sensor. No sensor reads more often than once
    /// a tick.
    Rate,
    /// Time from the reading to the sample that carries it.
    Latency,
    /// Largest random addition to the latency, uniform, drawn for each reading.
    Jitter,
    /// Share of the readings that is lost.
    Dropout,
    /// Standard deviation of white normal noise; of the inertial sensors its density.
    Noise,
    /// Standard deviation of further normal noise as a share of the reading.
    NoiseShare,
    /// Largest deviation of white uniform noise.
    Uniform,
    /// Bias from the start of the run on, with a random sign.
    Bias,
    /// Random walk of the bias, in the unit over the root of a second.
    Walk,
    /// Scale error, with a random sign.
    Scale,
    /// Step of the quantisation; 0: none.
    Resolution,
    /// Limit at which the reading is clipped, on both sides; 0: none.
    Range,
    /// Longest time in which the contact reading is random after an edge.
    Bounce,
    /// Openings per second of a switch that is closed, each with a bounce.
    Chatter,
    /// Density ratio from which on the sensor works.
    MinDensity,
    /// Height of the surface of the water above 0.
    Surface,
}

impl Quantity {
    /// Returns the name that users type.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rate => "rate",
            Self::Latency => "latency",
            Self::Jitter => "jitter",
            Self::Dropout => "dropout",
            Self::Noise => "noise",
            Self::NoiseShare => "noise-share",
            Self::Uniform => "uniform",
            Self::Bias => "bias",
            Self::Walk => "walk",
            Self::Scale => "scale",
            Self::Resolution => "resolution",
            Self::Range => "range",
            Self::Bounce => "bounce",
            Self::Chatter => "chatter",
            Self::MinDensity => "min-density",
            Self::Surface => "surface",
        }
    }
}

/// A figure of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Figure {
    /// The sensor.
    pub sensor: Sensor,
    /// What the figure says.
    pub quantity: Quantity,
}

impl Figure {
    /// Returns the unit of its value.
    #[must_use]
    pub fn unit(self) -> String {
        let unit = self.sensor.unit();
        match self.quantity {
            Quantity::Rate => "Hz".to_owned(),
            Quantity::Latency | Quantity::Jitter | Quantity::Bounce => "s".to_owned(),
            Quantity::Dropout | Quantity::NoiseShare | Quantity::Scale => "share".to_owned(),
            Quantity::Noise if matches!(self.sensor, Sensor::Accelerometer | Sensor::Gyro) => {
                format!("{unit}/sqrt(Hz)")
            }
            Quantity::Walk if unit.contains(',') => format!("({unit})/sqrt(s)"),
            Quantity::Walk => format!("{unit}/sqrt(s)"),
            Quantity::Chatter => "1/s".to_owned(),
            Quantity::MinDensity => "ratio".to_owned(),
            Quantity::Surface => "m".to_owned(),
            _ => unit.to_owned(),
        }
    }
}

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{}", self.sensor.name(), self.quantity.name())
    }
}
