//! What the guard rejects, and how it enters and leaves the safe state.

extern crate std;
use super::*;
use crate::measurement::Sensors;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use std::vec::Vec;

const TICK_NS: u64 = 1_000_000;

fn measurement(tick: u64) -> Measurement {
    Measurement {
        t_ns: tick * TICK_NS,
        vx_m_s: 0.0,
        y_m: 2.0,
        vy_m_s: 0.0,
        contact: Contact::Sensed(false),
        density_ratio: None,
        sensors: Sensors::default(),
    }
}

fn judge<'m>(guard: &mut Guard, measurement: &'m Measurement) -> Verdict<'m> {
    let checked = Limits::default().check(measurement);
    guard.judge(checked)
}

fn missing(guard: &mut Guard) -> Verdict<'static> {
    guard.judge(Err(Reject::Missing))
}

fn running() -> Guard {
    let mut guard = Guard::new(&Limits::default(), TICK_NS, SAFE_AFTER_NS);
    assert!(matches!(judge(&mut guard, &measurement(100)), Verdict::Restart(_)));
    guard
}

fn rejected_as(change: impl Fn(&mut Measurement)) -> &'static str {
    let mut guard = running();
    let mut bad = measurement(101);
    change(&mut bad);
    assert!(matches!(judge(&mut guard, &bad), Verdict::Coast(_)));
    assert_eq!(guard.counts().rejected(), 1);
    guard.counts().by_kind().iter().find(|(_, n)| *n == 1).unwrap().0
}

#[test]
fn counts_each_bad_measurement_under_its_reason() {
    assert_eq!(rejected_as(|m| m.vx_m_s = f32::NAN), "non-finite");
    assert_eq!(rejected_as(|m| m.y_m = f32::INFINITY), "non-finite");
    assert_eq!(rejected_as(|m| m.y_m = -0.5), "out of range");
    assert_eq!(rejected_as(|m| m.vy_m_s = 51.0), "out of range");
    assert_eq!(rejected_as(|m| m.contact = Contact::LegLength(f32::NAN)), "non-finite");
    assert_eq!(rejected_as(|m| m.contact = Contact::LegLength(-1.0)), "out of range");
    assert_eq!(rejected_as(|m| m.density_ratio = Some(7.0)), "out of range");
    assert_eq!(rejected_as(|m| m.t_ns = 100 * TICK_NS), "stale");
    assert_eq!(rejected_as(|m| m.t_ns = 5), "out of order");
    assert_eq!(rejected_as(|m| m.t_ns += 30 * TICK_NS), "gap");
}

#[test]
fn enters_the_safe_state_after_silence_and_leaves_it_after_good_measurements() {
    let mut guard = running();
    for _ in 1..10 {
        assert_eq!(missing(&mut guard), Verdict::Coast(Reject::Missing));
    }
    assert_eq!(missing(&mut guard), Verdict::Safe(Some(Reject::Missing)));
    assert_eq!((guard.counts().missing, guard.counts().safe_entered), (10, 1));
    assert_eq!(judge(&mut guard, &measurement(900)), Verdict::Safe(None));
    assert_eq!(judge(&mut guard, &measurement(901)), Verdict::Safe(None));
    assert!(matches!(judge(&mut guard, &measurement(902)), Verdict::Restart(_)));
    assert!(matches!(judge(&mut guard, &measurement(903)), Verdict::Use(_)));
}

/// Over a link that loses most messages three in a row hardly ever come.
#[test]
fn recovers_by_good_measurements_between_lost_ones_but_not_between_bad_ones() {
    let silent = || {
        let mut guard = running();
        for _ in 0..20 {
            missing(&mut guard);
        }
        guard
    };
    let mut guard = silent();
    assert_eq!(judge(&mut guard, &measurement(200)), Verdict::Safe(None));
    for _ in 0..8 {
        assert_eq!(missing(&mut guard), Verdict::Safe(Some(Reject::Missing)));
    }
    assert_eq!(judge(&mut guard, &measurement(209)), Verdict::Safe(None));
    assert!(matches!(judge(&mut guard, &measurement(210)), Verdict::Restart(_)));
    let spoils: [fn(&mut Guard); 2] = [
        |guard| {
            for _ in 0..10 {
                missing(guard);
            }
        },
        |guard| {
            guard.judge(Err(Reject::NonFinite));
        },
    ];
    for spoil in spoils {
        let mut guard = silent();
        judge(&mut guard, &measurement(300));
        judge(&mut guard, &measurement(301));
        spoil(&mut guard);
        assert_eq!(judge(&mut guard, &measurement(320)), Verdict::Safe(None), "counted anew");
    }
}

#[test]
fn the_silence_before_the_safe_state_is_a_time_at_every_rate() {
    let ticks = |rate_hz: u64| safe_after_ticks(1_000_000_000 / rate_hz);
    assert_eq!([50, 200, 500, 1_000, 3_000, 20_000].map(ticks), [3, 3, 5, 10, 30, 200]);
    assert_eq!([0, 1, u64::MAX].map(safe_after_ticks), [3, 10_000_000, 3]);
}

