//! The runs: axes, levels, media, starts.

use std::time::Duration;

use crate::faults::stage::Stepped;
use clap::ValueEnum;
use leg_control::config::{Config, ConfigError};
use leg_control::policy::Policy;
use leg_control::wire_controller::WireController;
use leg_host::Link;
use rayon::prelude::*;
use serde::Serialize;

use super::HOPS;
use super::report::{Report, Row};
use crate::faults::FaultSetting;
use crate::scenario::{BadValue, Scenario, Settings};
use crate::session::{Leg, TickRecord};
use leg_plant::EventKind;

/// Where the leg hops.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Media {
    /// All in water.
    Water,
    /// From water onto land: the density falls over 10 m.
    Shore,
    /// All on land.
    Land,
}

impl Media {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Water => "water",
            Self::Shore => "shore",
            Self::Land => "land",
        }
    }

    fn density_profile(self) -> Vec<[f64; 2]> {
        match self {
            Self::Water => vec![[0.0, 1.0]],
            Self::Shore => vec![[1.0, 1.0], [11.0, 0.0]],
            Self::Land => vec![[0.0, 0.0]],
        }
    }
}

/// One kind of fault at growing levels; the first is none of it.
pub(super) struct Axis {
    pub(super) name: &'static str,
    pub(super) unit: &'static str,
    /// Before the level, in a `--fault`.
    prefix: &'static str,
    /// After it.
    suffix: &'static str,
    pub(super) levels: [f64; 7],
    /// The level that is no fault.
    pub(super) none: f64,
}

