use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::time::{Duration, Instant};

use leg_control::leg::LegModel;
use leg_control::wire::{Command, Sample};
use leg_process::Stop;

use super::error::disagreement;
use super::hello::{Channel, Hello, Line, SOCKET};
use super::payload::{Message, Payload};
use super::service::{Ports, node};
use super::*;
use crate::discovery::{Domain, Session};
use crate::link::{Link, Role, SessionParams, TimeMode};
use crate::socket::SocketFile;

const SHORT: Duration = Duration::from_millis(50);
const LONG: Duration = Duration::from_secs(10);

fn domain(dir: &tempfile::TempDir) -> Arc<Domain> {
    Domain::join_in(&dir.path().join("base"), "d").unwrap()
}

#[track_caller]
fn assert_connects(leg: &mut ShmLeg, domain: &Arc<Domain>) {
    std::thread::scope(|scope| {
        let params = SessionParams::at(1000);
        let controller =
            scope.spawn(move || ShmController::connect(domain, params, LONG, &Stop::default()));
        leg.wait_for_peer(Some(LONG), |_| true).unwrap();
        drop(controller.join().unwrap().unwrap());
    });
}

/// Returns the errors of the leg and of the controller when their parameters differ.
fn connect_errors(leg: SessionParams, controller: SessionParams) -> (ConnectError, ConnectError) {
    let dir = tempfile::tempdir().unwrap();
    std::thread::scope(|scope| {
        let controller = scope.spawn(|| {
            ShmController::connect(&domain(&dir), controller, LONG, &Stop::default()).err()
        });
        let leg = ShmLeg::connect(&domain(&dir), leg, LONG, &Stop::default()).err();
        (leg.expect("an error"), controller.join().unwrap().expect("an error"))
    })
}

#[test]
fn both_sides_reject_another_wire_version() {
    let ours = SessionParams::at(1000);
    let before = SessionParams { wire_version: ours.wire_version - 1, ..ours };
    let (leg, controller) = connect_errors(ours, before);
    for (error, by, expected) in
        [(leg, Role::Controller, ("1", "2")), (controller, Role::Leg, ("2", "1"))]
    {
        assert!(
            matches!(&error, ConnectError::Disagreement { peer, parameter, theirs, ours }
                if (*peer, *parameter) == (by, Parameter::WireVersion)
                    && (&theirs[..], &ours[..]) == expected),
            "{error}"
        );
        assert!(error.to_string().contains("the same release"), "{error}");
    }
}

#[test]
fn both_sides_reject_another_gravity() {
    let earth = SessionParams::at(1000);
    let (leg, controller) = connect_errors(earth.with_gravity(1.62), earth);
    for (message, parts) in [
        (leg.to_string(), ["the controller", "9.81 m/s2, this program under 1.62 m/s2"]),
        (controller.to_string(), ["the simulator", "1.62 m/s2, this program under 9.81 m/s2"]),
    ] {
        for part in parts {
            assert!(message.contains(part), "`{part}` in {message}");
        }
    }
}

#[test]
fn both_sides_reject_another_time_mode_unless_one_accepts_any() {
    let lock_step = SessionParams::at(1000);
    let real_time = lock_step.with_time_mode(TimeMode::RealTime);
    let (leg, controller) = connect_errors(real_time, lock_step);
    for (message, part) in [
        (leg.to_string(), "the controller runs in lock-step, this program in real time"),
        (controller.to_string(), "the simulator runs in real time, this program in lock-step"),
    ] {
        assert!(message.contains(part), "{message}");
    }
    for params in [lock_step, real_time, lock_step.with_any_time_mode()] {
        let any = lock_step.with_any_time_mode();
        assert!(disagreement(Role::Leg, (1, params), (1, any)).is_none());
        assert!(disagreement(Role::Leg, (1, any), (1, params)).is_none());
    }
}

#[test]
fn another_leg_is_reported_and_not_rejected() {
    let dir = tempfile::tempdir().unwrap();
    let trained = SessionParams::at(1000).with_leg(&LegModel::HUMAN);
    let simulated =
        SessionParams::at(1000).with_leg(&LegModel { mass_kg: 70.0, ..LegModel::HUMAN });
    std::thread::scope(|scope| {
        let (connected, wait) = std::sync::mpsc::channel();
        let dir = &dir;
        let controller = scope.spawn(move || {
            let link = ShmController::connect(&domain(dir), trained, LONG, &Stop::default());
            let leg = link.as_ref().ok().and_then(|link| link.peer()?.leg);
            // Keep the link open until the leg has connected.
            wait.recv().unwrap();
            leg
        });
        let link = ShmLeg::connect(&domain(dir), simulated, LONG, &Stop::default());
        connected.send(()).unwrap();
        // Keep this link open until the controller has connected.
        let link = link.unwrap();
        assert_eq!(controller.join().unwrap(), simulated.leg);
        assert_eq!(link.peer().unwrap().leg, trained.leg);
    });
}

