//! A policy switched while the leg hops.

use super::*;

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

fn controller(bytes: &Bytes) -> Controller<'_> {
    Controller::new(Policy::parse(bytes.get()).unwrap(), Config::at_rate(1_000).unwrap())
}

/// Returns the outputs over `ticks` of the hopping leg, with a swap requested before tick
/// `at`, and the tick in which it took place.
fn run<'a>(
    from: &'a Bytes,
    to: Option<&'a Bytes>,
    at: u64,
    ticks: u64,
) -> (Vec<Output>, Option<u64>) {
    let mut controller = controller(from);
    let (mut outputs, mut taken) = (Vec::new(), None);
    for tick in 0..ticks {
        if let Some(to) = to.filter(|_| tick == at) {
            controller.swap(Policy::parse(to.get()).unwrap());
        }
        let was_pending = controller.swap_is_pending();
        outputs.push(controller.step(Some(&hopping(tick)), 0.5));
        if was_pending && !controller.swap_is_pending() {
            taken = Some(tick);
        }
    }
    (outputs, taken)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// On rails the cascade does not feel the actor: with the same gains, what
    /// is swapped in must go on as if it had been there from the start.
    #[test]
    fn from_its_first_apex_on_a_new_policy_gives_the_bits_of_one_that_ran_from_the_start(
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
        prop_assert!(!swapped[200..].iter().any(|output| output.status.is_safe()));
    }
}

#[test]
fn a_swap_to_the_same_policy_changes_no_output() {
    let policy = blob(0.0, gains(0.3, 0.1));
    assert_eq!(run(&policy, Some(&policy), 333, 900).0, run(&policy, None, 0, 900).0);
}

#[test]
fn new_gains_do_not_step_the_offset() {
    // Integral gains only: what the offset may gain in one apex is ki * error.
    let (old, new) = (blob(0.0, gains(0.0, 0.5)), blob(0.0, gains(0.0, 0.02)));
    let (outputs, taken) = run(&old, Some(&new), 1_050, 1_400);
    assert_eq!(taken, Some(1_100));
    let offset_at = |tick: usize| outputs[tick].telemetry.velocity_offset_m_s;
    let before = offset_at(1_099);
    assert!(before > 0.9, "the old gains have wound up to {before} m/s");
    let error_m_s = 0.5 - outputs[1_100].telemetry.apex_vx_m_s;
    assert!((offset_at(1_100) - before - 0.02 * error_m_s).abs() < 1e-6);
}

#[test]
fn leg_and_media_of_the_new_policy_hold_from_its_first_apex() {
    let old = blob(0.0, gains(0.3, 0.1));
    let mut manifest = manifest();
    manifest.leg.rest_length_m = 0.9;
    manifest.leg.max_elongation_m = 0.02;
    manifest.media.density_ratio = [0.6, 0.7];
    let new = Bytes::new(&blob_of(&manifest).unwrap());
    let (outputs, taken) = run(&old, Some(&new), 150, 400);
    assert_eq!(taken, Some(200));
    let density_at = |tick: usize| outputs[tick].telemetry.density_ratio.unwrap();
    assert!(!(0.6..=0.7).contains(&density_at(199)));
    assert!((0.6..=0.7).contains(&density_at(200)));
    let grown_m = |ticks: core::ops::Range<usize>| {
        outputs[ticks].iter().map(|o| o.command.elongation_m).fold(0.0_f32, f32::max)
    };
    assert!(grown_m(110..199) > 0.02 && grown_m(200..400) <= 0.02);
    assert!(!outputs[200..].iter().any(|output| output.status.is_safe()));
}

#[test]
fn a_swap_without_an_action_in_force_takes_place_at_once() {
    let (old, new) = (blob(0.0, gains(0.3, 0.1)), blob(0.05, gains(0.3, 0.1)));
    let new_policy = || Policy::parse(new.get()).unwrap();
    let mut controller = controller(&old);
    controller.swap(new_policy());
    assert!(!controller.swap_is_pending());
    assert_eq!(controller.policy().crc32(), new_policy().crc32());
    // The same once the guard has given up.
    let mut controller = super::swap::controller(&old);
    for tick in 0..150 {
        controller.step(Some(&hopping(tick)), 0.5);
    }
    controller.swap(new_policy());
    for _ in 1..10 {
        assert!(!controller.step(None, 0.5).status.is_safe() && controller.swap_is_pending());
    }
    assert!(controller.step(None, 0.5).status.is_safe() && !controller.swap_is_pending());
    controller.swap(Policy::parse(old.get()).unwrap());
    assert!(!controller.swap_is_pending());
}

#[test]
fn a_restarted_controller_gives_the_bits_of_a_new_one() {
    let policy = blob(0.0, gains(0.3, 0.1));
    let mut used = controller(&policy);
    for tick in 0..777 {
        used.step(Some(&hopping(tick)), 0.5);
    }
    let config = Config::at_rate(500).unwrap().with_gravity(3.7).unwrap();
    used.restart(config);
    let mut fresh = Controller::new(Policy::parse(policy.get()).unwrap(), config);
    for tick in 0..400 {
        let measurement = (tick % 7 != 3).then(|| hopping(tick));
        assert_eq!(used.step(measurement.as_ref(), 0.5), fresh.step(measurement.as_ref(), 0.5));
    }
    assert_eq!(used.counts(), fresh.counts());
}
