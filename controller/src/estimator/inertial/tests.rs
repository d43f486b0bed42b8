//! The filter on a leg that hops, integrated in small steps in f64.

extern crate std;

mod hopper;

use super::*;
use crate::estimator::random::Random;
use crate::measurement::{Aged, Contact, LegPosture, SpecificImpulse};
use core::f64::consts::FRAC_PI_2;
use hopper::{Errors, Hopper};

const TICK_NS: u64 = 1_000_000;
/// Angle of the leg at touchdown for each m/s, rad: hardly more than keeps the velocity.
const FOOT_AHEAD: f64 = 0.13;

/// Hops for `seconds`. `tamper` may change a measurement, or lose it by returning false; `seen`
/// is called after every tick.
fn run(
    hopper: Hopper,
    seconds: u64,
    tamper: impl FnMut(&mut Hopper, &mut Measurement) -> bool,
    seen: impl FnMut(&Hopper, &InertialFilter, Option<Events>),
) {
    run_with(&SensorNoise::default(), hopper, seconds, tamper, seen);
}

/// The same with sensors of this noise.
fn run_with(
    noise: &SensorNoise,
    mut hopper: Hopper,
    seconds: u64,
    mut tamper: impl FnMut(&mut Hopper, &mut Measurement) -> bool,
    mut seen: impl FnMut(&Hopper, &InertialFilter, Option<Events>),
) {
    let mut filter = InertialFilter::new(&LegModel::HUMAN, 9.81, TICK_NS, noise);
    for _ in 0..1_000 * seconds {
        let mut measurement = hopper.read();
        if tamper(&mut hopper, &mut measurement) {
            let rest_m = 1.0 + hopper.extension_m as f32;
            let touchdown_y_m = libm::sin(FRAC_PI_2 + FOOT_AHEAD * hopper.velocity[0]) as f32;
            let events = filter.take(&measurement, Channels::ALL, rest_m, touchdown_y_m);
            if !filter.has_begun() {
                // As the control law does where the state is lost.
                filter = InertialFilter::new(&LegModel::HUMAN, 9.81, TICK_NS, noise);
            }
            seen(&hopper, &filter, events);
        }
        hopper.step();
    }
}

/// What was seen of a run after its first five seconds, in flight.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    /// Root mean square errors: vx, y, vy, density.
    rms: [f64; 4],
    /// Mean squares of the errors over their variances.
    nees: [f64; 4],
    apexes: u32,
    /// Ticks without an estimate.
    lost: u32,
}

fn see(
    hopper: Hopper,
    seconds: u64,
    tamper: impl FnMut(&mut Hopper, &mut Measurement) -> bool,
) -> Seen {
    see_with(&SensorNoise::default(), hopper, seconds, tamper)
}

fn see_with(
    noise: &SensorNoise,
    hopper: Hopper,
    seconds: u64,
    tamper: impl FnMut(&mut Hopper, &mut Measurement) -> bool,
) -> Seen {
    let mut sum = Seen::default();
    let mut count = 0.0;
    run_with(noise, hopper, seconds, tamper, |hopper, filter, events| {
        sum.apexes += u32::from(events.is_some_and(|events| events.passed_apex));
        sum.lost += u32::from(events.is_none());
        if hopper.tick < 5_000 || hopper.foot.is_some() || filter.in_stance() {
            return;
        }
        let Some(e) = filter.estimate() else { return };
        let of = [
            (f64::from(e.vx_m_s) - hopper.velocity[0], e.vx_variance),
            (f64::from(e.y_m) - hopper.position[1], e.y_variance),
            (f64::from(e.vy_m_s) - hopper.velocity[1], e.vy_variance),
            (f64::from(e.density_ratio) - hopper.density_ratio, e.density_variance),
        ];
        count += 1.0;
        for ((square, nees), (error, variance)) in sum.rms.iter_mut().zip(&mut sum.nees).zip(of) {
            *square += error * error;
            *nees += error * error / f64::from(variance);
        }
    });
    Seen {
        rms: sum.rms.map(|square| libm::sqrt(square / count)),
        nees: sum.nees.map(|nees| nees / count),
        ..sum
    }
}

/// Asserts that the root mean square errors are below these limits.
#[track_caller]
fn assert_below(seen: &Seen, limits: [f64; 4], what: &str) {
    std::println!("{what}: {seen:.4?}");
    assert!(seen.rms.iter().zip(limits).all(|(rms, limit)| *rms < limit), "{what}: {seen:?}");
}

