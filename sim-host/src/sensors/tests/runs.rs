//! Sensors of a leg that hops.

use leg_control::config::Config;
use leg_control::measurement::{Contact, SpecificImpulse};
use leg_control::policy::{Policy, SHIPPED};
use leg_control::wire::{Sample, flags};
use leg_control::wire_controller::WireController;
use leg_plant::{Body, Phase};

use super::*;
use crate::faults::FaultSetting;
use crate::scenario::{MediumPreset, Scenario, Settings};
use crate::session::lock_step::Options;
use crate::session::{Leg, Outcome, stepped};

/// A tick of a run: the truth at its start, and the sample.
type Tick = (Body, Phase, Sample);

fn settings(sensors: SensorProfile, figures: &[&str]) -> Settings {
    Settings {
        duration_s: Some(20.0),
        set_point_m_s: Some(0.5),
        sensors: Some(sensors),
        sensor_figures: figures.iter().map(|figure| figure.parse().unwrap()).collect(),
        ..Settings::default()
    }
}

/// Plays a run with the shipped policy. The controller uses the state where it is sensed.
fn play(settings: &Settings) -> (Outcome, Vec<Tick>) {
    let scenario = Scenario::from_settings(settings).unwrap();
    let config = Config::at_rate(scenario.rate_hz).unwrap();
    let mut controller = WireController::new(Policy::parse(SHIPPED).unwrap(), config);
    let mut ticks = Vec::new();
    let law = |sample: Option<&Sample>| controller.tick(sample);
    let outcome = stepped::run(&scenario, law, Options::default(), |tick| {
        ticks.push((tick.body, tick.phase, *tick.sample));
    });
    (outcome.unwrap(), ticks)
}

/// The exact state for the controller, and an inertial sensor without errors beside it.
const EXACT_INERTIAL: [&str; 7] = [
    "accelerometer-rate=20000",
    "accelerometer-noise=0",
    "accelerometer-bias=0",
    "accelerometer-walk=0",
    "accelerometer-scale=0",
    "accelerometer-resolution=0",
    "accelerometer-range=0",
];

#[test]
fn without_errors_the_sum_of_the_accelerometer_is_the_change_of_the_velocity() {
    for medium in [MediumPreset::Water, MediumPreset::Air] {
        let settings =
            Settings { medium: Some(medium), ..settings(SensorProfile::Ideal, &EXACT_INERTIAL) };
        let (outcome, ticks) = play(&settings);
        assert!(outcome.touchdowns > 5, "it hops: {}", outcome.touchdowns);
        let unit = f64::from(SpecificImpulse::UNIT_M_S);
        let (start, _, first) = ticks[0];
        for (seq, (body, _, sample)) in ticks.iter().enumerate() {
            assert!(sample.header.flags & flags::IMPULSE_SENSED != 0);
            let impulse = SpecificImpulse(sample.sensors.impulse);
            let since = SpecificImpulse(first.sensors.impulse);
            let [x, y] = [0, 1].map(|i| unit * f64::from(impulse.0[i].wrapping_sub(since.0[i])));
            let fallen_m_s = 9.81 * 1e-3 * seq as f64;
            let errors =
                [x - (body.vx_m_s - start.vx_m_s), y - (body.vy_m_s - start.vy_m_s + fallen_m_s)];
            // Half a count, at the end of the run as at its start.
            assert!(errors.iter().all(|error| error.abs() < 0.5001 * unit), "{seq}: {errors:?}");
        }
    }
}

#[test]
fn the_encoders_measure_the_leg_in_flight_and_in_stance() {
    let settings =
        settings(SensorProfile::Ideal, &["leg-angle-rate=20000", "leg-length-noise=0.001"]);
    let (_, ticks) = play(&settings);
    let mut lengths = Vec::new();
    let mut stances = 0;
    for (body, phase, sample) in &ticks {
        let has = |flag| sample.header.flags & flag != 0;
        assert!(has(flags::LEG_LENGTH_SENSED) && has(flags::LEG_ANGLE_SENSED));
        let measured = sample.measurement().unwrap().sensors.posture.expect("both encoders");
        if let Phase::Stance { foot_x_m, foot_y_m } = phase {
            stances += 1;
            let [dx, dy] = [body.x_m - foot_x_m, body.y_m - foot_y_m];
            lengths.push(f64::from(measured.length_m) - dx.hypot(dy));
            let error_rad = f64::from(measured.angle_rad) - dy.atan2(dx);
            // Half a step of 14 bit, and the rounding of f32.
            assert!(error_rad.abs() < 0.000_193, "{error_rad}");
        }
    }
    assert!(stances > 2000, "{stances}");
    assert!((deviation(&lengths) - 0.001).abs() < 5e-5 && mean(&lengths).abs() < 1e-4);
}

#[test]
fn imu_senses_no_velocity_height_or_density_and_underwater_adds_two_slow_sensors() {
    let (_, ticks) = play(&settings(SensorProfile::Imu, &[]));
    let inertial = flags::CONTACT_SENSED
        | flags::LEG_LENGTH_SENSED
        | flags::LEG_ANGLE_SENSED
        | flags::IMPULSE_SENSED
        | flags::PITCH_SENSED
        | flags::PITCH_RATE_SENSED;
    assert!(ticks.iter().all(|(_, _, s)| s.header.flags & !flags::IN_CONTACT == inertial));
    let blank = |s: &Sample| [s.vx_m_s, s.y_m, s.vy_m_s, s.density_ratio] == [0.0; 4];
    assert!(ticks.iter().all(|(_, _, s)| blank(s)));
    let water =
        Settings { medium: Some(MediumPreset::Water), ..settings(SensorProfile::Underwater, &[]) };
    let (_, ticks) = play(&water);
    let count = |flag| ticks.iter().filter(|(_, _, s)| s.header.flags & flag == flag).count();
    assert_eq!(count(inertial), ticks.len());
    let (velocities, pressures) = (count(flags::VELOCITY_SENSED), count(flags::PRESSURE_SENSED));
    // 10 and 50 a second for 20 s, of the first 2 % lost.
    assert!((180..=200).contains(&velocities) && (995..=1000).contains(&pressures));
    assert_eq!(count(flags::HEIGHT_SENSED) + count(flags::VX_SENSED), 0);
}

