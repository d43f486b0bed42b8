//! The shore demo as a user runs it: two processes, shared memory, the shipped policy.

use serde_json::Value;
use std::path::Path;
use std::process::Output;

/// Hash of every state and command of the shore run with the shipped policy, the same on
/// any machine. It changes only with policy, control law, plant or scenario; then redraw
/// `sim-host/pictures/shore.svg` too.
const GOLDEN_HASH: &str = "9f9ba2dcdc071032";

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

#[test]
fn the_shore_run_has_the_golden_state_hash_and_repeats_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let first = json(&shore(folder.path(), &["--json"]));
    assert_eq!(first["falls"], 0);
    assert_eq!(first["end_rho"], 0.0);
    assert!(first["distance_m"].as_f64().unwrap() > 40.0);
    assert!(first["hops"].as_u64().unwrap() > 30);
    assert_eq!(first["state_hash"], GOLDEN_HASH, "the run differs from the committed one");
    assert!(first["rho_error_max"].as_f64().unwrap() < 0.01);
    for region in ["water", "shore", "land"] {
        let error = first["tracking"][region].as_f64().unwrap();
        assert!(error < 0.25, "{region}: {error} m/s");
    }
    let svg = std::fs::read_to_string(folder.path().join("shore.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));

    let second = json(&shore(folder.path(), &["--json"]));
    assert_eq!(first["state_hash"], second["state_hash"]);
    assert_eq!(std::fs::read_to_string(folder.path().join("shore.svg")).unwrap(), svg);
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
