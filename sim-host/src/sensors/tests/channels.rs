//! Single channels: noise, bias, scale, clipping, quantisation, rate, latency, the switch.

use super::super::accelerometer::Accelerometer;
use super::super::channel::Channel;
use super::super::contact::ContactSwitch;
use super::super::delivery::Delivery;
use super::*;
use leg_control::measurement::SpecificImpulse;

const READINGS: usize = 20_000;

/// Creates a channel of `sensor` at 1 kHz with only these errors.
fn channel(sensor: Sensor, settings: &[&str], seed: u64) -> Channel {
    let of_sensor = |setting: &&str| format!("{}-{setting}", sensor.name());
    let settings: Vec<String> = ["rate=20000"].iter().chain(settings).map(of_sensor).collect();
    let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
    let figures = figures(SensorProfile::Ideal, &settings);
    Channel::new(&figures, sensor, 1000.0, rng(seed, sensor, 0))
}

fn readings(mut channel: Channel, truth: f64) -> Vec<f64> {
    (0..READINGS).map(|_| channel.read(truth, truth)).collect()
}

#[test]
fn noise_has_the_declared_deviation() {
    let ideal = readings(channel(Sensor::State, &[], 1), -0.0);
    assert!(ideal.iter().all(|reading| reading.to_bits() == (-0.0_f64).to_bits()), "exact");
    let normal = readings(channel(Sensor::State, &["noise=0.25"], 1), 3.0);
    assert!((mean(&normal) - 3.0).abs() < 0.01, "{}", mean(&normal));
    assert!((deviation(&normal) - 0.25).abs() < 0.005, "{}", deviation(&normal));
    let uniform = readings(channel(Sensor::State, &["uniform=0.1"], 1), 3.0);
    assert!(uniform.iter().all(|reading| (reading - 3.0).abs() <= 0.1));
    assert!((deviation(&uniform) - 0.1 / 3_f64.sqrt()).abs() < 0.001);
    let shared = readings(channel(Sensor::Velocity, &SILENT_VELOCITY, 1), 4.0);
    assert!((deviation(&shared) - 0.2).abs() < 0.005, "5 % of 4 m/s: {}", deviation(&shared));
}

const SILENT_VELOCITY: [&str; 4] = ["noise=0", "bias=0", "scale=0", "noise-share=0.05"];

#[test]
fn noise_of_an_inertial_sensor_is_a_density() {
    let settings = ["noise=0.002", "bias=0", "walk=0", "scale=0", "resolution=0"];
    let at_1_khz = readings(channel(Sensor::Accelerometer, &settings, 1), 9.81);
    assert!((deviation(&at_1_khz) - 0.002 * 1000_f64.sqrt()).abs() < 0.001);
}

/// Returns the accelerometer's sum after 2 s of `force_m_s2` in level axes, m/s.
fn sum(settings: &[&str], force_m_s2: [f64; 2], pitch_rad: f64) -> [f64; 2] {
    let exact = ["noise=0", "bias=0", "walk=0", "scale=0", "resolution=0", "range=0"];
    let own = |name: &str| settings.iter().any(|setting| setting.starts_with(name));
    let others = exact.iter().filter(|setting| !own(setting.split('=').next().unwrap()));
    let all = ["rate=1000"].iter().chain(others).chain(settings);
    let all: Vec<String> = all.map(|setting| format!("accelerometer-{setting}")).collect();
    let all: Vec<&str> = all.iter().map(String::as_str).collect();
    let mut sensor = Accelerometer::new(&figures(SensorProfile::Ideal, &all), 1000, 1);
    let start = sensor.sum();
    for _ in 0..2000 {
        sensor.add(force_m_s2.map(|m_s2| 1e-3 * m_s2), pitch_rad, 1e-3);
    }
    SpecificImpulse::since(sensor.sum(), start).map(f64::from)
}

