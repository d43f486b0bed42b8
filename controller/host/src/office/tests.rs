use super::*;
use crate::desk::requests::Moment;
use crate::desk::requests::Rejected;
use crate::fixture::{blob_of, manifest};
use leg_control::policy::SHIPPED;
use leg_control::wire::{Command, Header, Sample, WIRE_VERSION, flags};

fn open() -> (Operated, Office) {
    let windows = Windows { peer: Box::new(PeerStatus::default), timing: None };
    let policy = shelf::keep(SHIPPED).unwrap();
    let config = Config::at_rate(1000).unwrap();
    Office::open(policy, "the shipped policy", config, SessionParams::at(1000), windows)
}

fn other() -> Vec<u8> {
    blob_of(&manifest()).unwrap()
}

/// A leg that hops as if on rails, an apex every hundred ticks.
fn hopping(run_id: u32, seq: u64) -> Sample {
    let phase = core::f32::consts::TAU * (seq % 100) as f32 / 100.0;
    let y_m = 1.05 + 0.15 * phase.cos();
    let contact = if y_m < 0.99 { flags::IN_CONTACT } else { 0 };
    Sample {
        header: Header {
            version: WIRE_VERSION,
            flags: flags::CONTACT_SENSED | contact,
            run_id,
            seq,
            t_ns: seq * 1_000_000,
        },
        y_m,
        vy_m_s: -0.15 * core::f32::consts::TAU * 10.0 * phase.sin(),
        ..Sample::default()
    }
}

fn is_safe(command: &Command) -> bool {
    command.is_safe()
}

#[test]
fn a_swap_waits_for_the_apex_and_is_told_with_its_ticks() {
    let (mut controller, mut office) = open();
    for seq in 0..250 {
        controller.tick(Some(&hopping(7, seq)));
    }
    let swapping = office.swap("other.bin", &other()).unwrap();
    assert_eq!((swapping.number, swapping.policy.name.as_str()), (1, "test"));
    assert_ne!(swapping.instead_of.name, "test");
    controller.tick(Some(&hopping(7, 250)));
    let status = office.status();
    assert_eq!(status.pending.unwrap(), swapping.policy);
    assert_eq!((status.policy, status.swaps), (swapping.instead_of, 0));
    assert_eq!(office.news(), None);
    for seq in 251..=300 {
        assert!(!is_safe(&controller.tick(Some(&hopping(7, seq)))));
    }
    let status = office.status();
    assert_eq!((status.policy, status.swaps, status.pending), (swapping.policy, 1, None));
    assert_eq!(status.since, Some(Moment { run_id: 7, seq: 300 }), "the apex");
    assert_eq!((status.last, status.ticks), (Some(Moment { run_id: 7, seq: 300 }), 301));
    assert_eq!(status.rejected, Rejected::default());
    let news = office.news().unwrap();
    assert!(news.contains("other.bin") && news.contains("at tick 300"), "{news}");
    assert_eq!(office.news(), None, "said once");
    let Policies { running, swaps } = office.policies();
    assert_eq!(running.blob, other());
    assert_eq!(swaps.len(), 1);
    assert_eq!(swaps[0].at, Some(Moment { run_id: 7, seq: 250 }), "the order");
}

#[test]
fn what_is_refused_leaves_the_old_one_and_says_why() {
    let (mut controller, mut office) = open();
    let mut bad = other();
    bad[200] ^= 4;
    let why = office.swap("bad.bin", &bad).unwrap_err();
    assert!(why.contains("bad.bin is not a valid policy") && why.contains("stays"), "{why}");
    let missing = office.swap_file(Path::new("/no/where.bin")).unwrap_err();
    assert!(missing.contains("/no/where.bin"), "{missing}");
    controller.tick(Some(&hopping(1, 0)));
    assert_eq!(office.status().swaps, 0);

    // Nobody takes them: at some point there is no room.
    for _ in 0..ORDERS {
        office.swap("other.bin", &other()).unwrap();
    }
    let full = office.swap("other.bin", &other()).unwrap_err();
    assert!(full.contains("16 swaps wait") && full.contains("stays"), "{full}");
    controller.tick(Some(&hopping(1, 1)));
    assert_eq!(office.status().swaps, ORDERS as u64);
    office.swap("other.bin", &other()).unwrap();
}

#[test]
fn a_thousand_swaps_leave_every_tick_a_command_and_none_safe() {
    let (mut controller, mut office) = open();
    for seq in 0..150 {
        controller.tick(Some(&hopping(1, seq)));
    }
    let other = other();
    for seq in 150..150 + 1000 * 100 {
        if seq % 100 == 50 {
            let blob = if seq % 200 == 50 { SHIPPED } else { &other };
            office.swap("one.bin", blob).unwrap();
        }
        assert!(!is_safe(&controller.tick(Some(&hopping(1, seq)))), "tick {seq}");
    }
    let status = office.status();
    assert_eq!((status.swaps, status.rejected.ticks, status.pending), (1000, 0, None));
    let swaps = office.policies().swaps;
    assert_eq!(swaps.len(), 1000);
    assert!(swaps.iter().all(|swap| swap.at.is_some_and(|at| at.seq % 100 == 50)));
}

#[test]
fn a_restart_keeps_the_policy_and_takes_the_one_that_waits() {
    let (mut controller, mut office) = open();
    for seq in 0..250 {
        controller.tick(Some(&hopping(1, seq)));
    }
    office.swap("other.bin", &other()).unwrap();
    controller.restart();
    assert_eq!(office.status().policy.name, "test");
    assert_eq!(office.status().since, None, "no sample yet");
    controller.tick(Some(&hopping(2, 0)));
    assert_eq!(office.status().since, Some(Moment { run_id: 2, seq: 0 }));
}
