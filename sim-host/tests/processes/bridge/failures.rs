//! What the bridge reports when a board, a simulator or an option is not as it must be.

use std::os::unix::net::UnixListener;

use leg_control::serial::message::{Alarm, Crash};
use leg_host::serial::client::IDENTIFY_TIMEOUT;

use super::{Board, Disturbance, assert_lost_its_controller, bridge};
use crate::ENDLESS;
use crate::place::{Place, text};

#[test]
fn ends_on_unplug_if_configured_or_after_the_timeout() {
    let place = Place::new();
    let board = Board::new(&place, &[(2000, Disturbance::Unplug)]);
    let first = bridge(&place, &board, &["--on-unplug", "end"]);
    let run = place.simulator(&ENDLESS);
    first.end().assert(1, &["the line to the controller broke", "--on-unplug reconnect"]);
    assert_lost_its_controller(run);

    // The simulator is there first, so that the short time is that for the line only.
    let run = place.simulator(&ENDLESS);
    run.wait_for_message("still waiting");
    let domain = ["--domain", place.domain(), "--timeout", "3"];
    let second = place.start("bridge", &[&board.option()[..], &domain].concat());
    place.wait_for_the_run(None);
    std::fs::remove_file(&board.path).unwrap();
    drop(board);
    second
        .end()
        .assert(1, &["warning: the line", "the line was not back after", "board", "--timeout"]);
    assert_lost_its_controller(run);
    place.assert_clean();
}

#[test]
fn names_a_missing_or_silent_board_with_a_hint() {
    let place = Place::new();
    let path = place.policy().with_file_name("mute");
    let start = |arguments: &[&str]| place.start("bridge", arguments);
    start(&["--unix", text(&path)]).end().assert(1, &[text(&path), "no process listens there"]);
    let _mute = UnixListener::bind(&path).unwrap();
    let mute = start(&["--unix", text(&path)]).end();
    mute.assert(1, &["no answer for 3.0 s", "does another program use it?"]);
    assert!(mute.took >= IDENTIFY_TIMEOUT, "{:?}", mute.took);
    let port = path.with_file_name("ttyACM7");
    start(&["--serial", text(&port)]).end().assert(1, &[text(&port), "2000000 baud", "plugged in"]);
    place.assert_clean();
}

#[test]
fn waits_for_a_missing_simulator_and_names_it() {
    let place = Place::new();
    let board = Board::new(&place, &[]);
    let bridge = place.start(
        "bridge",
        &[
            "--unix",
            board.socket(),
            "--domain",
            place.domain(),
            "--timeout",
            "3",
            "--gravity",
            "1.62",
        ],
    );
    bridge.end().assert(
        1,
        &[
            "still waiting",
            &format!("no simulator in domain `{}`", place.domain()),
            "sim-host run",
            "--gravity 1.62",
        ],
    );
    place.assert_clean();
}

#[test]
fn warns_once_of_a_policy_for_another_leg() {
    let place = Place::new();
    let board = Board::new(&place, &[]);
    let bridge = bridge(&place, &board, &[]);
    place.simulator(&["--leg", "crab", "--duration", "0.1", "--timeout", "30"]).end();
    let warning = "warning: the policy hop in place was trained for another leg";
    let bridge = bridge.end();
    assert_eq!(bridge.assert_ok().err.matches(warning).count(), 1, "{}", bridge.err);
    place.assert_clean();
}

#[test]
fn rejects_invalid_options_with_status_2() {
    let place = Place::new();
    let start = |arguments: &[&str]| place.start("bridge", arguments).end();
    start(&[]).assert(2, &["--serial", "--unix", "--tcp", "required"]);
    start(&["--unix", "a", "--tcp", "b:1"]).assert(2, &["cannot be used with"]);
    start(&["--unix", "a", "--baud", "9600"]).assert(2, &["--baud", "cannot be used with"]);
    start(&["--serial", "a", "--baud", "7"]).assert(2, &["--baud", "7", "9600"]);
    start(&["--tcp", "here"]).assert(2, &["--tcp", "here", "HOST:PORT"]);
    start(&["--unix", "a", "--rate", "7"]).assert(2, &["7 Hz", "50"]);
    start(&["--unix", "a", "--gravity", "-1"]).assert(2, &["gravity -1", "above 0"]);
    start(&["--unix", "a", "--noise", "2"]).assert(2, &["--noise", "2", "0.5"]);
    start(&["--unix", "a", "--mode", "b"]).assert(2, &["lock-step", "live"]);
    let board = Board::new(&place, &[]);
    start(&["--unix", board.socket(), "--domain", "a/b"])
        .assert(2, &["a/b", "is not a valid domain name"]);

    // A bad file is refused before anything is opened.
    let bad = place.policy().with_file_name("bad.bin");
    std::fs::write(&bad, "no policy").unwrap();
    let controller = |arguments: &[&str]| place.start("controller", arguments).end();
    let upload = ["policy", "upload", text(&bad), "--unix", "nowhere"];
    controller(&upload).assert(2, &["bad.bin is not a valid policy"]);
    controller(&["identify", "--domain", place.domain()])
        .assert(1, &["no controller is running in domain `test-", "--serial"]);
    controller(&["identify", "--unix", "nowhere"]).assert(1, &["no process listens there"]);
    controller(&["--rate", "500", "identify", "--unix", "nowhere"])
        .assert(2, &["identify", "--rate"]);
    place.assert_clean();
}

/// The board closes the line right after its alarm, so that the bridge's next write may fail
/// before the alarm is read.
#[test]
fn reports_the_alarm_of_a_board_that_crashes_and_not_only_the_broken_line() {
    for crash in [Crash::Panic { line: 7 }, Crash::HardFault { pc: 0x800 }] {
        let place = Place::new();
        let alarm = Alarm::Crash(crash);
        let board = Board::new(&place, &[(2000, Disturbance::Crash(alarm))]);
        let bridge = bridge(&place, &board, &[]);
        let run = place.simulator(&ENDLESS);
        bridge.end().assert(1, &[format!("the controller has raised an alarm: {alarm}")]);
        assert_lost_its_controller(run);
        place.assert_clean();
    }
}
