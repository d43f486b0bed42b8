//! The control law on an estimate.

use super::*;
use crate::estimator::{SensorNoise, StateNoise};
use crate::guard::Limits;
use crate::measurement::{LegPosture, SpecificImpulse};

fn config() -> Config {
    let noise = Estimation::StateChannels(StateNoise::default());
    Config::at_rate(1_000).unwrap().with_estimation(noise).unwrap()
}

fn controller() -> Controller<'static> {
    Controller::new(Policy::parse(crate::policy::SHIPPED).unwrap(), config())
}

/// Ticks of one hop of [`bouncing`].
const HOP_TICKS: u64 = 1_050;

/// A leg that hops on land as if on rails: from an apex of 2 m down to 1 m, 0.1 s of stance,
/// and up again.
fn bouncing(tick: u64) -> Measurement {
    let ay = 80.0 / 88.0 * 9.81_f32;
    let fall_s = libm::sqrtf(2.0 / ay);
    let t = 1e-3 * f32::from((tick % HOP_TICKS) as u16);
    let stance_s = 1e-3 * HOP_TICKS as f32 - 2.0 * fall_s;
    let into = t - fall_s;
    let (y_m, vy_m_s) = if into < 0.0 {
        (2.0 - 0.5 * ay * t * t, -ay * t)
    } else if into < stance_s {
        // Half a sine, of the speed of the fall at both ends.
        let phase = core::f32::consts::PI * into / stance_s;
        let depth_m = ay * fall_s * stance_s / core::f32::consts::PI;
        (1.0 - depth_m * phase.sin(), -ay * fall_s * phase.cos())
    } else {
        let left = 1e-3 * HOP_TICKS as f32 - t;
        (2.0 - 0.5 * ay * left * left, ay * left)
    };
    Measurement {
        t_ns: tick * 1_000_000,
        vx_m_s: 0.4,
        y_m,
        vy_m_s,
        contact: Contact::Sensed((0.0..stance_s).contains(&into)),
        density_ratio: None,
        sensors: Sensors::default(),
    }
}