#[test]
fn finds_motion_and_density_of_a_leg_that_senses_neither() {
    for (density_ratio, errors, limits) in [
        (0.0, Errors::NONE, [0.001, 0.001, 0.002, 0.001]),
        (1.0, Errors::NONE, [0.001, 0.001, 0.002, 0.001]),
        (0.0, Errors::COMMON, [0.006, 0.005, 0.006, 0.003]),
        (0.4, Errors::COMMON, [0.006, 0.005, 0.006, 0.003]),
        (1.0, Errors::COMMON, [0.006, 0.005, 0.006, 0.003]),
    ] {
        let seen = see(Hopper::new(density_ratio, errors), 20, |_, _| true);
        assert_below(&seen, limits, &std::format!("density {density_ratio}"));
        assert!(seen.nees.iter().all(|&nees| nees < 1.5), "{seen:?}");
        assert_eq!(seen.lost, 1, "the first tick");
    }
}

#[test]
fn passes_one_apex_a_hop() {
    let mut touchdowns = 0;
    let mut was_in_stance = false;
    let hopper = Hopper::new(0.4, Errors::COMMON);
    let seen = see(hopper, 30, |hopper, _| {
        touchdowns += u32::from(hopper.foot.is_some() && !was_in_stance);
        was_in_stance = hopper.foot.is_some();
        true
    });
    assert!(seen.apexes.abs_diff(touchdowns) <= 1, "{} for {touchdowns}", seen.apexes);
}

#[test]
fn lost_messages_cost_next_to_nothing_for_impulses_are_summed() {
    let mut random = Random::new();
    let hopper = Hopper::new(0.0, Errors::COMMON);
    let seen = see(hopper, 20, |_, _| random.uniform() < 0.1);
    assert_below(&seen, [0.015, 0.01, 0.02, 0.01], "one of ten");
}

#[test]
fn an_accelerometer_of_200_hz_is_enough() {
    let hopper = Hopper::new(0.3, Errors::COMMON);
    let seen = see(hopper, 20, |hopper, m| {
        if !hopper.tick.is_multiple_of(5) {
            m.sensors.impulse = None;
        }
        true
    });
    assert_below(&seen, [0.02, 0.01, 0.02, 0.02], "200 Hz");
}

#[test]
fn carries_on_without_accelerometer_by_its_model_and_the_encoders() {
    let hopper = Hopper::new(0.0, Errors::COMMON);
    let seen = see(hopper, 20, |hopper, m| {
        if hopper.tick > 3_000 {
            m.sensors.impulse = None;
        }
        true
    });
    assert_below(&seen, [0.2, 0.15, 0.3, 0.05], "no accelerometer");
}

#[test]
fn a_contact_reading_that_sticks_or_chatters_is_overruled() {
    let mut random = Random::new();
    for (what, reading) in [("stuck on", Some(true)), ("stuck off", Some(false)), ("5 %", None)] {
        let hopper = Hopper::new(0.0, Errors::COMMON);
        let seen = see(hopper, 20, |hopper, m| {
            if hopper.tick > 3_000 {
                let flipped = hopper.contacts[2] ^ (random.uniform() < 0.05);
                m.contact = Contact::Sensed(reading.unwrap_or(flipped));
            }
            true
        });
        assert_below(&seen, [0.02, 0.02, 0.03, 0.01], what);
    }
}

#[test]
fn without_contact_reading_the_leg_length_shows_the_load() {
    let hopper = Hopper::new(0.0, Errors::COMMON);
    let seen = see(hopper, 20, |_, m| {
        m.contact = Contact::LegLength(m.sensors.posture.unwrap().length_m);
        true
    });
    assert_below(&seen, [0.02, 0.02, 0.03, 0.01], "by length");
}

#[test]
fn a_medium_that_changes_at_once_is_known_within_a_tenth_of_a_second() {
    let mut checked = 0;
    let hopper = Hopper::new(0.0, Errors::COMMON);
    let mut changed_at = None;
    run(
        hopper,
        12,
        |hopper, _| {
            if hopper.tick > 6_000 && hopper.velocity[1] > 1.0 && hopper.foot.is_none() {
                hopper.density_ratio = 1.0;
                changed_at.get_or_insert(hopper.tick);
            }
            true
        },
        |hopper, filter, _| {
            if hopper.density_ratio == 1.0 && hopper.foot.is_none() {
                checked += 1;
                let off = (filter.density_ratio() - 1.0).abs();
                assert!(checked < 100 || filter.in_stance() || off < 0.05, "{off} after {checked}");
            }
        },
    );
    assert!(checked > 1_000);
}