/// Each up to where the shipped policy no longer hops, or to what no leg would
/// be asked to stand.
pub(super) const AXES: [Axis; 6] = [
    Axis {
        name: "drop",
        unit: "share of messages lost, each way",
        prefix: "drop=",
        suffix: "",
        levels: [0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9],
        none: 0.0,
    },
    Axis {
        name: "delay",
        unit: "ticks of 1 ms that messages are late, each way",
        prefix: "delay=",
        suffix: "",
        levels: [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        none: 0.0,
    },
    Axis {
        name: "noise",
        unit: "standard deviation of vx, y, vy and leg length, m/s and m",
        prefix: "noise=",
        suffix: "",
        levels: [0.0, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2],
        none: 0.0,
    },
    Axis {
        name: "ground",
        unit: "roughness, highest over lowest, m (a height each 0.5 m)",
        prefix: "ground=rough,length=0.5,height=",
        suffix: "",
        levels: [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0],
        none: 0.0,
    },
    Axis {
        name: "mass",
        unit: "mass of the leg over that of the training",
        prefix: "mass=",
        suffix: "",
        levels: [0.8, 0.85, 0.9, 1.0, 1.5, 2.0, 3.0],
        none: 1.0,
    },
    Axis {
        name: "stiffness",
        unit: "stiffness of the spring over that of the training",
        prefix: "stiffness=",
        suffix: "",
        levels: [0.2, 0.35, 0.5, 1.0, 2.0, 4.0, 8.0],
        none: 1.0,
    },
];

impl Axis {
    fn fault(&self, level: f64) -> Vec<FaultSetting> {
        if level == self.none {
            return Vec::new();
        }
        let text = format!("{}{level}{}", self.prefix, self.suffix);
        vec![text.parse().expect("the axes are tested")]
    }
}

/// How large the sweep is.
#[derive(Clone, Debug)]
pub struct Size {
    /// Runs, each from a start of its own, at each level in each medium.
    pub runs: u64,
    /// Where.
    pub media: Vec<Media>,
}

/// One run to be made; the starts are those of the seeds from 0 on.
struct Case {
    axis: usize,
    level: usize,
    media: Media,
    seed: u64,
}

fn scenario(axis: &Axis, level: f64, media: Media, seed: u64) -> Result<Scenario, BadValue> {
    let mut settings = Settings {
        // A hop takes a second on land, two in water, and nine in water when the mass is
        // hardly more than that of the water in its place: time enough for all.
        duration_s: Some(400.0),
        seed: Some(seed),
        density_profile: Some(media.density_profile()),
        set_point_m_s: Some(0.5),
        faults: axis.fault(level),
        ..Settings::default()
    };
    settings.start.vx_spread_m_s = Some(0.5);
    settings.start.y_spread_m = Some(0.5);
    Scenario::from_settings(&settings)
}

/// Apexes of a run until it falls, at most [`HOPS`].
fn apexes(scenario: &Scenario, mut controller: WireController<'_>) -> u32 {
    let law = |sample: Option<&_>| controller.tick(sample);
    let mut link = Stepped::new(law, scenario.faults.plan());
    let mut leg = Leg::new(scenario, 1);
    let mut apexes = 0;
    while leg.ending().is_none() && apexes < HOPS {
        // Within a thread neither fails.
        let sent = link.send(leg.sample());
        let command = sent.and_then(|()| link.receive(Duration::ZERO)).unwrap_or(None);
        leg.step(command, Duration::ZERO, &mut |tick: &TickRecord| {
            let at_apex = tick.events.iter().filter(|event| event.kind == EventKind::Apex);
            apexes += at_apex.count() as u32;
        });
    }
    apexes
}

/// Plays every axis at every level in every medium, on the threads of the
/// current rayon pool. The result depends on policy and size only.
///
/// # Errors
/// When the controller cannot be made, which no policy that parses causes.
pub fn sweep(policy: &Policy<'_>, size: &Size) -> Result<Report, ConfigError> {
    let mut cases = Vec::new();
    for &media in &size.media {
        for (axis, row) in AXES.iter().enumerate() {
            for level in 0..row.levels.len() {
                cases.extend((0..size.runs).map(|seed| Case { axis, level, media, seed }));
            }
        }
    }
    let hopped: Vec<u32> = cases
        .par_iter()
        .map(|case| {
            let axis = &AXES[case.axis];
            let level = axis.levels[case.level];
            // Without a fault all axes are the same run: it is made once, for the first.
            if level == axis.none && case.axis > 0 {
                return Ok(0);
            }
            let scenario = scenario(axis, level, case.media, case.seed)
                .expect("the axes and the starts are tested");
            let config = Config::at_rate(scenario.rate_hz)?
                .with_gravity(scenario.controller_gravity_m_s2())?;
            Ok(apexes(&scenario, WireController::new(policy.clone(), config)))
        })
        .collect::<Result<_, ConfigError>>()?;

    let runs = size.runs.max(1) as usize;
    let still = |apexes: &[u32]| apexes.iter().filter(|&&apexes| apexes >= HOPS).count() as u64;
    let mut rows: Vec<Row> = cases
        .chunks(runs)
        .zip(hopped.chunks(runs))
        .map(|(cases, apexes)| {
            let axis = &AXES[cases[0].axis];
            Row {
                fault: axis.name,
                level: axis.levels[cases[0].level],
                media: cases[0].media,
                runs: size.runs,
                hopping: still(apexes),
            }
        })
        .collect();
    for &media in &size.media {
        let none = rows.iter().find(|row| row.media == media && row.is_none());
        let Some(hopping) = none.map(|row| row.hopping) else { continue };
        rows.iter_mut()
            .filter(|row| row.media == media && row.is_none())
            .for_each(|row| row.hopping = hopping);
    }
    Ok(Report { policy: policy.manifest().name.to_owned(), hops: HOPS, runs: size.runs, rows })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_run_of_the_sweep_can_be_made() {
        for axis in &AXES {
            assert!(axis.levels.contains(&axis.none) && axis.levels.is_sorted(), "{}", axis.name);
            for level in axis.levels {
                for media in [Media::Water, Media::Shore, Media::Land] {
                    let made = scenario(axis, level, media, 3).unwrap();
                    assert_eq!(made.faults.is_empty(), level == axis.none, "{}", axis.name);
                }
            }
        }
    }
}
