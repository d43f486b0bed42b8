//! The shipped policy hops and stops at every density.

use controller::policy::{Policy, SHIPPED};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use trainer::evaluate::survival::{draw_starts, survival};
use trainer::evaluate::tracking::{Tracking, tracking_table};
use trainer::evaluate::{DENSITIES, hopper};

#[test]
fn the_shipped_policy_is_fit_to_fly() {
    let policy = Policy::parse(SHIPPED).unwrap();
    let starts = draw_starts(1000, &mut Pcg64::seed_from_u64(99));
    for rho in DENSITIES {
        let s = survival(policy.actor(), &hopper(rho), rho, &starts);
        assert!(s.survive30 >= 0.99, "{rho}: {s:?}");
        assert!(s.abs_v_median.unwrap() <= 0.03, "{rho}: {s:?}");
    }
    let tracking = tracking_table(policy.actor(), &policy.manifest().gains);
    let possible: Vec<&Tracking> = tracking.iter().filter(|t| t.possible()).collect();
    assert!(tracking.iter().all(|t| !t.fell));
    assert!(possible.iter().filter(|t| t.tracked()).count() >= 37);
}
