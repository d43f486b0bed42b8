//! A flashed controller instead of a controller process: real processes over shared
//! memory, and the flashed controller's code behind a line on a thread.

mod board;
mod failures;
mod port;
mod requests;

use leg_control::serial::message::Mode;
use leg_host::serial::Endpoint;
use leg_host::serial::client::{Client, IDENTIFY_TIMEOUT};
use leg_process::Stop;
use rustix::process::Signal;
use serde_json::Value;

use super::ENDLESS;
use super::place::{Ended, Place, Running};
pub(super) use board::Board;
use board::Disturbance;

const TICKS: u64 = 10_000;
const RUN: [&str; 6] = ["--duration", "10", "--start-vx", "0.2", "--timeout", "30"];

/// Returns the options of a bridge in the domain of a place.
fn options(place: &Place) -> [&str; 4] {
    ["--domain", place.domain(), "--timeout", "30"]
}

pub(super) fn bridge(place: &Place, board: &Board, arguments: &[&str]) -> Running {
    place.start("bridge", &[&board.option()[..], &["--json"], &options(place), arguments].concat())
}

/// Returns the hash of the run with a controller in the simulator's process.
fn expected(place: &Place) -> String {
    place.alone(&[&["--in-process"], &RUN[..]].concat()).end().assert_ok().state_hash()
}

/// Asserts that the run has lost its controller, for which it waits, and ends it.
#[track_caller]
fn assert_lost_its_controller(mut run: Running) {
    run.wait_for_message("left before the run was over");
    run.signal(Signal::INT);
    run.end().assert(1, &["stopped by a signal"]);
}

/// Parses the report of a bridge.
#[track_caller]
fn report(ended: &Ended) -> Value {
    serde_json::from_str(&ended.assert_ok().out).expect("JSON")
}

fn number(report: &Value, pointer: &str) -> u64 {
    report.pointer(pointer).and_then(Value::as_u64).unwrap_or_else(|| panic!("{pointer}: {report}"))
}

/// Asserts that the counts of the bridge agree with each other and the controller's.
#[track_caller]
fn assert_counts_add_up(report: &Value) {
    let number = |pointer| number(report, pointer);
    let retransmitted = number("/sent/sample_retries") + number("/sent/request_retries");
    let replies = number("/sent/replies");
    assert_eq!(number("/sent/frames_out"), TICKS + replies + retransmitted, "{report}");
    assert_eq!((number("/ticks"), number("/sent/commands")), (TICKS, TICKS), "{report}");
    let received = TICKS + number("/sent/repeats") + replies + number("/sent/stale");
    assert_eq!(number("/received/frames"), received, "{report}");
    assert_eq!(number("/controller/ticks"), TICKS, "{report}");
    // Every good frame was a tick, a request of the run's, or a retransmission of either.
    let good = number("/controller/line/frames");
    let known = TICKS + number("/controller/repeated");
    assert!(known <= good && good <= known + replies + 3, "{report}");
    assert_eq!(number("/received/unknown") + number("/controller/line/unknown"), 0, "{report}");
}

#[test]
fn a_flashed_controller_gives_the_run_of_a_process_without_lost_messages() {
    let place = Place::new();
    let board = Board::new(&place, &[]);
    let bridge = bridge(&place, &board, &[]);
    let run = place.simulator(&RUN).end();
    let bridge = bridge.end();
    assert_eq!(run.assert_ok().state_hash(), expected(&place));
    assert_eq!((run.err.as_str(), bridge.err.as_str()), ("", ""));

    let report = report(&bridge);
    assert_counts_add_up(&report);
    assert_eq!(number(&report, "/sent/frames_out"), number(&report, "/received/frames"));
    for none in [
        "/received/crc_errors",
        "/received/malformed",
        "/controller/line/crc_errors",
        "/controller/line/malformed",
        "/controller/missed",
        "/controller/lost_bytes",
        "/reconnects",
        "/reboots",
    ] {
        assert_eq!(number(&report, none), 0, "{none}: {report}");
    }
    assert_eq!(report["policy"], "hop in place");
    assert!(report["round_trip_us"]["p50"].as_f64() > report["own_share_us"]["p50"].as_f64());
    place.assert_clean();
}

