//! `sim-host bench loop` as a user calls it.

use std::process::Command;

use serde_json::Value;

#[test]
fn bench_loop_reports_times_of_the_tick_and_its_transports() {
    let run = Command::new(env!("CARGO_BIN_EXE_sim-host"))
        .args(["bench", "loop", "--rounds", "1", "--exchanges", "2000", "--json"])
        .output()
        .expect("sim-host starts");
    assert!(run.status.success(), "{run:?}");
    let report: Value = serde_json::from_slice(&run.stdout).expect("one JSON object");
    for name in ["raw_shm_us", "raw_iceoryx2_us", "full_tick_us"] {
        let us = |quantile: &str| report[name][quantile].as_f64().expect("a time");
        assert!(us("p50") > 0.0 && us("p50") <= us("p99"), "{report}");
        assert!(us("p99") <= us("p99_9") && us("p99_9") <= us("max"), "{report}");
    }
    assert!(report["ticks_per_s"].as_f64().expect("a rate") > 0.0);
    // The shipped policy has run the whole demonstration.
    assert!(report["ticks"].as_u64().expect("a count") > 10_000, "{report}");
}
