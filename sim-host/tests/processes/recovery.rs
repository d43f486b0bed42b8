//! Peers that leave and return, and peers that are refused.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::time::{Duration, Instant};

use leg_host::Domain;
use rustix::process::Signal;

use super::place::Place;
use super::{ENDLESS, LONG_TIMEOUT, SHORT, SOON};

/// Long enough to be interrupted: more than a second on any machine.
const LONG_RUN: [&str; 4] = ["--duration", "400", "--timeout", "30"];

fn count(text: &str, part: &str) -> usize {
    text.matches(part).count()
}

#[test]
fn a_run_continues_with_the_next_controller() {
    let place = Place::new();
    let simulator = place.simulator(&LONG_RUN);
    let mut controller = place.controller(&LONG_TIMEOUT);
    place.wait_for_the_run(None);
    let first = controller.pid();
    controller.kill();
    let mut controller = place.controller(&LONG_TIMEOUT);
    place.wait_for_status(|status| status["ticks"].as_u64() > Some(0));
    // The second ends by a signal.
    let second = controller.pid();
    controller.signal(Signal::TERM);
    controller.end().assert(1, &["stopped by a signal"]);
    std::thread::sleep(Duration::from_millis(100));
    let third = place.controller(&LONG_TIMEOUT);
    let simulator = simulator.end();
    simulator.assert_ok();
    assert!(simulator.out.contains("400000 ticks"), "{}", simulator.out);
    let err = &simulator.err;
    assert_eq!(count(err, &format!("the controller (process {first}) died")), 1, "{err}");
    assert_eq!(count(err, &format!("the controller (process {second}) left")), 1, "{err}");
    assert_eq!((count(err, "is back"), err.lines().count()), (2, 4), "{err}");
    third.end().assert_ok();
    place.assert_clean();
}

#[test]
fn a_stopped_and_continued_controller_does_not_change_the_run() {
    let place = Place::new();
    let within = place.alone(&[&["--in-process"], &LONG_RUN[..]].concat()).end();
    let mut simulator = place.simulator(&LONG_RUN);
    let mut controller = place.controller(&LONG_TIMEOUT);
    place.wait_for_the_run(None);
    controller.signal(Signal::STOP);
    std::thread::sleep(Duration::from_millis(1300));
    controller.signal(Signal::CONT);
    // And the simulator, for which the controller waits.
    std::thread::sleep(Duration::from_millis(100));
    simulator.signal(Signal::STOP);
    std::thread::sleep(Duration::from_millis(1300));
    simulator.signal(Signal::CONT);
    let (simulator, controller) = (simulator.end(), controller.end());
    assert_eq!(simulator.assert_ok().state_hash(), within.assert_ok().state_hash());
    let err = &simulator.err;
    assert_eq!(count(err, "the controller is alive but has sent nothing for 1 s"), 1, "{err}");
    assert_eq!((count(err, "sends again after"), err.lines().count()), (1, 2), "{err}");
    let err = &controller.assert_ok().err;
    assert_eq!(count(err, "the simulator is alive but has sent nothing for 1 s"), 1, "{err}");
    assert_eq!((count(err, "sends again after"), err.lines().count()), (1, 2), "{err}");
    place.assert_clean();
}

