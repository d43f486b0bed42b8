//! A board on a serial port, here a pseudo-terminal, that other programs use, too.

use std::io::Write;
use std::os::unix::fs::chown;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use leg_host::serial::port::other_users;
use rustix::process::Signal;

use super::board::terminal;
use super::{Board, Disturbance, RUN, bridge, expected, number, report};
use crate::place::{NOBODY, Place, text, wait_until};

#[test]
fn a_run_continues_after_the_settings_have_changed_and_the_board_has_come_back() {
    let place = Place::new();
    let disturbances = [
        (2000, Disturbance::ChangeSettings),
        (2000, Disturbance::Unplug),
        (2000, Disturbance::ChangeSettings),
    ];
    let board = Board::on_terminal(&place, &disturbances);
    let bridge = bridge(&place, &board, &[]);
    let run = place.simulator(&RUN).end();
    let bridge = bridge.end();
    println!("{}", bridge.err);
    assert_eq!(run.assert_ok().state_hash(), expected(&place));
    let report = report(&bridge);
    assert_eq!((number(&report, "/reconnects"), number(&report, "/reboots")), (3, 0), "{report}");
    let changed = "another program has changed the settings of the port";
    assert_eq!(bridge.err.matches(changed).count(), 2, "{}", bridge.err);
    place.assert_clean();
}

/// A terminal whose board sends noise all the time, all of which `cat` may read.
struct Shared {
    cat: Child,
    on: Arc<AtomicBool>,
    noise: Option<JoinHandle<()>>,
}

impl Shared {
    fn start(place: &Place) -> Self {
        let path = place.file("tty");
        let mut master = terminal(&path);
        let cat = Command::new("cat")
            .arg(&path)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let on = Arc::new(AtomicBool::new(true));
        let goes_on = Arc::clone(&on);
        let noise = std::thread::spawn(move || {
            while goes_on.load(Ordering::Relaxed) {
                master.write_all(b"\0noise\n").unwrap();
                std::thread::sleep(Duration::from_micros(200));
            }
        });
        Self { cat, on, noise: Some(noise) }
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        // `cat` reads to the end, so that the writer is not blocked.
        self.on.store(false, Ordering::Relaxed);
        self.noise.take().unwrap().join().unwrap();
        self.cat.kill().unwrap();
        self.cat.wait().unwrap();
    }
}

/// Waits until a bridge has the port open.
#[track_caller]
fn wait_for_bridge(place: &Place) {
    let is_user = |user: &String| user.starts_with("sim-host");
    wait_until(|| {
        let is_open = other_users(&place.file("tty")).iter().any(is_user);
        if is_open { Ok(()) } else { Err("no bridge has opened the port".to_owned()) }
    });
}

#[test]
fn ends_in_time_and_names_the_other_program_that_reads_the_port() {
    let place = Place::new();
    let shared = Shared::start(&place);
    let port = place.file("tty");
    let start = || {
        let own = ["--domain", place.domain(), "--timeout", "1"];
        place.start("bridge", &[&["--serial", text(&port)], &own[..]].concat())
    };
    let named = format!("cat (process {}) has the port open, too", shared.cat.id());
    start().end().assert(1, &[named]);
    let mut bridge = start();
    wait_for_bridge(&place);
    bridge.signal(Signal::TERM);
    bridge.end().assert(1, &["stopped by a signal"]);
    drop(shared);
    place.assert_clean();
}

/// The exclusive mode of a terminal outlives a killed process. It does not stop the superuser.
#[test]
fn opens_the_port_of_a_bridge_that_was_killed() {
    if !requirements::root() {
        return;
    }
    let place = Place::new();
    let board = Board::on_terminal(&place, &[]);
    chown(&board.path, Some(NOBODY), Some(NOBODY)).unwrap();
    let start = |domain, timeout| {
        let domain = ["--domain", domain, "--timeout", timeout];
        place.start_as_nobody(&[&["bridge"], &board.option()[..], &domain].concat())
    };
    let (domain, other) = (place.domain(), format!("{}-other", place.domain()));
    let first = start(domain, "30");
    // By then it has locked the port.
    first.wait_for_message("still waiting");
    start(&other, "30").end().assert(1, &["sim-host (process ", "has the port open"]);
    first.kill();
    start(domain, "1").end().assert(1, &["no simulator in domain"]);
    place.assert_clean();
}
