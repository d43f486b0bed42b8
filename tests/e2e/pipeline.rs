//! From training to a run, with the three programs that a user starts.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};

fn run(command: &mut Command) -> (String, String, Option<i32>) {
    let output = command.output().expect("the program runs");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (text(&output.stdout), text(&output.stderr), output.status.code())
}

fn train(folder: &Path, name: &str) -> Vec<u8> {
    let path = folder.join(name);
    let (_, stderr, status) = run(harness::program("trainer")
        .args(["train", "--preset", "robust", "--seed", "3", "--steps", "9000"])
        .args(["--eval-starts", "0", "--out"])
        .arg(&path));
    assert_eq!(status, Some(0), "{stderr}");
    std::fs::read(path).expect("a policy file")
}

#[test]
fn trains_and_evaluates_a_policy_and_runs_it_in_a_separate_controller_process() {
    let folder = tempfile::tempdir().unwrap();
    let blob = train(folder.path(), "policy.bin");
    assert_eq!(blob, train(folder.path(), "again.bin"), "the same seed gives another file");
    let log = std::fs::read_to_string(folder.path().join("policy.csv")).unwrap();
    assert!(log.lines().count() > 500, "one line per episode");
    let policy = folder.path().join("policy.bin");

    let (json, stderr, status) = run(harness::program("trainer")
        .args(["eval", "--json", "--starts", "40", "--policy"])
        .arg(&policy));
    assert_eq!(status, Some(0), "{stderr}");
    let report: Value = serde_json::from_str(&json).expect("one JSON object");
    for metric in ["survive30", "abs_v_median", "abs_v_p95", "reward5", "max_speed"] {
        assert!(report[metric]["0"].is_number() || report[metric]["0"].is_null(), "{metric}");
        assert_eq!(report[metric].as_object().unwrap().len(), 8, "{metric} at every density");
    }
    assert_eq!(report["tracking"].as_array().unwrap().len(), 48);

    // Two separate processes connect over shared memory.
    let domain = format!("pipeline-{}", std::process::id());
    let mut controller = harness::program("controller")
        .args(["--once", "--domain", &domain, "--policy"])
        .arg(&policy)
        .stdout(Stdio::piped())
        .spawn()
        .expect("the controller starts");
    let options = ["run", "--medium", "water", "--duration", "20", "--set-point", "0.3", "--json"];
    let (separate, stderr, _) =
        run(harness::program("sim-host").args(options).args(["--domain", &domain]));
    assert!(controller.wait().expect("the controller ends").success());
    let (together, _, _) = run(harness::program("sim-host")
        .args(options)
        .arg("--in-process")
        .arg("--policy")
        .arg(&policy));
    let hash = |json: &str| {
        let run: Value = serde_json::from_str(json).unwrap_or_else(|_| panic!("{json}{stderr}"));
        assert!(run["ticks"].as_u64().unwrap() > 1_000);
        run["state_hash"].clone()
    };
    assert_eq!(hash(&separate), hash(&together));
}

#[test]
fn trainer_infer_prints_the_actions_of_the_controllers_actor() {
    use leg_control::actor::Observation;
    use leg_control::policy::{Policy, SHIPPED};
    let folder = tempfile::tempdir().unwrap();
    let observations = folder.path().join("obs.csv");
    std::fs::write(&observations, "vx,y,rho\n0.5,2,0\n-1.25,1.5,1\n").unwrap();
    let (csv, stderr, status) = run(harness::program("trainer")
        .args(["infer", "--input"])
        .arg(&observations)
        .arg("--policy")
        .arg(harness::checkout().join("controller/policies/robust.bin")));
    assert_eq!(status, Some(0), "{stderr}");
    let policy = Policy::parse(SHIPPED).unwrap();
    let mut rows = csv.lines();
    assert_eq!(rows.next(), Some("vx,y,rho,alpha,rs"));
    for row in rows.by_ref().take(2) {
        let cells: Vec<f32> = row.split(',').map(|cell| cell.parse().unwrap()).collect();
        let [apex_vx_m_s, apex_y_m, density_ratio, alpha, rs] = cells[..] else { panic!("{row}") };
        let action = policy.actor().act(Observation { apex_vx_m_s, apex_y_m, density_ratio });
        assert_eq!([action.touchdown_angle_rad, action.elongation_speed_m_s], [alpha, rs]);
    }
    assert_eq!(rows.next(), None);
}
