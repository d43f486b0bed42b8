//! What `cargo xtask budget --policy` counts: an inference of the policy file that `LEG_POLICY`
//! names, when this is built.
#![no_std]
#![no_main]

mod image;

use core::hint::black_box;
use cortex_m_rt::entry;
use leg_control::actor::{Action, Actor, Observation};
use leg_control::policy::Policy;

/// Exit status: the policy is refused.
const NO_POLICY: i32 = 2;

/// Bytes at an address that the weights may have.
#[repr(align(16))]
struct Aligned<T: ?Sized>(T);

static BLOB: &Aligned<[u8]> = &Aligned(*include_bytes!(env!("LEG_POLICY")));

#[inline(never)]
fn measured_inference(actor: &Actor<'_>, observation: Observation) -> Action {
    actor.act(observation)
}

#[entry]
fn main() -> ! {
    let Ok(policy) = Policy::parse(black_box(&BLOB.0)) else {
        semihosting::process::exit(NO_POLICY)
    };
    let actor = black_box(policy.actor());
    // In flight and in the water, on both sides of the activations.
    for apex_vx_m_s in [-2.0, -0.3, 0.0, 0.3, 2.0] {
        for density_ratio in [0.0, 0.4, 1.0] {
            let observation = Observation { apex_vx_m_s, apex_y_m: 1.5, density_ratio };
            black_box(measured_inference(actor, black_box(observation)));
        }
    }
    semihosting::process::exit(0)
}
