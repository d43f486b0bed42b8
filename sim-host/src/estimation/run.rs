//! The runs of the study.

use std::time::Duration;

use leg_control::config::{Config, ConfigError, Estimation};
use leg_control::policy::Policy;
use leg_control::wire_controller::WireController;
use leg_host::Link;
use leg_plant::{Body, EventKind, Phase};
use rayon::prelude::*;

use super::cases::Case;
use super::report::{Report, Row};
use crate::faults::stage::SteppedLink;
use crate::robustness::Media;
use crate::scenario::{BadValue, Scenario, Settings};
use crate::session::{Leg, TickRecord};

/// Longest run, s for each hop. A hop takes a second on land, two in water, and nine in water
/// for a leg that is hardly heavier than the water it displaces.
const S_PER_HOP: f64 = 13.0;
/// Hops before the errors count.
const SETTLED_AFTER: usize = 5;

/// Size of the study.
#[derive(Clone, Debug)]
pub struct Size {
    /// Number of runs of each case in each medium, each from another start.
    pub runs: u64,
    /// Media of the runs.
    pub media: Vec<Media>,
    /// Whether the control law has the estimator for its sensors, or takes the readings for the
    /// state.
    pub estimates: bool,
}

/// What one run has shown.
#[derive(Clone, Debug, Default)]
pub(super) struct Played {
    pub(super) apexes: u32,
    /// Distance of the velocity at each apex from the set-point, m/s.
    pub(super) tracking_m_s: Vec<f64>,
    /// Error of the velocity, m/s, the height, m, and the density ratio at each decision.
    pub(super) errors: Vec<[f64; 3]>,
    /// Apexes for which there was another number of decisions than one.
    pub(super) miscounted: u32,
    /// Sum of the squares of the innovations in flight, and their number.
    pub(super) innovations: [f64; 2],
    /// Sum of the squares of the errors of vx, y, vy and density in flight over their
    /// variances.
    pub(super) errors_squared: [f64; 4],
    /// The squares at the apex in the middle of the run: one draw of each run, for those of a run
    /// depend on each other.
    pub(super) middle: Option<[f64; 4]>,
}

/// An apex as it was.
#[derive(Clone, Copy, Debug)]
struct Apex {
    t_s: f64,
    vx_m_s: f64,
    y_m: f64,
    density_ratio: f64,
    decisions: u32,
}

fn scenario(case: &Case, media: Media, seed: u64) -> Result<Scenario, BadValue> {
    let mut settings = Settings {
        duration_s: Some(S_PER_HOP * f64::from(case.hops)),
        seed: Some(seed),
        density_profile: Some(media.density_profile()),
        set_point_m_s: Some(case.set_point_m_s),
        sensors: Some(case.sensors),
        sensor_figures: case.sensor_settings(),
        faults: case.settings(),
        ..Settings::default()
    };
    settings.start.vx_spread_m_s = Some(0.5);
    settings.start.y_spread_m = Some(0.5);
    let mut scenario = Scenario::from_settings(&settings)?;
    scenario.stale_limit_ns = 1_000_000 * case.stale_limit_ms;
    Ok(scenario)
}

