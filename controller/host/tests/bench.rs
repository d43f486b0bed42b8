//! `controller bench` as a user calls it.

use std::process::Command;

use serde_json::Value;

#[test]
fn bench_times_every_kind_of_work_and_counts_its_instructions() {
    let run = Command::new(env!("CARGO_BIN_EXE_controller")).args(["bench", "--json"]).output();
    let run = run.expect("the controller starts");
    assert!(run.status.success(), "{run:?}");
    let report: Value = serde_json::from_slice(&run.stdout).expect("one JSON object");
    let kinds = ["tick_in_flight", "tick_in_stance", "inference", "tick_at_apex"];
    for kind in kinds {
        let ns = |name: &str| report[kind]["ns"][name].as_f64().expect("a time");
        assert!(ns("p50") > 0.0 && ns("p50") <= ns("p99"), "{report}");
        assert!(ns("p99") <= ns("p99_9") && ns("p99_9") <= ns("max"), "{report}");
    }
    let counts: Option<Vec<u64>> =
        kinds.iter().map(|kind| report[kind]["instructions"].as_u64()).collect();
    let counts = counts.ok_or_else(|| "a child process cannot be traced here".to_owned());
    let Some(counts) = requirements::Requirement::Ptrace.check(counts) else { return };
    // A tick between apexes does not evaluate the actor; a tick at an apex does, and more.
    assert!(counts[0] > 50 && counts[1] > 50, "{counts:?}");
    assert!(counts[2] > 2 * counts[0].max(counts[1]) && counts[3] > counts[2], "{counts:?}");
}
