//! What must hold for any hop.

use std::f64::consts::PI;

use leg_plant::{Action, Apex, Hop, Hopper, Leg, Medium, NextApex, Outcome, Tolerance};
use proptest::prelude::*;

fn hop(
    rho: f64,
    vx_m_s: f64,
    y_m: f64,
    touchdown_angle_rad: f64,
    elongation_speed_m_s: f64,
) -> Hop {
    let medium = Medium::new(rho, 9.81).unwrap();
    Hopper::new(&Leg::human(), medium)
        .hop(Apex { vx_m_s, y_m }, Action { touchdown_angle_rad, elongation_speed_m_s })
}

/// Returns the next apex, or rejects the case as a fall.
fn next(hop: &Hop) -> Result<NextApex, TestCaseError> {
    match hop.outcome {
        Outcome::Apex(next) => Ok(next),
        Outcome::Fall => Err(TestCaseError::reject("a fall")),
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 2000,
        failure_persistence: None,
        // Every property is checked on 2,000 accepted cases. Five in six random hops on land at
        // up to 8 m/s are falls; a property fails if more than eight in nine are.
        max_global_rejects: 16_000,
        ..ProptestConfig::default()
    })]

    #[test]
    fn energy_is_conserved_in_vacuum(vx in -8.0..8.0, y in 1.0..9.0, alpha in 0.4..2.7) {
        // Only the dry mass weighs, but the added mass moves along.
        let energy = |vx: f64, y: f64| 0.5 * vx * vx + 9.81 * 80.0 / 88.0 * y;
        let next = next(&hop(0.0, vx, y, alpha, 0.0))?;
        // In stance a part of the energy is in the spring.
        prop_assume!(!next.in_stance);
        prop_assert!((energy(next.vx_m_s, next.y_m) - energy(vx, y)).abs() < 1e-8);
    }

    #[test]
    fn drag_without_elongation_never_adds_energy(
        rho in 0.0..1.0, vx in -8.0..8.0, y in 1.0..9.0, alpha in 0.4..2.7,
    ) {
        let net = 9.81 * (80.0 - 62.4 * rho) / 88.0;
        let energy = |vx: f64, y: f64| 0.5 * vx * vx + net * y;
        let next = next(&hop(rho, vx, y, alpha, 0.0))?;
        prop_assert!(energy(next.vx_m_s, next.y_m) <= energy(vx, y) + 1e-8);
    }

    #[test]
    fn a_mirrored_start_gives_a_mirrored_hop(
        rho in 0.0..1.0, vx in -6.0..6.0, y in 1.0..9.0, tilt in -0.4..0.4, rs in 0.0..2.0,
    ) {
        // pi is not a float: the angles, and so the hops, differ in the last bits.
        let (right, left) = (
            hop(rho, vx, y, 0.5 * PI + tilt, rs),
            hop(rho, -vx, y, 0.5 * PI - tilt, rs),
        );
        let (right, left) = (next(&right)?, next(&left)?);
        prop_assert!((right.vx_m_s + left.vx_m_s).abs() < 1e-7);
        prop_assert!((right.x_m + left.x_m).abs() < 1e-7);
        prop_assert!((right.y_m - left.y_m).abs() < 1e-7);
    }

    #[test]
    fn a_vanishing_density_converges_to_vacuum(
        exponent in -300.0..-10.0, vx in -3.0..3.0, y in 1.2..5.0, tilt in -0.2..0.2,
        rs in 0.0..2.0,
    ) {
        let thin = hop(10_f64.powf(exponent), vx, y, 0.5 * PI + tilt, rs);
        let vacuum = hop(0.0, vx, y, 0.5 * PI + tilt, rs);
        let (thin, vacuum) = (next(&thin)?, next(&vacuum)?);
        prop_assert!((thin.vx_m_s - vacuum.vx_m_s).abs() < 1e-7);
        prop_assert!((thin.y_m - vacuum.y_m).abs() < 1e-7);
        prop_assert!((thin.t_s - vacuum.t_s).abs() < 1e-7);
    }

    #[test]
    fn no_input_panics_or_gives_a_non_finite_apex(
        rho in prop_oneof![0.0..3.0, Just(0.0), Just(1e300)],
        vx in any::<f64>(), y in any::<f64>(), alpha in any::<f64>(), rs in any::<f64>(),
        tame in any::<[bool; 4]>(),
    ) {
        let (vx, y) = (if tame[0] { 1.0 } else { vx }, if tame[1] { 2.0 } else { y });
        let alpha = if tame[2] { 1.5 } else { alpha };
        let rs = if tame[3] { 0.5 } else { rs };
        // A fall is an answer here too: no case is rejected.
        if let Outcome::Apex(next) = hop(rho, vx, y, alpha, rs).outcome {
            for number in [next.t_s, next.x_m, next.vx_m_s, next.y_m] {
                prop_assert!(number.is_finite());
            }
        }
    }

    #[test]
    fn the_training_tolerance_stays_close_to_the_golden_one(
        rho in 0.0..1.0, vx in -3.0..3.0, y in 1.2..5.0, tilt in -0.2..0.2, rs in 0.0..2.0,
    ) {
        let medium = Medium::new(rho, 9.81).unwrap();
        let hopper = Hopper::new(&Leg::human(), medium);
        let start = Apex { vx_m_s: vx, y_m: y };
        let action = Action { touchdown_angle_rad: 0.5 * PI + tilt, elongation_speed_m_s: rs };
        let fine = hopper.hop(start, action);
        let coarse = hopper.with_tolerance(Tolerance::TRAINING).hop(start, action);
        let (fine, coarse) = (next(&fine)?, next(&coarse)?);
        prop_assert!((fine.vx_m_s - coarse.vx_m_s).abs() < 1e-4);
        prop_assert!((fine.y_m - coarse.y_m).abs() < 1e-4);
    }
}

#[test]
fn a_floating_leg_never_comes_down() {
    // Net weight zero and below, from rest.
    for rho in [80.0 / 62.4, 1.5, 10.0] {
        let fall = hop(rho, 1.0, 2.0, 1.5, 0.0);
        assert_eq!(fall.outcome, Outcome::Fall);
        assert_eq!(fall.stance_phases, 0);
    }
}

#[test]
fn the_crab_preset_hops() {
    let crab = Leg::crab();
    let hopper = Hopper::new(&crab, Medium::WATER);
    let start = Apex { vx_m_s: 0.05, y_m: 0.06 };
    let action = Action { touchdown_angle_rad: 1.5, elongation_speed_m_s: 0.2 };
    let next = hopper.hop(start, action).outcome.next().unwrap();
    assert!(next.y_m > 0.04 && next.y_m < 0.1, "{next:?}");
}
