use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::node::NodeBuilder;
use iceoryx2::prelude::{SignalHandlingMode, ipc};
use leg_control::leg::LegModel;
use leg_control::wire::Sample;
use leg_process::Stop;

use super::error::disagreement;
use super::service::{config, service};
use super::*;
use crate::discovery::Domain;
use crate::link::{Role, SessionParams, TimeMode};

const SHORT: Duration = Duration::from_millis(50);
const LONG: Duration = Duration::from_secs(10);

fn domain(dir: &tempfile::TempDir) -> Arc<Domain> {
    Domain::join_in(&dir.path().join("base"), "d").unwrap()
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
    let next = SessionParams { wire_version: ours.wire_version + 1, ..ours };
    let (leg, controller) = connect_errors(ours, next);
    assert!(
        matches!(leg, ConnectError::WireVersion { peer: Role::Controller, theirs, ours }
            if theirs == ours + 1),
        "{leg}"
    );
    assert!(
        matches!(controller, ConnectError::WireVersion { peer: Role::Leg, theirs, ours }
            if theirs + 1 == ours),
        "{controller}"
    );
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
        assert!(disagreement(Role::Leg, params, lock_step.with_any_time_mode()).is_none());
        assert!(disagreement(Role::Leg, lock_step.with_any_time_mode(), params).is_none());
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
            let leg = link.as_ref().map(ShmLink::peer_leg).ok();
            // Keep the link open until the leg has connected.
            wait.recv().unwrap();
            leg
        });
        let link = ShmLeg::connect(&domain(dir), simulated, LONG, &Stop::default());
        connected.send(()).unwrap();
        // Keep this link open until the controller has connected.
        let link = link.unwrap();
        assert_eq!(controller.join().unwrap(), Some(simulated.leg));
        assert_eq!(link.peer_leg(), trained.leg);
    });
}

/// A later version may publish no record; the attributes of the services then reveal it.
#[test]
fn rejects_a_service_of_another_version_without_a_record() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let node = NodeBuilder::new()
        .config(&config(&domain).unwrap())
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .unwrap();
    let ours = SessionParams::at(1000);
    let next = SessionParams { wire_version: ours.wire_version + 1, ..ours };
    let _theirs = service::<Sample>(&node, &domain, next).unwrap();
    let rejected = ShmLeg::connect(&domain, ours, SHORT, &Stop::default());
    let message = rejected.expect_err("an error").to_string();
    assert!(message.contains("another version") && message.contains("Attributes"), "{message}");
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
    let given_up = ShmLeg::connect_while(&domain, params, LONG, &Stop::default(), |missing| {
        assert_eq!((missing.peer, missing.rate_hz), (Role::Controller, 500));
        calls += 1;
        calls < 3
    });
    assert!(matches!(given_up, Err(ConnectError::PeerMissing(_))));
    assert_eq!(calls, 3);

    let stop = Stop::default();
    stop.raise();
    let stopped = ShmLeg::connect(&domain, params, LONG, &stop);
    assert!(matches!(stopped, Err(ConnectError::Stopped(Role::Controller))));
}