#[test]
fn slow_sensors_correct_the_velocity_of_a_leg_without_encoders() {
    let errors = Errors { tilt_rad: 0.005, ..Errors::COMMON };
    let mut past = [[0.0; 2]; 101];
    let seen = see(Hopper::new(1.0, errors), 20, |hopper, m| {
        past.rotate_right(1);
        past[0] = hopper.velocity;
        m.sensors.posture = None;
        if hopper.tick.is_multiple_of(125) {
            let value = past[100].map(|v| v as f32);
            m.sensors.velocity_m_s = Some(Aged { value, age_ns: 100_000_000 });
        }
        true
    });
    assert_below(&seen, [0.1, 0.2, 0.1, 0.05], "Doppler log");
}

#[test]
fn pressure_tells_the_vertical_velocity_in_water() {
    let pressure = |hopper: &Hopper| (1e5 + 9_810.0 * (10.0 - hopper.position[1])) as f32;
    let off = |uses_pressure: bool| {
        let mut off = 0.0_f32;
        run(
            Hopper::new(1.0, Errors::COMMON),
            1,
            |hopper, m| {
                let reading = Aged { value: pressure(hopper), age_ns: 0 };
                let is_due = uses_pressure && hopper.tick.is_multiple_of(50);
                m.sensors.pressure_pa = is_due.then_some(reading);
                true
            },
            |hopper, filter, _| {
                if hopper.foot.is_none() {
                    let variance = filter.vertical.factor.velocity_variance();
                    off = libm::sqrtf(variance);
                }
            },
        );
        off
    };
    let (with, without) = (off(true), off(false));
    assert!(with < 0.5 * without, "deviation {with} with, {without} without, before touchdown");
}

#[test]
fn a_state_that_nothing_corrects_any_more_is_lost_and_said_to_be() {
    let hopper = Hopper::new(0.0, Errors::COMMON);
    let seen = see(hopper, 20, |hopper, m| {
        if hopper.tick > 6_000 {
            m.sensors.posture = None;
            m.sensors.impulse = None;
        }
        true
    });
    assert!(seen.lost > 1, "beside the first tick: {seen:?}");
}

/// Encoders that contradict the state in one stance after another: there is no estimate then, and
/// a good one again soon after they agree.
#[test]
fn stances_that_contradict_the_state_end_the_estimate_until_they_agree() {
    let (mut lost, mut back) = (0, 0);
    run(
        Hopper::new(0.0, Errors::COMMON),
        25,
        |hopper, m| {
            if (5_000..15_000).contains(&hopper.tick) && hopper.foot.is_some() {
                // By turns 0.1 m too long and too short, for longer than the gate waits.
                let off = if hopper.tick % 50 < 25 { 0.1 } else { -0.1 };
                m.sensors.posture.as_mut().unwrap().length_m += off;
            }
            true
        },
        |hopper, filter, events| {
            lost += u32::from(events.is_none() && (5_000..15_500).contains(&hopper.tick));
            if hopper.tick > 20_000 {
                let estimate = filter.estimate().expect("the encoders agree again");
                let off = f64::from(estimate.vx_m_s) - hopper.velocity[0];
                assert!(off.abs() < 0.03, "{off} m/s at tick {}", hopper.tick);
                back += 1;
            }
        },
    );
    assert!(lost > 0 && back > 4_000, "{lost} ticks without an estimate, {back} checked after");
}

#[test]
fn an_accelerometer_that_clips_leaves_the_stance_to_the_encoders() {
    let mut sums = [[0.0_f64; 2]; 2];
    let mut clips = 0;
    let noise = SensorNoise { acceleration_range_m_s2: 40.0, ..SensorNoise::default() };
    let seen = see_with(&noise, Hopper::new(0.0, Errors::COMMON), 20, |_, m| {
        let SpecificImpulse(counts) = m.sensors.impulse.unwrap();
        let [last, clipped] = &mut sums;
        for ((last, clipped), count) in last.iter_mut().zip(clipped).zip(counts) {
            let most = 0.040 * 65_536.0;
            let change = f64::from(count) - *last;
            // The first sum is of no tick.
            clips += u32::from(change.abs() > most && *last != 0.0);
            *clipped += if *last == 0.0 { change } else { change.clamp(-most, most) };
            *last = f64::from(count);
        }
        let clipped = sums[1].map(|sum| libm::round(sum) as i32);
        m.sensors.impulse = Some(SpecificImpulse(clipped));
        true
    });
    assert!(clips > 500, "{clips}");
    assert_below(&seen, [0.05, 0.1, 0.2, 0.05], "clipped at 40 m/s2");
}

