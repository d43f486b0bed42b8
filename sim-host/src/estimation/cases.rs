//! The cases of the study.

use crate::faults::FaultSetting;
use crate::robustness::Media;
use crate::sensors::{SensorProfile, SensorSetting};

/// A set of faults, and what is expected under them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// Name.
    pub name: &'static str,
    /// Description.
    pub about: &'static str,
    /// Profile of the sensors.
    pub sensors: SensorProfile,
    /// Figures of the sensors, as users write them.
    sensor_figures: &'static [&'static str],
    /// Faults, as users write them.
    faults: &'static [&'static str],
    /// Set-point, m/s.
    pub set_point_m_s: f64,
    /// Media; none: all.
    only: Option<Media>,
    /// Apexes after which a leg counts as still hopping.
    pub hops: u32,
    /// Stale limit of leg and controller, ms.
    pub stale_limit_ms: u64,
    /// Least share of the runs that is expected to hop on with the estimator.
    pub goal: f64,
}

const WHITE_1: Case = Case {
    name: "white-1",
    about: "white noise of 1 m/s and 1 m on every channel",
    sensors: SensorProfile::Ideal,
    sensor_figures: &[],
    faults: &["noise=1"],
    set_point_m_s: 0.5,
    only: None,
    hops: 30,
    stale_limit_ms: 10,
    goal: 0.999,
};

const IMU: Case = Case {
    name: "imu",
    about: "sensors `imu`: no velocity, height or density sensed",
    sensors: SensorProfile::Imu,
    faults: &[],
    goal: 1.0,
    ..WHITE_1
};

