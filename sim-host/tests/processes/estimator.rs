//! The estimator of the controller, chosen at run time: in this process, in two, and behind a
//! bridge; and what leg and controller must agree on.

use sim_host::record::read::Reader;
use sim_host::record::schema::{AnyMessage, Law};

use super::bridge::{Board, bridge};
use super::place::Place;
use super::{LONG_TIMEOUT, text};

/// Noise that fells every run by the readings, delay beyond the usual stale limit, and loss.
const NOISY: [&str; 18] = [
    "--medium",
    "air",
    "--set-point",
    "0.5",
    "--duration",
    "12",
    "--seed",
    "4",
    "--fault",
    "noise=0.2",
    "--fault",
    "delay=15,direction=both",
    "--fault",
    "drop=0.2,direction=both",
    "--timeout",
    "30",
    "--stale-limit",
    "100",
];
const STATE: [&str; 4] = ["--estimator", "state", "--estimator-noise", "velocity=0.1,height=0.1"];

/// Returns how the control law of a recording ran.
fn law(path: &std::path::Path) -> Law {
    let mut reader = Reader::open(path).unwrap();
    loop {
        if let AnyMessage::Law(law) = reader.next_message().unwrap().expect("a law").message {
            return law;
        }
    }
}

#[test]
fn a_run_with_the_estimator_hops_on_where_readings_fall_and_replays_bit_for_bit() {
    let place = Place::new();
    // With the shipped policy, not the one of other tests, which hops in place whatever it reads.
    let by_readings = place.start("run", &[&["--in-process"], &NOISY[..]].concat()).end();
    by_readings.assert(1, &["the leg fell"]);
    for (how, stepped) in [("--in-process", true), ("--spawn", false)] {
        let path = place.file("run.mcap");
        let run = [&[how, "--record", text(&path)], &NOISY[..], &STATE[..]].concat();
        let run = place.start("run", &run).end();
        assert!(run.assert_ok().out.contains("(12000 ticks)"), "{}", run.out);
        let law = law(&path);
        assert_eq!((law.estimator.as_str(), law.stepped), ("state", stepped));
        assert_eq!(law.stale_limit_ns, 100_000_000);
        let noise: Vec<_> = law.noise.iter().map(|n| (n.name.as_str(), n.deviation)).collect();
        assert_eq!(noise, [("velocity", 0.1), ("height", 0.1), ("leg-length", 0.001)]);
        let replayed = place.start("replay", &[text(&path)]).end();
        let out = &replayed.assert_ok().out;
        assert!(out.contains("commands compared: the same, bit for bit"), "{out}");
        assert!(!replayed.err.contains("warning"), "{}", replayed.err);
    }
    place.assert_clean();
}

/// A controller that is started apart tells the leg what it takes for the state.
#[test]
fn a_recording_keeps_the_estimator_of_a_controller_that_was_started_apart() {
    let place = Place::new();
    let path = place.file("run.mcap");
    let controller = place.controller(&STATE);
    let run = ["--duration", "5", "--fault", "noise=0.1", "--record", text(&path)];
    place.simulator(&[&run[..], &LONG_TIMEOUT].concat()).end().assert_ok();
    controller.end().assert_ok();
    assert_eq!(law(&path).estimator, "state");
    let replayed = place.start("replay", &[text(&path)]).end();
    let out = &replayed.assert_ok().out;
    assert!(out.contains("5000 commands compared: the same, bit for bit"), "{out}");
    place.assert_clean();
}

#[test]
fn a_bridge_gives_the_estimator_to_its_board_and_the_run_is_that_of_a_process() {
    let place = Place::new();
    let run = ["--duration", "5", "--fault", "noise=0.1", "--stale-limit", "40"];
    let apart = place.alone(&[&["--in-process"], &run[..], &STATE[..]].concat()).end();
    let board = Board::new(&place, &[]);
    let bridge = bridge(&place, &board, &[&STATE[..], &["--stale-limit", "40"]].concat());
    let played = place.simulator(&[&run[..], &LONG_TIMEOUT].concat()).end();
    bridge.end().assert_ok();
    // A dropped message aside, a link in lock-step is that of one process.
    assert_eq!(played.assert_ok().state_hash(), apart.assert_ok().state_hash());
    place.assert_clean();
}

