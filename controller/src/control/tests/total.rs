//! Whatever comes in, what goes out is finite and in range.

use super::*;
use crate::estimator::{SensorNoise, StateNoise};
use crate::measurement::{Aged, LegPosture, SpecificImpulse};
use core::cell::Cell;
use core::f32::consts::PI;
use proptest::test_runner::TestRunner;

/// Values at which floats go wrong: zeros of both signs, subnormals, numbers whose
/// squares vanish or overflow, the limits and their neighbours.
const EDGES: [f32; 24] = [
    0.0,
    -0.0,
    1e-45,
    -1e-45,
    f32::MIN_POSITIVE,
    -f32::MIN_POSITIVE,
    1e-30,
    -1e-30,
    1e-19,
    8.742_278_4e-5,
    1e-3,
    0.98,
    1.0,
    1.000_000_1,
    -1.0,
    2.0,
    49.999_996,
    50.0,
    -50.0,
    99.999_99,
    100.0,
    f32::MAX,
    f32::NEG_INFINITY,
    f32::NAN,
];

fn any_float() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => prop::sample::select(&EDGES[..]),
        4 => -3.0_f32..3.0,
        1 => any::<u32>().prop_map(f32::from_bits),
    ]
}

/// As [`any_float`], but mostly what the guard lets through, so that runs get far.
fn mostly_good(low: f32, high: f32) -> impl Strategy<Value = f32> {
    let edges: Vec<f32> = EDGES.into_iter().filter(|x| (low..=high).contains(x)).collect();
    prop_oneof![
        12 => prop::sample::select(edges),
        12 => low..=high,
        8 => low.max(-2.0)..=high.min(2.0),
        1 => any_float(),
    ]
}

/// A measurement, or none, and the time since the one before, ns.
fn any_measurement() -> impl Strategy<Value = (Option<Measurement>, u64)> {
    let contact = prop_oneof![
        any::<bool>().prop_map(Contact::Sensed),
        mostly_good(0.0, 10.0).prop_map(Contact::LegLength),
    ];
    let density = prop::option::weighted(0.3, mostly_good(0.0, 2.0));
    let step_ns = prop_oneof![8 => Just(1_000_000_u64), 1 => Just(1), 1 => 0_u64..40_000_000];
    let motion = (mostly_good(-50.0, 50.0), mostly_good(0.0, 100.0), mostly_good(-50.0, 50.0));
    let measurement = (motion, contact, density, any_sensors()).prop_map(
        |((vx_m_s, y_m, vy_m_s), contact, density_ratio, sensors)| Measurement {
            t_ns: 0,
            vx_m_s,
            y_m,
            vy_m_s,
            contact,
            density_ratio,
            sensors,
        },
    );
    (prop::option::weighted(0.95, measurement), step_ns)
}

/// Readings of raw sensors, each of which may be missing.
fn any_sensors() -> impl Strategy<Value = Sensors> {
    fn often<T: Strategy>(reading: T) -> impl Strategy<Value = Option<T::Value>> {
        prop::option::weighted(0.8, reading)
    }
    fn seldom<T: Strategy>(
        reading: T,
    ) -> impl Strategy<Value = Option<Aged<<T as Strategy>::Value>>>
    where
        T::Value: Copy + core::fmt::Debug,
    {
        let aged = (reading, prop_oneof![0..300_000_000_u32, any::<u32>()]);
        prop::option::weighted(0.1, aged.prop_map(|(value, age_ns)| Aged { value, age_ns }))
    }
    let impulse = prop_oneof![
        8 => [0..2_000_i32, 0..2_000_i32],
        1 => [any::<i32>(), any::<i32>()],
    ];
    let posture = (mostly_good(0.5, 1.2), mostly_good(0.0, PI))
        .prop_map(|(length_m, angle_rad)| LegPosture { length_m, angle_rad });
    let fast = (often(impulse), often(mostly_good(-1.6, 1.6)), often(any_float()), often(posture));
    let speed = || mostly_good(-50.0, 50.0);
    let slow = (seldom([speed(), speed()]), seldom(mostly_good(0.0, 100.0)), seldom(any_float()));
    (fast, slow).prop_map(|((impulse, pitch_rad, pitch_rate_rad_s, posture), slow)| {
        let (velocity_m_s, height_m, pressure_pa) = slow;
        let impulse = impulse.map(SpecificImpulse);
        let fast = Sensors { impulse, pitch_rad, pitch_rate_rad_s, posture, ..Sensors::default() };
        Sensors { velocity_m_s, height_m, pressure_pa, ..fast }
    })
}

