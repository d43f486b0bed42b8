//! Faults of sensors.

use super::*;
use crate::faults::stage::sensor::{
    ContactNoise, Dead, FaultyReadings, Reading, ReadingFault, SensorTarget, Stuck, StuckSwitch,
};
use leg_control::measurement::SpecificImpulse;

#[test]
fn sensor_faults_change_only_their_reading_and_by_the_given_amount() {
    let values = |received: &[Option<Sample>]| -> Vec<f64> {
        let error = |(i, m): (usize, &Option<Sample>)| f64::from(m.unwrap().vx_m_s) - i as f64;
        received.iter().enumerate().map(error).collect()
    };
    let (received, count) =
        through(FaultyReadings::new(&[Reading::Vx], ReadingFault::Noise(0.25), rng()));
    let errors = values(&received);
    let mean = errors.iter().sum::<f64>() / TICKS as f64;
    let deviation = (errors.iter().map(|e| e * e).sum::<f64>() / TICKS as f64).sqrt();
    assert!(mean.abs() < 0.02 && (deviation - 0.25).abs() < 0.02, "{mean} {deviation}");
    assert_eq!(count, TICKS);
    assert!(received.iter().flatten().all(|sample| sample.vy_m_s == 0.0), "another reading");

    let (received, _) =
        through(FaultyReadings::new(&[Reading::Vx], ReadingFault::Uniform(0.25), rng()));
    let errors = values(&received);
    let deviation = (errors.iter().map(|e| e * e).sum::<f64>() / TICKS as f64).sqrt();
    // That of the uniform distribution over (-1, 1) is 1 over the root of 3.
    assert!(errors.iter().all(|e| e.abs() <= 0.25 + 1e-4), "{errors:?}");
    assert!((deviation - 0.25 / 3_f64.sqrt()).abs() < 0.01, "{deviation}");

    let correlated = ReadingFault::Correlated { deviation: 0.25, ticks: 5.0 };
    let (received, _) = through(FaultyReadings::new(&[Reading::Vx], correlated, rng()));
    let errors = values(&received);
    let covariance = |lag: usize| {
        let pairs = errors.iter().zip(&errors[lag..]);
        pairs.map(|(a, b)| a * b).sum::<f64>() / (TICKS as usize - lag) as f64
    };
    assert!((covariance(0).sqrt() - 0.25).abs() < 0.04, "{}", covariance(0).sqrt());
    let kept = covariance(5) / covariance(0);
    assert!((0.2..0.55).contains(&kept), "{kept} after the correlation time, in place of 0.37");

    let (received, _) =
        through(FaultyReadings::new(&[Reading::Vx], ReadingFault::Bias(-0.5), rng()));
    assert!(values(&received).iter().all(|&error| error == -0.5));

    let (received, count) =
        through(FaultyReadings::new(Reading::MOTION, ReadingFault::NotANumber(0.2), rng()));
    let blind = received.iter().flatten().filter(|sample| sample.vx_m_s.is_nan()).count();
    assert!(blind as u64 == count && (300..500).contains(&blind), "{blind}");

    let window = Window { from: 10, until: 11 };
    let stuck = Stuck::new(SensorTarget::Readings(&[Reading::Vx]), 5, 1.0, rng());
    let (received, count) = through_in(window, stuck);
    let vx: Vec<f32> = received[9..16].iter().map(|sample| sample.unwrap().vx_m_s).collect();
    assert_eq!(vx, [9.0, 10.0, 10.0, 10.0, 10.0, 10.0, 15.0]);
    assert_eq!((count, received[14].unwrap().header.seq), (5, 14), "only the reading is old");

    let (received, count) = through(ContactNoise::new(0.5, rng()));
    let turned = received.iter().flatten().filter(|s| s.is_in_contact()).count();
    assert!(turned as u64 == count && (900..1100).contains(&turned));
}

/// Passes samples with all readings, and a velocity in every hundredth, through a fault.
fn with_sensors(window: Window, stage: impl FaultStage<Sample> + 'static) -> Vec<Sample> {
    let mut plan = FaultPlan::default();
    plan.samples.push(0, window, Box::new(stage));
    let all = flags::STATE_SENSED
        | flags::LEG_LENGTH_SENSED
        | flags::LEG_ANGLE_SENSED
        | flags::CONTACT_SENSED
        | flags::IMPULSE_SENSED
        | flags::PITCH_SENSED
        | flags::PITCH_RATE_SENSED
        | flags::HEIGHT_SENSED
        | flags::PRESSURE_SENSED;
    let pass = |tick: u64| {
        let mut sample = sample(tick);
        sample.header.flags = all;
        // The sum wraps on the way.
        sample.sensors.impulse = [i32::MAX.wrapping_add(tick as i32), 0];
        sample.sensors.pressure_pa = 1e5;
        if tick.is_multiple_of(100) {
            sample.header.flags |= flags::VELOCITY_SENSED;
            sample.sensors.velocity_m_s = [tick as f32, 1.0];
        }
        plan.samples.pass(tick, Some(sample)).unwrap()
    };
    (0..TICKS).map(pass).collect()
}

