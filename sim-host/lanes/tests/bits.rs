//! Hops in lanes have the bits of single hops, on every instruction set of this machine.

#[path = "../../plant/tests/common/mod.rs"]
mod common;

use common::{Case, GOLDEN, for_each_row};
use leg_lanes::{Job, hops};
use leg_plant::{Action, Apex, Hop, Hopper, Leg, Medium, Outcome, Tolerance};
use leg_simd::Isa;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Number of random hops; `LEG_LANES_HOPS` in the environment replaces it.
const RANDOM_HOPS: usize = 100_000;

/// Returns everything that a hop has, as bits.
fn bits(hop: &Hop) -> Vec<u64> {
    let mut numbers = Vec::new();
    if let Some(touchdown) = hop.touchdown {
        numbers.extend([touchdown.t_s, touchdown.foot_x_m]);
    }
    numbers.extend(hop.liftoff_t_s);
    if let Outcome::Apex(next) = hop.outcome {
        let in_stance = f64::from(u8::from(next.in_stance));
        numbers.extend([next.t_s, next.x_m, next.vx_m_s, next.y_m, in_stance]);
    }
    numbers.push(f64::from(hop.stance_phases));
    numbers.into_iter().map(f64::to_bits).collect()
}

/// Asserts that every instruction set computes the hops of the jobs; returns them.
fn assert_same(jobs: &[Job<'_>]) -> Vec<Hop> {
    let single: Vec<Hop> = jobs.iter().map(|job| job.hopper.hop(job.start, job.action)).collect();
    for isa in Isa::ALL.into_iter().filter(|isa| isa.available()) {
        let together = hops(isa, jobs);
        assert_eq!(together.len(), jobs.len());
        for (i, (found, expected)) in together.iter().zip(&single).enumerate() {
            assert_eq!(bits(found), bits(expected), "{isa:?}, {:?}", jobs[i]);
        }
    }
    single
}

fn assert_same_cases(text: &str) -> usize {
    let mut cases = Vec::new();
    for_each_row(text, |row| cases.push(Case::of(row)));
    for tolerance in [Tolerance::GOLDEN, Tolerance::TRAINING] {
        let hoppers: Vec<Hopper> =
            cases.iter().map(|case| case.hopper().with_tolerance(tolerance)).collect();
        let jobs = cases.iter().zip(&hoppers).map(|(case, hopper)| Job {
            hopper,
            start: case.start,
            action: case.action,
        });
        assert_same(&jobs.collect::<Vec<_>>());
    }
    cases.len()
}

/// Draws legs and media of every kind: with drag and without, sinking and floating, stiff and
/// soft.
fn draw_hopper(rng: &mut impl Rng) -> Hopper {
    let leg = if rng.random_bool(0.1) { Leg::crab() } else { Leg::human() };
    let mut parameters = *leg.parameters();
    parameters.stiffness_n_m *= rng.random_range(0.2..5.0);
    parameters.drag_x *= f64::from(rng.random_range(0..3_u8));
    parameters.drag_y *= f64::from(rng.random_range(0..3_u8));
    let density_ratio = if rng.random_bool(0.3) { 0.0 } else { rng.random_range(0.0..1.5) };
    let gravity_m_s2 = if rng.random_bool(0.05) { 0.0 } else { rng.random_range(1.0..12.0) };
    let tolerance = if rng.random_bool(0.5) { Tolerance::GOLDEN } else { Tolerance::TRAINING };
    let medium = Medium::new(density_ratio, gravity_m_s2).unwrap();
    Hopper::new(&Leg::new(parameters).unwrap(), medium).with_tolerance(tolerance)
}

/// Draws a number of a usual size, at times a huge one, seldom a special one.
fn draw(rng: &mut impl Rng, low: f64, high: f64) -> f64 {
    let usual = rng.random_range(low..high);
    match rng.random_range(0..1000_u32) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => f64::MIN,
        3 => 0.0,
        4 => -0.0,
        5 => 5e-324,
        6..20 => usual * 1e150,
        20..60 => usual * 1e5,
        _ => usual,
    }
}

fn draw_job<'a>(hopper: &'a Hopper, rng: &mut impl Rng) -> Job<'a> {
    Job {
        hopper,
        start: Apex { vx_m_s: draw(rng, -4.0, 4.0), y_m: draw(rng, 0.9, 3.0) },
        action: Action {
            touchdown_angle_rad: draw(rng, 1.1, 2.0),
            elongation_speed_m_s: draw(rng, -0.5, 1.5),
        },
    }
}

#[test]
fn golden_cases_have_the_bits_of_single_hops() {
    assert_eq!(assert_same_cases(GOLDEN), 1200);
}

#[test]
fn published_transitions_have_the_bits_of_single_hops() {
    let Some(folder) = requirements::reference_data() else { return };
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let names = ["transitions_air.csv", "transitions_water_to_air.csv"];
    let rows: usize = names.iter().map(|name| assert_same_cases(&read(name))).sum();
    assert_eq!(rows, 4000);
}

#[test]
fn random_hops_have_the_bits_of_single_hops() {
    let count = std::env::var("LEG_LANES_HOPS")
        .map_or(RANDOM_HOPS, |number| number.parse().expect("a number of hops"));
    let mut rng = Pcg64::seed_from_u64(1);
    let (mut apexes, mut falls) = (0, 0);
    while apexes + falls < count {
        let hoppers: Vec<Hopper> = (0..1000).map(|_| draw_hopper(&mut rng)).collect();
        let jobs: Vec<Job<'_>> = hoppers.iter().map(|hopper| draw_job(hopper, &mut rng)).collect();
        let ends = assert_same(&jobs);
        let fell = ends.iter().filter(|hop| hop.outcome == Outcome::Fall).count();
        falls += fell;
        apexes += ends.len() - fell;
    }
    println!("{apexes} apexes, {falls} falls");
    assert!(apexes > count / 5 && falls > count / 5, "{apexes} apexes, {falls} falls");
}

#[test]
fn batches_of_any_size_and_order_give_each_job_its_hop() {
    let mut rng = Pcg64::seed_from_u64(2);
    let hoppers: Vec<Hopper> = (0..1000).map(|_| draw_hopper(&mut rng)).collect();
    let mut jobs: Vec<Job<'_>> = hoppers.iter().map(|hopper| draw_job(hopper, &mut rng)).collect();
    for size in [0, 1, 7, 1000] {
        assert_eq!(assert_same(&jobs[..size]).len(), size);
    }
    let all = |jobs: &[Job<'_>]| hops(Isa::best(), jobs).iter().map(bits).collect::<Vec<_>>();
    let forwards = all(&jobs);
    jobs.reverse();
    let mut backwards = all(&jobs);
    backwards.reverse();
    assert_eq!(forwards, backwards);
}
