//! The published actors (doi 10.5281/zenodo.4607469): the import checks their test vectors, and
//! the tests compare their metrics from 2,000 random starts.
//!
//! The actors are not part of this repository, see [`requirements::reference_data`].

use leg_control::policy::GainPoint;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use trainer::bridge::json::from_json;
use trainer::evaluate::conditions::{Change, Condition};
use trainer::evaluate::hopper;
use trainer::evaluate::survival::{Survival, draw_starts, survival};
use trainer::evaluate::tracking::{highest_speed, track};
use trainer::policy::PackedActor;

/// Imports a published actor; `None` without the folder. In the folder every actor must exist.
fn imported(name: &str) -> Option<PackedActor> {
    let path = requirements::reference_data()?.join(format!("actor_{name}.json"));
    let text = std::fs::read_to_string(&path)
        .unwrap_or_else(|e| panic!("{}: {e}; is LEG_REFERENCE_DATA right?", path.display()));
    Some(from_json(&text).unwrap_or_else(|e| panic!("{name}: {e}")))
}

fn at(packed: &PackedActor, rho: f64) -> Survival {
    let starts = draw_starts(2000, &mut Pcg64::seed_from_u64(11));
    survival(&packed.actor(), &hopper(rho), rho, &starts)
}

/// Compares survival, median and 95 % quantile of |v|, and the reward over five steps.
fn assert_near(s: Survival, survive30: f64, v: Option<[f64; 2]>, reward5: f64) {
    // Three standard errors of 2,000 starts and of the reference's 5,000.
    let error = (survive30 * (1.0 - survive30) * (1.0 / 2000.0 + 1.0 / 5000.0)).sqrt();
    assert!((s.survive30 - survive30).abs() <= 3.0 * error + 6e-4, "{s:?}, {survive30}");
    if let Some([median, p95]) = v {
        assert!((s.abs_v_median.unwrap() - median).abs() < 0.05 * median + 6e-4, "{s:?}");
        assert!((s.abs_v_p95.unwrap() - p95).abs() < 0.1 * p95, "{s:?}");
    }
    assert!((s.reward5 - reward5).abs() < 0.05 * reward5 + 0.02, "{s:?}, {reward5}");
}

#[test]
fn the_published_actors_reproduce_their_test_vectors() {
    let Some(folder) = requirements::reference_data() else { return };
    let vectors = |name: &str| {
        let path = folder.join(format!("actor_{name}.json"));
        let text = std::fs::read_to_string(&path).unwrap();
        // Checked by the import.
        from_json(&text).unwrap_or_else(|e| panic!("{name}: {e}"));
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        json["test_vectors"].as_array().map_or(0, Vec::len)
    };
    let checked = ["water", "air", "water_to_air"].map(vectors);
    assert_eq!(checked.iter().filter(|&&n| n > 0).count(), 3, "{checked:?}");
}

#[test]
fn the_published_water_actor_survives_in_water_only() {
    let Some(actor) = imported("water") else { return };
    assert_eq!(actor.widths.as_slice(), [3, 100, 100, 2]);
    assert_near(at(&actor, 1.0), 1.0, Some([0.200, 0.200]), 4.00);
    assert_near(at(&actor, 0.0), 0.0, None, 0.0);
}

#[test]
fn the_published_air_actor_falls_on_land() {
    let Some(actor) = imported("air") else { return };
    assert_near(at(&actor, 0.05), 0.905, Some([5.73, 5.73]), 0.34);
    assert_near(at(&actor, 0.0), 0.0, None, 0.20);
}

#[test]
fn the_published_transferred_actor_survives_at_every_density() {
    let Some(actor) = imported("water_to_air") else { return };
    assert_near(at(&actor, 1.0), 0.993, Some([0.036, 0.036]), 7.80);
    assert_near(at(&actor, 0.5), 0.989, Some([0.148, 0.148]), 5.06);
    assert_near(at(&actor, 0.1), 1.0, Some([0.177, 0.181]), 4.96);
    assert_near(at(&actor, 0.05), 0.999, Some([0.162, 0.182]), 4.54);
    assert_near(at(&actor, 0.0), 0.906, Some([0.181, 8.59]), 2.94);
}

#[test]
fn the_published_transferred_actor_tracks_a_set_point_on_land() {
    let Some(actor) = imported("water_to_air") else { return };
    let gains = |ki, feed_forward| {
        let point = GainPoint { ki, feed_forward, limit_m_s: 10.0, ..GainPoint::default() };
        [point].into_iter().collect()
    };
    let actor = actor.actor();
    let run = track(&actor, &gains(0.05, 0.0), 0.0, 1.0);
    assert!((run.mean_v.unwrap() - 1.0).abs() < 1e-3, "{run:?}");
    assert!(run.oscillation.unwrap() < 1e-3, "{run:?}");
    let run = track(&actor, &gains(0.0, 1.0), 0.0, 1.0);
    assert!((run.mean_v.unwrap() - 3.2).abs() < 0.1, "{run:?}");
    assert!(track(&actor, &gains(0.05, 0.0), 1.0, 1.0).fell);
    // The reference has 5.98 m/s. The ramp ends where the leg falls, so this holds to a few
    // tenths.
    let speed = highest_speed(&actor, &gains(0.02, 0.0), 0.0);
    assert!((5.5..6.3).contains(&speed), "{speed}");
}

#[test]
fn the_published_transferred_actor_survives_as_published_on_other_legs() {
    let Some(actor) = imported("water_to_air") else { return };
    let starts = draw_starts(2000, &mut Pcg64::seed_from_u64(11));
    for (change, survive30) in [
        (Change::Stiffness(5_000.0), 0.04),
        (Change::Stiffness(10_000.0), 0.39),
        (Change::Stiffness(15_000.0), 0.78),
        (Change::Stiffness(20_000.0), 0.90),
        (Change::Stiffness(30_000.0), 0.99),
        (Change::Stiffness(40_000.0), 1.00),
        (Change::Mass(40.0), 1.00),
        (Change::Mass(60.0), 0.98),
        (Change::Mass(100.0), 0.81),
        (Change::Mass(120.0), 0.70),
    ] {
        let s = Condition::on_land(change).run(&actor.actor(), &starts).survival;
        // Three standard errors of both sets of starts, and the rounding of the published
        // value.
        let variance = survive30 * (1.0 - survive30) * (1.0 / 2000.0 + 1.0 / 5000.0);
        let off = (s.survive30 - survive30).abs();
        assert!(off <= 3.0 * variance.sqrt() + 5e-3, "{change}: {s:?}, {survive30}");
    }
}
