//! What every transport must do.

use std::sync::{Barrier, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use leg_control::wire::{Command, Header, Sample, SensorReadings, WIRE_VERSION, flags};
use leg_host::{Link, LinkError};

use crate::transports::{LONG, Transport};

const SHORT: Duration = Duration::from_millis(30);

/// Every check of the suite.
pub(crate) fn all<T: Transport>() -> [fn(&T); 8] {
    [
        delivers_every_bit,
        the_newest_message_replaces_older_ones,
        a_timeout_is_not_an_error,
        delivers_the_last_message_before_reporting_that_the_peer_left,
        reports_that_the_controller_left,
        keeps_a_message_until_it_is_received,
        polling_never_blocks,
        a_plain_link_always_expects_a_reply,
    ]
}

/// Creates a sample in which every field differs, and differs with `seq`.
fn sample(seq: u64) -> Sample {
    let x = seq as f32;
    Sample {
        header: Header {
            version: WIRE_VERSION,
            flags: flags::STATE_SENSED | flags::CONTACT_SENSED,
            run_id: 7,
            seq,
            t_ns: seq * 1_000_000,
        },
        set_point_m_s: x + 0.1,
        vx_m_s: x + 0.2,
        y_m: x + 0.3,
        vy_m_s: x + 0.4,
        leg_length_m: x + 0.5,
        density_ratio: x + 0.6,
        sensors: SensorReadings {
            pitch_rad: x + 0.7,
            pitch_rate_rad_s: x + 0.8,
            leg_angle_rad: x + 0.9,
            impulse: [i32::MIN + seq as i32, i32::MAX - seq as i32],
            velocity_m_s: [x + 1.1, x + 1.2],
            height_m: x + 1.3,
            pressure_pa: x + 1.4,
            velocity_age_ns: u32::MAX - seq as u32,
            height_age_ns: 1 + seq as u32,
            pressure_age_ns: 1_000 + seq as u32,
        },
    }
}

/// Creates a command that repeats all fields of a sample.
fn reply(sample: &Sample) -> Command {
    Command {
        header: sample.header,
        leg_angle_rad: sample.set_point_m_s,
        elongation_m: sample.vx_m_s,
        elongation_rate_m_s: sample.y_m,
        apex_vx_m_s: sample.vy_m_s,
        apex_y_m: sample.leg_length_m,
        density_ratio: sample.density_ratio,
        velocity_offset_m_s: -0.0,
        apexes: u32::MAX,
        rejected: 1,
        set_points_refused: 0,
    }
}

/// Runs the two ends in two threads.
fn run<T: Transport, R: Send>(
    transport: &T,
    leg: impl FnOnce(T::Leg) -> R + Send,
    controller: impl FnOnce(T::Controller) + Send,
) -> R {
    let (new_leg, new_controller) = transport.pair();
    // Both ends connect before either runs, so that neither leaves before the other has seen it.
    let connected = Barrier::new(2);
    thread::scope(|scope| {
        let controlling = scope.spawn(|| {
            let end = new_controller();
            connected.wait();
            controller(end);
        });
        let end = new_leg();
        connected.wait();
        let result = leg(end);
        controlling.join().expect("the controller's end");
        result
    })
}

fn delivers_every_bit(transport: &impl Transport) {
    const TICKS: u64 = 1000;
    run(
        transport,
        |mut leg| {
            for seq in 0..TICKS {
                let mut sent = sample(seq);
                // Not every bit pattern equals itself as a float: compare a NaN's bits too.
                sent.vx_m_s = f32::from_bits(0x7fc0_1234);
                leg.send(&sent).expect("send a sample");
                let got = leg.receive(LONG).expect("a link").expect("a command");
                assert_eq!(got.elongation_m.to_bits(), 0x7fc0_1234, "NaN bits");
                let (mut got, mut want) = (got, reply(&sent));
                (got.elongation_m, want.elongation_m) = (0.0, 0.0);
                assert_eq!(got, want, "every field of tick {seq}");
                assert!(got.velocity_offset_m_s.is_sign_negative(), "sign of zero");
            }
        },
        |mut controller| {
            for _ in 0..TICKS {
                let got = controller.receive(LONG).expect("a link").expect("a sample");
                controller.send(&reply(&got)).expect("send a command");
            }
        },
    );
}

fn the_newest_message_replaces_older_ones(transport: &impl Transport) {
    let (sent, all_sent) = mpsc::channel();
    run(
        transport,
        |mut leg| {
            for seq in 0..3 {
                leg.send(&sample(seq)).expect("send without a reader");
            }
            sent.send(()).expect("notify");
            let got = leg.receive(LONG).expect("a link").expect("a command");
            assert_eq!(got.header.seq, 2, "the newest sample was answered");
        },
        move |mut controller| {
            all_sent.recv().expect("three samples sent");
            let got = controller.receive(LONG).expect("a link").expect("a sample");
            assert_eq!(got.header.seq, 2, "the newest replaces what was not taken");
            let more = controller.receive(Duration::ZERO).expect("a link");
            assert_eq!(more, None, "taken once");
            controller.send(&reply(&got)).expect("send a command");
        },
    );
}

fn a_timeout_is_not_an_error(transport: &impl Transport) {
    let (done, leg_done) = mpsc::channel();
    run(
        transport,
        |mut leg| {
            for timeout in [Duration::ZERO, SHORT] {
                let start = Instant::now();
                assert_eq!(leg.receive(timeout), Ok(None), "nothing was sent");
                assert!(start.elapsed() >= timeout, "waits for its whole timeout");
            }
            done.send(()).expect("notify");
        },
        move |controller| {
            leg_done.recv().expect("the leg waited");
            drop(controller);
        },
    );
}

fn delivers_the_last_message_before_reporting_that_the_peer_left(transport: &impl Transport) {
    let (left, leg_left) = mpsc::channel();
    run(
        transport,
        |mut leg| {
            leg.send(&sample(5)).expect("send");
            drop(leg);
            left.send(()).expect("notify");
        },
        move |mut controller| {
            leg_left.recv().expect("the leg left");
            let got = controller.receive(LONG).expect("a link").expect("a sample");
            assert_eq!(got.header.seq, 5, "sent before leaving");
            let start = Instant::now();
            let end = controller.receive(LONG);
            assert!(matches!(end, Err(LinkError::PeerLeft { .. })), "reported as left: {end:?}");
            assert!(start.elapsed() < LONG / 2, "reported before the timeout");
        },
    );
}

fn reports_that_the_controller_left(transport: &impl Transport) {
    run(
        transport,
        |mut leg| {
            leg.send(&sample(0)).expect("send");
            let got = leg.receive(LONG).expect("a link").expect("a command");
            assert_eq!(got.header.seq, 0);
            // The peer may have left; only `receive` reports that.
            leg.send(&sample(1)).expect("send");
            let end = leg.receive(LONG);
            assert!(matches!(end, Err(LinkError::PeerLeft { .. })), "reported as left: {end:?}");
        },
        |mut controller| {
            let got = controller.receive(LONG).expect("a link").expect("a sample");
            controller.send(&reply(&got)).expect("send a command");
        },
    );
}

/// A message is kept until the reader polls, because middleware takes it at its tick and not when
/// it was sent.
fn keeps_a_message_until_it_is_received(transport: &impl Transport) {
    let (answered, all_answered) = mpsc::channel();
    run(
        transport,
        move |mut leg| {
            leg.send(&sample(0)).expect("send");
            all_answered.recv().expect("answered");
            thread::sleep(SHORT);
            let got = leg.receive(Duration::ZERO).expect("a link").expect("a command, kept");
            assert_eq!(got.header.seq, 2, "of three the newest");
            assert_eq!(leg.receive(Duration::ZERO).map_or(None, |more| more), None, "taken once");
        },
        move |mut controller| {
            let got = controller.receive(LONG).expect("a link").expect("a sample");
            for seq in 0..3 {
                let header = Header { seq, ..got.header };
                controller.send(&Command { header, ..reply(&got) }).expect("send");
            }
            answered.send(()).expect("notify");
            // Stay connected until the leg has polled.
            let _ = controller.receive(LONG);
        },
    );
}

/// A real-time loop polls once a tick, with a timeout of zero.
fn polling_never_blocks(transport: &impl Transport) {
    const POLLS: u32 = 100;
    let (done, leg_done) = mpsc::channel();
    run(
        transport,
        |mut leg| {
            let start = Instant::now();
            for seq in 0..POLLS {
                leg.send(&sample(seq.into())).expect("send without a reader");
                assert_eq!(leg.receive(Duration::ZERO), Ok(None), "nothing was sent");
            }
            // A busy machine may suspend a thread; a link that waited would take seconds.
            assert!(start.elapsed() < SHORT * POLLS, "{:?}", start.elapsed());
            done.send(()).expect("notify");
        },
        move |controller| {
            leg_done.recv().expect("the leg polled");
            drop(controller);
        },
    );
}

/// Only fault injection may make a lock-step session not wait for a reply.
fn a_plain_link_always_expects_a_reply(transport: &impl Transport) {
    run(
        transport,
        |mut leg| {
            assert!(!leg.expects_no_reply());
            leg.send(&sample(0)).expect("send");
            assert!(!leg.expects_no_reply(), "an answer is to come");
            leg.receive(LONG).expect("a link").expect("a command");
        },
        |mut controller| {
            let got = controller.receive(LONG).expect("a link").expect("a sample");
            controller.send(&reply(&got)).expect("send a command");
        },
    );
}
