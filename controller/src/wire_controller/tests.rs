//! What is checked of a message beyond its readings.

use super::*;
use crate::measurement::{Aged, Contact, LegPosture, Measurement, Sensors, SpecificImpulse};
use crate::policy::SHIPPED;
use crate::wire::flags;

fn controller() -> WireController<'static> {
    WireController::new(Policy::parse(SHIPPED).unwrap(), Config::default())
}

/// A leg that falls from 50 m, with its density measured: an action is in force at once.
fn sample(seq: u64) -> Sample {
    let t_s = 1e-3 * seq as f32;
    Sample {
        header: Header {
            version: WIRE_VERSION,
            flags: flags::STATE_SENSED | flags::CONTACT_SENSED | flags::DENSITY_SENSED,
            run_id: 1,
            seq,
            t_ns: seq * 1_000_000,
        },
        y_m: 50.0 - 4.45 * t_s * t_s,
        vy_m_s: -8.9 * t_s,
        ..Sample::default()
    }
}

fn running() -> WireController<'static> {
    let mut controller = controller();
    assert!(!controller.tick(Some(&sample(100))).is_safe());
    controller
}

fn rejected_as(change: impl Fn(&mut Sample)) -> &'static str {
    let mut controller = running();
    let mut bad = sample(101);
    change(&mut bad);
    let command = controller.tick(Some(&bad));
    assert_eq!(command.rejected, 1);
    assert_eq!((command.header.seq, command.header.t_ns), (bad.header.seq, bad.header.t_ns));
    controller.counts().by_kind().iter().find(|(_, n)| *n == 1).unwrap().0
}

#[test]
fn counts_each_bad_message_under_its_reason() {
    assert_eq!(rejected_as(|s| s.header.version = 9), "version");
    assert_eq!(rejected_as(|s| s.header.flags = 0), "no contact sense");
    assert_eq!(rejected_as(|s| s.header.run_id = 0), "old run");
    assert_eq!(rejected_as(|s| s.header.seq = 100), "stale");
    assert_eq!(rejected_as(|s| s.header.seq = 99), "out of order");
    assert_eq!(rejected_as(|s| s.header.t_ns = 5), "out of order");
    assert_eq!(rejected_as(|s| s.vx_m_s = f32::NAN), "non-finite");
    assert_eq!(rejected_as(|s| s.y_m = -1.0), "out of range");
    assert_eq!(rejected_as(|s| s.header.t_ns += 30_000_000), "gap");
}

#[test]
fn ignores_what_the_flags_do_not_declare() {
    let mut controller = running();
    let mut bad = Sample { leg_length_m: f32::NAN, density_ratio: f32::NAN, ..sample(101) };
    bad.header.flags = flags::STATE_SENSED | flags::CONTACT_SENSED;
    assert_eq!(controller.tick(Some(&bad)).rejected, 0);
}

#[test]
fn a_bad_set_point_in_a_sample_costs_no_reading() {
    for bad in [f32::NAN, f32::INFINITY, 60.0] {
        let mut controller = running();
        for seq in 101..130 {
            let command = controller.tick(Some(&Sample { set_point_m_s: bad, ..sample(seq) }));
            assert!(!command.is_safe(), "{bad} m/s");
            assert_eq!((command.rejected, command.set_points_refused), (0, (seq - 100) as u32));
        }
    }
}

#[test]
fn a_corrupt_sequence_number_does_not_lock_out_the_true_ones() {
    let mut controller = running();
    let mut far = sample(101);
    far.header.seq = u64::MAX;
    assert_eq!(controller.tick(Some(&far)).rejected, 0);
    let first_used = (102..130).position(|seq| {
        let before = controller.counts().rejected();
        controller.tick(Some(&sample(seq)));
        controller.counts().rejected() == before
    });
    assert_eq!(first_used, Some(10));
}

#[test]
fn a_later_run_starts_anew_and_an_earlier_one_is_rejected() {
    let mut controller = running();
    controller.tick(None);
    let of_run = |run_id, seq| {
        let mut sample = sample(seq);
        sample.header.run_id = run_id;
        sample
    };
    let command = controller.tick(Some(&of_run(2, 0)));
    assert_eq!((command.rejected, command.apexes), (0, 1), "counters start anew");
    assert_eq!(controller.tick(Some(&of_run(1, 102))).rejected, 1);
    assert_eq!(controller.counts().old_run, 1);
    // Run ids wrap.
    let mut controller = self::controller();
    controller.tick(Some(&of_run(u32::MAX, 0)));
    assert_eq!(controller.tick(Some(&of_run(3, 0))).rejected, 0);
}

#[test]
fn a_bad_sample_of_another_run_does_not_begin_it() {
    let mut controller = running();
    let mut bad = Sample { vx_m_s: f32::NAN, ..sample(0) };
    bad.header.run_id = 7;
    controller.tick(Some(&bad));
    let command = controller.tick(Some(&sample(102)));
    assert_eq!((command.rejected, command.apexes), (1, 1), "the run goes on");
}

#[test]
fn a_missing_sample_repeats_the_header_and_holds_the_set_point() {
    let mut controller = controller();
    let first = Sample { set_point_m_s: 0.5, ..sample(100) };
    controller.tick(Some(&first));
    let command = controller.tick(None);
    assert_eq!(command.header.seq, 100);
    assert_eq!((command.rejected, command.set_points_refused), (1, 0));
}

#[test]
fn a_measurement_and_its_message_are_the_same() {
    let posture = Some(LegPosture { length_m: 0.9, angle_rad: 1.5 });
    let slow = Sensors {
        velocity_m_s: Some(Aged { value: [0.5, -0.5], age_ns: 90_000_000 }),
        height_m: Some(Aged { value: 2.5, age_ns: 7 }),
        pressure_pa: Some(Aged { value: 2e5, age_ns: 0 }),
        ..Sensors::default()
    };
    let inertial = Sensors {
        impulse: Some(SpecificImpulse([i32::MIN, i32::MAX])),
        pitch_rad: Some(0.0),
        pitch_rate_rad_s: Some(-1.0),
        posture,
        ..slow
    };
    for contact in [Contact::Sensed(true), Contact::Sensed(false), Contact::LegLength(0.9)] {
        for (density_ratio, sensors) in [
            (None, Sensors::default()),
            (Some(0.3), Sensors::default()),
            (None, slow),
            (None, inertial),
        ] {
            let measurement = Measurement {
                t_ns: 7,
                vx_m_s: 1.0,
                y_m: 2.0,
                vy_m_s: -3.0,
                contact,
                density_ratio,
                sensors,
            };
            let message = Sample::new(3, 7, &measurement, 0.5);
            assert_eq!(message.measurement(), Some(measurement));
            assert_eq!((message.header.run_id, message.header.seq), (3, 7));
            assert!(!message.ends_the_run());
        }
    }
}
