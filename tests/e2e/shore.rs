//! The shore demo as a user runs it: two processes, shared memory, the shipped policy.

use serde_json::Value;
use std::path::Path;
use std::process::Output;

/// Hashes of every state and command of the shore run with the shipped policy, the same on any
/// machine: with the sensors `imu` and the estimator for them, and with `ideal` ones and none. They
/// change only with policy, control law, plant, sensors or scenario; then redraw
/// `sim-host/pictures/shore.svg` too.
const GOLDEN_HASHES: [(&str, &str); 2] =
    [("imu", "94f1430e0d00a06a"), ("ideal", "9f9ba2dcdc071032")];

fn shore(folder: &Path, more: &[&str]) -> Output {
    harness::program("sim-host")
        .arg("--out")
        .arg(folder)
        .args(more)
        .output()
        .expect("sim-host runs")
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

/// Runs the shore twice and returns its result: reached the land, and repeats exactly.
fn repeated(sensors: &[&str]) -> (Value, String) {
    let folder = tempfile::tempdir().unwrap();
    let options = [sensors, &["--json"]].concat();
    let [first, second] = [(); 2].map(|()| {
        let result = json(&shore(folder.path(), &options));
        (result, std::fs::read_to_string(folder.path().join("shore.svg")).unwrap())
    });
    assert_eq!(first.0["state_hash"], second.0["state_hash"]);
    assert!(first.1 == second.1, "the pictures differ");
    let (result, svg) = first;
    assert_eq!(result["falls"], 0);
    assert_eq!(result["end_rho"], 0.0);
    assert!(result["distance_m"].as_f64().unwrap() > 40.0);
    assert!(result["hops"].as_u64().unwrap() > 30);
    for region in ["water", "shore", "land"] {
        let error = result["tracking"][region].as_f64().unwrap();
        assert!(error < 0.25, "{region}: {error} m/s");
    }
    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
    (result, svg)
}

#[test]
fn the_shore_run_has_the_golden_state_hash_and_repeats_exactly() {
    for (sensors, golden) in GOLDEN_HASHES {
        let (result, _) = repeated(&["--sensors", sensors]);
        assert_eq!(result["sensors"], sensors);
        assert_eq!(result["state_hash"], golden, "{sensors}: not the committed run");
        assert!(result["rho_error_max"].as_f64().unwrap() < 0.01, "{sensors}");
        assert_eq!(result["estimates"].is_null(), sensors == "ideal");
    }
}

#[test]
fn by_default_the_leg_walks_ashore_without_sensing_velocity_height_or_density() {
    let (result, svg) = repeated(&[]);
    let (sensors, golden) = GOLDEN_HASHES[0];
    assert_eq!((&result["sensors"], &result["state_hash"]), (&sensors.into(), &golden.into()));
    // The estimate of every tick is known in the leg's process too.
    assert_eq!(result["estimates"]["ticks"], result["ticks"]);
    for region in ["water", "shore", "land"] {
        for (quantity, most) in [("velocity", 0.015), ("height", 0.02), ("density", 0.008)] {
            let rms = result["regions"][region]["decision_error_rms"][quantity].as_f64().unwrap();
            assert!(0.0 < rms && rms < most, "{region}: {quantity} {rms}");
        }
    }
    for text in ["estimate", "true", "\u{b1}2 standard deviations", "Height: estimate less truth"] {
        assert!(svg.contains(text), "{text}");
    }
}

/// `sim-host run` plays the same scenario, by default with ideal sensors.
#[test]
fn the_demonstration_is_the_scenario_file_with_its_sensors() {
    let file = harness::checkout().join("sim-host/scenarios/shore.toml");
    for (sensors, golden) in GOLDEN_HASHES {
        let mut run = harness::program("sim-host");
        run.args(["run", "--in-process", "--json", "--scenario"]).arg(&file);
        if sensors != "ideal" {
            run.args(["--sensors", sensors]);
        }
        assert_eq!(json(&run.output().expect("sim-host runs"))["state_hash"], golden);
    }
}

#[test]
fn a_recording_of_the_demonstration_replays_with_its_estimates() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("shore.mcap");
    let file = recording.to_str().unwrap();
    let run = json(&shore(folder.path(), &["--json", "--record", file]));
    let replay =
        json(&harness::program("sim-host").args(["replay", "--json", file]).output().unwrap());
    assert_eq!(replay["equal"], true);
    assert_eq!(
        (&replay["compared"], &replay["estimates_compared"]),
        (&run["ticks"], &run["ticks"])
    );
}

#[test]
fn the_documents_state_the_golden_hashes() {
    for document in ["CONTRIBUTING.md", "tests/MEASUREMENTS.md"] {
        let text = std::fs::read_to_string(harness::checkout().join(document)).unwrap();
        for (sensors, hash) in GOLDEN_HASHES {
            assert!(text.contains(hash), "{document} has another state hash for {sensors}");
        }
    }
}

#[test]
fn sensors_that_do_not_exist_are_refused_with_the_names_of_those_that_do() {
    let folder = tempfile::tempdir().unwrap();
    let output = shore(folder.path(), &["--sensors", "lidar"]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    for word in ["lidar", "ideal", "trained-with", "imu", "underwater"] {
        assert!(stderr.contains(word), "{word}: {stderr}");
    }
}

#[test]
fn rejects_a_file_that_is_not_a_policy_with_one_message_and_status_2() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("not-a-policy.bin");
    std::fs::write(&path, b"GIF89a, an image").unwrap();
    let output = shore(folder.path(), &["--policy", path.to_str().unwrap()]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("not-a-policy.bin") && stderr.contains("LEGACTOR"), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(!folder.path().join("shore.svg").exists());
}

#[test]
fn an_output_folder_that_cannot_be_one_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("in-the-way");
    std::fs::write(&file, b"").unwrap();
    let output = shore(&file.join("out"), &["--json"]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("in-the-way"), "{stderr}");
}