#[test]
fn a_process_that_does_not_follow_the_protocol_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    std::thread::scope(|scope| {
        let controller = scope.spawn(|| {
            ShmController::connect(&domain, SessionParams::at(1000), LONG, &Stop::default())
        });
        let mut stranger = loop {
            if let Ok(socket) = UnixStream::connect(domain.root().join(SOCKET)) {
                break socket;
            }
            std::thread::sleep(Duration::from_millis(1));
        };
        stranger.write_all(b"{\"greetings\":null}\n").unwrap();
        let message = controller.join().unwrap().unwrap_err().to_string();
        assert!(message.contains("not understood") && message.contains("greetings"), "{message}");
    });
}

/// A leg that is killed in the middle of connecting costs its controller nothing, and the
/// other way round: each side goes on with the next process.
#[test]
fn a_peer_that_ends_while_it_connects_is_forgotten() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let params = SessionParams::at(1000);
    let hello = |session| Line::Hello(Hello { pid: 7, session, ..Hello::of(params) });
    let mut controller = ShmController::open(&domain, params, &Stop::default()).unwrap();
    let update = |controller: &ShmController| controller.monitor().update().unwrap();
    let mut half_met = Vec::new();
    for lines in [vec![], vec![hello(None)], vec![hello(None), Line::Ready]] {
        let leg = Channel::new(UnixStream::connect(domain.root().join(SOCKET)).unwrap()).unwrap();
        for line in &lines {
            leg.send(line);
        }
        for _ in 0..2 {
            match update(&controller) {
                None => (),
                Some(PeerEvent::Failed(cause)) => half_met.push(cause.to_string()),
                other => panic!("{other:?}"),
            }
        }
        drop(leg);
        for _ in 0..3 {
            if let Some(event) = update(&controller) {
                let PeerEvent::Failed(cause) = event else { panic!("{event:?}") };
                half_met.push(cause.to_string());
            }
        }
        assert!(controller.peer().is_none());
    }
    let [left, no_ports] = &half_met[..] else { panic!("{half_met:?}") };
    let process = "process 7 has connected as the simulator, but";
    assert!(left.starts_with(&format!("{process} left before it was ready")), "{left}");
    let missing = "has no publisher at leg/samples and no subscriber at leg/commands";
    assert!(no_ports.starts_with(&format!("{process} {missing}")), "{no_ports}");
    assert!(no_ports.contains(domain.prefix()), "{no_ports}");
    std::thread::scope(|scope| {
        let leg = scope.spawn(|| ShmLeg::connect(&domain, params, LONG, &Stop::default()));
        controller.wait_for_peer(Some(LONG), |_| true).unwrap();
        drop(leg.join().unwrap().unwrap());
    });
    drop(controller);

    let mut leg = ShmLeg::open(&domain, params, &Stop::default()).unwrap();
    let (file, listener) = SocketFile::bind(&domain.root().join(SOCKET)).unwrap();
    let session = Session::begin(&domain).unwrap();
    for answer in [None, Some(session)] {
        assert!(leg.monitor().update().unwrap().is_none());
        let mut killed = Channel::new(listener.accept().unwrap().0).unwrap();
        assert_eq!(killed.next().unwrap().map(|line| matches!(line, Line::Hello(_))), Some(true));
        let ports = answer.as_ref().map(|s| Ports::<Command, Sample>::create(s).unwrap());
        if answer.is_some() {
            killed.send(&hello(answer));
            assert!(leg.monitor().update().unwrap().is_none());
            assert_eq!(killed.next().unwrap(), Some(Line::Ready));
        }
        drop(killed);
        let event = leg.monitor().update().unwrap();
        assert_eq!(matches!(event, Some(PeerEvent::Failed(_))), ports.is_some(), "{event:?}");
        drop(ports);
    }
    drop((file, listener));
    assert_connects(&mut leg, &domain);
}

/// Regression: a controller that ended while the leg opened the memory ended the leg's run.
#[test]
fn a_leg_whose_try_to_connect_failed_tries_again_and_names_the_cause() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let params = SessionParams::at(1000);
    let mut leg = ShmLeg::open(&domain, params, &Stop::default()).unwrap();
    let monitor = leg.monitor();
    let (file, listener) = SocketFile::bind(&domain.root().join(SOCKET)).unwrap();
    let session = Session::begin(&domain).unwrap();
    // Memory that no leg can open.
    let node = node(&session, "other").unwrap();
    let name = "leg/samples".try_into().unwrap();
    let _other = node.service_builder(&name).publish_subscribe::<u64>().create().unwrap();
    assert!(monitor.update().unwrap().is_none());
    let controller = Channel::new(listener.accept().unwrap().0).unwrap();
    controller.send(&Line::Hello(Hello { session: Some(session), ..Hello::of(params) }));
    let event = monitor.update().unwrap();
    let Some(PeerEvent::Failed(cause)) = event else { panic!("{event:?}") };
    let cause = cause.to_string();
    assert!(cause.contains("cannot create the shared memory in domain `d`"), "{cause}");
    drop((file, listener, controller));
    assert_connects(&mut leg, &domain);
}