/// Plays a run until the leg falls or has passed the hops of its case.
pub(super) fn play(
    policy: &Policy<'_>,
    case: &Case,
    media: Media,
    seed: u64,
    estimates: bool,
) -> Result<Played, ConfigError> {
    let scenario = scenario(case, media, seed).expect("a test creates every scenario");
    let estimation =
        if estimates { scenario.sensors.estimator().try_into()? } else { Estimation::Readings };
    let config = Config::at_rate(scenario.rate_hz)?
        .with_gravity(scenario.controller_gravity_m_s2())?
        .with_stale_limit(scenario.stale_limit_ns)?
        .with_estimation(estimation)?;
    let mut controller = WireController::new(policy.clone(), config);
    let terrain = scenario.faults.terrain();
    let height_m = |body: &Body| {
        body.y_m - terrain.map_or(0.0, |terrain| leg_plant::Ground::height_m(&terrain, body.x_m))
    };
    let mut played = Played::default();
    let estimates = std::cell::Cell::new(None);
    let law = |sample: Option<&_>| {
        let command = controller.tick(sample);
        estimates.set(sample.and_then(|sample| Some((sample.header.seq, controller.estimate()?))));
        command
    };
    let mut link = SteppedLink::new(law, scenario.faults.plan());
    let mut leg = Leg::new(&scenario, 1);
    let start = leg.body();
    let mut apexes = vec![Apex {
        t_s: 0.0,
        vx_m_s: start.vx_m_s,
        y_m: height_m(&start),
        density_ratio: scenario.density.at(start.x_m),
        decisions: 0,
    }];
    let mut decisions = Vec::new();
    let mut decided = 0;
    let mut first_lift_off_s = f64::INFINITY;
    while leg.ending().is_none() && played.apexes < case.hops {
        // Within a thread neither call fails.
        let sent = link.send(leg.sample());
        let command = sent.and_then(|()| link.receive(Duration::ZERO)).unwrap_or(None);
        if let Some(command) = command.filter(|command| command.apexes > decided) {
            decided = command.apexes;
            let known = [command.apex_vx_m_s, command.apex_y_m, command.density_ratio];
            decisions.push((1e-9 * command.header.t_ns as f64, known.map(f64::from)));
        }
        leg.step(command, Duration::ZERO, &mut |tick: &TickRecord| {
            let estimate = estimates.take().filter(|&(seq, _)| seq == tick.seq);
            let mut squares = None;
            if let Some((_, estimate)) = estimate
                && tick.phase == Phase::Flight
                && !estimate.in_stance
            {
                played.innovations[0] += f64::from(estimate.innovation).powi(2);
                played.innovations[1] += 1.0;
                let density_ratio = tick.medium.density_ratio();
                let of = |known: f32, truth: f64, variance: f32| {
                    (f64::from(known) - truth).powi(2) / f64::from(variance)
                };
                let e = estimate;
                let now = [
                    of(e.vx_m_s, tick.body.vx_m_s, e.vx_variance),
                    of(e.y_m, height_m(&tick.body), e.y_variance),
                    of(e.vy_m_s, tick.body.vy_m_s, e.vy_variance),
                    of(e.density_ratio, density_ratio, e.density_variance),
                ];
                for (sum, square) in played.errors_squared.iter_mut().zip(now) {
                    *sum += square;
                }
                squares = Some(now);
            }
            for event in tick.events.iter() {
                if event.kind == EventKind::LiftOff {
                    first_lift_off_s = first_lift_off_s.min(tick.t_s + event.t_s);
                }
                if event.kind != EventKind::Apex {
                    continue;
                }
                played.apexes += 1;
                if played.apexes == case.hops / 2 {
                    played.middle = squares;
                }
                played.tracking_m_s.push((event.body.vx_m_s - case.set_point_m_s).abs());
                apexes.push(Apex {
                    t_s: tick.t_s + event.t_s,
                    vx_m_s: event.body.vx_m_s,
                    y_m: height_m(&event.body),
                    density_ratio: tick.medium.density_ratio(),
                    decisions: 0,
                });
            }
        });
    }
    compare(&mut played, &mut apexes, first_lift_off_s, &decisions);
    Ok(played)
}

/// Compares each decision with the apex that is nearest in time; those before the first lift-off
/// with the start.
fn compare(
    played: &mut Played,
    apexes: &mut [Apex],
    first_lift_off_s: f64,
    decisions: &[(f64, [f64; 3])],
) {
    for &(t_s, [vx_m_s, y_m, density_ratio]) in decisions {
        let after = apexes.partition_point(|apex| apex.t_s < t_s);
        let near = [after.saturating_sub(1), after.min(apexes.len() - 1)];
        let off = |&i: &usize| (apexes[i].t_s - t_s).abs();
        let nearest = if off(&near[0]) <= off(&near[1]) { near[0] } else { near[1] };
        let i = if t_s < first_lift_off_s { 0 } else { nearest };
        let apex = &mut apexes[i];
        apex.decisions += 1;
        if i >= SETTLED_AFTER {
            let error = [vx_m_s - apex.vx_m_s, y_m - apex.y_m, density_ratio - apex.density_ratio];
            played.errors.push(error);
        }
    }
    // The start may be no apex, and the last apex may not be decided yet.
    let inner = apexes.get(1..apexes.len() - 1).unwrap_or_default();
    played.miscounted = inner.iter().filter(|apex| apex.decisions != 1).count() as u32;
}