/// A configuration for each source of the state.
fn configs() -> [Config; 3] {
    let config = Config::at_rate(1_000).unwrap();
    let with = |estimation| config.with_estimation(estimation).unwrap();
    [
        config,
        with(Estimation::StateChannels(StateNoise::default())),
        with(Estimation::Inertial(SensorNoise::default())),
    ]
}

/// Plays steps to a controller and checks every output; returns how many measurements
/// were used.
fn play(
    mut controller: Controller<'_>,
    steps: &[(Option<Measurement>, u64)],
    set_points: &[f32],
    check: impl Fn(&Output),
) -> usize {
    let (mut t_ns, mut used) = (0_u64, 0);
    for ((measurement, step_ns), set_point) in steps.iter().zip(set_points.iter().cycle()) {
        t_ns += step_ns;
        let measurement = measurement.map(|m| Measurement { t_ns, ..m });
        let output = controller.step(measurement.as_ref(), *set_point);
        let LegCommand { leg_angle_rad, elongation_m, elongation_rate_m_s } = output.command;
        let Telemetry { apex_vx_m_s, apex_y_m, density_ratio, velocity_offset_m_s, .. } =
            output.telemetry;
        let values = [
            leg_angle_rad,
            elongation_m,
            elongation_rate_m_s,
            apex_vx_m_s,
            apex_y_m,
            density_ratio.unwrap_or(0.0),
            velocity_offset_m_s,
            controller.set_point_m_s(),
        ];
        assert!(values.iter().all(|x| x.is_finite()), "{output:?} after {measurement:?}");
        assert!((0.0..=PI).contains(&leg_angle_rad), "{output:?}");
        check(&output);
        used += usize::from(output.rejected.is_none());
    }
    used
}

/// The measurement of finite values inside all limits with which the command was once
/// NaN: the mass at height 0 right over the foot, in the second tick after an upright
/// touchdown.
#[test]
fn a_mass_on_its_foot_has_a_command() {
    let policy = Policy::parse(crate::policy::SHIPPED).unwrap();
    for vx_m_s in [8.742_278_4e-5, 0.0, -0.0, 1e-30, -1e-30] {
        for y_m in [0.0, -0.0, 1e-45, 1e-30] {
            let mut controller = Controller::new(policy.clone(), Config::at_rate(1_000).unwrap());
            for tick in 0..40 {
                let falls = Measurement { vx_m_s: 0.0, ..falling(tick, 2.0) };
                controller.step(Some(&falls), 0.0);
            }
            for tick in 40..60 {
                let contact = Contact::Sensed(true);
                let lands = Measurement { vx_m_s, y_m, contact, ..falling(tick, 2.0) };
                let command = controller.step(Some(&lands), 0.0).command;
                assert!(command.is_valid(), "{command:?} for vx {vx_m_s:e}, y {y_m:e}");
            }
        }
    }
}

#[test]
fn any_run_of_measurements_gives_commands_in_range() {
    let (used, steps) = (Cell::new(0), Cell::new(0));
    let strategy = (
        prop::collection::vec(any_measurement(), 1..120),
        prop::collection::vec(any_float(), 1..5),
    );
    TestRunner::new(ProptestConfig::with_cases(4_000))
        .run(&strategy, |(run, set_points)| {
            let bytes = Bytes::new(&blob_of(&manifest()).unwrap());
            for config in configs() {
                steps.set(steps.get() + run.len());
                let controller = Controller::new(Policy::parse(bytes.get()).unwrap(), config);
                let played = play(controller, &run, &set_points, |output| {
                    let c = output.command;
                    assert!(c.elongation_m <= 0.2, "{c:?}");
                    assert!((0.0..=2.0).contains(&c.elongation_rate_m_s), "{c:?}");
                });
                used.set(used.get() + played);
            }
            Ok(())
        })
        .unwrap();
    let (used, steps) = (used.get(), steps.get());
    assert!(used > steps / 4 && used < steps, "{used} of {steps} measurements were used");
}