#[test]
fn a_corrupt_time_stamp_does_not_lock_out_the_true_ones() {
    let mut guard = running();
    let mut far = measurement(101);
    far.t_ns += Limits::default().max_gap_ns - TICK_NS;
    assert!(matches!(judge(&mut guard, &far), Verdict::Use(_)));
    let after =
        (102..150).position(|k| matches!(judge(&mut guard, &measurement(k)), Verdict::Restart(_)));
    assert_eq!(after, Some(10 + 3 - 1));
}

#[test]
fn a_new_run_restarts_with_counters_at_zero() {
    let mut guard = running();
    missing(&mut guard);
    guard.begin_run();
    assert!(matches!(judge(&mut guard, &measurement(0)), Verdict::Restart(_)));
    assert_eq!(guard.counts().rejected(), 0);
}

#[test]
fn a_new_run_after_silence_must_be_trusted_anew() {
    let mut guard = running();
    for _ in 0..20 {
        missing(&mut guard);
    }
    guard.begin_run();
    assert_eq!(judge(&mut guard, &measurement(0)), Verdict::Safe(None));
    assert_eq!(guard.counts().rejected(), 0);
    assert_eq!(judge(&mut guard, &measurement(1)), Verdict::Safe(None));
    assert!(matches!(judge(&mut guard, &measurement(2)), Verdict::Restart(_)));
}

#[test]
fn limits_that_nothing_can_satisfy_are_not_valid() {
    assert!(Limits::default().are_valid());
    let speed = |max_speed_m_s| Limits { max_speed_m_s, ..Limits::default() };
    for bad in [f32::NAN, f32::INFINITY, 0.0, -1.0, 1e7] {
        assert!(!speed(bad).are_valid(), "{bad} m/s");
    }
    assert!(!Limits { height_m: [2.0, 1.0], ..Limits::default() }.are_valid());
    assert!(!Limits { height_m: [-1.0, 1.0], ..Limits::default() }.are_valid());
    for max_gap_ns in [0, 1_000_000_001] {
        assert!(!Limits { max_gap_ns, ..Limits::default() }.are_valid(), "{max_gap_ns} ns");
    }
}

/// Values at and around the limits, zeros of both signs, subnormals, and any bits.
fn values() -> impl Strategy<Value = f32> {
    let edges = [
        0.0,
        -0.0,
        f32::MIN_POSITIVE,
        1e-45,
        -1e-45,
        50.0,
        -50.0,
        50.000_004,
        100.0,
        100.000_01,
        f32::MAX,
        f32::MIN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
    ];
    prop_oneof![
        3 => prop::sample::select(edges.to_vec()),
        2 => -60.0_f32..120.0,
        1 => any::<u32>().prop_map(f32::from_bits),
    ]
}

/// Every combination of edge values: what is accepted is in range, the rest is not.
#[test]
fn accepts_exactly_what_is_finite_and_in_range() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let (mut accepted, mut cases) = (0, 0);
    let strategy = (values(), values(), values(), values(), prop::option::of(values()));
    for _ in 0..50_000 {
        let (vx_m_s, y_m, vy_m_s, length, density_ratio) =
            strategy.new_tree(&mut runner).unwrap().current();
        for contact in [Contact::Sensed(true), Contact::LegLength(length)] {
            let sensors = Sensors::default();
            let any = Measurement { t_ns: 5, vx_m_s, y_m, vy_m_s, contact, density_ratio, sensors };
            let within = |x: f32, low: f32, high: f32| low <= x && x <= high;
            let good: Vec<bool> = [
                within(vx_m_s, -50.0, 50.0),
                within(vy_m_s, -50.0, 50.0),
                within(y_m, 0.0, 100.0),
                contact == Contact::Sensed(true) || within(length, 0.0, 10.0),
                density_ratio.is_none_or(|rho| within(rho, 0.0, 2.0)),
            ]
            .into();
            let mut guard = Guard::new(&Limits::default(), TICK_NS, SAFE_AFTER_NS);
            let used = matches!(judge(&mut guard, &any), Verdict::Restart(_));
            assert_eq!(used, good.iter().all(|&g| g), "{any:?}");
            cases += 1;
            accepted += u32::from(used);
        }
    }
    assert!(accepted > 1_000 && accepted < cases / 2, "{accepted} of {cases} accepted");
}

#[test]
fn counts_of_runs_add_up_to_the_sum_of_their_reasons() {
    let counts_of = |rejects: &[Reject]| {
        let mut guard = running();
        for &reject in rejects {
            guard.judge(Err(reject));
        }
        *guard.counts()
    };
    let sum = |counts: &Counts| counts.by_kind().iter().map(|(_, n)| n).sum::<u32>();
    let one = counts_of(&[Reject::Missing, Reject::Gap, Reject::Gap, Reject::OldRun]);
    let two = counts_of(&[Reject::Version, Reject::Missing, Reject::NonFinite]);
    let both = one.plus(&two);
    assert_eq!((one.rejected(), two.rejected(), both.rejected()), (4, 3, 7));
    assert_eq!((sum(&one), sum(&two), sum(&both)), (4, 3, 7));
    assert_eq!((both.missing, both.gap), (2, 2));
}