/// The cases in the order of the report.
pub const CASES: [Case; 39] = [
    Case { name: "ideal", about: "no fault", faults: &[], goal: 1.0, ..WHITE_1 },
    Case {
        name: "white-0.2",
        about: "white noise of 0.2 m/s and 0.2 m on every channel",
        faults: &["noise=0.2"],
        ..WHITE_1
    },
    WHITE_1,
    Case { name: "white-1-long", about: "the same for 300 hops", hops: 300, ..WHITE_1 },
    Case {
        name: "white-2",
        about: "white noise of 2 m/s and 2 m",
        faults: &["noise=2"],
        goal: 0.998,
        ..WHITE_1
    },
    Case {
        name: "white-5",
        about: "white noise of 5 m/s and 5 m",
        faults: &["noise=5"],
        goal: 0.99,
        ..WHITE_1
    },
    Case {
        name: "coloured",
        about: "noise of 0.3 m/s and 0.3 m, correlated over 20 ms",
        faults: &["noise=0.3,correlation=0.02"],
        goal: 0.99,
        ..WHITE_1
    },
    Case {
        name: "at-once",
        about: "noise of 1, 20 ms late each way with 5 ms of jitter, 30 % lost, 5 % of the \
                contact readings wrong, actuators with a lag of 20 ms, ground of 0.3 m",
        faults: &[
            "noise=1",
            "noise=0.05,field=contact",
            "drop=0.3",
            "delay=20",
            "jitter=5",
            "lag=0.02",
            "ground=rough,length=0.5,height=0.3",
        ],
        stale_limit_ms: 1_000,
        goal: 0.995,
        ..WHITE_1
    },
    Case {
        name: "late-100",
        about: "samples and commands 100 ms late each",
        faults: &["delay=100"],
        stale_limit_ms: 1_000,
        goal: 1.0,
        ..WHITE_1
    },
    Case {
        name: "late-300",
        about: "samples and commands 300 ms late each",
        faults: &["delay=300"],
        stale_limit_ms: 1_000,
        goal: 0.995,
        ..WHITE_1
    },
    Case {
        name: "lost-90",
        about: "90 % of the messages lost each way",
        faults: &["drop=0.9"],
        stale_limit_ms: 1_000,
        goal: 0.99,
        ..WHITE_1
    },
    Case {
        name: "trained-with",
        about: "uniform noise of up to 0.1 m/s and 0.1 m, 20 ms late each way: what legged_gym, \
                Isaac Lab and MuJoCo Playground train with; 300 hops",
        faults: &["noise=0.1,as=uniform", "delay=20"],
        stale_limit_ms: 100,
        hops: 300,
        ..WHITE_1
    },
    Case {
        name: "flood",
        about: "noise of 0.2; land turns to water at once after 15 s",
        faults: &["noise=0.2", "medium=1,at=15s"],
        only: Some(Media::Land),
        goal: 0.98,
        ..WHITE_1
    },
    Case {
        name: "mass-0.8",
        about: "noise of 0.2; 0.8 times the mass of the model",
        faults: &["noise=0.2", "mass=0.8"],
        goal: 0.98,
        ..WHITE_1
    },
    Case {
        name: "mass-2",
        about: "noise of 0.2; twice the mass of the model",
        faults: &["noise=0.2", "mass=2"],
        goal: 0.98,
        ..WHITE_1
    },
    Case {
        name: "stiffness-0.8",
        about: "noise of 0.2; 0.8 times the stiffness",
        faults: &["noise=0.2", "stiffness=0.8"],
        goal: 0.98,
        ..WHITE_1
    },
    Case {
        name: "leg-1.2",
        about: "noise of 0.2; mass, stiffness, drag and gravity of 1.2 times those of the model",
        faults: &["noise=0.2", "mass=1.2", "stiffness=1.2", "drag=1.2", "gravity=1.2"],
        goal: 0.98,
        ..WHITE_1
    },
    Case {
        name: "leg-0.8",
        about: "noise of 0.2; mass, stiffness, drag and gravity of 0.8 times those of the model",
        faults: &["noise=0.2", "mass=0.8", "stiffness=0.8", "drag=0.8", "gravity=0.8"],
        goal: 0.98,
        ..WHITE_1
    },
    Case {
        name: "nan",
        about: "noise of 0.2; a fifth of the readings of each channel not a number",
        faults: &["noise=0.2", "nan=0.2,field=vx", "nan=0.2,field=y", "nan=0.2,field=vy"],
        goal: 0.98,
        ..WHITE_1
    },
    IMU,
    Case { name: "imu-long", about: "the same for 300 hops", hops: 300, goal: 0.999, ..IMU },
    Case {
        name: "imu-1",
        about: "the same at 1 m/s on the shore",
        set_point_m_s: 1.0,
        only: Some(Media::Shore),
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-at-once",
        about: "sensors `imu`, orientation 0.05 rad off, foot of 2 kg, damping of 50 N s/m, \
                friction of 0.6, actuators of 20 Hz, 20 ms late each way, ground of 0.2 m",
        sensor_figures: &["pitch-bias=0.05"],
        faults: &[
            "foot-mass=2",
            "damping=50",
            "friction=0.6",
            "bandwidth=20",
            "delay=20",
            "ground=rough,length=0.5,height=0.2",
        ],
        stale_limit_ms: 200,
        goal: 0.97,
        ..IMU
    },
    Case {
        name: "imu-mass-0.8",
        about: "sensors `imu`, 0.8 times the mass of the model",
        faults: &["mass=0.8"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-mass-1.2",
        about: "sensors `imu`, 1.2 times the mass of the model",
        faults: &["mass=1.2"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-stiffness-0.8",
        about: "sensors `imu`, 0.8 times the stiffness of the model",
        faults: &["stiffness=0.8"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-stiffness-1.2",
        about: "sensors `imu`, 1.2 times the stiffness of the model",
        faults: &["stiffness=1.2"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-drag-0.8",
        about: "sensors `imu`, 0.8 times the drag of the model",
        faults: &["drag=0.8"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-drag-1.2",
        about: "sensors `imu`, 1.2 times the drag of the model",
        faults: &["drag=1.2"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-gravity-0.8",
        about: "sensors `imu`, 0.8 times the gravity of the model",
        faults: &["gravity=0.8"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-gravity-1.2",
        about: "sensors `imu`, 1.2 times the gravity of the model",
        faults: &["gravity=1.2"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-mass-2",
        about: "sensors `imu`, twice the mass of the model",
        faults: &["mass=2"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-slip",
        about: "sensors `imu`, friction of 0.5 under a foot of 0.5 kg: it slips in water",
        faults: &["friction=0.5", "foot-mass=0.5"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-chatter",
        about: "sensors `imu`, contact switch of which 5 % of the readings are wrong, and that bounces",
        faults: &["noise=0.05,field=contact"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-open",
        about: "sensors `imu`, contact switch that sticks open from 10 s on",
        faults: &["switch=open,at=10s"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-closed",
        about: "sensors `imu`, contact switch that sticks closed from 10 s on",
        faults: &["switch=closed,at=10s"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-clip",
        about: "sensors `imu`, accelerometer that clips at 6 g",
        sensor_figures: &["accelerometer-range=58.8"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "imu-deaf",
        about: "sensors `imu`, accelerometer that is dead from 10 s on",
        faults: &["dead=acceleration,at=10s"],
        goal: 0.98,
        ..IMU
    },
    Case {
        name: "underwater",
        about: "sensors `underwater`, from water onto land; 300 hops",
        sensors: SensorProfile::Underwater,
        only: Some(Media::Shore),
        hops: 300,
        goal: 0.98,
        ..IMU
    },
];

impl Case {
    /// Returns the case of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        CASES.iter().find(|case| case.name == name)
    }

    /// Returns whether the case is one of this medium.
    #[must_use]
    pub fn is_in(&self, media: Media) -> bool {
        self.only.is_none_or(|only| only == media)
    }

    /// Returns the same case for another number of hops.
    #[must_use]
    pub fn with_hops(self, hops: u32) -> Self {
        Self { hops, ..self }
    }

    /// Returns the fault settings.
    pub(super) fn settings(&self) -> Vec<FaultSetting> {
        let parse = |text: &&str| text.parse().expect("a test parses every fault");
        self.faults.iter().map(parse).collect()
    }

    /// Returns the settings of the sensors.
    pub(super) fn sensor_settings(&self) -> Vec<SensorSetting> {
        let parse = |text: &&str| text.parse().expect("a test parses every figure");
        self.sensor_figures.iter().map(parse).collect()
    }
}