#[test]
fn sides_that_disagree_are_refused_by_both_values_and_the_option() {
    let place = Place::new();
    let refuses = |controller: &[&str], leg: &[&str], parts: &[&str]| {
        let controller = place.controller(&[&LONG_TIMEOUT, controller].concat());
        let leg = place.simulator(&[&LONG_TIMEOUT, leg].concat());
        for side in [controller.end(), leg.end()] {
            side.assert(1, parts);
        }
    };
    refuses(
        &["--stale-limit", "300"],
        &[],
        &["stale limit", "300 ms", "10 ms", "give both the same --stale-limit"],
    );
    refuses(
        &["--estimator", "state"],
        &["--estimator", "readings"],
        &["state with noise velocity=0.01,height=0.01,leg-length=0.001", "readings", "--estimator"],
    );
    refuses(
        &["--estimator", "state"],
        &["--estimator", "state", "--estimator-noise", "height=0.5"],
        &["height=0.01", "height=0.5", "--estimator-noise"],
    );
    let parts = ["velocity and height", "an inertial sensor and the leg's joints", "--estimator"];
    refuses(&[], &["--sensors", "imu"], &parts);
    let readings = ["--in-process", "--sensors", "imu", "--estimator", "readings"];
    place.alone(&readings).end().assert(2, &parts);
    place.assert_clean();
}

/// Without a word about the estimator, in one process and in two; and with a controller that is
/// started apart and knows only the name of it.
#[test]
fn a_leg_with_raw_sensors_hops_by_the_estimator_for_them_and_its_run_replays() {
    let place = Place::new();
    let run = ["--medium", "water", "--sensors", "imu", "--set-point", "0.5", "--duration", "12"];
    let path = place.file("run.mcap");
    let play = |how: &[&str]| {
        let run = [how, &run[..], &["--json", "--record", text(&path)]].concat();
        let run = place.start("run", &run).end();
        let report: serde_json::Value = serde_json::from_str(&run.assert_ok().out).unwrap();
        let hops = report["hops"].as_u64().unwrap();
        assert!(hops >= 4, "{}", run.out);
        let replayed = place.start("replay", &[text(&path)]).end();
        let out = &replayed.assert_ok().out;
        assert!(out.contains("12000 commands compared: the same, bit for bit"), "{out}");
        report["state_hash"].clone()
    };
    assert_eq!(play(&["--in-process"]), play(&["--spawn"]));
    let controller = place.controller(&["--estimator", "inertial"]);
    let run = ["--sensors", "imu", "--duration", "5"];
    place.simulator(&[&run[..], &LONG_TIMEOUT].concat()).end().assert_ok();
    controller.end().assert_ok();
    place.assert_clean();
}

#[test]
fn wrong_settings_of_the_estimator_are_refused_with_the_option_and_the_limit() {
    let place = Place::new();
    for (arguments, parts) in [
        (&["--stale-limit", "0"][..], ["--stale-limit", "from 0.05 to 1000 ms"]),
        (&["--estimator-noise", "height=1"], ["--estimator-noise", "choose an estimator"]),
        (
            &["--estimator", "state", "--estimator-noise", "speed=1"],
            ["--estimator-noise", "this estimator knows velocity, height, leg-length"],
        ),
        (
            &["--estimator", "state", "--estimator-noise", "height=0"],
            ["--estimator-noise", "each standard deviation must be 1e-4 to 1e3"],
        ),
        (&["--estimator-noise", "height"], ["`height` has no `=`", "--estimator-noise"]),
    ] {
        place.controller(arguments).end().assert(2, &parts);
        place.simulator(arguments).end().assert(2, &parts);
    }
    let file = place.file("scenario.toml");
    std::fs::write(&file, "[controller]\nestimator = \"state\"\nnoise = { heigth = 1 }\n").unwrap();
    let parts = ["scenario.toml: controller.noise", "heigth=1"];
    place.simulator(&["--scenario", text(&file)]).end().assert(2, &parts);
    let known =
        "[controller]\nestimator = \"state\"\nnoise = { height = 1.0 }\nstale_limit_ms = 50";
    std::fs::write(&file, known).unwrap();
    let run = ["--in-process", "--duration", "1", "--scenario", text(&file)];
    place.alone(&run).end().assert_ok();
}
