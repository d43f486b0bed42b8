//! Sensors of the leg by profile, between real processes.

use super::place::Place;
use super::text;

const RUN: [&str; 6] = ["--duration", "4", "--seed", "3", "--sensors", "trained-with"];

#[test]
fn a_run_with_sensors_is_the_same_over_shared_memory_and_replays_bit_for_bit() {
    let place = Place::new();
    let path = place.file("run.mcap");
    let more = ["--sensor", "accelerometer-rate=1600", "--sensor", "velocity-rate=5"];
    let run = |how: &[&str]| place.alone(&[how, &RUN[..], &more[..]].concat()).end();
    let apart = run(&["--spawn"]).assert_ok().state_hash();
    let recorded = run(&["--in-process", "--record", text(&path)]).assert_ok().state_hash();
    assert_eq!(apart, recorded);
    let replayed = place.start("replay", &[text(&path)]).end();
    let out = &replayed.assert_ok().out;
    assert!(out.contains("4000 commands compared: the same, bit for bit"), "{out}");
    place.assert_clean();
}

#[test]
fn lists_the_sensors_and_rejects_wrong_settings_with_status_2() {
    let place = Place::new();
    let list = place.start("sensors", &[]).end();
    let list = &list.assert_ok().out;
    assert!(list.contains("trained-with") && list.contains("accelerometer-noise"), "{list}");
    let json = place.start("sensors", &["--json"]).end();
    let json: serde_json::Value = serde_json::from_str(&json.assert_ok().out).expect("JSON");
    assert_eq!(json["profiles"][2]["name"], "imu");
    assert_eq!(json["profiles"][2]["figures"]["pitch-bias"]["value"], 0.01);
    for (arguments, parts) in [
        (["--sensors", "imx"], ["imx", "trained-with"]),
        (["--sensor", "gyro-nois=1"], ["`gyro-nois` is not a figure", "gyro-noise"]),
        (["--sensor", "state-noise=101"], ["--sensor: ", "state-noise is 101; it must be"]),
        (["--sensor", "gyro-bias=1"], ["gyro-bias=1", "gyro-rate above 0 adds it"]),
    ] {
        place.simulator(&arguments).end().assert(2, &parts);
    }
}
