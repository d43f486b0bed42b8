//! The estimates in recordings: kept bit for bit, compared by `replay`, drawn by `plot`.

use std::cell::Cell;
use std::fs;
use std::path::Path;

use leg_control::estimator::Estimate;
use leg_control::policy::{Policy, SHIPPED};
use leg_control::wire::Sample;
use leg_control::wire_controller::WireController;
use leg_host::TimeMode;
use sim_host::record::Recorder;
use sim_host::record::config;
use sim_host::record::read::Reader;
use sim_host::record::schema::{self, AnyMessage};
use sim_host::scenario::{Scenario, Settings};
use sim_host::session::{Options, TickRecord, stepped};

use super::place::{PROGRAM, Place};
use super::record::RECORD_OPTIONS;
use super::text;

/// A leg without sensors of velocity and height.
const IMU: [&str; 7] =
    ["--in-process", "--set-point", "0.5", "--duration", "5", "--sensors", "imu"];

/// Returns the samples and the estimates of a recording.
fn read(path: &Path) -> (Vec<Sample>, Vec<schema::Estimate>) {
    let mut reader = Reader::open(path).unwrap();
    let (mut samples, mut estimates) = (Vec::new(), Vec::new());
    while let Some(entry) = reader.next_message().unwrap() {
        match entry.message {
            AnyMessage::Sample(sample) => samples.push((&sample).into()),
            AnyMessage::Estimate(estimate) => {
                let last: &Sample = samples.last().expect("its sample is before it");
                assert_eq!(estimate.seq, last.header.seq);
                estimates.push(estimate);
            }
            _ => (),
        }
    }
    (samples, estimates)
}

/// Returns the bits of an estimate.
fn bits(e: &Estimate) -> (u64, bool, [u32; 9]) {
    let states = [e.vx_m_s, e.y_m, e.vy_m_s, e.density_ratio];
    let variances = [e.vx_variance, e.y_variance, e.vy_variance, e.density_variance];
    let mut all = [0; 9];
    for (bits, value) in all.iter_mut().zip(states.into_iter().chain(variances)) {
        *bits = value.to_bits();
    }
    all[8] = e.innovation.to_bits();
    (e.t_ns, e.in_stance, all)
}

/// Returns the bits of a recorded estimate.
fn recorded_bits(e: &schema::Estimate) -> (u64, bool, [u32; 9]) {
    let all = [
        e.vx_m_s,
        e.y_m,
        e.vy_m_s,
        e.density_ratio,
        e.vx_variance_m2_s2,
        e.y_variance_m2,
        e.vy_variance_m2_s2,
        e.density_variance,
        e.innovation,
    ];
    (e.t_ns, e.in_stance, all.map(f32::to_bits))
}

#[test]
fn a_recording_has_the_estimate_of_each_tick_with_every_bit() {
    let place = Place::new();
    let path = place.file("run.mcap");
    let hash = place.start("run", &IMU).end().assert_ok().state_hash();
    let recorded = place.start("run", &[&IMU[..], &["--record", text(&path)]].concat()).end();
    assert_eq!(recorded.assert_ok().state_hash(), hash);
    let (samples, estimates) = read(&path);
    assert_eq!(samples.len(), 5_000);

    let settings =
        Settings::from_toml("set_point_m_s = 0.5\nduration_s = 5.0\nsensors = \"imu\"").unwrap();
    let config = Scenario::from_settings(&settings).unwrap().controller_config().unwrap();
    let mut controller = WireController::new(Policy::parse(SHIPPED).unwrap(), config);
    let mut recorded = estimates.iter().map(recorded_bits);
    for sample in &samples {
        controller.tick(Some(sample));
        if let Some(estimate) = controller.estimate() {
            assert_eq!(recorded.next(), Some(bits(&estimate)), "tick {}", sample.header.seq);
        }
    }
    assert_eq!(recorded.next(), None);
    assert!(estimates.len() > 4_500, "{}", estimates.len());
    assert!(estimates.iter().any(|e| e.in_stance) && estimates.iter().any(|e| !e.in_stance));
}

#[test]
fn a_run_by_its_readings_records_no_estimate_and_plots_none() {
    let place = Place::new();
    let (path, svg) = (place.file("run.mcap"), place.file("run.svg"));
    let plot = || {
        place.start("plot", &[text(&path), "-o", text(&svg)]).end().assert_ok();
        fs::read_to_string(&svg).unwrap()
    };
    place.start("run", &[&IMU[..5], &["--record", text(&path)]].concat()).end().assert_ok();
    assert!(read(&path).1.is_empty());
    let replayed = place.start("replay", &[text(&path)]).end();
    assert!(!replayed.assert_ok().out.contains("estimates"), "{}", replayed.out);
    assert!(!plot().contains("Estimate less truth"));

    place.start("run", &[&IMU[..], &["--record", text(&path)]].concat()).end().assert_ok();
    let drawn = plot();
    assert_eq!(drawn.matches("Estimate less truth").count(), 4, "one for each quantity");
}

