//! Measures the time of a hop over the golden cases, and of a tick:
//! `cargo bench -p leg-plant --bench apex_map`.
//!
//! An iteration of `apex_map` computes all 1,200 cases; criterion's throughput is hops per second.
//! `hopper_and_hop` also constructs the `Hopper`, as a trainer with a medium per episode does. An
//! iteration of `tick` steps 1,000 ticks.

#[path = "../tests/common/mod.rs"]
mod common;

use std::f64::consts::FRAC_PI_2;
use std::hint::black_box;

use common::{Case, GOLDEN, for_each_row};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use leg_plant::{Body, Flat, Hopper, Leg, LegCommand, Medium, TickPlant, Tolerance};

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for_each_row(GOLDEN, |row| cases.push(Case::of(row)));
    cases
}

fn apex_map(c: &mut Criterion) {
    let cases = cases();
    let mut group = c.benchmark_group("apex_map");
    group.throughput(Throughput::Elements(cases.len() as u64));
    for (name, tolerance) in [("golden", Tolerance::GOLDEN), ("training", Tolerance::TRAINING)] {
        let hoppers: Vec<_> = cases
            .iter()
            .map(|case| Hopper::new(&case.leg, case.medium).with_tolerance(tolerance))
            .collect();
        group.bench_function(name, |b| {
            b.iter(|| {
                for (hopper, case) in hoppers.iter().zip(&cases) {
                    black_box(hopper.hop(black_box(case.start), black_box(case.action)));
                }
            });
        });
    }
    group.bench_function("hopper_and_hop", |b| {
        b.iter(|| {
            for case in &cases {
                let hopper = Hopper::new(black_box(&case.leg), black_box(case.medium));
                black_box(hopper.hop(black_box(case.start), black_box(case.action)));
            }
        });
    });
    group.finish();
}

/// Hops in place for a second in ticks of 1 ms, a third of them in stance.
fn ticks(c: &mut Criterion) {
    let start = Body { x_m: 0.0, vx_m_s: 0.0, y_m: 1.3, vy_m_s: 0.0 };
    let command =
        LegCommand { leg_angle_rad: FRAC_PI_2, elongation_m: 0.0, elongation_rate_m_s: 0.0 };
    let mut group = c.benchmark_group("tick");
    group.throughput(Throughput::Elements(1000));
    for (name, medium) in [("air", Medium::AIR), ("water", Medium::WATER)] {
        group.bench_function(name, |b| {
            b.iter(|| {
                let mut plant = TickPlant::new(Leg::human(), black_box(start));
                for _ in 0..1000 {
                    black_box(plant.step(1e-3, black_box(command), medium, &Flat));
                }
            });
        });
    }
    group.finish();
}

criterion_group!(benches, apex_map, ticks);
criterion_main!(benches);
