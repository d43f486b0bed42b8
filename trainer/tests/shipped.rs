//! The shipped policy survives and stops at every density ratio.

use leg_control::actor::Observation;
use leg_control::policy::{Policy, SHIPPED};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::f32::consts::FRAC_PI_2;
use trainer::evaluate::survival::{draw_starts, survival};
use trainer::evaluate::tracking::{Tracking, highest_speed, tracking_table};
use trainer::evaluate::{DENSITIES, hopper};

#[test]
fn the_shipped_policy_reaches_the_goals() {
    let policy = Policy::parse(SHIPPED).unwrap();
    let starts = draw_starts(1000, &mut Pcg64::seed_from_u64(99));
    for rho in DENSITIES {
        let s = survival(policy.actor(), &hopper(rho), rho, &starts);
        assert!(s.survive30 >= 0.995, "{rho}: {s:?}");
        assert!(s.abs_v_median.unwrap() <= 0.001, "{rho}: {s:?}");
    }
    let tracking = tracking_table(policy.actor(), &policy.manifest().gains);
    let possible: Vec<&Tracking> = tracking.iter().filter(|t| t.possible()).collect();
    assert!(tracking.iter().all(|t| !t.fell));
    assert_eq!((possible.len(), possible.iter().filter(|t| t.tracked()).count()), (42, 42));
    assert!(highest_speed(policy.actor(), &policy.manifest().gains, 0.0) >= 15.0);
}

/// A symmetric actor stops upright at exactly zero velocity, and turns the leg as far forwards
/// as backwards for mirrored velocities.
/// the leg forwards as far as backwards for the velocities of a mirror image.
#[test]
fn the_shipped_policy_is_mirror_symmetric() {
    let policy = Policy::parse(SHIPPED).unwrap();
    let act = |apex_vx_m_s, apex_y_m, density_ratio| {
        let action = policy.actor().act(Observation { apex_vx_m_s, apex_y_m, density_ratio });
        (action.touchdown_angle_rad - FRAC_PI_2, action.elongation_speed_m_s)
    };
    for rho in DENSITIES {
        for y in [1.0, 1.7, 4.0, 9.0] {
            let rho = rho as f32;
            assert!(act(0.0, y, rho).0.abs() < 2e-6, "{y} {rho}");
            for v in [0.01, 0.7, 3.0, 9.0] {
                let (there, here) = (act(v, y, rho), act(-v, y, rho));
                // The high bound of the angle is nearer to upright than the low one.
                let angle = there.0.abs().max(here.0.abs());
                assert!(angle < 1.04 && (there.0 + here.0).abs() < 5e-6, "{v} {y} {rho}");
                assert!((there.1 - here.1).abs() < 5e-6, "{v} {y} {rho}");
            }
        }
    }
}