#[test]
fn the_pressure_is_that_of_the_water_above() {
    let exact = [
        "pressure-rate=20000",
        "pressure-latency=0",
        "pressure-noise=0",
        "pressure-bias=0",
        "pressure-walk=0",
        "pressure-resolution=0",
        "pressure-surface=4",
    ];
    let water =
        Settings { medium: Some(MediumPreset::Water), ..settings(SensorProfile::Ideal, &exact) };
    let (_, ticks) = play(&water);
    for (body, _, sample) in ticks {
        let expected_pa = 101_325.0 + 9810.0 * (4.0 - body.y_m);
        let error_pa = f64::from(sample.sensors.pressure_pa) - expected_pa;
        assert!(error_pa.abs() < 0.01, "{error_pa}");
    }
}

#[test]
fn acoustic_sensors_read_only_in_water() {
    let land = ["height-rate=10"];
    let (_, ticks) = play(&settings(SensorProfile::Underwater, &land));
    let count = |flag| ticks.iter().filter(|(_, _, s)| s.header.flags & flag == flag).count();
    assert_eq!(count(flags::VELOCITY_SENSED) + count(flags::HEIGHT_SENSED), 0);
    // 50 a second, of which the last may be under way.
    let pressures = ticks.len() / 20;
    assert!(pressures > 400 && count(flags::PRESSURE_SENSED) >= pressures - 1, "everywhere");
}

#[test]
fn a_restart_drops_readings_under_way_and_is_no_acceleration() {
    let figures = [&EXACT_INERTIAL[..], &["state-latency=0.02", "contact-latency=0.5"]].concat();
    let scenario = Scenario::from_settings(&settings(SensorProfile::Ideal, &figures)).unwrap();
    let mut leg = Leg::new(&scenario, 1);
    let step = |leg: &mut Leg<'_>| leg.step(None, std::time::Duration::ZERO, &mut |_| ());
    while !matches!(leg.sample().measurement().unwrap().contact, Contact::Sensed(true)) {
        step(&mut leg);
    }
    let before = leg.sample().sensors.impulse;
    leg.restart(2);
    let sample = *leg.sample();
    assert_eq!((sample.sensors.impulse, sample.header.seq), (before, 0));
    assert!(!sample.is_in_contact());
    assert_eq!(sample.header.flags & flags::STATE_SENSED, 0);
    for _ in 0..20 {
        step(&mut leg);
    }
    assert_eq!(leg.sample().y_m, scenario.start.y_m as f32, "20 ms late");
}

#[test]
fn a_new_set_point_reads_no_sensor_again() {
    let scenario = Scenario::from_settings(&settings(SensorProfile::Imu, &[])).unwrap();
    let mut leg = Leg::new(&scenario, 1);
    leg.step(None, std::time::Duration::ZERO, &mut |_| ());
    let before = *leg.sample();
    leg.override_set_point(Some(0.25));
    assert_eq!(*leg.sample(), Sample { set_point_m_s: 0.25, ..before });
}

#[test]
fn trained_with_blurs_the_state_and_sends_each_sample_late_with_its_stamp() {
    let (_, ticks) = play(&settings(SensorProfile::TrainedWith, &[]));
    assert!(ticks[..20].iter().all(|(_, _, s)| s.measurement().is_none()));
    let mut errors = Vec::new();
    for (tick, ((body, phase, _), (_, _, sample))) in ticks.iter().zip(&ticks[20..]).enumerate() {
        let header = sample.header;
        assert_eq!((header.seq, header.t_ns), (tick as u64 + 20, 1_000_000 * tick as u64));
        assert_eq!(header.flags & flags::STATE_SENSED, flags::STATE_SENSED);
        assert_eq!(sample.is_in_contact(), matches!(phase, Phase::Stance { .. }));
        errors.push(f64::from(sample.vx_m_s) - body.vx_m_s);
        errors.push(f64::from(sample.y_m) - body.y_m);
        errors.push(f64::from(sample.vy_m_s) - body.vy_m_s);
    }
    assert!(errors.iter().all(|error| error.abs() < 0.100_001), "20 ms before");
    assert!((deviation(&errors) - 0.1 / 3_f64.sqrt()).abs() < 0.001, "{}", deviation(&errors));
}

#[test]
fn the_seed_decides_the_readings_and_the_sensors_not_the_faults() {
    let samples = |seed| {
        let settings = Settings { seed: Some(seed), ..settings(SensorProfile::Underwater, &[]) };
        play(&settings).1.into_iter().map(|(_, _, sample)| sample).collect::<Vec<_>>()
    };
    assert_eq!(samples(3), samples(3));
    assert_ne!(samples(3), samples(4));
    // A fault draws the same beside other sensors: here the run is the same as well.
    let noisy = |figures: &[&str]| {
        let mut settings = settings(SensorProfile::Ideal, figures);
        settings.faults = vec!["noise=0.01,field=vx".parse::<FaultSetting>().unwrap()];
        play(&settings).0.state_hash
    };
    assert_eq!(noisy(&[]), noisy(&["accelerometer-rate=1600", "gyro-rate=100"]));
}
