//! One suite that every transport passes, bare and behind the fault injector.

use std::sync::{Barrier, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use leg_control::wire::{Command, Header, Sample, WIRE_VERSION, flags};
use leg_host::{ControllerLink, LegLink, LinkError};

/// Longer than anything here should take.
const LONG: Duration = Duration::from_secs(10);
const SHORT: Duration = Duration::from_millis(30);

/// Runs the whole suite. `pair` prepares a new pair of ends, each made in the
/// thread that will use it (the ends of a shared-memory link stay in theirs).
fn check<L, C, ML, MC>(pair: impl Fn() -> (ML, MC))
where
    L: LegLink,
    C: ControllerLink,
    ML: FnOnce() -> L + Send,
    MC: FnOnce() -> C + Send,
{
    every_bit_arrives(&pair);
    the_newest_wins(&pair);
    silence_is_not_an_error(&pair);
    the_last_word_is_heard_then_the_leaving(&pair);
    a_leaving_controller_is_noticed(&pair);
    a_message_waits_for_its_reader(&pair);
    polls_never_wait(&pair);
    a_plain_link_is_never_settled(&pair);
}

/// A sample of which every field is different, and differs with `seq`.
fn sample(seq: u64) -> Sample {
    let x = seq as f32;
    Sample {
        header: Header {
            version: WIRE_VERSION,
            flags: flags::CONTACT_SENSED,
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
    }
}

/// A command that shows that the whole sample was read.
fn answer(sample: &Sample) -> Command {
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

/// The two ends in two threads.
fn play<L, C, R: Send>(
    pair: (impl FnOnce() -> L + Send, impl FnOnce() -> C + Send),
    leg: impl FnOnce(L) -> R + Send,
    controller: impl FnOnce(C) + Send,
) -> R {
    // Both are connected before either plays: one that comes and goes at once was never there.
    let connected = Barrier::new(2);
    thread::scope(|scope| {
        let controlling = scope.spawn(|| {
            let end = pair.1();
            connected.wait();
            controller(end);
        });
        let end = pair.0();
        connected.wait();
        let played = leg(end);
        controlling.join().expect("the controller's end");
        played
    })
}

fn every_bit_arrives<L: LegLink, C: ControllerLink, ML, MC>(pair: &impl Fn() -> (ML, MC))
where
    ML: FnOnce() -> L + Send,
    MC: FnOnce() -> C + Send,
{
    const TICKS: u64 = 1000;
    play(
        pair(),
        |mut leg| {
            for seq in 0..TICKS {
                let mut sent = sample(seq);
                // Not every bit pattern equals itself as a float: compare a NaN's bits too.
                sent.vx_m_s = f32::from_bits(0x7fc0_1234);
                leg.send(&sent).expect("send a sample");
                let got = leg.receive(LONG).expect("a link").expect("a command");
                assert_eq!(got.elongation_m.to_bits(), 0x7fc0_1234, "NaN bits");
                let (mut got, mut want) = (got, answer(&sent));
                (got.elongation_m, want.elongation_m) = (0.0, 0.0);
                assert_eq!(got, want, "every field of tick {seq}");
                assert!(got.velocity_offset_m_s.is_sign_negative(), "sign of zero");
            }
        },
        |mut controller| {
            for _ in 0..TICKS {
                let got = controller.receive(LONG).expect("a link").expect("a sample");
                controller.send(&answer(&got)).expect("send a command");
            }
        },
    );
}

fn the_newest_wins<L: LegLink, C: ControllerLink, ML, MC>(pair: &impl Fn() -> (ML, MC))
where
    ML: FnOnce() -> L + Send,
    MC: FnOnce() -> C + Send,
{
    let (sent, all_sent) = mpsc::channel();
    play(
        pair(),
        |mut leg| {
            for seq in 0..3 {
                leg.send(&sample(seq)).expect("send without a reader");
            }
            sent.send(()).expect("tell");
            let got = leg.receive(LONG).expect("a link").expect("a command");
            assert_eq!(got.header.seq, 2, "the newest sample was answered");
        },
        move |mut controller| {
            all_sent.recv().expect("three samples sent");
            let got = controller.receive(LONG).expect("a link").expect("a sample");
            assert_eq!(got.header.seq, 2, "the newest replaces what was not taken");
            let more = controller.receive(Duration::ZERO).expect("a link");
            assert_eq!(more, None, "taken once");
            controller.send(&answer(&got)).expect("send a command");
        },
    );
}

fn silence_is_not_an_error<L: LegLink, C: ControllerLink, ML, MC>(pair: &impl Fn() -> (ML, MC))
where
    ML: FnOnce() -> L + Send,
    MC: FnOnce() -> C + Send,
{
    let (done, leg_done) = mpsc::channel();
    play(
        pair(),
        |mut leg| {
            for timeout in [Duration::ZERO, SHORT] {
                let start = Instant::now();
                assert_eq!(leg.receive(timeout), Ok(None), "nothing was sent");
                assert!(start.elapsed() >= timeout, "waits for its whole timeout");
            }
            done.send(()).expect("tell");
        },
        move |controller| {
            leg_done.recv().expect("the leg waited");
            drop(controller);
        },
    );
}

fn the_last_word_is_heard_then_the_leaving<L: LegLink, C: ControllerLink, ML, MC>(
    pair: &impl Fn() -> (ML, MC),
) where
    ML: FnOnce() -> L + Send,
    MC: FnOnce() -> C + Send,
{
    let (left, leg_left) = mpsc::channel();
    play(
        pair(),
        |mut leg| {
            leg.send(&sample(5)).expect("send");
            drop(leg);
            left.send(()).expect("tell");
        },
        move |mut controller| {
            leg_left.recv().expect("the leg left");
            let got = controller.receive(LONG).expect("a link").expect("a sample");
            assert_eq!(got.header.seq, 5, "sent before leaving");
            let start = Instant::now();
            let end = controller.receive(LONG);
            assert!(matches!(end, Err(LinkError::PeerLeft { .. })), "leaving is noticed: {end:?}");
            assert!(start.elapsed() < LONG / 2, "leaving is noticed early");
        },
    );
}

fn a_leaving_controller_is_noticed<L: LegLink, C: ControllerLink, ML, MC>(
    pair: &impl Fn() -> (ML, MC),
) where
    ML: FnOnce() -> L + Send,
    MC: FnOnce() -> C + Send,
{
    play(
        pair(),
        |mut leg| {
            leg.send(&sample(0)).expect("send");
            let got = leg.receive(LONG).expect("a link").expect("a command");
            assert_eq!(got.header.seq, 0);
            // Nobody may be there to take it; that is for `receive` to tell.
            leg.send(&sample(1)).expect("send");
            let end = leg.receive(LONG);
            assert!(matches!(end, Err(LinkError::PeerLeft { .. })), "leaving is noticed: {end:?}");
        },
        |mut controller| {
            let got = controller.receive(LONG).expect("a link").expect("a sample");
            controller.send(&answer(&got)).expect("send a command");
        },
    );
}

/// Middleware takes a tick's message when the tick comes, not when it was sent.
fn a_message_waits_for_its_reader<L: LegLink, C: ControllerLink, ML, MC>(
    pair: &impl Fn() -> (ML, MC),
) where
    ML: FnOnce() -> L + Send,
    MC: FnOnce() -> C + Send,
{
    let (answered, all_answered) = mpsc::channel();
    play(
        pair(),
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
                controller.send(&Command { header, ..answer(&got) }).expect("send");
            }
            answered.send(()).expect("tell");
            // It stays until the leg has looked.
            let _ = controller.receive(LONG);
        },
    );
}

/// A loop in real time asks once a tick, by a timeout of zero.
fn polls_never_wait<L: LegLink, C: ControllerLink, ML, MC>(pair: &impl Fn() -> (ML, MC))
where
    ML: FnOnce() -> L + Send,
    MC: FnOnce() -> C + Send,
{
    const POLLS: u32 = 100;
    let (done, leg_done) = mpsc::channel();
    play(
        pair(),
        |mut leg| {
            let start = Instant::now();
            for seq in 0..POLLS {
                leg.send(&sample(seq.into())).expect("send without a reader");
                assert_eq!(leg.receive(Duration::ZERO), Ok(None), "nothing was sent");
            }
            // A busy machine may take a thread away; waiting would take seconds.
            assert!(start.elapsed() < SHORT * POLLS, "{:?}", start.elapsed());
            done.send(()).expect("tell");
        },
        move |controller| {
            leg_done.recv().expect("the leg polled");
            drop(controller);
        },
    );
}

/// A session in lock-step waits for the answer, unless middleware says otherwise.
fn a_plain_link_is_never_settled<L: LegLink, C: ControllerLink, ML, MC>(
    pair: &impl Fn() -> (ML, MC),
) where
    ML: FnOnce() -> L + Send,
    MC: FnOnce() -> C + Send,
{
    play(
        pair(),
        |mut leg| {
            assert!(!leg.expects_no_reply());
            leg.send(&sample(0)).expect("send");
            assert!(!leg.expects_no_reply(), "an answer is to come");
            leg.receive(LONG).expect("a link").expect("a command");
        },
        |mut controller| {
            let got = controller.receive(LONG).expect("a link").expect("a sample");
            controller.send(&answer(&got)).expect("send a command");
        },
    );
}

use std::os::unix::net::UnixStream;
use std::sync::Arc;

use leg_host::Domain;
use leg_host::serial::stream::over_unix;
use leg_host::serial::{SerialController, SerialLeg};
use leg_host::shm::{ShmController, ShmLeg};
use leg_host::{SessionParams, memory};
use leg_process::Stop;
use sim_host::faults::stage::message::{Corrupt, Delay, Drop, Duplicate, Freeze, Ice, Reorder};
use sim_host::faults::stage::{Chain, Dice, Faulty, WireMessage, Plan, Window};

#[test]
fn within_a_process() {
    check(|| {
        let (leg, controller) = memory::pair();
        (move || leg, move || controller)
    });
}

/// Every fault of messages, none of which acts: by its window, or by its figures.
fn asleep() -> Plan {
    fn put<M: WireMessage>(chain: &mut Chain<M>) {
        let later = Window { from: 1 << 40, until: u64::MAX };
        let dice = || Dice::new(1, 2);
        chain.push(0, later, Box::new(Drop::new(1.0, dice())));
        chain.push(1, later, Box::new(Delay::new(3, 4, dice())));
        chain.push(2, later, Box::new(Duplicate::new(1.0, dice())));
        chain.push(3, later, Box::new(Reorder::new(1.0, dice())));
        chain.push(4, later, Box::new(Corrupt::new(1.0, 9, dice())));
        chain.push(5, later, Box::new(Freeze::new(7, 1.0, Ice::Nothing, dice())));
        chain.push(6, Window::ALWAYS, Box::new(Delay::new(0, 0, dice())));
        chain.push(7, Window::ALWAYS, Box::new(Drop::new(0.0, dice())));
    }
    let mut plan = Plan::default();
    put(&mut plan.samples);
    put(&mut plan.commands);
    plan
}

/// The suite over both ends wrapped, without any fault and with idle ones.
fn check_wrapped<L, C, ML, MC>(pair: impl Fn() -> (ML, MC))
where
    L: LegLink,
    C: ControllerLink,
    ML: FnOnce() -> L + Send,
    MC: FnOnce() -> C + Send,
{
    for plan in [Plan::default, asleep] {
        check(|| {
            let (leg, controller) = pair();
            (
                move || Faulty::at_leg(leg(), plan()),
                move || Faulty::at_controller(controller(), plan()),
            )
        });
    }
}

fn serial() -> (impl FnOnce() -> SerialLeg + Send, impl FnOnce() -> SerialController + Send) {
    let (leg, controller) = UnixStream::pair().unwrap();
    let (leg, controller) = (over_unix(leg).unwrap(), over_unix(controller).unwrap());
    let pid = std::process::id();
    (move || SerialLeg::new(leg, pid), move || SerialController::new(controller, pid))
}

#[test]
fn over_a_serial_line() {
    check(serial);
}

#[test]
fn through_the_fault_injector_over_any_transport() {
    check_wrapped(serial);
    check_wrapped(|| {
        let (leg, controller) = memory::pair();
        (move || leg, move || controller)
    });
    let dir = tempfile::tempdir().unwrap();
    let base = dir.path().join("base");
    check_wrapped(|| {
        let domain = || Domain::join_in(&base, "faulty").unwrap();
        let (params, stop) = (SessionParams::at(1000), Stop::default());
        let (leg, controller): (Arc<_>, Arc<_>) = (domain(), domain());
        let stop_too = stop.clone();
        (
            move || ShmLeg::connect(&leg, params, LONG, &stop).unwrap(),
            move || ShmController::connect(&controller, params, LONG, &stop_too).unwrap(),
        )
    });
}

#[test]
fn over_shared_memory() {
    let dir = tempfile::tempdir().unwrap();
    let base = dir.path().join("base");
    check(|| {
        let domain = || Domain::join_in(&base, "conformance").unwrap();
        let (params, stop) = (SessionParams::at(1000), Stop::default());
        let (leg, controller): (Arc<_>, Arc<_>) = (domain(), domain());
        let stop_too = stop.clone();
        (
            move || ShmLeg::connect(&leg, params, LONG, &stop).unwrap(),
            move || ShmController::connect(&controller, params, LONG, &stop_too).unwrap(),
        )
    });
    assert!(!base.exists(), "nothing is left of the domain");
}
