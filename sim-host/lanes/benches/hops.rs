//! Measures hops over the golden cases, one after the other and in the lanes of each instruction
//! set: `cargo bench -p leg-lanes`.
//!
//! An iteration computes all 1,200 cases; criterion's throughput is hops per second. The last
//! lines are the ratios, from batches that take turns, so that a busy machine slows all alike.

#[path = "../../plant/tests/common/mod.rs"]
mod common;

use std::hint::black_box;
use std::time::Instant;

use common::{Case, GOLDEN, for_each_row};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use leg_lanes::{Job, hops};
use leg_plant::{Hopper, Tolerance};
use leg_simd::Isa;

/// Number of turns, of which the ratios take the median.
const TURNS: usize = 101;

fn together(c: &mut Criterion) {
    let mut cases = Vec::new();
    for_each_row(GOLDEN, |row| cases.push(Case::of(row)));
    for (name, tolerance) in [("golden", Tolerance::GOLDEN), ("training", Tolerance::TRAINING)] {
        let hoppers: Vec<Hopper> =
            cases.iter().map(|case| case.hopper().with_tolerance(tolerance)).collect();
        let jobs: Vec<Job<'_>> = cases
            .iter()
            .zip(&hoppers)
            .map(|(case, hopper)| Job { hopper, start: case.start, action: case.action })
            .collect();
        let single = || {
            for job in &jobs {
                black_box(job.hopper.hop(black_box(job.start), black_box(job.action)));
            }
        };
        let sets = || Isa::ALL.into_iter().filter(|isa| isa.available());
        let mut group = c.benchmark_group(name);
        group.throughput(Throughput::Elements(jobs.len() as u64));
        group.bench_function("single", |b| b.iter(single));
        for isa in sets() {
            group.bench_function(isa.name(), |b| b.iter(|| hops(isa, black_box(&jobs))));
        }
        group.finish();
        for isa in sets() {
            let ratio = median_ratio(&single, &|| drop(black_box(hops(isa, &jobs))));
            println!("{name}: {} is {ratio:.2} times as fast as single", isa.name());
        }
    }
}

/// Returns the time of `one` over that of `other`, the median over turns.
fn median_ratio(one: &dyn Fn(), other: &dyn Fn()) -> f64 {
    let timed = |work: &dyn Fn()| {
        let began = Instant::now();
        work();
        began.elapsed().as_secs_f64()
    };
    let mut ratios: Vec<f64> = (0..TURNS).map(|_| timed(one) / timed(other)).collect();
    ratios.sort_by(f64::total_cmp);
    ratios[TURNS / 2]
}

criterion_group!(benches, together);
criterion_main!(benches);