/// Plays every case in every medium, on the threads of the current rayon pool. The result
/// depends only on policy, cases and size.
///
/// # Errors
/// Returns an error if the controller rejects its configuration.
pub fn study(policy: &Policy<'_>, cases: &[Case], size: &Size) -> Result<Report, ConfigError> {
    let rows: Vec<(&Case, Media)> = cases
        .iter()
        .flat_map(|case| size.media.iter().map(move |&media| (case, media)))
        .filter(|(case, media)| case.is_in(*media))
        .collect();
    let runs: Vec<(usize, u64)> =
        (0..rows.len()).flat_map(|row| (0..size.runs).map(move |seed| (row, seed))).collect();
    let played: Vec<Played> = runs
        .par_iter()
        .map(|&(row, seed)| {
            let (case, media) = rows[row];
            play(policy, case, media, seed, size.estimates)
        })
        .collect::<Result<_, ConfigError>>()?;
    let rows = rows
        .iter()
        .zip(played.chunks(size.runs.max(1) as usize))
        .map(|(&(case, media), played)| Row::of(case, media, played))
        .collect();
    Ok(Report {
        policy: policy.manifest().name.to_owned(),
        estimated: size.estimates,
        runs: size.runs,
        rows,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::CASES;
    use crate::sensors::SensorProfile;
    use leg_control::policy::SHIPPED;
    use leg_process::policy_file::AlignedBytes;

    const MEDIA: [Media; 3] = [Media::Water, Media::Shore, Media::Land];

    fn report(cases: &[Case], runs: u64, estimates: bool) -> Report {
        let blob: AlignedBytes = SHIPPED.into();
        let policy = Policy::parse(blob.as_slice()).unwrap();
        study(&policy, cases, &Size { runs, media: MEDIA.to_vec(), estimates }).unwrap()
    }

    fn of(name: &str, hops: u32) -> Case {
        Case::named(name).unwrap().with_hops(hops)
    }

    #[test]
    fn every_case_is_valid_and_named_once() {
        for case in &CASES {
            assert_eq!(Case::named(case.name), Some(case), "two are called {}", case.name);
            for media in MEDIA {
                let scenario = scenario(case, media, 3).unwrap();
                let is_ideal = case.sensors == SensorProfile::Ideal && scenario.faults.is_empty();
                assert_eq!(is_ideal, case.name == "ideal");
            }
        }
    }

    #[test]
    fn the_leg_hops_on_under_noise_delay_and_loss_with_the_estimator_and_falls_without() {
        let cases = [of("white-1", 12), of("at-once", 12), of("late-300", 8), of("lost-90", 12)];
        for row in report(&cases, 2, true).rows {
            assert_eq!(row.hopping, row.runs, "{row:?}");
            // An early decision can come before the apex that ends the run.
            assert!(row.miscounted <= 1, "{row:?}");
        }
        let noisy = &cases[..2];
        let on_land = |row: &Row| row.media == Media::Land;
        for row in report(noisy, 2, false).rows.into_iter().filter(on_land) {
            assert_eq!(row.hopping, 0, "{row:?}");
        }
    }

    #[test]
    fn without_noise_the_leg_tracks_the_set_point_as_well_as_by_its_readings() {
        let ideal = [*Case::named("ideal").unwrap()];
        let by = |estimates| report(&ideal, 6, estimates).rows;
        for (estimate, readings) in by(true).iter().zip(by(false)) {
            assert_eq!((estimate.hopping, readings.hopping), (6, 6));
            let (ours, theirs) = (estimate.tracking_m_s, readings.tracking_m_s);
            assert!(ours < 1.02 * theirs, "{ours} m/s, and {theirs} m/s by the readings");
            assert_eq!(estimate.miscounted, 0);
            let [vx, y, density] = estimate.rms;
            assert!(vx < 1e-3 && y < 1e-3 && density < 6e-3, "{:?}", estimate.rms);
        }
    }

    #[test]
    fn a_leg_that_senses_neither_velocity_nor_height_nor_density_hops_on() {
        let cases = [of("imu", 12), of("imu-at-once", 12), of("imu-mass-2", 8)];
        for row in report(&cases, 2, true).rows {
            assert_eq!((row.hopping, row.miscounted), (row.runs, 0), "{row:?}");
            if row.case == "imu" {
                let [vx, y, density] = row.rms;
                assert!(vx < 0.015 && y < 0.04 && density < 0.015, "{row:?}");
                let nis = row.innovations_squared;
                assert!((0.6..1.1).contains(&nis), "{row:?}");
                // Of few flights, of which each has one error.
                assert!(row.errors_squared.iter().all(|&nees| nees < 8.0), "{row:?}");
            }
        }
        // By the readings it never gets an action: no apex is decided.
        for row in report(&cases[..1], 1, false).rows {
            assert!(row.apexes > 2 && row.miscounted + 1 >= row.apexes, "{row:?}");
        }
    }

    /// The errors are as large as the filter says, in every medium: the innovations have
    /// variance 1, and no state is off by more than its variance on average. Process noise
    /// makes the filter more careful than white noise of a known level would need.
    #[test]
    fn the_filter_is_consistent_in_every_medium() {
        for row in report(&[of("white-1", 20), of("white-0.2", 20)], 4, true).rows {
            let nis = row.innovations_squared;
            assert!((0.93..1.07).contains(&nis), "{}, {}: {nis}", row.case, row.media.name());
            for (state, nees) in ["vx", "y", "vy", "density"].iter().zip(row.errors_squared) {
                assert!(
                    (0.1..1.6).contains(&nees),
                    "{}, {}: {state} {nees}",
                    row.case,
                    row.media.name()
                );
            }
        }
    }

    #[test]
    fn the_same_study_gives_the_same_report_on_any_number_of_threads() {
        let cases = [of("white-1", 5)];
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| report(&cases, 3, true))
        };
        assert_eq!(on(1), on(4));
    }
}