#[test]
fn the_accelerometer_measures_along_the_axes_of_a_body_that_leans_back() {
    // Leaning back, the body's x axis points upwards, and its y axis backwards.
    let [x, y] = sum(&[], [0.0, 9.81], 0.3);
    assert!((x - 19.62 * 0.3_f64.sin()).abs() < 1e-4, "{x}");
    assert!((y - 19.62 * 0.3_f64.cos()).abs() < 1e-4, "{y}");
    let [x, y] = sum(&[], [1.0, 0.0], 0.3);
    assert!((x - 2.0 * 0.3_f64.cos()).abs() < 1e-4, "{x}");
    assert!((y + 2.0 * 0.3_f64.sin()).abs() < 1e-4, "{y}");
}

#[test]
fn the_accelerometer_clips_the_specific_force_and_adds_up_its_bias() {
    let [x, y] = sum(&["range=20"], [-50.0, 9.81], 0.0);
    assert!((x + 40.0).abs() < 1e-4 && (y - 19.62).abs() < 1e-4, "{x} {y}");
    for axis in sum(&["bias=0.25"], [0.0, 0.0], 0.0) {
        assert!((axis.abs() - 0.5).abs() < 1e-4, "{axis}");
    }
    // Of forces below half a step nothing is left, and of the sum's own counts everything.
    assert_eq!(sum(&["resolution=0.1"], [0.04, 0.0], 0.0), [0.0; 2]);
    let [x, _] = sum(&[], [0.001, 0.0], 0.0);
    assert!((x - 0.002).abs() < 1e-5, "{x}");
}

#[test]
fn bias_and_scale_have_their_size_and_a_random_sign() {
    for settings in [["bias=0.5", "scale=0"], ["bias=0", "scale=0.25"]] {
        let error = |seed| channel(Sensor::State, &settings, seed).read(2.0, 2.0) - 2.0;
        let errors: Vec<f64> = (0..1000).map(error).collect();
        assert!(errors.iter().all(|error| error.abs() == 0.5), "{settings:?}");
        let positive = errors.iter().filter(|&&error| error > 0.0).count();
        assert!((440..560).contains(&positive), "{positive} of 1000");
    }
}

#[test]
fn the_bias_walks_by_the_root_of_time() {
    let ends: Vec<f64> = (0..500)
        .map(|seed| {
            let mut channel = channel(Sensor::State, &["walk=0.1"], seed);
            (0..4000).map(|_| channel.read(0.0, 0.0)).last().unwrap()
        })
        .collect();
    let after_4_s = deviation(&ends);
    assert!((after_4_s - 0.2).abs() < 0.02, "{after_4_s}");
}

#[test]
fn readings_are_clipped_and_then_quantised() {
    let mut channel = channel(Sensor::State, &["range=2", "resolution=0.25"], 1);
    for (truth, reading) in [(1.1, 1.0), (1.13, 1.25), (-9.0, -2.0), (f64::INFINITY, 2.0)] {
        assert_eq!(channel.read(truth, truth), reading, "{truth}");
    }
}

/// Returns for each tick the number of the tick that arrives with its age, ms.
fn arrivals(settings: &[&str]) -> Vec<Option<(u64, u32)>> {
    let settings: Vec<String> = settings.iter().map(|s| format!("height-{s}")).collect();
    let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
    let figures = figures(SensorProfile::Ideal, &settings);
    let rng = rng(1, Sensor::Height, 7);
    let mut delivery = Delivery::new(&figures, Sensor::Height, 1000, rng).unwrap();
    let pass = |tick| {
        let aged = delivery.pass(tick, || Some(tick))?;
        assert_eq!(u64::from(aged.age_ns), 1_000_000 * (tick - aged.value), "the age is true");
        Some((aged.value, aged.age_ns / 1_000_000))
    };
    (0..READINGS as u64).map(pass).collect()
}

