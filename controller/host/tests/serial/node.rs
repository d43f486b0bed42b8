//! The control node in its three modes.

use crate::rig::{HOP_TICKS, Rig, factory, hopping, is_safe, small_blob};
use leg_control::config::Config;
use leg_control::policy::Policy;
use leg_control::serial::message::{Mode, Request, SessionParams};
use leg_control::serial::node::{ControlNode, SharedNode};
use leg_control::wire::{Command, Header, WIRE_VERSION, flags};
use leg_control::wire_controller::WireController;
use leg_host::flash::MemoryFlash;

fn rig(mode: Mode) -> Rig<MemoryFlash> {
    let mut rig = Rig::power_up(factory(&small_blob("one")));
    rig.order(&Request::Reset {
        session: 1,
        params: SessionParams { rate_hz: 1_000, gravity_m_s2: 9.81, ..SessionParams::default() },
    })
    .unwrap();
    rig.order(&Request::SetMode(mode)).unwrap();
    rig
}

/// Returns the bits of a command, so that a NaN or a sign of zero shows; of its header, only
/// the flags.
fn bits(command: &Command) -> Vec<u8> {
    let header = Header { flags: command.header.flags, ..Header::default() };
    bytemuck::bytes_of(&Command { header, ..*command }).to_vec()
}

fn bare_controller(blob: &[u8]) -> WireController<'static> {
    let words: Vec<u32> =
        blob.chunks(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect();
    let policy = Policy::parse(bytemuck::cast_slice(Vec::leak(words))).unwrap();
    WireController::new(policy, Config::at_rate(1_000).unwrap())
}

#[test]
fn in_lock_step_each_new_number_is_a_tick_with_the_bits_of_the_bare_controller() {
    let mut rig = rig(Mode::LockStep);
    let mut bare = bare_controller(&small_blob("one"));
    for k in 0..1_000 {
        // Bad samples among them, and the last number again at times.
        let mut sample = hopping(k);
        match k % 97 {
            13 => sample.vx_m_s = f32::NAN,
            14 => sample.y_m = -3.0,
            15 => sample.header.seq = 0,
            _ => {}
        }
        let expected = bare.tick(Some(&sample));
        let line_seq = k as u32;
        for _ in 0..=u32::from(k % 10 == 0) {
            let found = rig.node.with(|node| node.sample(line_seq, &sample)).unwrap();
            assert_eq!((bits(&found), found.header), (bits(&expected), expected.header));
        }
    }
    let counts = rig.counts();
    assert_eq!((counts.ticks, counts.repeated), (1_000, 100));
}

#[test]
fn idle_mode_answers_with_the_safe_command_and_the_header_of_the_sample() {
    let mut rig = rig(Mode::Idle);
    let command = rig.ticks(HOP_TICKS);
    assert!(is_safe(&command));
    let header = hopping(HOP_TICKS - 1).header;
    assert_eq!(command.header, Header { version: WIRE_VERSION, flags: flags::SAFE, ..header });
    assert_eq!((command.leg_angle_rad, command.apexes), (core::f32::consts::FRAC_PI_2, 0));
    assert_eq!(rig.counts().ticks, 0);
}

#[test]
fn without_a_policy_every_command_is_safe_in_every_mode() {
    let mut node = ControlNode::new();
    for mode in [Mode::Idle, Mode::LockStep, Mode::Live] {
        node.set_mode(mode);
        for k in 0..2 * HOP_TICKS {
            let sample = hopping(k);
            let command = node.sample(k as u32, &sample).or_else(|| {
                let (line_seq, command) = node.live_tick()?;
                assert_eq!(line_seq, k as u32);
                Some(command)
            });
            let command = command.unwrap();
            assert!(is_safe(&command));
            assert_eq!(command.header.seq, sample.header.seq);
        }
    }
    // In live mode, after the last sample.
    let (line_seq, command) = node.live_tick().unwrap();
    assert!(is_safe(&command));
    assert_eq!(u64::from(line_seq), 2 * HOP_TICKS - 1);
}