/// Faults of the link change what the controller receives, and so its estimate.
#[test]
fn replay_compares_the_estimates_also_of_a_run_with_faults_on_its_link() {
    let place = Place::new();
    let path = place.file("run.mcap");
    let faults = ["--fault", "delay=15", "--fault", "drop=0.2", "--stale-limit", "100"];
    let by_state = ["--estimator", "state", "--fault", "noise=0.1"];
    let slow_link = [&IMU[..5], &faults, &by_state].concat();
    for run in [&IMU[..], &slow_link] {
        place.start("run", &[run, &["--record", text(&path)]].concat()).end().assert_ok();
        let count = read(&path).1.len();
        assert!(count > 4_000, "{count}");
        let replayed = place.start("replay", &[text(&path)]).end();
        let out = &replayed.assert_ok().out;
        let same = format!("{count} estimates compared: the same, bit for bit");
        assert!(out.contains(&same), "{out}");
    }
}

#[test]
fn replay_names_the_first_estimate_that_differs_in_a_bit() {
    let place = Place::new();
    let path = place.file("run.mcap");
    let settings = Settings::from_toml("duration_s = 2.0\nsensors = \"imu\"").unwrap();
    let scenario = Scenario::from_settings(&settings).unwrap();
    let config = config::of_run(&settings, &scenario, TimeMode::LockStep).unwrap();
    let (recorder, mut tap) =
        Recorder::begin_with(Path::new(PROGRAM), &path, &config, RECORD_OPTIONS).unwrap();
    let policy = Policy::parse(SHIPPED).unwrap();
    let sink = recorder.sink();
    sink.policy(schema::Policy::of(SHIPPED, &policy, 1, 0));
    sink.law(config::of_law(scenario.estimator.unwrap(), scenario.stale_limit_ns, true));
    let mut controller = WireController::new(policy, scenario.controller_config().unwrap());
    let estimate = Cell::new(None);
    let law = |sample: Option<&Sample>| {
        let command = controller.tick(sample);
        estimate.set(controller.estimate());
        command
    };
    let observe = |tick: &TickRecord<'_>| {
        let one_bit_off = |e: Estimate| Estimate { y_variance: e.y_variance.next_up(), ..e };
        let held = estimate.take();
        tap.push_estimated(tick, if tick.seq == 1_500 { held.map(one_bit_off) } else { held });
    };
    let outcome = stepped::run(&scenario, law, Options::default(), observe).unwrap();
    recorder.finish(config::of_end(&outcome)).unwrap();
    let replayed = place.start("replay", &[text(&path)]).end();
    let out = &replayed.assert(1, &[] as &[&str]).out;
    assert!(out.contains("2000 commands compared: the same, bit for bit"), "{out}");
    assert!(out.contains("at tick 1500, in y_variance_m2: recorded"), "{out}");
    let json = place.start("replay", &[text(&path), "--json"]).end();
    let report: serde_json::Value = serde_json::from_str(&json.out).unwrap();
    assert_eq!(report["equal"], false, "{report}");
    assert_eq!(report["first_estimate_difference"]["tick"], 1_500, "{report}");
}

/// A run of two processes has no estimates in its recording.
#[test]
fn plot_draws_the_estimates_of_a_run_of_two_processes_as_of_one_in_a_process() {
    let place = Place::new();
    let sensors = ["--set-point", "0.5", "--duration", "6", "--sensors", "imu"];
    let drawn = |folder: &str, how: &[&str], more: &[&str]| {
        fs::create_dir(place.file(folder)).unwrap();
        let [mcap, svg] = ["run.mcap", "run.svg"].map(|name| place.file(folder).join(name));
        let record = ["--record", text(&mcap)];
        let run = [how, &sensors, more, &record].concat();
        place.start("run", &run).end().assert_ok();
        let plotted = place.start("plot", &[text(&mcap), "-o", text(&svg)]).end();
        assert_eq!(plotted.assert_ok().err, "");
        (read(&mcap).1.len(), fs::read_to_string(svg).unwrap())
    };
    let lossy = ["--fault", "drop=0.2", "--fault", "delay=5", "--stale-limit", "100"];
    for (i, more) in [&[][..], &lossy].into_iter().enumerate() {
        let [one, two] = ["one", "two"].map(|name| format!("{name}-{i}"));
        let (recorded, in_process) = drawn(&one, &["--in-process"], more);
        let spawn = ["--domain", place.domain(), "--spawn"];
        let (none, computed) = drawn(&two, &spawn, more);
        assert!(recorded > 4_000 && none == 0, "{recorded}, {none}");
        assert_eq!(computed.matches("Estimate less truth").count(), 4);
        if i == 0 {
            assert!(computed == in_process, "the pictures differ");
        }
    }
}

/// In real time the estimates are drawn as far as the commands show which samples the controller
/// received.
#[test]
fn plot_draws_the_estimates_of_a_run_in_real_time_or_reports_why_it_cannot() {
    let place = Place::new();
    let [mcap, svg] = ["run.mcap", "run.svg"].map(|name| place.file(name));
    let run = ["--domain", place.domain(), "--spawn", "--real-time", "--duration", "3"];
    let sensors = ["--sensors", "imu", "--set-point", "0.5", "--record", text(&mcap)];
    place.start("run", &[&run[..], &sensors].concat()).end().assert_ok();
    assert!(read(&mcap).1.is_empty());
    let plotted = place.start("plot", &[text(&mcap), "-o", text(&svg)]).end();
    let drawn = fs::read_to_string(&svg).unwrap().matches("Estimate less truth").count();
    let reported = plotted.assert_ok().err.contains("not all estimates are drawn: ");
    assert!(drawn == 4 || (drawn == 0 && reported), "{drawn}: {}", plotted.err);
    let ended = place.start("controller", &["estimate", "--input", text(&mcap)]).end();
    assert!(ended.assert_ok().err.contains("in real time the controller may have missed"));
}
