//! A policy swapped in while the leg hops.

extern crate std;
use super::*;
use crate::policy::GainPoint;
use crate::policy::fixture::{Bytes, blob_of, manifest};
use proptest::prelude::*;
use std::vec::Vec as StdVec;

/// Ticks from one apex to the next.
const HOP_TICKS: u64 = 100;

/// A policy of its own actor, and the gains given.
fn blob(actor: f32, gains: GainPoint) -> Bytes {
    let mut manifest = manifest();
    manifest.action.offset[0] += actor;
    manifest.gains[0] = gains;
    Bytes::new(&blob_of(&manifest).unwrap())
}

fn gains(kp: f32, ki: f32) -> GainPoint {
    GainPoint { kp, ki, limit_m_s: 5.0, ..GainPoint::default() }
}

/// A leg that hops as if on rails, whatever it is told: the apex at each
/// multiple of [`HOP_TICKS`], the speed another at each.
fn hopping(tick: u64) -> Sample {
    let phase = core::f32::consts::TAU * (tick % HOP_TICKS) as f32 / HOP_TICKS as f32;
    let y_m = 1.05 + 0.15 * phase.cos();
    let contact = if y_m < 0.99 { flags::IN_CONTACT } else { 0 };
    Sample {
        header: Header {
            version: WIRE_VERSION,
            flags: flags::CONTACT_SENSED | contact,
            run_id: 1,
            seq: tick,
            t_ns: tick * 1_000_000,
        },
        set_point_m_s: 0.5,
        vx_m_s: 0.3 + 1e-3 * ((tick / HOP_TICKS * 7) % 5) as f32,
        y_m,
        vy_m_s: -0.15 * core::f32::consts::TAU * 10.0 * phase.sin(),
        ..Sample::default()
    }
}

fn controller(bytes: &Bytes) -> Controller<'_> {
    Controller::new(Policy::parse(bytes.get()).unwrap(), Config::at_rate(1_000).unwrap())
}

fn is_safe(command: &Command) -> bool {
    command.header.flags & flags::SAFE != 0
}

/// Commands of `ticks` of the hopping leg, the swap asked for before tick `at`;
/// and the tick that took it.
fn run<'a>(
    from: &'a Bytes,
    to: Option<&'a Bytes>,
    at: u64,
    ticks: u64,
) -> (StdVec<Command>, Option<u64>) {
    let mut controller = controller(from);
    let (mut commands, mut taken) = (StdVec::new(), None);
    for tick in 0..ticks {
        if let Some(to) = to.filter(|_| tick == at) {
            controller.swap(Policy::parse(to.get()).unwrap());
        }
        let was_pending = controller.swap_is_pending();
        commands.push(controller.tick(Some(&hopping(tick))));
        if was_pending && !controller.swap_is_pending() {
            taken = Some(tick);
        }
    }
    (commands, taken)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// On rails the cascade does not feel the actor: with the same gains, what
    /// is swapped in must go on as if it had been there from the start.
    #[test]
    fn from_its_apex_on_a_policy_gives_the_bits_of_one_that_was_there_all_along(
        at in 150_u64..600, actor in -0.1_f32..0.1,
    ) {
        let old = blob(0.0, gains(0.3, 0.1));
        let new = blob(actor, gains(0.3, 0.1));
        let (swapped, taken) = run(&old, Some(&new), at, 900);
        let (before, _) = run(&old, None, 0, 900);
        let (after, _) = run(&new, None, 0, 900);
        let taken = taken.unwrap() as usize;
        // The first apex that comes, and its very tick.
        prop_assert_eq!(taken as u64 % HOP_TICKS, 0);
        prop_assert!(taken as u64 >= at && taken as u64 - at < HOP_TICKS);
        prop_assert_eq!(&swapped[..taken], &before[..taken]);
        prop_assert_eq!(&swapped[taken..], &after[taken..]);
        prop_assert!(!swapped[200..].iter().any(is_safe));
    }
}

#[test]
fn a_policy_swapped_for_its_like_leaves_no_trace() {
    let policy = blob(0.0, gains(0.3, 0.1));
    assert_eq!(run(&policy, Some(&policy), 333, 900).0, run(&policy, None, 0, 900).0);
}

#[test]
fn new_gains_give_no_kick() {
    // Integral gains only: what the offset may gain in one apex is ki * error.
    let (old, new) = (blob(0.0, gains(0.0, 0.5)), blob(0.0, gains(0.0, 0.02)));
    let (commands, taken) = run(&old, Some(&new), 1_050, 1_400);
    assert_eq!(taken, Some(1_100));
    let offset_at = |tick: usize| commands[tick].velocity_offset_m_s;
    let before = offset_at(1_099);
    assert!(before > 0.9, "the old gains have wound up to {before} m/s");
    let error_m_s = 0.5 - commands[1_100].apex_vx_m_s;
    assert!((offset_at(1_100) - before - 0.02 * error_m_s).abs() < 1e-6);
}

#[test]
fn all_of_the_new_policy_holds_from_that_apex_its_leg_and_its_media_too() {
    let old = blob(0.0, gains(0.3, 0.1));
    let mut manifest = manifest();
    manifest.leg.rest_length_m = 0.9;
    manifest.leg.max_elongation_m = 0.02;
    manifest.media.density_ratio = [0.6, 0.7];
    let new = Bytes::new(&blob_of(&manifest).unwrap());
    let (commands, taken) = run(&old, Some(&new), 150, 400);
    assert_eq!(taken, Some(200));
    assert!(!(0.6..=0.7).contains(&commands[199].density_ratio));
    assert!((0.6..=0.7).contains(&commands[200].density_ratio));
    let grown_m = |ticks: core::ops::Range<usize>| {
        commands[ticks].iter().map(|c| c.elongation_m).fold(0.0_f32, f32::max)
    };
    assert!(grown_m(110..199) > 0.02 && grown_m(200..400) <= 0.02);
    assert!(!commands[200..].iter().any(is_safe));
}

#[test]
fn without_an_action_in_force_a_swap_is_at_once() {
    let (old, new) = (blob(0.0, gains(0.3, 0.1)), blob(0.05, gains(0.3, 0.1)));
    let new_policy = || Policy::parse(new.get()).unwrap();
    let mut controller = controller(&old);
    controller.swap(new_policy());
    assert!(!controller.swap_is_pending());
    assert_eq!(controller.policy().crc32(), new_policy().crc32());
    // The same once the guard has given up.
    let mut controller = super::swap_tests::controller(&old);
    for tick in 0..150 {
        controller.tick(Some(&hopping(tick)));
    }
    controller.swap(new_policy());
    for _ in 1..10 {
        assert!(!is_safe(&controller.tick(None)) && controller.swap_is_pending());
    }
    assert!(is_safe(&controller.tick(None)) && !controller.swap_is_pending());
    controller.swap(Policy::parse(old.get()).unwrap());
    assert!(!controller.swap_is_pending());
}

#[test]
fn a_restart_is_as_good_as_new() {
    let policy = blob(0.0, gains(0.3, 0.1));
    let mut used = controller(&policy);
    for tick in 0..777 {
        used.tick(Some(&hopping(tick)));
    }
    let config = Config::at_rate(500).unwrap().with_gravity(3.7).unwrap();
    used.restart(config);
    let mut fresh = Controller::new(Policy::parse(policy.get()).unwrap(), config);
    for tick in 0..400 {
        let sample = (tick % 7 != 3).then(|| hopping(tick));
        assert_eq!(used.tick(sample.as_ref()), fresh.tick(sample.as_ref()));
    }
    assert_eq!(used.counts(), fresh.counts());
}