#[test]
fn a_slow_sensor_sends_only_at_its_rate() {
    for (rate, expected) in [("rate=10", 200), ("rate=7.5", 150), ("rate=1000", 20_000)] {
        let settings = [rate, "latency=0", "jitter=0", "dropout=0"];
        let all = arrivals(&settings);
        let ticks: Vec<u64> = all.iter().flatten().map(|&(tick, _)| tick).collect();
        assert!(ticks.len().abs_diff(expected) <= 1, "{rate}: {}", ticks.len());
        let gaps: Vec<u64> = ticks.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let (least, most) = (gaps.iter().min().unwrap(), gaps.iter().max().unwrap());
        assert!(most - least <= 1, "even: {least} to {most}");
    }
}

#[test]
fn readings_arrive_late_by_latency_and_jitter_and_in_order() {
    let all = arrivals(&["rate=100", "latency=0.03", "jitter=0.04", "dropout=0"]);
    let ages: Vec<f64> = all.iter().flatten().map(|&(_, age_ms)| f64::from(age_ms)).collect();
    assert!(ages.iter().all(|age_ms| (30.0..=70.0).contains(age_ms)), "{ages:?}");
    assert!(ages.iter().any(|&age_ms| age_ms < 35.0) && ages.iter().any(|&age_ms| age_ms > 65.0));
    let ticks: Vec<u64> = all.iter().flatten().map(|&(tick, _)| tick).collect();
    assert!(ticks.windows(2).all(|pair| pair[0] < pair[1]), "in order, none twice");
}

#[test]
fn dropouts_lose_their_share() {
    let all = arrivals(&["rate=1000", "latency=0", "jitter=0", "dropout=0.3"]);
    let lost = all.iter().filter(|arrival| arrival.is_none()).count() as f64 / READINGS as f64;
    assert!((lost - 0.3).abs() < 0.015, "{lost}");
}

/// Returns the readings of a switch, and the truth, at 1 kHz: a stance of 200 ms in every
/// 500 ms.
fn switch(settings: &[&str]) -> Vec<(bool, bool)> {
    let figures = figures(SensorProfile::Imu, settings);
    let mut switch = ContactSwitch::new(&figures, 1000, rng(1, Sensor::Contact, 0)).unwrap();
    let at = |tick: u64| (300..500).contains(&(tick % 500));
    (0..READINGS as u64).map(|tick| (at(tick), switch.read(tick, at(tick)))).collect()
}

/// Returns the ticks in which a reading differs from the one before.
fn edges(readings: &[bool]) -> Vec<usize> {
    (1..readings.len()).filter(|&tick| readings[tick] != readings[tick - 1]).collect()
}

#[test]
fn the_switch_is_1_to_3_ms_late_at_every_edge() {
    let (truth, read): (Vec<bool>, Vec<bool>) = switch(&["contact-bounce=0"]).into_iter().unzip();
    let delays: Vec<usize> = edges(&truth)
        .into_iter()
        .zip(edges(&read))
        .map(|(true_at, read_at)| read_at - true_at)
        .collect();
    assert_eq!(delays.len(), edges(&truth).len());
    assert_eq!((delays.iter().min(), delays.iter().max()), (Some(&1), Some(&3)), "{delays:?}");
}

#[test]
fn the_switch_bounces_for_its_time_after_an_edge_and_not_later() {
    let (truth, read): (Vec<bool>, Vec<bool>) = switch(&[]).into_iter().unzip();
    let true_edges = edges(&truth);
    let read_edges = edges(&read);
    assert!(read_edges.len() > true_edges.len() + true_edges.len() / 2, "it bounces");
    for edge in read_edges {
        let since = true_edges.iter().rev().find(|&&at| at <= edge).map(|at| edge - at).unwrap();
        assert!((1..=3 + 7).contains(&since), "{since} ms after the edge");
    }
}

#[test]
fn a_switch_chatters_only_while_it_is_closed() {
    let settings =
        ["contact-latency=0", "contact-jitter=0", "contact-bounce=0", "contact-chatter=20"];
    let all = switch(&settings);
    let wrong =
        |phase: bool| all.iter().filter(|&&(truth, read)| truth == phase && read != truth).count();
    assert_eq!(wrong(false), 0, "open");
    // Closed for 8 s of 20.
    assert!((120..200).contains(&wrong(true)), "{}", wrong(true));
}
