#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]
#![allow(
    clippy::inline_always,
    reason = "code that is inlined is compiled for the instruction set"
)]

mod wide;

use leg_plant::lanes;
use leg_plant::{Hop, Outcome};
use leg_simd::{Isa, Kernel, Lanes, Simd, dispatch};
use wide::Wide;

pub use leg_plant::lanes::Job;

/// Computes the hop of each job, and returns them in the order of the jobs.
///
/// # Panics
/// If this CPU does not have `isa`.
#[must_use]
pub fn hops(isa: Isa, jobs: &[Job<'_>]) -> Vec<Hop> {
    let none = Hop { outcome: Outcome::Fall, stance_phases: 0, touchdown: None, liftoff_t_s: None };
    let mut hops = vec![none; jobs.len()];
    dispatch(isa, Hops { jobs, hops: &mut hops });
    hops
}

struct Hops<'a> {
    jobs: &'a [Job<'a>],
    hops: &'a mut [Hop],
}

impl Kernel for Hops<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self { jobs, hops } = self;
        if S::Doubles::LANES > 2 {
            lanes::hop_all(Wide(S::Doubles::splat(simd, 0.0)), jobs, hops);
        } else {
            // A single hop fills registers of two numbers better than two hops do: it computes x
            // and y at once, and each search runs for the hop that needs it. Two hops in lanes
            // took 1.2 times as long.
            for (hop, job) in hops.iter_mut().zip(jobs) {
                *hop = job.hopper.hop(job.start, job.action);
            }
        }
    }
}