#[test]
fn a_controller_serves_run_after_run_however_they_end() {
    let place = Place::new();
    let within = place.alone(&[&["--in-process"], &SHORT[..]].concat()).end();
    let mut controller = place.staying(&[]);
    let pid = controller.pid();
    for _ in 0..2 {
        let run = place.simulator(&[&SHORT[..], &LONG_TIMEOUT].concat()).end();
        assert_eq!(run.assert_ok().state_hash(), within.state_hash());
        assert_eq!(run.err, "");
    }
    let mut killed = place.simulator(&ENDLESS);
    let dead = killed.pid();
    place.wait_for_status(|status| status["peer"]["pid"] == dead);
    killed.kill();
    place.wait_for_status(|status| status["activity"] == "waiting");
    // A peer with other parameters is refused, and the controller stays.
    let misfit = place.simulator(&["--rate", "2000", "--timeout", "30"]).end();
    misfit.assert(1, &["the controller runs at 1000 Hz, this program at 2000 Hz"]);
    let run = place.simulator(&[&SHORT[..], &LONG_TIMEOUT].concat()).end();
    assert_eq!(run.assert_ok().state_hash(), within.state_hash(), "as if nothing had been");
    let status = place.status();
    assert_eq!(status["pid"], pid);
    assert!(status["peer"]["connections"].as_u64() == Some(4), "{status}");

    controller.signal(Signal::TERM);
    let controller = controller.end();
    let err = &controller.assert_ok().err;
    assert_eq!(count(err, &format!("the simulator (process {dead}) died")), 1, "{err}");
    assert_eq!(count(err, "the simulator runs at 2000 Hz"), 1, "{err}");
    assert_eq!(count(&controller.out, "20000 ticks"), 3, "{}", controller.out);
    place.assert_clean();
}

/// The first line of a program of a later release.
const HELLO: &str = r#"{"hello":{"pid":7,"params":{"wire_version":9,"rate_hz":1000,"gravity_m_s2":9.81,"leg":null,"time_mode":null,"novelty":3},"novelty":3}}"#;

#[test]
fn refuses_a_peer_of_another_wire_version() {
    let place = Place::new();
    let domain = Domain::join(place.domain()).expect("a domain");
    let path = domain.root().join("session.sock");
    let other_leg = |version: &str| {
        let deadline = Instant::now() + SOON;
        let mut socket = loop {
            match UnixStream::connect(&path) {
                Ok(socket) => break socket,
                Err(cause) => assert!(Instant::now() < deadline, "{cause}"),
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        writeln!(socket, "{}", HELLO.replace(":9,", version)).unwrap();
        // It learns about the controller, too.
        let mut answer = String::new();
        BufReader::new(&socket).read_line(&mut answer).unwrap();
        assert!(answer.contains(r#""wire_version":2"#), "{answer}");
        socket
    };
    let controller = place.controller(&LONG_TIMEOUT);
    drop(other_leg(":9,"));
    let parts = ["the simulator uses version 9", "this program version 2", "the same release"];
    controller.end().assert(1, &parts);
    // A controller that stays reports that once.
    let mut staying = place.staying(&[]);
    let leg = other_leg(":9,");
    place.wait_for_status(|status| status["activity"] == "waiting");
    drop(leg);
    drop(other_leg(":1,"));
    staying.signal(Signal::TERM);
    let staying = staying.end();
    let err = &staying.assert_ok().err;
    for version in ["9", "1"] {
        assert_eq!(count(err, &format!("the simulator uses version {version}")), 1, "{err}");
    }

    let listener = UnixListener::bind(&path).expect("a socket");
    let simulator = place.simulator(&LONG_TIMEOUT);
    writeln!(listener.accept().expect("a leg").0, "{HELLO}").unwrap();
    simulator.end().assert(1, &["the controller uses version 9", "this program version 2"]);
    drop(domain);
    place.assert_clean();
}

#[test]
fn reports_that_processes_of_two_users_cannot_connect() {
    if !requirements::root() {
        return;
    }
    let place = Place::new();
    let mut controller = place.staying(&[]);
    place.wait_for_status(|status| status["activity"] == "waiting");
    let apart = "user 0 has domains here too, and processes of two users cannot connect";
    for arguments in [
        &["run", "--domain", place.domain(), "--timeout", "0.2"][..],
        &["controller", "status", "--domain", place.domain()],
    ] {
        place.start_as_nobody(arguments).end().assert(1, &["no controller", apart]);
    }
    controller.signal(Signal::TERM);
    controller.end().assert_ok();
    place.assert_clean();
}
