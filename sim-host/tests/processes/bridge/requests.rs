//! Requests of other programs to a controller whose line the bridge uses.

use std::os::unix::net::UnixListener;
use std::path::Path;

use leg_control::serial::message::{Mode, Request, SessionParams};
use leg_host::serial::Endpoint;
use leg_host::serial::client::{Client, IDENTIFY_TIMEOUT};
use leg_process::Stop;
use rustix::process::Signal;
use serde_json::Value;

use super::{Board, bridge, number, options, report};
use crate::ENDLESS;
use crate::place::{Place, text, wait_until};

/// Sends a request to the controller by the `controller` program.
fn request(place: &Place, socket: &Path, arguments: &[&str]) -> Value {
    let all = [arguments, &["--unix", text(socket), "--json"]].concat();
    report(&place.start("controller", &all).end())
}

/// Waits until a controller answers behind a socket: its file exists before anybody listens.
#[track_caller]
fn wait_for_board(socket: &Path) {
    wait_until(|| {
        let stream = Endpoint::Unix(socket.to_owned()).open().map_err(|cause| cause.to_string())?;
        let identity = Client::new(stream, &Stop::default()).identify(IDENTIFY_TIMEOUT);
        identity.map(|_| ()).map_err(|cause| cause.to_string())
    });
}

#[test]
fn uploads_and_rolls_back_a_policy_during_a_run() {
    let place = Place::new();
    let board = Board::new(&place, &[]);
    let socket = place.policy().with_file_name("share");
    // A killed bridge leaves its socket.
    drop(UnixListener::bind(&socket).unwrap());
    let share = ["--share", text(&socket)];
    let bridge_on = bridge(&place, &board, &share);
    wait_for_board(&socket);
    let refused = bridge(&place, &board, &share).end();
    refused.assert(1, &["another process listens on", text(&socket), "--share names the socket"]);

    let run = place.simulator(&[&ENDLESS[..], &["--start-vx", "0.2"]].concat());
    place.wait_for_the_run(None);
    let policy = place.policy();
    let done = request(&place, &socket, &["policy", "upload", text(&policy)]);
    assert_eq!((done["slot"].as_str(), done["name"].as_str()), (Some("B"), Some("hop in place")));
    assert!(done["swapped_after_s"].as_f64().is_some(), "{done}");
    let slots = request(&place, &socket, &["policy", "list"]);
    assert_eq!(slots.pointer("/slots/1/running"), Some(&true.into()), "{slots}");
    let back = request(&place, &socket, &["policy", "roll-back"]);
    assert_eq!(back["slot"], "A");
    assert!(back["swapped_after_s"].as_f64().is_some(), "{back}");
    let who = request(&place, &socket, &["identify"]);
    assert_eq!((who["mode"].as_str(), &who["policy"]["slot"]), (Some("lock-step"), &"A".into()));

    // Requests that would disturb the run are refused.
    let stream = Endpoint::Unix(socket.clone()).open().unwrap();
    let mut client = Client::new(stream, &Stop::default());
    for request in [
        Request::SetMode(Mode::Idle),
        Request::Reset {
            session: 1,
            params: SessionParams { rate_hz: 1000, gravity_m_s2: 9.81, ..SessionParams::default() },
        },
    ] {
        let refused = client.have_done(&request).unwrap_err().to_string();
        assert!(refused.contains("the run belongs to the program"), "{refused}");
    }

    place.end_the_run();
    let run = run.end();
    let report = report(&bridge_on.end());
    assert!(!socket.exists(), "the bridge removes its socket");
    assert_eq!(number(&report, "/controller/swaps"), 2, "{report}");
    assert!(number(&report, "/shared_requests") >= 10, "{report}");
    // The same policy, so the run must be equal bit for bit.
    let alone = place.alone_for(run.assert_ok().ticks(), &["--start-vx", "0.2"]);
    assert_eq!(run.state_hash(), alone.state_hash());
    place.assert_clean();
}

