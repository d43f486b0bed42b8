//! A flashed controller instead of a controller process: real processes over shared
//! memory, and the flashed controller's code behind a socket on a thread.

use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use leg_control::serial::message::{Mode, Request, Slot};
use leg_host::flash::MemoryFlash;
use leg_host::serial::client::{Client, IDENTIFY_TIMEOUT};
use leg_host::serial::stream::over_unix;
use leg_host::serial::{Endpoint, VirtualBoard};
use leg_process::Stop;
use rustix::process::Signal;
use serde_json::Value;

use super::SOON;
use super::place::{Place, Running, text};

const TICKS: u64 = 10_000;
const RUN: [&str; 6] = ["--duration", "10", "--start-vx", "0.2", "--timeout", "30"];

/// Returns the options of a bridge in the domain of a place.
fn options(place: &Place) -> [&str; 4] {
    ["--domain", place.domain(), "--timeout", "30"]
}

/// A disturbance of a board.
#[derive(Clone, Copy, Debug)]
enum Disturbance {
    /// The line is unplugged; the board keeps running.
    Unplug,
    /// The board is reset; the line stays open.
    Reset,
    /// The board is reset and the line unplugged.
    PowerCut,
}

/// A board behind a socket, with disturbances.
struct Board {
    path: PathBuf,
    on: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Board {
    /// Starts a board with the place's policy in slot A. Each disturbance comes after
    /// this many reads from the line since the one before, about one message each.
    fn new(place: &Place, disturbances: &[(u64, Disturbance)]) -> Self {
        let path = place.policy().with_file_name("board");
        let listener = UnixListener::bind(&path).unwrap();
        listener.set_nonblocking(true).unwrap();
        let policy = std::fs::read(place.policy()).unwrap();
        let board = VirtualBoard::power_up(MemoryFlash::new().loaded(Slot::A, &policy));
        let on = Arc::new(AtomicBool::new(true));
        let (goes_on, disturbances) = (Arc::clone(&on), disturbances.to_vec());
        let thread = std::thread::spawn(move || live(board, &listener, &disturbances, &goes_on));
        Self { path, on, thread: Some(thread) }
    }

    fn socket(&self) -> &str {
        text(&self.path)
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        self.on.store(false, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

fn live(
    mut board: VirtualBoard,
    listener: &UnixListener,
    disturbances: &[(u64, Disturbance)],
    on: &AtomicBool,
) {
    let mut disturbances = disturbances.iter();
    let mut next = disturbances.next();
    let mut reads = 0;
    while on.load(Ordering::Relaxed) {
        let Ok((socket, _)) = listener.accept() else {
            std::thread::sleep(Duration::from_millis(2));
            continue;
        };
        let mut stream = over_unix(socket).unwrap();
        loop {
            let due = |reads| next.is_some_and(|(after, _)| reads >= *after);
            board
                .serve(&mut *stream, || {
                    reads += 1;
                    on.load(Ordering::Relaxed) && !due(reads)
                })
                .unwrap();
            if !due(reads) {
                break; // The caller has hung up.
            }
            let disturbance = next.map(|(_, disturbance)| *disturbance);
            (next, reads) = (disturbances.next(), 0);
            if matches!(disturbance, Some(Disturbance::Reset | Disturbance::PowerCut)) {
                board.power_cycle();
            }
            if !matches!(disturbance, Some(Disturbance::Reset)) {
                break;
            }
        }
    }
}

fn bridge(place: &Place, board: &Board, arguments: &[&str]) -> Running {
    place.start(
        "bridge",
        &[&["--unix", board.socket(), "--json"], &options(place)[..], arguments].concat(),
    )
}

/// Returns the hash of the run with a controller in the simulator's process.
fn expected(place: &Place) -> String {
    place.alone(&[&["--in-process"], &RUN[..]].concat()).end().assert_ok().state_hash()
}

/// Parses the report of a bridge.
#[track_caller]
fn report(ended: &super::place::Ended) -> Value {
    serde_json::from_str(&ended.assert_ok().out).expect("JSON")
}

fn number(report: &Value, pointer: &str) -> u64 {
    report.pointer(pointer).and_then(Value::as_u64).unwrap_or_else(|| panic!("{pointer}: {report}"))
}

/// Asserts that the counts of the bridge agree with each other and the controller's.
#[track_caller]
fn assert_counts_add_up(report: &Value) {
    let number = |pointer| number(report, pointer);
    let said_again = number("/sent/sample_retries") + number("/sent/request_retries");
    let replies = number("/sent/replies");
    assert_eq!(number("/sent/frames_out"), TICKS + replies + said_again, "{report}");
    assert_eq!((number("/ticks"), number("/sent/commands")), (TICKS, TICKS), "{report}");
    let heard = TICKS + number("/sent/repeats") + replies + number("/sent/stale");
    assert_eq!(number("/received/frames"), heard, "{report}");
    assert_eq!(number("/controller/ticks"), TICKS, "{report}");
    // Every good frame was a tick, a request of the run's or one of either said again.
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
    assert_eq!(number(&report, "/controller/ticks"), TICKS, "none was done twice");
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

/// Runs longer than its test, but not than its controller.
const IMPATIENT: [&str; 4] = ["--duration", "80000", "--timeout", "1"];

#[test]
fn ends_on_unplug_if_configured_or_after_the_timeout() {
    let place = Place::new();
    let board = Board::new(&place, &[(2000, Disturbance::Unplug)]);
    let first = bridge(&place, &board, &["--on-unplug", "end"]);
    let run = place.simulator(&IMPATIENT);
    first.end().assert(1, &["the line to the controller broke", "--on-unplug reconnect"]);
    run.end().assert(1, &["the controller", "left before the run was over"]);

    let second = place.start(
        "bridge",
        &["--unix", board.socket(), "--domain", place.domain(), "--timeout", "0.7"],
    );
    let run = place.simulator(&IMPATIENT);
    place.wait_for_the_run(None);
    std::fs::remove_file(&board.path).unwrap();
    drop(board);
    second
        .end()
        .assert(1, &["warning: the line", "the line was not back after", "board", "--timeout"]);
    run.end().assert(1, &["left before the run was over"]);
    place.assert_clean();
}

#[test]
fn two_bridges_run_independently() {
    let place = Place::new();
    let board = Board::new(&place, &[]);
    let mut first = bridge(&place, &board, &[]);
    let run = place.simulator(&IMPATIENT);
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
    run.end().assert(1, &["left before the run was over"]);
    // It was left in good order.
    let mut client =
        Client::new(Endpoint::Unix(board.path.clone()).open().unwrap(), &Stop::default());
    assert_eq!(client.identify(IDENTIFY_TIMEOUT).unwrap().mode, Mode::Idle);
    place.assert_clean();
}

/// Sends a request to the controller by the `controller` program.
fn request(place: &Place, socket: &Path, arguments: &[&str]) -> Value {
    let all = [arguments, &["--unix", text(socket), "--json"]].concat();
    report(&place.start("controller", &all).end())
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
    let wait_for_socket = || {
        let start_time = Instant::now();
        while !Endpoint::Unix(socket.clone()).open().is_ok_and(|stream| {
            Client::new(stream, &Stop::default()).identify(IDENTIFY_TIMEOUT).is_ok()
        }) {
            assert!(start_time.elapsed() < SOON, "no board behind the socket");
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    wait_for_socket();
    let refused = bridge(&place, &board, &share).end();
    refused.assert(1, &["another process listens on", text(&socket), "--share names the socket"]);

    let long = ["--duration", "100", "--start-vx", "0.2", "--timeout", "30"];
    let run = place.simulator(&long);
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
        Request::Reset { session: 1, rate_hz: 1000, gravity_m_s2: 9.81 },
    ] {
        let refused = client.have_done(&request).unwrap_err().to_string();
        assert!(refused.contains("the run belongs to the program"), "{refused}");
    }

    let run = run.end();
    let report = report(&bridge_on.end());
    assert!(!socket.exists(), "the bridge removes its socket");
    assert_eq!(number(&report, "/controller/swaps"), 2, "{report}");
    assert!(number(&report, "/shared_requests") >= 10, "{report}");
    // The same policy, so the run must be equal bit for bit.
    let alone = place.alone(&[&["--in-process"], &long[..]].concat()).end();
    assert_eq!(run.assert_ok().state_hash(), alone.assert_ok().state_hash());
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

#[test]
fn names_a_missing_or_silent_board_with_a_hint() {
    let place = Place::new();
    let path = place.policy().with_file_name("mute");
    let start = |arguments: &[&str]| place.start("bridge", arguments);
    start(&["--unix", text(&path)]).end().assert(1, &[text(&path), "nobody listens there"]);
    let _mute = UnixListener::bind(&path).unwrap();
    let mute = start(&["--unix", text(&path)]).end();
    mute.assert(1, &["no answer for", "powered"]);
    assert!(mute.took >= IDENTIFY_TIMEOUT && mute.took < SOON);
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
    controller(&["identify"])
        .assert(1, &["no controller is running in domain `default`", "--serial"]);
    controller(&["identify", "--unix", "nowhere"]).assert(1, &["nobody listens there"]);
    controller(&["--rate", "500", "identify", "--unix", "nowhere"])
        .assert(2, &["identify", "--rate"]);
    place.assert_clean();
}

#[test]
fn connects_to_the_virtual_board_program() {
    let place = Place::new();
    let socket = place.policy().with_file_name("virtual");
    let arguments = ["virtual-board", "--unix", text(&socket), "--empty"];
    let mut board = place.start("controller", &arguments);
    let start_time = Instant::now();
    while !socket.exists() {
        assert!(start_time.elapsed() < SOON);
        std::thread::sleep(Duration::from_millis(5));
    }
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