/// A number from -1 to 1 that looks random.
fn jumping(tick: u64, of: u64) -> f32 {
    let bits = (tick * 3 + of).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let bits = (bits ^ (bits >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40;
    bits as f32 / (1 << 23) as f32 - 1.0
}

fn noisy(tick: u64, most: f32) -> Measurement {
    let m = bouncing(tick);
    Measurement {
        vx_m_s: m.vx_m_s + most * jumping(tick, 0),
        y_m: m.y_m + most * jumping(tick, 1),
        vy_m_s: m.vy_m_s + most * jumping(tick, 2),
        ..m
    }
}

#[test]
fn each_hop_has_one_decision_whatever_the_noise() {
    for most in [0.0, 0.1, 1.0, 3.0] {
        let mut controller = controller();
        let mut counts = Vec::new();
        for tick in 0..8 * HOP_TICKS {
            let telemetry = controller.step(Some(&noisy(tick, most)), 0.5).telemetry;
            if tick % HOP_TICKS == HOP_TICKS / 2 + 100 {
                counts.push(telemetry.apexes);
            }
            if tick > 2 * HOP_TICKS {
                assert!((telemetry.apex_y_m - 2.0).abs() < 0.25 * most + 0.01, "{telemetry:?}");
                assert!((telemetry.apex_vx_m_s - 0.4).abs() < 0.25 * most + 0.01, "{telemetry:?}");
            }
        }
        let first = counts[0];
        assert!(first <= 1, "{counts:?}");
        let expected: Vec<u32> = (0..8).map(|hop| first + hop).collect();
        assert_eq!(counts, expected, "at noise of {most}");
    }
}

#[test]
fn a_height_below_the_ground_costs_no_measurement() {
    let mut controller = controller();
    for tick in 0..3 * HOP_TICKS {
        let m = Measurement { y_m: bouncing(tick).y_m + 4.0 * jumping(tick, 1), ..bouncing(tick) };
        let output = controller.step(Some(&m), 0.5);
        assert_eq!(output.rejected, None, "{m:?}");
    }
    assert_eq!(controller.counts().rejected(), 0);
    assert!((controller.telemetry().apex_y_m - 2.0).abs() < 0.5, "{:?}", controller.telemetry());
}

#[test]
fn a_reading_that_is_not_finite_or_absurd_leaves_the_others_in_force() {
    let change: [&dyn Fn(&mut Measurement); 5] = [
        &|m| m.vx_m_s = f32::NAN,
        &|m| m.y_m = f32::INFINITY,
        &|m| m.vy_m_s = 1e9,
        &|m| m.contact = Contact::LegLength(f32::NAN),
        &|m| m.density_ratio = Some(-3.0),
    ];
    for (i, change) in change.into_iter().enumerate() {
        let mut controller = controller();
        for tick in 0..3 * HOP_TICKS {
            let mut m = bouncing(tick);
            // Never three good ones lost: a tenth of the readings of one kind.
            if tick > 20 && tick % 10 == 3 {
                change(&mut m);
            }
            let output = controller.step(Some(&m), 0.5);
            assert_eq!(output.rejected, None, "change {i}");
            assert!(tick < 50 || !output.status.is_safe(), "change {i} in {tick}");
        }
        assert!(controller.counts().used_in_part > 200, "change {i}");
        assert!((controller.telemetry().apex_y_m - 2.0).abs() < 0.05, "change {i}");
        assert_eq!(controller.telemetry().apexes, 3, "change {i}");
    }
}

#[test]
fn a_channel_that_dies_ends_in_the_safe_state_and_its_return_in_a_new_start() {
    let mut controller = controller();
    let died = HOP_TICKS + 200;
    let mut safe_at = None;
    for tick in 0..died + 100 {
        let mut m = bouncing(tick);
        if tick >= died {
            m.vy_m_s = f32::NAN;
        }
        let output = controller.step(Some(&m), 0.5);
        if tick >= died && output.status.is_safe() && safe_at.is_none() {
            safe_at = Some(tick - died);
            assert_eq!(output.command, LegCommand::SAFE);
        }
        assert!(safe_at.is_none() || output.status.is_safe());
    }
    // The stale limit is 10 ms.
    assert!(safe_at.is_some_and(|ticks| (9..=11).contains(&ticks)), "{safe_at:?}");
    let back = (died + 100..died + 2_000)
        .find(|&tick| !controller.step(Some(&bouncing(tick)), 0.5).status.is_safe());
    assert!(back.is_some());
}

#[test]
fn wrong_contact_readings_make_no_stance() {
    let mut controller = controller();
    for tick in 0..4 * HOP_TICKS {
        let Measurement { contact, .. } = bouncing(tick);
        let is_wrong = jumping(tick, 5) > 0.9;
        let contact = Contact::Sensed((contact == Contact::Sensed(true)) != is_wrong);
        controller.step(Some(&Measurement { contact, ..bouncing(tick) }), 0.5);
        let Some(estimate) = controller.estimate() else { continue };
        let from_edge = [473, 577].map(|edge: u64| (tick % HOP_TICKS).abs_diff(edge));
        if from_edge.iter().all(|&ticks| ticks > 12) {
            let Contact::Sensed(truth) = bouncing(tick).contact else { unreachable!() };
            assert_eq!(estimate.in_stance, truth, "tick {tick}");
        }
    }
    assert_eq!(controller.telemetry().apexes, 4);
}

/// An action for this hop is there long before its apex: a command that takes a second of
/// the flight to the leg is in time.
#[test]
fn the_action_follows_the_set_point_from_soon_after_lift_off_on() {
    let angle_after = |set_point: f32, ticks: u64| {
        let mut controller = controller();
        let lift_off = 2 * HOP_TICKS + 577;
        for tick in 0..lift_off {
            controller.step(Some(&bouncing(tick)), 0.5);
        }
        let last = lift_off + ticks;
        for tick in lift_off..last {
            controller.step(Some(&bouncing(tick)), set_point);
        }
        controller.step(Some(&bouncing(last)), set_point).command.leg_angle_rad
    };
    assert_eq!(angle_after(0.5, 10), angle_after(-0.5, 10), "the action of the hop before");
    assert!((angle_after(0.5, 30) - angle_after(-0.5, 30)).abs() > 0.02);
}

/// Contact is proven by its fourth reading only, but the ramp begins with the first.
#[test]
fn the_ramp_of_the_elongation_goes_on_while_the_touchdown_is_being_proven() {
    let mut controller = controller();
    let mut last = LegCommand::SAFE;
    let mut grown = 0;
    for tick in 0..2 * HOP_TICKS {
        // Water as it is measured: there the leg pushes.
        let m = Measurement { density_ratio: Some(1.0), ..bouncing(tick) };
        let command = controller.step(Some(&m), 0.5).command;
        // The first reading of contact is that of tick 474.
        if (475..560).contains(&(tick % HOP_TICKS)) && command.elongation_rate_m_s > 0.0 {
            let expected_m = last.elongation_m + 1e-3 * last.elongation_rate_m_s;
            let step_m = (command.elongation_m - expected_m).abs();
            assert!(step_m < 1e-4, "a step of {step_m} m in tick {tick}");
            grown += 1;
        }
        last = command;
    }
    assert!(grown > 100, "the ramp was seen in {grown} ticks");
}

#[test]
fn a_new_run_and_a_swap_keep_to_the_bits_of_a_fresh_controller() {
    let mut used = controller();
    for tick in 0..1_777 {
        used.step(Some(&noisy(tick, 0.5)), 0.5);
    }
    used.restart(config());
    let mut fresh = controller();
    for tick in 0..2 * HOP_TICKS {
        let m = noisy(tick, 0.5);
        assert_eq!(used.step(Some(&m), 0.5), fresh.step(Some(&m), 0.5));
    }
    // The same policy again: nothing changes.
    let mut swapped = fresh.clone();
    swapped.swap(Policy::parse(crate::policy::SHIPPED).unwrap());
    for tick in 2 * HOP_TICKS..4 * HOP_TICKS {
        let m = noisy(tick, 0.5);
        assert_eq!(swapped.step(Some(&m), 0.5), fresh.step(Some(&m), 0.5));
    }
    assert!(!swapped.swap_is_pending());
}

/// The leg of [`bouncing`] that senses its acceleration and posture alone; the foot stays under the
/// mass.
fn sensed(tick: u64, has_encoders: bool) -> Measurement {
    let m = bouncing(tick);
    // The specific force is what changes the velocity beside gravity, from the start on.
    let fallen_m_s = 9.81 * 1e-3 * tick as f32;
    let counts = |m_s: f32| (f64::from(m_s) * 65_536.0) as i64 as i32;
    let posture = LegPosture { length_m: m.y_m.min(1.0), angle_rad: core::f32::consts::FRAC_PI_2 };
    Measurement {
        vx_m_s: f32::NAN,
        y_m: f32::NAN,
        vy_m_s: f32::NAN,
        sensors: Sensors {
            impulse: Some(SpecificImpulse([0, counts(m.vy_m_s + fallen_m_s)])),
            posture: has_encoders.then_some(posture),
            ..Sensors::default()
        },
        ..m
    }
}

#[test]
fn an_estimate_beyond_the_limits_of_measurements_has_diverged_and_is_lost() {
    let config = Config::at_rate(1_000).unwrap();
    let config = config.with_estimation(Estimation::Inertial(SensorNoise::default())).unwrap();
    let policy = Policy::parse(crate::policy::SHIPPED).unwrap();
    let lost = |limits: Limits| {
        let config = config.with_limits(limits).unwrap();
        let mut controller = Controller::new(policy.clone(), config);
        for tick in 0..6 * HOP_TICKS {
            let lost = controller.counts().estimates_lost;
            let output = controller.step(Some(&sensed(tick, true)), 0.5);
            if controller.counts().estimates_lost > lost {
                assert_eq!((output.command, output.status), (LegCommand::SAFE, Status::Safe));
            }
        }
        controller.counts().estimates_lost
    };
    let usual = *config.limits();
    assert_eq!(lost(usual), 0);
    // The leg lands at some 4 m/s, and rises to some 2 m.
    assert!(lost(Limits { max_speed_m_s: 3.0, ..usual }) > 0);
    assert!(lost(Limits { height_m: [0.0, 1.2], ..usual }) > 0);
}

#[test]
fn a_lost_estimate_is_counted_and_ends_in_the_safe_command() {
    let noise = SensorNoise { acceleration_bias_m_s2: 2.0, ..SensorNoise::default() };
    let config = Config::at_rate(1_000).unwrap().with_estimation(Estimation::Inertial(noise));
    let policy = Policy::parse(crate::policy::SHIPPED).unwrap();
    let mut controller = Controller::new(policy, config.unwrap());
    for tick in 0..6 * HOP_TICKS {
        controller.step(Some(&sensed(tick, true)), 0.5);
    }
    assert_eq!(controller.counts().estimates_lost, 0);
    assert!(controller.estimate().is_some() && controller.telemetry().apexes >= 4);
    let mut lost_at = None;
    for tick in 6 * HOP_TICKS..200 * HOP_TICKS {
        let output = controller.step(Some(&sensed(tick, false)), 0.5);
        if controller.counts().estimates_lost > 0 && lost_at.is_none() {
            lost_at = Some(tick);
            assert_eq!((output.command, output.status), (LegCommand::SAFE, Status::Safe));
            assert_eq!(controller.estimate(), None);
        }
    }
    assert!(lost_at.is_some(), "without encoders nothing tells the velocity for 200 s");
}
