use super::*;
use crate::fixture::{blob_of, manifest};
use crate::policy_cache;
use leg_control::policy::SHIPPED;
use leg_control::serial::message::{self, RejectCounts, RunTick};
use leg_control::wire::{Header, WIRE_VERSION, flags};

fn open() -> (NodeLoop, NodeServer) {
    let peer = || PeerStatus { pid: Some(1), ..PeerStatus::default() };
    let sources = StatusSources { peer: Box::new(peer), timing: None };
    let policy = policy_cache::intern(SHIPPED).unwrap();
    NodeServer::open(policy, "the shipped policy", SessionParams::at(1000), sources).unwrap()
}

/// Swaps to a blob, by requests as a client sends them.
fn swap(server: &mut NodeServer, origin: &str, blob: &[u8]) -> Result<u32, RequestError> {
    let crc32 = u32::from_le_bytes(*blob.last_chunk().unwrap());
    let mut requests = vec![Request::Begin { length: blob.len() as u32, crc32, origin }];
    for (index, bytes) in blob.chunks(MAX_CHUNK).enumerate() {
        requests.push(Request::Chunk { offset: (index * MAX_CHUNK) as u32, bytes });
    }
    requests.extend([Request::Verify, Request::Commit]);
    for request in requests {
        let mut filter = RepeatFilter::default();
        match server.answer(7, &request, &mut filter, &LineCounts::ZERO) {
            Reply::Done => (),
            Reply::Refused(error) => return Err(error),
            other => panic!("{other:?}"),
        }
    }
    Ok(crc32)
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
            flags: flags::STATE_SENSED | flags::CONTACT_SENSED | contact,
            run_id,
            seq,
            t_ns: seq * 1_000_000,
        },
        y_m,
        vy_m_s: -0.15 * core::f32::consts::TAU * 10.0 * phase.sin(),
        ..Sample::default()
    }
}

#[test]
fn a_swap_waits_for_the_apex_and_is_logged_with_its_ticks() {
    let (mut node, mut server) = open();
    for seq in 0..250 {
        node.tick(Some(&hopping(7, seq)));
    }
    let before = server.status().policy;
    let crc32 = swap(&mut server, "other.bin", &other()).unwrap();
    node.tick(Some(&hopping(7, 250)));
    let status = server.status();
    let pending = status.pending.unwrap();
    assert_eq!((pending.name.as_str(), pending.crc32), ("test", Crc32(crc32)));
    assert_eq!((pending.file.as_str(), &status.policy, status.swaps), ("other.bin", &before, 0));
    assert_eq!(server.news(), None);
    for seq in 251..=300 {
        assert!(!node.tick(Some(&hopping(7, seq))).is_safe());
    }
    let status = server.status();
    assert_eq!((status.policy, status.swaps, status.pending), (pending, 1, None));
    let apex = Some(RunTick { run_id: 7, seq: 300 });
    assert_eq!((status.since, status.last, status.ticks), (apex, apex, 301));
    assert_eq!(status.rejected, RejectCounts::default());
    let news = server.news().unwrap();
    assert!(news.contains("other.bin") && news.contains("at tick 300"), "{news}");
    assert_eq!(server.news(), None, "reported once");
    assert_eq!(status.swap_log.len(), 1);
    let order = Some(RunTick { run_id: 7, seq: 250 });
    assert_eq!((status.swap_log[0].crc32, status.swap_log[0].at), (Crc32(crc32), order));
    let mut filter = RepeatFilter::default();
    let read = Request::Read { crc32, offset: 0 };
    let reply = server.answer(1, &read, &mut filter, &LineCounts::ZERO);
    assert_eq!(reply, Reply::Bytes(&other()[..MAX_CHUNK]));
}

#[test]
fn a_refused_swap_leaves_the_policy_and_the_error_names_it() {
    let (mut node, mut server) = open();
    let mut bad = other();
    bad[200] ^= 4;
    assert!(matches!(swap(&mut server, "bad.bin", &bad), Err(RequestError::Blob(_))));
    let missing = server.swap_file(Path::new("/no/where.bin")).unwrap_err();
    assert!(missing.contains("/no/where.bin") && missing.contains("stays"), "{missing}");
    node.tick(Some(&hopping(1, 0)));
    assert_eq!(server.status().swaps, 0);

    // Without ticks the ring is full at some point.
    for _ in 0..CHANGES {
        swap(&mut server, "other.bin", &other()).unwrap();
    }
    assert_eq!(swap(&mut server, "other.bin", &other()), Err(RequestError::Busy));
    node.tick(Some(&hopping(1, 1)));
    assert_eq!(server.status().swaps, CHANGES as u64);
    swap(&mut server, "other.bin", &other()).unwrap();
}

#[test]
fn a_thousand_swaps_leave_every_tick_a_command_and_none_safe() {
    let (mut node, mut server) = open();
    for seq in 0..150 {
        node.tick(Some(&hopping(1, seq)));
    }
    let other = other();
    for seq in 150..150 + 1000 * 100 {
        if seq % 100 == 50 {
            let blob = if seq % 200 == 50 { SHIPPED } else { &other };
            swap(&mut server, "one.bin", blob).unwrap();
        }
        assert!(!node.tick(Some(&hopping(1, seq))).is_safe(), "tick {seq}");
    }
    let status = server.status();
    assert_eq!((status.swaps, status.rejected.ticks, status.pending), (1000, 0, None));
    assert_eq!(status.swap_log.len(), SWAP_LOG);
    assert!(status.swap_log.iter().all(|swap| swap.at.is_some_and(|at| at.seq % 100 == 50)));
}

