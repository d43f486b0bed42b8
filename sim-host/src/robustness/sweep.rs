//! The runs of the sweep.

use std::time::Duration;

use crate::faults::stage::SteppedLink;
use leg_control::config::ConfigError;
use leg_control::policy::Policy;
use leg_control::wire_controller::WireController;
use leg_host::Link;
use rayon::prelude::*;

use super::HOPS;
use super::axes::{AXES, Axis, Media};
use super::report::{Report, Row};
use crate::scenario::{BadValue, Scenario, Settings};
use crate::session::{Leg, TickRecord};
use leg_plant::EventKind;

/// Size of the sweep.
#[derive(Clone, Debug)]
pub struct Size {
    /// Number of runs at each level in each medium, each from another start.
    pub runs: u64,
    /// Media of the runs.
    pub media: Vec<Media>,
}

/// One run of the sweep. Its seed, from 0 on, determines the start.
struct Case {
    axis: usize,
    level: usize,
    media: Media,
    seed: u64,
}

/// Returns a run. Its controller is configured for the usual figures of its sensors, whatever
/// they are in the run.
fn scenario(axis: &Axis, level: f64, media: Media, seed: u64) -> Result<Scenario, BadValue> {
    let complete = |base: Settings| {
        let mut settings = Settings {
            // A hop takes a second on land, two in water, and nine in water for a leg that is
            // hardly heavier than the water it displaces. This is enough for all.
            duration_s: Some(400.0),
            seed: Some(seed),
            density_profile: Some(media.density_profile()),
            set_point_m_s: Some(0.5),
            ..base
        };
        settings.start.vx_spread_m_s = Some(0.5);
        settings.start.y_spread_m = Some(0.5);
        Scenario::from_settings(&settings)
    };
    let estimator = complete(axis.usual(level))?.estimator;
    Ok(Scenario { estimator, ..complete(axis.settings(level))? })
}

/// Returns the number of apexes of a run until the leg falls, at most [`HOPS`].
fn apexes(scenario: &Scenario, mut controller: WireController<'_>) -> u32 {
    let law = |sample: Option<&_>| controller.tick(sample);
    let mut link = SteppedLink::new(law, scenario.faults.plan());
    let mut leg = Leg::new(scenario, 1);
    let mut apexes = 0;
    while leg.ending().is_none() && apexes < HOPS {
        // Within a thread neither call fails.
        let sent = link.send(leg.sample());
        let command = sent.and_then(|()| link.receive(Duration::ZERO)).unwrap_or(None);
        leg.step(command, Duration::ZERO, &mut |tick: &TickRecord| {
            let at_apex = tick.events.iter().filter(|event| event.kind == EventKind::Apex);
            apexes += at_apex.count() as u32;
        });
    }
    apexes
}

/// Runs every axis at every level in every medium, on the threads of the current rayon pool. The
/// result depends only on policy and size.
///
/// # Errors
/// Returns an error if the controller rejects its configuration, which cannot happen for a policy
/// that parses.
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
            // Without a fault the run is the same on all axes; only the first axis runs it.
            if axis.is_none(level) && case.axis > 0 {
                return Ok(0);
            }
            let scenario = scenario(axis, level, case.media, case.seed)
                .expect("a test creates every scenario");
            let config = scenario.controller_config()?;
            Ok(apexes(&scenario, WireController::new(policy.clone(), config)))
        })
        .collect::<Result<_, ConfigError>>()?;

    let runs = size.runs.max(1) as usize;
    let fell = |apexes: &[u32]| -> Vec<u64> {
        (0..).zip(apexes).filter(|(_, apexes)| **apexes < HOPS).map(|(seed, _)| seed).collect()
    };
    let mut rows: Vec<Row> = cases
        .chunks(runs)
        .zip(hopped.chunks(runs))
        .map(|(cases, apexes)| {
            let axis = &AXES[cases[0].axis];
            let fallen = fell(apexes);
            Row {
                fault: axis.name.into(),
                level: axis.levels[cases[0].level],
                media: cases[0].media,
                runs: size.runs,
                hopping: size.runs - fallen.len() as u64,
                fallen: Some(fallen),
            }
        })
        .collect();
    for &media in &size.media {
        let none = rows.iter().find(|row| row.media == media && row.is_none());
        let Some(none) = none.cloned() else { continue };
        for row in rows.iter_mut().filter(|row| row.media == media && row.is_none()) {
            row.hopping = none.hopping;
            row.fallen.clone_from(&none.fallen);
        }
    }
    let policy = policy.manifest().name.to_owned();
    Ok(Report { policy, hops: HOPS, runs: size.runs, rows, against: None })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::SensorProfile;

    #[test]
    fn every_scenario_of_the_sweep_is_valid() {
        for axis in &AXES {
            let none = axis.none.is_none_or(|none| axis.levels.contains(&none));
            assert!(none && axis.levels.is_sorted(), "{}", axis.name);
            for &level in axis.levels {
                for media in [Media::Water, Media::Shore, Media::Land] {
                    let scenario = scenario(axis, level, media, 3).unwrap();
                    let is_usual = scenario.faults.is_empty()
                        && scenario.sensor_profile == SensorProfile::Ideal;
                    assert_eq!(is_usual, axis.is_none(level), "{}", axis.name);
                    scenario.controller_config().unwrap();
                }
            }
        }
    }

    #[test]
    fn the_controller_is_not_told_a_level_of_its_sensors() {
        let axis = AXES.iter().find(|axis| axis.name == "acceleration-bias").unwrap();
        let [low, high] = [0.0, 5.0].map(|level| scenario(axis, level, Media::Land, 3).unwrap());
        assert_ne!(low.sensors, high.sensors);
        assert!(low.estimator.is_some() && low.estimator == high.estimator);
    }
}