#[test]
fn the_scale_error_of_the_accelerometer_shows_in_stance() {
    let mut last = [0.0_f64; 2];
    let mut scaled = 0.0;
    let mut found = 0.0;
    run_with(
        &SensorNoise::default(),
        Hopper::new(0.0, Errors::COMMON),
        20,
        |_, m| {
            let SpecificImpulse([x, y]) = m.sensors.impulse.unwrap();
            let change = f64::from(y) - last[1];
            scaled += if last[1] == 0.0 { change } else { 1.006 * change };
            last = [x, y].map(f64::from);
            m.sensors.impulse = Some(SpecificImpulse([x, libm::round(scaled) as i32]));
            true
        },
        |_, filter, _| found = filter.scale_error.value,
    );
    assert!((found - 0.006).abs() < 0.001, "{found}");
}

/// A foot that slips for a part of each stance: the encoders show a motion that the accelerometer
/// does not feel. (One that slides at the same speed from touchdown to lift-off nothing tells from a
/// leg that is faster.)
#[test]
fn a_foot_that_slips_for_a_while_does_not_carry_the_velocity_along() {
    let (mut slipped_m, mut stance_ticks) = (0.0, 0);
    let seen = see(Hopper::new(0.0, Errors::COMMON), 20, |hopper, m| {
        if hopper.foot.is_none() {
            (slipped_m, stance_ticks) = (0.0, 0);
            return true;
        }
        stance_ticks += 1;
        // 1 m/s for 15 ms in the middle.
        slipped_m += if (40..55).contains(&stance_ticks) { 1e-3 } else { 0.0 };
        let posture = m.sensors.posture.as_mut().unwrap();
        let (sine, cosine) = (libm::sinf(posture.angle_rad), libm::cosf(posture.angle_rad));
        let (x, y) = (posture.length_m * cosine - slipped_m, posture.length_m * sine);
        posture.length_m = libm::hypotf(x, y);
        posture.angle_rad = libm::atan2f(y, x);
        true
    });
    assert_below(&seen, [0.15, 0.02, 0.03, 0.01], "slip of 15 mm in each stance");
    assert_eq!(seen.lost, 1, "the first tick alone has no estimate");
}

#[test]
fn no_reading_makes_an_estimate_that_is_not_finite() {
    let mut random = Random::new();
    let odd = [0.0, -0.0, 1e-30, 1e30, f32::MAX, -f32::MAX, 3.0, -1.5];
    let mut pick = move || {
        let i = (random.uniform() * odd.len() as f64) as usize;
        odd[i.min(odd.len() - 1)]
    };
    let mut filter = InertialFilter::new(&LegModel::HUMAN, 9.81, TICK_NS, &SensorNoise::default());
    let mut t_ns = 0;
    for tick in 0..20_000_u32 {
        t_ns += if tick % 97 == 0 { 900_000_000 } else { TICK_NS };
        let mut m = Hopper::new(0.5, Errors::COMMON).read();
        m.t_ns = t_ns;
        m.sensors.impulse = Some(SpecificImpulse([pick() as i32, pick() as i32]));
        m.sensors.posture = Some(LegPosture { length_m: pick(), angle_rad: pick() });
        m.sensors.pitch_rad = Some(pick());
        m.sensors.velocity_m_s = Some(Aged { value: [pick(), pick()], age_ns: tick * 7_001 });
        m.sensors.height_m = Some(Aged { value: pick(), age_ns: u32::MAX });
        m.sensors.pressure_pa = Some(Aged { value: pick(), age_ns: 0 });
        m.contact = Contact::Sensed(tick % 50 < 20);
        filter.take(&m, Channels::ALL, pick(), pick());
        if let Some(e) = filter.estimate() {
            let sum = e.vx_m_s + e.y_m + e.vy_m_s + e.density_ratio;
            assert!(sum.is_finite() && e.vx_variance > 0.0 && e.y_variance > 0.0, "{e:?}");
        } else if !filter.has_begun() {
            let leg = LegModel::HUMAN;
            filter = InertialFilter::new(&leg, 9.81, TICK_NS, &SensorNoise::default());
        }
    }
}
