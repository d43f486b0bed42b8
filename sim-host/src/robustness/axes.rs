//! The axes of the sweep: media, and faults at increasing levels.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use crate::faults::FaultSetting;

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

/// One kind of fault at increasing levels.
pub(super) struct Axis {
    pub(super) name: &'static str,
    /// Description of the level with its unit.
    pub(super) unit: &'static str,
    /// Fault setting, to which the level is appended.
    prefix: &'static str,
    pub(super) levels: [f64; 7],
    /// The level that is no fault, if there is one.
    pub(super) none: Option<f64>,
}

/// The faults of the sweep. The levels reach to where the shipped policy no longer hops, or beyond
/// what a leg can be expected to tolerate.
pub(super) const AXES: [Axis; 12] = [
    Axis {
        name: "drop",
        unit: "share of messages lost, each way",
        prefix: "drop=",
        levels: [0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9],
        none: Some(0.0),
    },
    Axis {
        name: "delay",
        unit: "ticks of 1 ms that messages are late, each way",
        prefix: "delay=",
        levels: [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        none: Some(0.0),
    },
    Axis {
        name: "noise",
        unit: "standard deviation of vx, y, vy and leg length, m/s and m",
        prefix: "noise=",
        levels: [0.0, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2],
        none: Some(0.0),
    },
    Axis {
        name: "ground",
        unit: "roughness, highest over lowest, m (a height each 0.5 m)",
        prefix: "ground=rough,length=0.5,height=",
        levels: [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0],
        none: Some(0.0),
    },
    Axis {
        name: "mass",
        unit: "mass of the leg over that of the training",
        prefix: "mass=",
        levels: [0.8, 0.85, 0.9, 1.0, 1.5, 2.0, 3.0],
        none: Some(1.0),
    },
    Axis {
        name: "stiffness",
        unit: "stiffness of the spring over that of the training",
        prefix: "stiffness=",
        levels: [0.2, 0.35, 0.5, 1.0, 2.0, 4.0, 8.0],
        none: Some(1.0),
    },
    Axis {
        name: "damping",
        unit: "damping of the spring, N s/m",
        prefix: "damping=",
        levels: [0.0, 50.0, 100.0, 200.0, 400.0, 700.0, 1000.0],
        none: Some(0.0),
    },
    Axis {
        name: "foot-mass",
        unit: "mass of the foot, kg",
        prefix: "foot-mass=",
        levels: [0.0, 0.5, 1.0, 2.0, 4.0, 7.0, 10.0],
        none: Some(0.0),
    },
    Axis {
        name: "friction",
        unit: "coefficient of friction of a massless foot",
        prefix: "friction=",
        levels: [0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6],
        none: None,
    },
    Axis {
        name: "bandwidth",
        unit: "bandwidth of angle and elongation, Hz",
        prefix: "bandwidth=",
        levels: [0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0],
        none: None,
    },
    Axis {
        name: "dead-time",
        unit: "dead time of angle and elongation, ms",
        prefix: "dead-time=",
        levels: [0.0, 50.0, 100.0, 200.0, 300.0, 500.0, 800.0],
        none: Some(0.0),
    },
    Axis {
        name: "backlash",
        unit: "backlash of the leg angle, rad",
        prefix: "backlash=",
        levels: [0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6],
        none: Some(0.0),
    },
];

impl Axis {
    /// Returns true if the level is no fault.
    pub(super) fn is_none(&self, level: f64) -> bool {
        self.none == Some(level)
    }

    /// Returns the fault settings of a level; none for [`Axis::none`].
    pub(super) fn faults(&self, level: f64) -> Vec<FaultSetting> {
        if self.is_none(level) {
            return Vec::new();
        }
        let text = format!("{}{level}", self.prefix);
        vec![text.parse().expect("a test parses every level")]
    }
}
