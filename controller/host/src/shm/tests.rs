use super::*;
use crate::card::Pace;
use leg_control::leg::LegModel;

const SHORT: Duration = Duration::from_millis(50);
const LONG: Duration = Duration::from_secs(10);

fn domain(dir: &tempfile::TempDir) -> Arc<Domain> {
    Domain::join_in(&dir.path().join("base"), "d").unwrap()
}

/// What both sides say when their terms differ.
fn refusals(leg: Terms, controller: Terms) -> (ConnectError, ConnectError) {
    let dir = tempfile::tempdir().unwrap();
    std::thread::scope(|scope| {
        let controlling = scope.spawn(|| {
            ShmController::connect(&domain(&dir), controller, LONG, &Stop::default()).err()
        });
        let played = ShmLeg::connect(&domain(&dir), leg, LONG, &Stop::default()).err();
        (played.expect("refused"), controlling.join().unwrap().expect("refused"))
    })
}

#[test]
fn another_wire_version_is_refused_on_both_sides() {
    let ours = Terms::at(1000);
    let next = Terms { wire_version: ours.wire_version + 1, ..ours };
    let (leg, controller) = refusals(ours, next);
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
fn another_gravity_is_refused_on_both_sides() {
    let earth = Terms::at(1000);
    let (leg, controller) = refusals(earth.with_gravity(1.62), earth);
    for (message, parts) in [
        (leg.to_string(), ["the controller", "9.81 m/s2, this program under 1.62 m/s2"]),
        (controller.to_string(), ["the simulator", "1.62 m/s2, this program under 9.81 m/s2"]),
    ] {
        for part in parts.into_iter().chain(["--gravity"]) {
            assert!(message.contains(part), "`{part}` in {message}");
        }
    }
}

#[test]
fn another_pace_is_refused_on_both_sides_unless_one_leaves_it_open() {
    let lock_step = Terms::at(1000);
    let (leg, controller) = refusals(lock_step.with_pace(Pace::RealTime), lock_step);
    for (message, part) in [
        (leg.to_string(), "the controller runs in lock-step, this program in real time"),
        (controller.to_string(), "the simulator runs in real time, this program in lock-step"),
    ] {
        assert!(message.contains(part) && message.contains("--real-time"), "{message}");
    }
    for any in [lock_step, lock_step.with_pace(Pace::RealTime), lock_step.with_any_pace()] {
        assert!(disagreement(Role::Leg, any, lock_step.with_any_pace()).is_none());
        assert!(disagreement(Role::Leg, lock_step.with_any_pace(), any).is_none());
    }
}

#[test]
fn another_leg_is_told_and_not_refused() {
    let dir = tempfile::tempdir().unwrap();
    let trained = Terms::at(1000).with_leg(&LegModel::HUMAN);
    let played = Terms::at(1000).with_leg(&LegModel { mass_kg: 70.0, ..LegModel::HUMAN });
    std::thread::scope(|scope| {
        let (met, wait) = std::sync::mpsc::channel();
        let dir = &dir;
        let controlling = scope.spawn(move || {
            let link = ShmController::connect(&domain(dir), trained, LONG, &Stop::default());
            let leg = link.as_ref().map(ShmLink::peer_leg).ok();
            // It stays until the leg has seen it.
            wait.recv().unwrap();
            leg
        });
        let link = ShmLeg::connect(&domain(dir), played, LONG, &Stop::default());
        met.send(()).unwrap();
        // It too stays until the controller has seen it.
        let link = link.unwrap();
        assert_eq!(controlling.join().unwrap(), Some(played.leg));
        assert_eq!(link.peer_leg(), trained.leg);
    });
}

/// A peer that keeps no card, as a later version may not: the services tell.
#[test]
fn a_service_of_another_version_is_refused_also_without_a_card() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let node = NodeBuilder::new()
        .config(&config(&domain).unwrap())
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .unwrap();
    let next = Terms { wire_version: 2, ..Terms::at(1000) };
    let _theirs = service::<Sample>(&node, &domain, next).unwrap();
    let refused = ShmLeg::connect(&domain, Terms::at(1000), SHORT, &Stop::default());
    let message = refused.expect_err("refused").to_string();
    assert!(message.contains("another version") && message.contains("Attributes"), "{message}");
}

#[test]
fn a_missing_peer_is_waited_for_as_long_as_told_or_until_given_up() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let start = Instant::now();
    let missing = ShmLeg::connect(&domain, Terms::at(500), SHORT, &Stop::default());
    assert!(start.elapsed() >= SHORT);
    let message = missing.expect_err("nobody there").to_string();
    assert!(message.contains("no controller in domain `d`"), "{message}");
    assert!(message.contains("--rate 500 --gravity 9.81`"), "{message}");
    let real_time = Terms::at(500).with_pace(Pace::RealTime);
    let missing = ShmLeg::connect(&domain, real_time, SHORT, &Stop::default());
    let message = missing.expect_err("nobody there").to_string();
    assert!(message.contains("--gravity 9.81 --real-time`"), "{message}");

    let mut looks = 0;
    let given_up =
        ShmLeg::connect_watching(&domain, Terms::at(500), LONG, &Stop::default(), |missing| {
            assert_eq!(missing.peer, Role::Controller);
            looks += 1;
            looks < 3
        });
    assert!(matches!(given_up, Err(ConnectError::PeerMissing(_))));
    assert_eq!(looks, 3);

    let stop = Stop::default();
    stop.raise();
    let stopped = ShmLeg::connect(&domain, Terms::at(500), LONG, &stop);
    assert!(matches!(stopped, Err(ConnectError::Stopped(Role::Controller))));
}
