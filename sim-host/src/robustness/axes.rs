//! The axes of the sweep: media, faults at increasing levels, and sensors.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use crate::scenario::Settings;
use crate::sensors::SensorProfile;

/// The medium of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Media {
    /// Water everywhere.
    Water,
    /// From water onto land: the density falls to 0 over 10 m.
    Shore,
    /// Land everywhere.
    Land,
}

impl Media {
    /// Returns the name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Water => "water",
            Self::Shore => "shore",
            Self::Land => "land",
        }
    }

    /// Returns the density profile as pairs of a place (m) and a density ratio.
    pub(crate) fn density_profile(self) -> Vec<[f64; 2]> {
        match self {
            Self::Water => vec![[0.0, 1.0]],
            Self::Shore => vec![[1.0, 1.0], [11.0, 0.0]],
            Self::Land => vec![[0.0, 0.0]],
        }
    }
}

/// What a level of an axis sets.
#[derive(Clone, Copy, Debug)]
enum Sets {
    /// A fault, written up to its level; the sensors are ideal.
    Fault(&'static str),
    /// The profile of the sensors, by its place in [`PROFILES`].
    Profile,
    /// A figure of the sensors `imu`, up to its level. The controller has the estimator for the
    /// figures of the profile and is not told the level.
    Figure(&'static str),
}

/// The profiles in the order of their levels.
pub(super) const PROFILES: [SensorProfile; 4] = [
    SensorProfile::Ideal,
    SensorProfile::TrainedWith,
    SensorProfile::Imu,
    SensorProfile::Underwater,
];

/// One kind of fault, or one property of the sensors, at increasing levels.
pub(super) struct Axis {
    pub(super) name: &'static str,
    /// Description of the level with its unit.
    pub(super) unit: &'static str,
    sets: Sets,
    pub(super) levels: &'static [f64],
    /// The level that is no fault, if there is one: on an axis of sensors their usual figure.
    pub(super) none: Option<f64>,
}

/// The faults of the sweep. The levels reach to where the shipped policy no longer hops, or beyond
/// what a leg can be expected to tolerate.
pub(super) const AXES: [Axis; 21] = [
    Axis {
        name: "drop",
        unit: "share of messages lost, each way",
        sets: Sets::Fault("drop="),
        levels: &[0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9],
        none: Some(0.0),
    },
    Axis {
        name: "delay",
        unit: "ticks of 1 ms that messages are late, each way",
        sets: Sets::Fault("delay="),
        levels: &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        none: Some(0.0),
    },
    Axis {
        name: "noise",
        unit: "standard deviation of vx, y, vy and leg length, m/s and m",
        sets: Sets::Fault("noise="),
        levels: &[0.0, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2],
        none: Some(0.0),
    },
    Axis {
        name: "ground",
        unit: "roughness, highest over lowest, m (a height each 0.5 m)",
        sets: Sets::Fault("ground=rough,length=0.5,height="),
        levels: &[0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0],
        none: Some(0.0),
    },
    Axis {
        name: "mass",
        unit: "mass of the leg over that of the training",
        sets: Sets::Fault("mass="),
        levels: &[0.8, 0.85, 0.9, 1.0, 1.5, 2.0, 3.0],
        none: Some(1.0),
    },
    Axis {
        name: "stiffness",
        unit: "stiffness of the spring over that of the training",
        sets: Sets::Fault("stiffness="),
        levels: &[0.2, 0.35, 0.5, 1.0, 2.0, 4.0, 8.0],
        none: Some(1.0),
    },
    Axis {
        name: "damping",
        unit: "damping of the spring, N s/m",
        sets: Sets::Fault("damping="),
        levels: &[0.0, 50.0, 100.0, 200.0, 400.0, 700.0, 1000.0],
        none: Some(0.0),
    },
    Axis {
        name: "foot-mass",
        unit: "mass of the foot, kg",
        sets: Sets::Fault("foot-mass="),
        levels: &[0.0, 0.5, 1.0, 2.0, 4.0, 7.0, 10.0],
        none: Some(0.0),
    },
    Axis {
        name: "friction",
        unit: "coefficient of friction of a massless foot",
        sets: Sets::Fault("friction="),
        levels: &[0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6],
        none: None,
    },
    Axis {
        name: "bandwidth",
        unit: "bandwidth of angle and elongation, Hz",
        sets: Sets::Fault("bandwidth="),
        levels: &[0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0],
        none: None,
    },
    Axis {
        name: "dead-time",
        unit: "dead time of angle and elongation, ms",
        sets: Sets::Fault("dead-time="),
        levels: &[0.0, 50.0, 100.0, 200.0, 300.0, 500.0, 800.0],
        none: Some(0.0),
    },
    Axis {
        name: "backlash",
        unit: "backlash of the leg angle, rad",
        sets: Sets::Fault("backlash="),
        levels: &[0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6],
        none: Some(0.0),
    },
    Axis {
        name: "drive-force",
        unit: "largest force of the drive of the elongation, N",
        sets: Sets::Fault("drive-force="),
        levels: &[0.0, 250.0, 500.0, 1000.0, 1500.0, 2000.0, 3000.0],
        none: None,
    },
    Axis {
        name: "sensors",
        unit: "profile: 0 ideal, 1 trained-with, 2 imu, 3 underwater",
        sets: Sets::Profile,
        levels: &[0.0, 1.0, 2.0, 3.0],
        none: Some(0.0),
    },
    figure(
        "acceleration-noise",
        "imu: noise density of the accelerometer, m/s2/sqrt(Hz)",
        "accelerometer-noise=",
        &[0.0, 0.003, 0.01, 0.03, 0.05, 0.1, 0.2],
    ),
    figure(
        "acceleration-bias",
        "imu: bias of the accelerometer, m/s2",
        "accelerometer-bias=",
        &[0.0, 0.2, 0.5, 1.0, 2.0, 3.0, 5.0],
    ),
    figure(
        "pitch-bias",
        "imu: error of the orientation, rad",
        "pitch-bias=",
        &[0.0, 0.01, 0.05, 0.1, 0.2, 0.3, 0.5],
    ),
    figure(
        "leg-length-noise",
        "imu: noise of the leg length, m",
        "leg-length-noise=",
        &[0.0, 0.001, 0.002, 0.003, 0.005, 0.01, 0.02],
    ),
    figure(
        "leg-angle-bias",
        "imu: error of the leg angle, rad",
        "leg-angle-bias=",
        &[0.0, 0.01, 0.03, 0.05, 0.1, 0.2, 0.3],
    ),
    figure(
        "contact-latency",
        "imu: latency of the contact switch, s",
        "contact-latency=",
        &[0.001, 0.003, 0.01, 0.02, 0.04, 0.07, 0.1],
    ),
    figure(
        "sample-latency",
        "imu: latency of every sample with its stamp, s",
        "sample-latency=",
        &[0.0, 0.002, 0.005, 0.01, 0.012, 0.02, 0.05],
    ),
];

const fn figure(
    name: &'static str,
    unit: &'static str,
    prefix: &'static str,
    levels: &'static [f64],
) -> Axis {
    Axis { name, unit, sets: Sets::Figure(prefix), levels, none: None }
}

impl Axis {
    /// Returns true if the level is no fault, and the sensors are ideal.
    pub(super) fn is_none(&self, level: f64) -> bool {
        self.none == Some(level)
    }

    /// Returns the names of the levels, where they are names.
    pub(super) fn names(&self) -> Option<Vec<(f64, String)>> {
        let name = |profile: &SensorProfile| {
            profile.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned())
        };
        let names = PROFILES.iter().map(name);
        matches!(self.sets, Sets::Profile).then(|| self.levels.iter().copied().zip(names).collect())
    }

    /// Returns the settings that are completed to those of a level: the sensors for which the
    /// controller is configured.
    pub(super) fn usual(&self, level: f64) -> Settings {
        let sensors = match self.sets {
            Sets::Fault(_) => SensorProfile::Ideal,
            Sets::Profile => PROFILES[level as usize],
            Sets::Figure(_) => SensorProfile::Imu,
        };
        Settings { sensors: Some(sensors), ..Settings::default() }
    }

    /// Returns the settings of a level, with no fault for [`Axis::none`].
    pub(super) fn settings(&self, level: f64) -> Settings {
        const TESTED: &str = "a test parses every level";
        let mut settings = self.usual(level);
        match self.sets {
            Sets::Fault(_) if self.is_none(level) => {}
            Sets::Fault(prefix) => {
                settings.faults = vec![format!("{prefix}{level}").parse().expect(TESTED)];
            }
            Sets::Profile => {}
            Sets::Figure(prefix) => {
                settings.sensor_figures = vec![format!("{prefix}{level}").parse().expect(TESTED)];
            }
        }
        settings
    }
}
