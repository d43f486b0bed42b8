//! `sim-host estimation` as a user calls it.

use std::process::{Command, Output};

fn run(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sim-host")).arg("estimation").args(args).output().unwrap()
}

#[test]
fn prints_shares_with_intervals_and_names_bad_values() {
    let run_one = ["--case", "white-0.2", "--runs", "1", "--media", "land"];
    let table = run(&run_one);
    assert_eq!(table.status.code(), Some(0), "{table:?}");
    let text = String::from_utf8(table.stdout).unwrap();
    let row = text.lines().find(|line| line.split_whitespace().take(2).eq(["white-0.2", "land"]));
    assert!(row.is_some_and(|row| row.contains("100.0 %")), "{text}");
    let json = run(&[&run_one[..], &["--json"]].concat());
    let report: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!((&report["runs"], &report["rows"][0]["hopping"]), (&1.into(), &1.into()));
    let list = String::from_utf8(run(&["--list"]).stdout).unwrap();
    assert!(list.lines().count() > 10 && list.contains("trained-with"), "{list}");
    for (args, part) in [
        (&["--case", "wite-1"][..], "--case wite-1: there is no such case; the cases are ideal"),
        (&["--runs", "0"], "--runs is 0; it must be from 1 to 100000"),
        (&["--jobs", "0"], "--jobs is 0; it must be from 1 to 1024"),
    ] {
        let refused = run(args);
        assert_eq!(refused.status.code(), Some(2), "{args:?}");
        let message = String::from_utf8(refused.stderr).unwrap();
        assert!(message.contains(part), "{message}");
    }
}