#[test]
fn connects_to_the_virtual_board_program() {
    let place = Place::new();
    let socket = place.policy().with_file_name("virtual");
    let arguments = ["virtual-board", "--unix", text(&socket), "--empty"];
    let mut board = place.start("controller", &arguments);
    wait_for_board(&socket);
    let slots = request(&place, &socket, &["policy", "list"]);
    assert_eq!(slots.pointer("/slots/0/fault"), Some(&"empty".into()), "{slots}");
    let bridge =
        place.start("bridge", &[&["--unix", text(&socket)], &options(&place)[..]].concat());
    let run = place.simulator(&["--duration", "1", "--timeout", "30"]).end();
    run.assert(0, &["never left its safe state"]);
    let bridge = bridge.end();
    bridge.assert(0, &["the controller has no policy", "policy upload"]);
    assert!(
        bridge.out.contains("1000 ticks") && bridge.out.contains("CRC errors"),
        "{}",
        bridge.out
    );
    board.signal(Signal::INT);
    board.end().assert_ok();
    assert!(!socket.exists());
    place.assert_clean();
}

#[test]
fn a_board_behind_a_bridge_answers_the_requests_to_its_domain() {
    let place = Place::new();
    let board = Board::new(&place, &[]);
    let bridge_on = bridge(&place, &board, &[]);
    let json = |arguments: &[&str]| -> Value {
        let ended = place.request(&[arguments, &["--json"]].concat());
        serde_json::from_str(&ended.assert_ok().out).expect("JSON")
    };
    // Also while the simulator is missing.
    place.wait_for_status(|status| status["board"] == "virtual");
    assert_eq!(json(&["identify"])["policy"]["name"], "hop in place");

    let run = place.simulator(&[&ENDLESS[..], &["--start-vx", "0.2"]].concat());
    place.wait_for_the_run(None);
    assert!(number(&place.status(), "/ticks") > 0);
    let policy = place.policy();
    let swap = place.request(&["swap", text(&policy)]);
    assert!(swap.assert_ok().out.contains("runs, instead of hop in place"), "{}", swap.out);
    let set_point = place.request(&["set-point", "0.3"]);
    assert!(set_point.assert_ok().out.contains("the set-point is 0.3 m/s"), "{}", set_point.out);
    place.request(&["set-point"]).assert_ok();
    place.request(&["set-point", "99"]).assert(2, &["-50 to 50 m/s"]);
    assert_eq!(json(&["policy", "roll-back"])["slot"], "A");
    assert_eq!(number(&place.status(), "/swaps"), 2);
    place.end_the_run();
    run.end().assert_ok();
    let report = report(&bridge_on.end());
    assert_eq!(number(&report, "/controller/swaps"), 2, "{report}");
    place.request(&["status"]).assert(1, &["no controller is running in domain"]);
    place.assert_clean();
}

/// A board serves one caller at a time, here the bridge.
#[test]
fn a_silent_board_that_a_bridge_uses_is_reported_with_the_domain_that_answers() {
    let place = Place::new();
    let board = Board::new(&place, &[]);
    let mut bridge_on = bridge(&place, &board, &[]);
    place.wait_for_status(|status| status["board"] == "virtual");
    let status = ["status", "--unix", board.socket(), "--timeout", "0.7"];
    let status = place.start("controller", &status).end();
    let bridge = "A bridge runs in the domain";
    status.assert(1, &["no answer for 0.7 s", bridge, place.domain(), "name its --domain"]);
    assert!(!status.err.contains("baud") && !status.err.contains("?;"), "{}", status.err);
    bridge_on.signal(Signal::TERM);
    bridge_on.end().assert(1, &["stopped by a signal"]);
    place.assert_clean();
}

/// A board cannot send its policy, and a recorder that asked for it all the time would load
/// the line.
#[test]
fn a_recorder_requests_the_policy_of_a_board_once() {
    let place = Place::new();
    let board = Board::new(&place, &[]);
    let bridge_on = bridge(&place, &board, &[]);
    let path = place.file("run.mcap");
    let run = ["--duration", "10", "--timeout", "30", "--record", text(&path)];
    place.simulator(&run).end().assert_ok();
    // On a busy machine the one request is sent again until its answer comes. Asked all the
    // time, it would be one every 10 ms of the run.
    let requests = number(&report(&bridge_on.end()), "/shared_requests");
    assert!(requests <= 8, "{requests} requests");
    place.start("replay", &[text(&path)]).end().assert(2, &["topic /policy", "bridge"]);
    let policy = place.policy();
    place.start("replay", &[text(&path), "--policy", text(&policy)]).end().assert_ok();
    place.assert_clean();
}