#[test]
fn a_stranger_that_sends_nothing_or_is_rejected_keeps_no_leg_from_connecting() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let params = SessionParams::at(1000);
    let mut controller = ShmController::open(&domain, params, &Stop::default()).unwrap();
    let monitor = controller.monitor();
    let stranger = || UnixStream::connect(domain.root().join(SOCKET)).unwrap();
    let _silent = stranger();
    assert!(monitor.update().unwrap().is_none());
    let mut rejected = stranger();
    rejected.write_all(b"7\n").unwrap();
    assert!(matches!(monitor.update().unwrap(), Some(PeerEvent::Rejected(_))));
    assert!(monitor.update().unwrap().is_none(), "reported once");
    // Many strangers do not fill the log, nor keep the leg waiting for long.
    let mut many: Vec<_> = (0..100).map(|_| stranger()).collect();
    for stranger in &mut many {
        stranger.write_all(b"7\n").unwrap();
    }
    let reports = (0..100).filter(|_| monitor.update().unwrap().is_some()).count();
    assert!(reports < 10, "{reports}: at most one a second");
    std::thread::scope(|scope| {
        let leg = scope.spawn(|| ShmLeg::connect(&domain, params, LONG, &Stop::default()));
        controller.wait_for_peer(Some(LONG), |_| true).unwrap();
        // A stranger does not disturb a connected leg either.
        let _late = stranger();
        let leg = leg.join().unwrap().unwrap();
        assert!(monitor.update().unwrap().is_none());
        drop(leg);
    });
}

#[test]
fn a_peer_that_does_not_answer_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let params = SessionParams::at(1000);
    // It holds its role, but nobody calls its monitor, as if it were stopped.
    let _stopped = ShmController::open(&domain, params, &Stop::default()).unwrap();
    let message =
        ShmLeg::connect(&domain, params, SHORT, &Stop::default()).unwrap_err().to_string();
    let expected = format!("process {} has the role but has not answered", std::process::id());
    assert!(message.contains(&expected), "{message}");
}

#[test]
fn the_wait_for_a_peer_ends_at_its_timeout_or_when_given_up_or_stopped() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let params = SessionParams::at(500);
    let start = Instant::now();
    let missing = ShmLeg::connect(&domain, params, SHORT, &Stop::default());
    assert!(start.elapsed() >= SHORT);
    let message = missing.expect_err("no peer").to_string();
    assert!(message.contains("no controller in domain `d`"), "{message}");

    let mut calls = 0;
    let mut leg = ShmLeg::open(&domain, params, &Stop::default()).unwrap();
    let given_up = leg.wait_for_peer(Some(LONG), |missing| {
        assert_eq!((missing.peer, missing.params), (Role::Controller, params));
        calls += 1;
        calls < 3
    });
    assert!(matches!(given_up, Err(ConnectError::PeerMissing(_))));
    assert_eq!(calls, 3);
    drop(leg);

    let stop = Stop::default();
    stop.raise();
    let stopped = ShmLeg::connect(&domain, params, LONG, &stop);
    assert!(matches!(stopped, Err(ConnectError::Stopped(Role::Controller))));
}

/// A loop in Python holds its message until it has received the next.
#[test]
fn a_reader_may_hold_a_message_while_it_receives_the_next() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let params = SessionParams::at(1000);
    let (mut leg, _controller) = std::thread::scope(|scope| {
        let leg = scope.spawn(|| ShmLeg::connect(&domain, params, LONG, &Stop::default()));
        let controller = ShmController::connect(&domain, params, LONG, &Stop::default());
        (leg.join().unwrap().unwrap(), controller.unwrap())
    });
    let node = node(&Session::current(&domain).unwrap(), "reader").unwrap();
    let service = node.service_builder(&Sample::SERVICE.try_into().unwrap());
    let service = service.publish_subscribe::<Payload<Sample>>().open().unwrap();
    let reader = service.subscriber_builder().create().unwrap();
    let mut send = |seq| {
        let mut sample = Sample::default();
        sample.header.seq = seq;
        leg.send(&sample).unwrap();
    };
    send(1);
    let held = reader.receive().unwrap().unwrap();
    send(2);
    let next = reader.receive().expect("a second one").unwrap();
    assert_eq!((held.0.header.seq, next.0.header.seq), (1, 2));
}