#[test]
fn noise_on_the_line_does_not_change_the_run() {
    let place = Place::new();
    let board = Board::new(&place, &[]);
    let bridge = bridge(&place, &board, &["--noise", "0.01", "--noise-seed", "5"]);
    let run = place.simulator(&RUN).end();
    let report = report(&bridge.end());
    assert_eq!(run.assert_ok().state_hash(), expected(&place));
    assert_counts_add_up(&report);
    for some in [
        "/received/crc_errors",
        "/received/resyncs",
        "/controller/line/crc_errors",
        "/controller/line/resyncs",
        "/sent/sample_retries",
    ] {
        assert!(number(&report, some) > TICKS / 10, "{some}: {report}");
    }
    place.assert_clean();
}

#[test]
fn a_run_continues_after_the_line_is_reconnected() {
    let place = Place::new();
    let board = Board::new(&place, &[(2000, Disturbance::Unplug), (3000, Disturbance::Unplug)]);
    let bridge = bridge(&place, &board, &[]);
    let run = place.simulator(&RUN).end();
    let bridge = bridge.end();
    assert_eq!(run.assert_ok().state_hash(), expected(&place));
    let report = report(&bridge);
    assert_eq!((number(&report, "/reconnects"), number(&report, "/reboots")), (2, 0));
    assert_eq!(number(&report, "/controller/ticks"), TICKS, "no tick was run twice");
    assert_eq!(bridge.err.matches("the line is back").count(), 2, "{}", bridge.err);
    place.assert_clean();
}

#[test]
fn a_reset_controller_restarts_within_the_run() {
    for (disturbance, reconnects) in [(Disturbance::PowerCut, 1), (Disturbance::Reset, 0)] {
        let place = Place::new();
        let board = Board::new(&place, &[(3000, disturbance)]);
        let bridge = bridge(&place, &board, &[]);
        let run = place.simulator(&[&RUN[..], &["--json"]].concat()).end();
        let bridge = bridge.end();
        let report = report(&bridge);
        assert_eq!(number(&report, "/reconnects"), reconnects, "{disturbance:?}");
        assert_eq!(number(&report, "/reboots"), 1, "{disturbance:?}");
        let warning = "warning: the controller was reset in the middle of the run";
        assert_eq!(bridge.err.matches(warning).count(), 1, "{}", bridge.err);
        // Safe until the next apex, and hopping from there.
        let played: Value = serde_json::from_str(&run.assert_ok().out).expect("JSON");
        assert_eq!(number(&played, "/ticks"), TICKS);
        assert!(number(&played, "/safe_ticks") < TICKS / 4, "{played}");
        let ticks = number(&report, "/controller/ticks");
        assert!(ticks < TICKS - 2000 && ticks > TICKS / 2, "since the reset: {report}");
        place.assert_clean();
    }
}

#[test]
fn two_bridges_run_independently() {
    let place = Place::new();
    let board = Board::new(&place, &[]);
    let mut first = bridge(&place, &board, &[]);
    let run = place.simulator(&ENDLESS);
    place.wait_for_the_run(None);
    // A board has one line.
    bridge(&place, &board, &[]).end().assert(1, &["no answer for"]);
    // A domain has one controller.
    let elsewhere = Place::new();
    let other = Board::new(&elsewhere, &[]);
    let taken = format!("already running in domain `{}` (process {})", place.domain(), first.pid());
    bridge(&place, &other, &[]).end().assert(1, &[taken]);

    first.signal(Signal::INT);
    first.end().assert(1, &["stopped by a signal"]);
    assert_lost_its_controller(run);
    // The controller was left idle.
    let mut client =
        Client::new(Endpoint::Unix(board.path.clone()).open().unwrap(), &Stop::default());
    assert_eq!(client.identify(IDENTIFY_TIMEOUT).unwrap().mode, Mode::Idle);
    place.assert_clean();
}

#[test]
fn in_live_mode_the_boards_timer_ticks() {
    let place = Place::new();
    let board = Board::new(&place, &[]);
    let bridge = bridge(&place, &board, &["--mode", "live", "--rate", "200"]);
    let run = place.simulator(&["--rate", "200", "--duration", "1", "--timeout", "30"]).end();
    let report = report(&bridge.end());
    run.assert_ok();
    assert_eq!((report["mode"].as_str(), number(&report, "/ticks")), (Some("live"), 200));
    let ticks = number(&report, "/controller/ticks");
    assert!(ticks >= 200, "{report}");
    assert_eq!(ticks - number(&report, "/controller/missed"), 200, "{report}");
    // Real time: 200 ticks of 5 ms, less the wait for the first.
    assert!(report["ticks_per_s"].as_f64() < Some(202.0), "{report}");
    place.assert_clean();
}
