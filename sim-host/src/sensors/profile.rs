//! The profiles by name.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use super::catalog::EVERY_TICK_HZ;
use super::figure::{Figure, Quantity, Sensor};

/// A set of sensors by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum SensorProfile {
    /// The state itself, exact, at every tick.
    #[default]
    Ideal,
    /// The state as simulators for training blur it: uniform noise and a delay.
    TrainedWith,
    /// An inertial sensor, encoders and a contact switch; no velocity, height or density.
    Imu,
    /// As imu, with a Doppler velocity log and a pressure gauge.
    Underwater,
}

/// A figure in which a profile differs from the table.
#[derive(Clone, Copy, Debug)]
pub(super) struct OwnFigure {
    pub(super) figure: Figure,
    pub(super) value: f64,
    pub(super) source: &'static str,
}

const fn own(sensor: Sensor, quantity: Quantity, value: f64, source: &'static str) -> OwnFigure {
    OwnFigure { figure: Figure { sensor, quantity }, value, source }
}

const EXACT: &str = "exact";
const TICK: &str = "every tick";

const IDEAL: &[OwnFigure] = {
    use Quantity::{Bounce, Jitter, Latency, Noise, Rate};
    use Sensor::{Contact, LegLength, State};
    &[
        own(State, Rate, EVERY_TICK_HZ, TICK),
        own(Contact, Latency, 0.0, EXACT),
        own(Contact, Jitter, 0.0, EXACT),
        own(Contact, Bounce, 0.0, EXACT),
        own(LegLength, Noise, 0.0, EXACT),
    ]
};

const TRAINED_WITH: &[OwnFigure] = {
    use Quantity::{Bounce, Jitter, Latency, Noise, Rate, Uniform};
    use Sensor::{Contact, LegLength, Sample, State};
    &[
        own(Sample, Latency, 0.02, "chosen; walk-these-ways trains with up to 30 ms"),
        own(State, Rate, EVERY_TICK_HZ, TICK),
        own(
            State,
            Uniform,
            0.1,
            "legged_gym: uniform noise of 0.1 m/s on the velocity and 0.1 m on heights",
        ),
        own(Contact, Latency, 0.0, EXACT),
        own(Contact, Jitter, 0.0, EXACT),
        own(Contact, Bounce, 0.0, EXACT),
        own(LegLength, Noise, 0.0, EXACT),
    ]
};

const BMI088_RATE: &str = "Bosch BMI088 data sheet: up to 1600 Hz";

const IMU: &[OwnFigure] = {
    use Quantity::Rate;
    use Sensor::{Accelerometer, Gyro, LegAngle, Pitch};
    &[
        own(Accelerometer, Rate, 1600.0, BMI088_RATE),
        own(Gyro, Rate, 2000.0, "Bosch BMI088 data sheet: up to 2000 Hz"),
        own(Pitch, Rate, 1000.0, "chosen"),
        own(LegAngle, Rate, EVERY_TICK_HZ, TICK),
    ]
};

const UNDERWATER: &[OwnFigure] = {
    use Quantity::Rate;
    use Sensor::{Pressure, Velocity};
    let [accelerometer, gyro, pitch, leg_angle] = *IMU else { panic!("four figures") };
    &[
        accelerometer,
        gyro,
        pitch,
        leg_angle,
        own(Velocity, Rate, 10.0, "Water Linked documentation, DVL A50: 10 Hz from 0.3 to 3 m"),
        own(Pressure, Rate, 50.0, "chosen: one conversion of 20 ms after the other"),
    ]
};

impl SensorProfile {
    /// The profiles in the order of the lists.
    pub const ALL: [Self; 4] = [Self::Ideal, Self::TrainedWith, Self::Imu, Self::Underwater];

    /// Returns the name that users type.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ideal => "ideal",
            Self::TrainedWith => "trained-with",
            Self::Imu => "imu",
            Self::Underwater => "underwater",
        }
    }

    /// Returns what sensors it has.
    #[must_use]
    pub fn about(self) -> &'static str {
        match self {
            Self::Ideal => "the state itself, exact, at every tick",
            Self::TrainedWith => {
                "the state as simulators for training blur it: uniform noise, and 20 ms late"
            }
            Self::Imu => {
                "an inertial sensor, encoders and a contact switch: no velocity, height or density"
            }
            Self::Underwater => "as imu, with a Doppler velocity log and a pressure gauge",
        }
    }

    /// Returns the figures in which the profile differs from the table.
    pub(super) fn own_figures(self) -> &'static [OwnFigure] {
        match self {
            Self::Ideal => IDEAL,
            Self::TrainedWith => TRAINED_WITH,
            Self::Imu => IMU,
            Self::Underwater => UNDERWATER,
        }
    }
}
