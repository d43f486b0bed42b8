//! Swaps policies of a running controller, by request and by SIGHUP.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use rustix::process::Signal;

use super::place::{Place, hopping_named, text, wait_until};
use super::{ENDLESS, LONG_TIMEOUT};

#[test]
fn swaps_a_policy_at_an_apex_and_rejects_an_invalid_one() {
    let place = Place::new();
    let other = place.file("other.bin");
    fs::write(&other, hopping_named("other")).unwrap();
    let unanswered = place.request(&["swap", text(&other)]);
    unanswered
        .assert(1, &["no controller is running in domain `test-", "controller --policy FILE"]);

    let mut simulator = place.simulator(&ENDLESS);
    let mut controller = place.staying(&LONG_TIMEOUT);
    place.wait_for_the_run(None);
    let before = place.status();
    assert_eq!(before["policy"]["name"], "hop in place");
    assert_eq!((&before["swaps"], &before["pending"]), (&0.into(), &serde_json::Value::Null));
    let swapped = place.request(&["swap", text(&other)]);
    let message = &swapped.assert_ok().out;
    assert!(
        message.contains("the policy other") && message.contains("instead of hop in place"),
        "{message}"
    );
    let after = place.status();
    assert_eq!((after["policy"]["name"].as_str(), &after["swaps"]), (Some("other"), &1.into()));
    assert_eq!(after["policy"]["file"], text(&other));
    assert_ne!(after["policy"]["crc32"], before["policy"]["crc32"]);
    assert_eq!(after["since"]["run_id"], after["last"]["run_id"]);
    assert_eq!(after["rejected"]["ticks"], 0);
    let table = place.request(&["status"]);
    for part in ["other", after["policy"]["crc32"].as_str().unwrap(), "swaps 1"] {
        assert!(table.assert_ok().out.contains(part), "{part}: {}", table.out);
    }

    // Refused, each with what is wrong; the old one stays.
    let mut blob = hopping_named("worse");
    blob[60] ^= 1;
    let bad = place.file("bad.bin");
    fs::write(&bad, blob).unwrap();
    place
        .request(&["swap", text(&bad)])
        .assert(2, &["bad.bin", "not a valid policy", "other", "stays"]);
    let none = place.file("none.bin");
    place.request(&["swap", text(&none)]).assert(2, &["cannot read", "none.bin"]);
    place.request(&["swap"]).assert(2, &["FILE"]);
    assert_eq!(place.status()["swaps"], 1);

    // A SIGHUP has the file of --policy read again.
    fs::write(place.policy(), hopping_named("third")).unwrap();
    controller.signal(Signal::HUP);
    let sighup = requirements::sighup();
    place.wait_for_status(|status| status["policy"]["name"] == "third" || !sighup);
    fs::write(place.policy(), "nothing").unwrap();
    controller.signal(Signal::HUP);
    if sighup {
        controller.wait_for_message("policy.bin is not a valid policy");
    }

    simulator.signal(Signal::INT);
    simulator.end().assert(1, &["stopped by a signal"]);
    place.wait_for_the_controller();
    controller.signal(Signal::TERM);
    let controller = controller.end();
    controller.assert(0, &["the policy other", "has taken over at tick"]);
    if sighup {
        controller
            .assert(0, &["policy.bin is read again", "policy.bin is not a valid policy", "stays"]);
    }
    place.assert_clean();
}

/// In lock-step no tick can be missed, so the counts are exact: every sample is
/// answered, none is rejected, and only the commands before the first apex are safe
/// ones.
#[test]
fn a_hundred_swaps_on_a_hopping_leg_lose_no_tick() {
    const SWAPS: u64 = 100;
    let place = Place::new();
    let files = ["a", "b"].map(|name| {
        let file = place.file(&format!("{name}.bin"));
        fs::write(&file, hopping_named(name)).unwrap();
        file
    });
    let simulator = place.simulator(&[&ENDLESS[..], &["--json"]].concat());
    let mut controller = place.staying(&LONG_TIMEOUT);
    place.wait_for_status(|status| status["activity"] == "running");
    for i in 0..SWAPS {
        let file = &files[i as usize % 2];
        place.request(&["swap", text(file)]).assert_ok();
    }
    let swaps = place.status()["swaps"].as_u64();
    place.end_the_run();
    let simulator = simulator.end();
    controller.signal(Signal::TERM);
    let controller = controller.end();

    let json = |run: &str| -> serde_json::Value { serde_json::from_str(run).expect("JSON") };
    let swapped = json(&simulator.assert_ok().out);
    assert_eq!(swaps, Some(SWAPS), "all in force while the leg hopped: {swapped}");
    let ticks = swapped["ticks"].as_u64().unwrap();
    let plain = json(&place.alone_for(ticks, &["--json"]).out);
    // The policies differ in name only, so the hash must be equal, too.
    for key in ["state_hash", "ticks", "safe_ticks", "rejected", "held_ticks", "silences"] {
        assert_eq!(swapped[key], plain[key], "{key}");
    }
    controller.assert_ok();
    assert!(controller.err.matches("has taken over").count() > 1, "{}", controller.err);
    place.assert_clean();
}

/// SIGHUP reloads the policy, but a closed terminal, which also sends it, ends the
/// controller.
#[test]
fn a_closed_terminal_ends_a_controller_with_a_policy_file() {
    if !requirements::sighup() || !requirements::script() {
        return;
    }
    let place = Place::new();
    // `script` holds the other end of a terminal; what it runs has that terminal as its own.
    let controller = format!(
        "exec {} controller --domain {} --policy {}",
        env!("CARGO_BIN_EXE_sim-host"),
        place.domain(),
        text(&place.policy())
    );
    let mut terminal = Command::new("script")
        .args(["--quiet", "--command", &controller, "/dev/null"])
        .env("SHELL", "/bin/sh")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("script");
    place.wait_for_the_controller();
    let pid = place.status()["pid"].as_u64().unwrap();
    terminal.kill().unwrap();
    terminal.wait().unwrap();
    let process = PathBuf::from(format!("/proc/{pid}/exe"));
    wait_until(|| {
        let runs = place.root().exists() || fs::read_link(&process).is_ok();
        if runs { Err("it still runs".to_owned()) } else { Ok(()) }
    });
    place.assert_clean();
}
