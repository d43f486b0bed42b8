//! The whole law: what it does, that it is total, and policies switched while it runs.

extern crate std;
use super::*;
use crate::config::{Config, Estimation};
use crate::measurement::{Contact, Sensors};
use crate::policy::GainPoint;
use crate::policy::fixture::{Bytes, blob_of, manifest};
use core::f32::consts::TAU;
use proptest::prelude::*;
use std::vec::Vec;

mod estimated;
mod swap;
mod total;

/// Ticks of silence before the safe state at 1 kHz.
const SAFE_AFTER: usize = 10;

fn with_controller(test: impl FnOnce(Controller<'_>)) {
    let bytes = Bytes::new(&blob_of(&manifest()).unwrap());
    let policy = Policy::parse(bytes.get()).unwrap();
    test(Controller::new(policy, Config::at_rate(1_000).unwrap()));
}

/// Free fall from rest at `y_m` in air.
fn falling(tick: u64, y_m: f32) -> Measurement {
    let t_s = 1e-3 * tick as f32;
    let ay = -80.0 / 88.0 * 9.81;
    Measurement {
        t_ns: tick * 1_000_000,
        vx_m_s: 0.4,
        y_m: y_m + 0.5 * ay * t_s * t_s,
        vy_m_s: ay * t_s,
        contact: Contact::Sensed(false),
        density_ratio: None,
        sensors: Sensors::default(),
    }
}

#[test]
fn a_leg_released_in_mid_air_is_safe_until_the_density_is_estimated() {
    with_controller(|mut controller| {
        for tick in 0..START_MEASUREMENTS as u64 - 1 {
            assert!(controller.step(Some(&falling(tick, 2.0)), 0.0).status.is_safe());
        }
        let output = controller.step(Some(&falling(START_MEASUREMENTS as u64 - 1, 2.0)), 0.0);
        assert_eq!(output.status, Status::Running);
        let Telemetry { apexes, apex_y_m, density_ratio, .. } = output.telemetry;
        assert_eq!(apexes, 1);
        assert!((apex_y_m - 2.0).abs() < 1e-4, "{apex_y_m}");
        assert!(density_ratio.unwrap().abs() < 0.01, "{density_ratio:?}");
    });
}

#[test]
fn a_measured_density_is_used_at_once() {
    with_controller(|mut controller| {
        let measurement = Measurement { density_ratio: Some(0.7), ..falling(0, 2.0) };
        let telemetry = controller.step(Some(&measurement), 0.0).telemetry;
        assert_eq!((telemetry.apexes, telemetry.density_ratio), (1, Some(0.7)));
    });
}

#[test]
fn the_elongation_ramp_starts_at_the_predicted_touchdown() {
    with_controller(|mut controller| {
        let mut command = LegCommand::SAFE;
        for tick in 0..300 {
            command = controller.step(Some(&falling(tick, 2.0)), 0.0).command;
        }
        // At 2 m, from the fall's own formula.
        let ay = 80.0_f32 / 88.0 * 9.81;
        let touchdown_s = (2.0 * (2.0 - libm::sinf(command.leg_angle_rad)) / ay).sqrt();
        let predicted_s = 0.299 - command.elongation_m / command.elongation_rate_m_s;
        assert!((predicted_s - touchdown_s).abs() < 1e-5, "{predicted_s} for {touchdown_s}");
    });
}

#[test]
fn coasts_through_silence_then_is_safe_and_recovers() {
    with_controller(|mut controller| {
        for tick in 0..100 {
            controller.step(Some(&falling(tick, 3.0)), 0.0);
        }
        for _ in 1..SAFE_AFTER {
            let output = controller.step(None, 0.0);
            assert_eq!(output.status, Status::Coasting);
            assert_eq!(output.rejected, Some(Reject::Missing));
        }
        let output = controller.step(None, 0.0);
        assert_eq!((output.status, output.command), (Status::Safe, LegCommand::SAFE));
        let first_back = (200..260)
            .find(|&tick| !controller.step(Some(&falling(tick, 3.0)), 0.0).status.is_safe());
        // Three good measurements to trust again, then those of the estimate.
        assert_eq!(first_back, Some(200 + 2 + START_MEASUREMENTS as u64 - 1));
    });
}

#[test]
fn a_bad_set_point_is_held_and_counted_and_costs_no_measurement() {
    let run = |set_point: &dyn Fn(u64) -> f32| {
        let policy = Policy::parse(crate::policy::SHIPPED).unwrap();
        let mut controller = Controller::new(policy, Config::at_rate(1_000).unwrap());
        let outputs: Vec<Output> =
            (0..1_500).map(|tick| controller.step(Some(&hopping(tick)), set_point(tick))).collect();
        assert_eq!(controller.counts().rejected(), 0, "no measurement is lost");
        assert_eq!(controller.set_point_m_s(), 0.5);
        outputs
    };
    let good = run(&|_| 0.5);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 60.0, -50.1] {
        assert_eq!(run(&|tick| if tick % 3 == 0 && tick > 0 { bad } else { 0.5 }), good, "{bad}");
    }
    assert!(good.last().unwrap().telemetry.velocity_offset_m_s.abs() > 0.1, "it is used");
    with_controller(|mut controller| {
        for tick in 0..25 {
            let output = controller.step(Some(&hopping(tick)), f32::NAN);
            assert_eq!(output.rejected, None);
        }
        assert_eq!(controller.counts().set_points_refused, 25);
        assert_eq!(controller.set_point_m_s(), 0.0, "stop, until there is a good one");
    });
}

/// Ticks from one apex to the next of [`hopping`].
const HOP_TICKS: u64 = 100;

/// A leg that hops as if on rails, whatever it is commanded: the apex at each
/// multiple of [`HOP_TICKS`], with another velocity at each.
fn hopping(tick: u64) -> Measurement {
    let phase = TAU * (tick % HOP_TICKS) as f32 / HOP_TICKS as f32;
    let y_m = 1.05 + 0.15 * phase.cos();
    Measurement {
        t_ns: tick * 1_000_000,
        vx_m_s: 0.3 + 1e-3 * ((tick / HOP_TICKS * 7) % 5) as f32,
        y_m,
        vy_m_s: -0.15 * TAU * 10.0 * phase.sin(),
        contact: Contact::Sensed(y_m < 0.99),
        density_ratio: None,
        sensors: Sensors::default(),
    }
}