#[test]
fn a_restart_keeps_the_policy_and_lets_the_waiting_one_run() {
    let (mut node, mut server) = open();
    for seq in 0..250 {
        node.tick(Some(&hopping(1, seq)));
    }
    swap(&mut server, "other.bin", &other()).unwrap();
    node.restart();
    assert_eq!(server.status().policy.name, "test");
    assert_eq!(server.status().since, None, "no sample yet");
    node.tick(Some(&hopping(2, 0)));
    assert_eq!(server.status().since, Some(RunTick { run_id: 2, seq: 0 }));
}

#[test]
fn the_set_point_of_a_request_replaces_that_of_the_samples() {
    let velocity_offset = |set_point_m_s: Option<f32>| {
        let (mut node, mut server) = open();
        let request = Request::SetPoint(set_point_m_s);
        let mut filter = RepeatFilter::default();
        let reply = server.answer(1, &request, &mut filter, &LineCounts::ZERO);
        assert_eq!(reply, Reply::Done);
        (0..=200).map(|seq| node.tick(Some(&hopping(1, seq)))).last().unwrap().velocity_offset_m_s
    };
    assert_ne!(velocity_offset(Some(1.5)).to_bits(), velocity_offset(None).to_bits());
    let (_node, mut server) = open();
    for bad in [f32::NAN, 60.0] {
        let mut filter = RepeatFilter::default();
        let request = Request::SetPoint(Some(bad));
        let reply = server.answer(1, &request, &mut filter, &LineCounts::ZERO);
        assert!(matches!(reply, Reply::Refused(RequestError::SetPoint { .. })), "{reply:?}");
    }
}

/// A recorder needs the ticks to repeat the run, and the runs before may have left a set-point.
#[test]
fn a_set_point_is_logged_with_its_tick_and_stays_in_force_in_the_next_run() {
    let (mut node, mut server) = open();
    let request = |server: &mut NodeServer, set_point_m_s: Option<f32>| {
        let request = Request::SetPoint(set_point_m_s);
        let mut filter = RepeatFilter::default();
        assert_eq!(server.answer(1, &request, &mut filter, &LineCounts::ZERO), Reply::Done);
    };
    let at = |run_id, seq| Some(RunTick { run_id, seq });
    node.tick(Some(&hopping(7, 0)));
    request(&mut server, Some(0.5));
    request(&mut server, Some(0.25));
    assert_eq!(server.status().set_point_log[1].at, None);
    node.tick(None);
    node.tick(Some(&hopping(7, 1)));
    request(&mut server, Some(1.0));
    node.restart();
    node.tick(Some(&hopping(8, 0)));
    let status = server.status();
    let log: Vec<_> =
        status.set_point_log.iter().map(|r| (r.number, r.set_point_m_s, r.at)).collect();
    let expected = [(1, Some(0.5), at(7, 1)), (2, Some(0.25), at(7, 1)), (3, Some(1.0), at(8, 0))];
    assert_eq!(log, expected);
    assert_eq!((status.set_point_m_s, server.set_point_m_s()), (Some(1.0), Some(1.0)));

    // However many come while no leg is there, and between two looks at the log.
    for round in 0..200 {
        for _ in 0..CHANGES {
            request(&mut server, Some(0.0));
        }
        if round % 2 == 0 {
            node.idle();
        }
        node.tick(Some(&hopping(8, 1 + round)));
    }
    request(&mut server, None);
    node.tick(Some(&hopping(8, 201)));
    let status = server.status();
    assert_eq!(status.set_point_log.len(), SET_POINT_LOG);
    assert!(status.set_point_log.iter().all(|record| record.at.is_some()));
    assert_eq!((status.set_point_m_s, status.set_point_log[63].at), (None, at(8, 201)));
}

#[test]
fn a_run_ends_by_a_restart_or_with_the_first_accepted_sample_of_another_and_the_total_is_the_sum() {
    let (mut node, mut server) = open();
    // Returns the number of apexes.
    let run = |node: &mut NodeLoop, run_id, ticks| -> u64 {
        let commands = (0..ticks).map(|seq| node.tick(Some(&hopping(run_id, seq))));
        commands.last().unwrap().apexes.into()
    };
    let first_apexes = run(&mut node, 3, 150);
    node.tick(None);
    node.restart();
    let first = server.ended_run().unwrap();
    assert!(first_apexes > 0);
    assert_eq!((first.runs, first.ticks, first.apexes), (1, 150, first_apexes));
    assert_eq!((first.counts.missing, server.ended_run()), (1, None));
    run(&mut node, 4, 20);
    // A sample of a run of before is rejected, and ends nothing.
    node.tick(Some(&hopping(3, 0)));
    assert_eq!(server.ended_run(), None);
    let last_apexes = run(&mut node, 5, 120);
    let ended = server.ended_run().unwrap();
    assert_eq!((ended.ticks, ended.counts.old_run, ended.counts.missing), (21, 1, 0));
    node.restart();
    node.restart();
    let last = server.ended_run().unwrap();
    assert_eq!((last.ticks, last.counts.rejected(), server.ended_run()), (120, 0, None));
    let total = node.total();
    let apexes = first_apexes + ended.apexes + last_apexes;
    assert_eq!((total.runs, total.ticks, total.apexes), (3, 291, apexes));
    assert_eq!((total.counts.missing, total.counts.old_run, total.counts.rejected()), (1, 1, 2));
}

#[test]
fn a_client_cannot_reset_a_process_or_set_its_mode() {
    let (_node, mut server) = open();
    for request in [
        Request::Reset {
            session: 1,
            params: message::SessionParams { rate_hz: 500, ..message::SessionParams::default() },
        },
        Request::SetMode(Mode::Idle),
    ] {
        let mut filter = RepeatFilter::default();
        let reply = server.answer(1, &request, &mut filter, &LineCounts::ZERO);
        assert_eq!(reply, Reply::Refused(RequestError::InSession));
    }
}