/// Parameters of any size: every policy that parses gives commands in range.
#[test]
fn any_policy_that_parses_gives_commands_in_range() {
    let (parsed, tried) = (Cell::new(0), Cell::new(0));
    let strategy = (
        prop::array::uniform6(prop_oneof![1 => any::<f32>(), 2 => -10.0_f32..10.0]),
        (0.0_f32..3.0, 0.0_f32..0.14, 0.0_f32..50.0, 0.0_f32..50.0),
        prop::array::uniform5(-1e3_f32..1e3),
        prop::array::uniform3(prop_oneof![0.0_f32..1e9, 0.0_f32..2.0]),
        prop::collection::vec(any_measurement(), 1..60),
        prop::collection::vec(any_float(), 1..5),
    );
    TestRunner::new(ProptestConfig::with_cases(1_000))
        .run(&strategy, |(scale, clip, gains, lengths, run, set_points)| {
            let mut manifest = manifest();
            manifest.observation.scale = [scale[0], scale[1], scale[2]];
            manifest.observation.offset[0] = scale[3];
            manifest.action.scale = [scale[4], scale[5]];
            manifest.action.low = [clip.0, clip.2];
            manifest.action.high = [clip.0 + clip.1, clip.2 + clip.3];
            manifest.leg.rest_length_m = lengths[0] + 1e-6;
            manifest.leg.max_elongation_m = lengths[1];
            manifest.leg.volume_m3 = lengths[2] + 1e-6;
            manifest.gains[0] = GainPoint {
                density_ratio: 0.0,
                kp: gains[0],
                ki: gains[1],
                kd: gains[2],
                feed_forward: gains[3],
                limit_m_s: gains[4].abs() * 0.1,
            };
            tried.set(tried.get() + 1);
            let Ok(blob) = blob_of(&manifest) else { return Ok(()) };
            parsed.set(parsed.get() + 1);
            let bytes = Bytes::new(&blob);
            for config in configs() {
                let controller = Controller::new(Policy::parse(bytes.get()).unwrap(), config);
                play(controller, &run, &set_points, |output| {
                    assert!(output.telemetry.velocity_offset_m_s.abs() <= 100.0);
                });
            }
            Ok(())
        })
        .unwrap();
    let (parsed, tried) = (parsed.get(), tried.get());
    assert!(parsed > tried / 2, "{parsed} of {tried} policies parse");
}

/// Hours of falling, of hopping on the spot with contact that says nothing, of values at
/// the limits: an estimator that runs for long stays finite.
#[test]
fn a_long_run_of_an_estimator_gives_commands_in_range() {
    let policy = Policy::parse(crate::policy::SHIPPED).unwrap();
    let [_, state, inertial] = configs();
    let at = |tick: u64| tick as f32;
    let motions: [&dyn Fn(u64) -> [f32; 3]; 5] = [
        &|_| [0.0; 3],
        &|tick| [50.0, 100.0, if tick % 2 == 0 { 50.0 } else { -50.0 }],
        &|tick| [50.0 * (0.1 * at(tick)).sin(), 2.0, 3.0 * (7.0 * at(tick)).sin()],
        &|tick| [0.5, 2.0, -9.0 * 1e-3 * at(tick % 400)],
        &|tick| [at(tick % 100) - 50.0, at(tick % 200) - 100.0, 0.02],
    ];
    let runs = [state, inertial].into_iter().flat_map(|config| {
        motions.into_iter().enumerate().map(move |(kind, motion)| (config, kind, motion))
    });
    for (config, kind, motion) in runs {
        let mut controller = Controller::new(policy.clone(), config);
        for tick in 0..200_000_u64 {
            let [vx_m_s, y_m, vy_m_s] = motion(tick);
            let contact = Contact::Sensed(tick % 700 > 500);
            let m = Measurement {
                t_ns: tick * 1_000_000,
                vx_m_s,
                y_m,
                vy_m_s,
                contact,
                density_ratio: None,
                sensors: Sensors {
                    impulse: Some(SpecificImpulse([vx_m_s, vy_m_s].map(|v| (65_536.0 * v) as i32))),
                    posture: Some(LegPosture { length_m: y_m.abs().min(1.0), angle_rad: 1.5 }),
                    ..Sensors::default()
                },
            };
            let command = controller.step(Some(&m), 0.5).command;
            assert!(command.is_valid(), "{command:?} in tick {tick} of kind {kind}");
            let Some(e) = controller.estimate() else { continue };
            let variances = [e.vx_variance, e.y_variance, e.vy_variance, e.density_variance];
            assert!(variances.iter().all(|x| (0.0..1e6).contains(x)), "{e:?}, kind {kind}");
        }
    }
}

proptest! {
    #[test]
    fn the_same_measurements_give_the_same_bits(
        run in prop::collection::vec(any_measurement(), 1..80)
    ) {
        let outputs = || {
            let bytes = Bytes::new(&blob_of(&manifest()).unwrap());
            let mut outputs = Vec::new();
            for config in configs() {
                let mut controller = Controller::new(Policy::parse(bytes.get()).unwrap(), config);
                let mut t_ns = 0;
                for (measurement, step_ns) in &run {
                    t_ns += step_ns;
                    let measurement = measurement.map(|m| Measurement { t_ns, ..m });
                    outputs.push(controller.step(measurement.as_ref(), 0.5));
                }
            }
            outputs
        };
        prop_assert_eq!(outputs(), outputs());
    }
}