#[test]
fn in_live_mode_a_tick_uses_the_newest_sample_and_missed_ones_are_counted() {
    let mut rig = rig(Mode::Live);
    let mut bare = bare_controller(&small_blob("one"));
    assert_eq!(rig.node.with(ControlNode::live_tick), None, "nothing to answer yet");
    for k in 0..200_u64 {
        let expected = if k % 50 == 49 {
            bare.tick(None)
        } else {
            if k % 40 == 39 {
                // A newer sample replaces this one.
                let late = hopping(2 * k);
                assert_eq!(rig.node.with(|node| node.sample(5_000, &late)), None);
            }
            let sample = hopping(2 * k + 1);
            assert_eq!(rig.node.with(|node| node.sample(k as u32, &sample)), None);
            bare.tick(Some(&sample))
        };
        let (line_seq, found) = rig.node.with(ControlNode::live_tick).unwrap();
        assert_eq!(u64::from(line_seq), if k % 50 == 49 { k - 1 } else { k });
        assert_eq!(bits(&found), bits(&expected), "tick {k}");
    }
    // The last number again, after its answer: the same answer.
    let again = rig.node.with(|node| node.sample(198, &hopping(0)));
    assert_eq!(again.map(|c| c.header.seq), Some(397));
    let counts = rig.counts();
    assert_eq!((counts.ticks, counts.missed), (200, 4));
    assert_eq!((counts.overwritten, counts.repeated), (4, 1));
}

#[test]
fn in_live_mode_ticks_without_samples_end_in_the_safe_command() {
    let rig = rig(Mode::Live);
    for k in 0..50 {
        rig.node.with(|node| node.sample(k, &hopping(u64::from(k))));
        rig.node.with(ControlNode::live_tick);
    }
    let silent: Vec<bool> =
        (0..12).map(|_| is_safe(&rig.node.with(ControlNode::live_tick).unwrap().1)).collect();
    let first_safe = silent.iter().position(|&safe| safe);
    assert_eq!(first_safe, Some(9), "{silent:?}");
}

#[test]
fn a_set_point_of_the_host_overrides_that_of_the_samples() {
    let offset_with = |set_point| {
        let mut rig = rig(Mode::LockStep);
        rig.order(&Request::SetPoint(set_point)).unwrap();
        rig.ticks(HOP_TICKS + 2).velocity_offset_m_s
    };
    assert!(offset_with(Some(1.5)) > offset_with(None));
    assert_eq!(offset_with(Some(0.5)).to_bits(), offset_with(None).to_bits());
}

#[test]
fn after_a_reset_the_controller_is_as_after_a_power_up() {
    let run = |rig: &mut Rig<MemoryFlash>| -> Vec<Vec<u8>> {
        rig.order(&Request::Reset {
            session: 9,
            params: SessionParams { rate_hz: 1_000, gravity_m_s2: 3.7, ..SessionParams::default() },
        })
        .unwrap();
        rig.order(&Request::SetMode(Mode::LockStep)).unwrap();
        let ticks = 0..3 * HOP_TICKS;
        let commands =
            ticks.map(|k| rig.node.with(|node| node.sample(k as u32, &hopping(k)).unwrap()));
        commands.map(|command| bits(&command)).collect()
    };
    let mut fresh = rig(Mode::Idle);
    let mut used = rig(Mode::LockStep);
    used.ticks(5 * HOP_TICKS / 2);
    used.order(&Request::SetPoint(Some(2.0))).unwrap();
    assert_eq!(run(&mut fresh), run(&mut used));
    let counts = used.counts();
    assert_eq!((counts.ticks, counts.swaps), (3 * HOP_TICKS, 0));
}

#[test]
fn a_pending_policy_takes_over_at_once_in_idle_mode() {
    let mut rig = rig(Mode::LockStep);
    rig.ticks(HOP_TICKS / 4);
    rig.upload(&small_blob("two")).unwrap();
    assert!(rig.node.with(|node| node.status(None).run.pending.is_some()));
    rig.order(&Request::SetMode(Mode::Idle)).unwrap();
    assert_eq!(rig.name(), "two");
    assert_eq!(rig.counts().swaps, 1);
}