const ACCELERATION: &[Reading] = &[Reading::ImpulseX, Reading::ImpulseY];

#[test]
fn faults_of_the_accelerometer_are_accelerations_and_their_sum_stays() {
    let window = Window { from: 500, until: 1500 };
    let bias = FaultyReadings::new(ACCELERATION, ReadingFault::Bias(0.5), rng());
    let samples = with_sensors(window, bias);
    let error_m_s = |tick: i32| {
        let truth = SpecificImpulse([i32::MAX.wrapping_add(tick), 0]);
        SpecificImpulse(samples[tick as usize].sensors.impulse).since(truth)
    };
    for (tick, expected_m_s) in [(0, 0.0), (499, 0.0), (1000, 0.25), (1499, 0.5), (1999, 0.5)] {
        for error_m_s in error_m_s(tick) {
            assert!((error_m_s - expected_m_s).abs() < 0.001, "{tick}: {error_m_s}");
        }
    }
    let noise = FaultyReadings::new(ACCELERATION, ReadingFault::Noise(2.0), rng());
    let samples = with_sensors(Window::ALWAYS, noise);
    let steps = samples.windows(2).map(|pair| {
        let [_, y_m_s] = SpecificImpulse(pair[1].sensors.impulse)
            .since(SpecificImpulse(pair[0].sensors.impulse));
        1e3 * f64::from(y_m_s)
    });
    let squares: Vec<f64> = steps.map(|m_s2| m_s2 * m_s2).collect();
    let deviation = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    assert!((deviation - 2.0).abs() < 0.1, "{deviation}");
}

#[test]
fn a_fault_acts_only_on_samples_that_have_its_reading() {
    let velocity = &[Reading::VelocityX, Reading::VelocityY];
    let bias = FaultyReadings::new(velocity, ReadingFault::Bias(3.0), rng());
    for (tick, sample) in with_sensors(Window::ALWAYS, bias).iter().enumerate() {
        let expected = if tick.is_multiple_of(100) { [tick as f32 + 3.0, 4.0] } else { [0.0; 2] };
        assert_eq!(sample.sensors.velocity_m_s, expected, "{tick}");
    }
    let stuck = Stuck::new(SensorTarget::Readings(velocity), 5000, 1.0, rng());
    let samples = with_sensors(Window { from: 350, until: 351 }, stuck);
    let at = |tick: usize| samples[tick].sensors.velocity_m_s[0];
    assert_eq!([at(200), at(300), at(400), at(500), at(501)], [200.0, 300.0, 300.0, 300.0, 0.0]);
}

#[test]
fn a_dead_sensor_is_in_no_sample_from_its_time_on_and_the_others_are() {
    let window = Window { from: 1000, until: u64::MAX };
    for (target, gone) in [
        (SensorTarget::Readings(ACCELERATION), flags::IMPULSE_SENSED),
        (SensorTarget::Readings(&[Reading::Pressure]), flags::PRESSURE_SENSED),
        (SensorTarget::Contact, flags::CONTACT_SENSED),
    ] {
        let samples = with_sensors(window, Dead(target));
        let intact = with_sensors(window, Dead(SensorTarget::Readings(&[])));
        assert_eq!(samples[..1000], intact[..1000]);
        for (dead, intact) in samples[1000..].iter().zip(&intact[1000..]) {
            assert_eq!(dead.header.flags, intact.header.flags & !gone);
            assert_eq!(dead.vx_m_s, intact.vx_m_s);
        }
        let nothing = SpecificImpulse::default().0;
        let last = samples.last().unwrap();
        assert_eq!(last.sensors.impulse == nothing, gone == flags::IMPULSE_SENSED);
        assert_eq!(last.sensors.pressure_pa == 0.0, gone == flags::PRESSURE_SENSED);
    }
}

#[test]
fn a_stuck_switch_reads_the_same_from_its_time_on() {
    let window = Window { from: 1000, until: 1500 };
    for is_closed in [true, false] {
        let samples = with_sensors(window, StuckSwitch { is_closed });
        let read = |range: std::ops::Range<usize>| {
            samples[range].iter().map(Sample::is_in_contact).collect::<Vec<_>>()
        };
        assert!(read(1000..1500).iter().all(|&read| read == is_closed));
        assert!(!read(0..1000).contains(&true) && !read(1500..2000).contains(&true));
    }
    let (received, count) = through(StuckSwitch { is_closed: true });
    assert_eq!(count, 0, "of samples without a switch");
    assert!(received.iter().flatten().all(|sample| !sample.is_in_contact()));
}
