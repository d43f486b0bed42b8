//! Compares what is in assembly with what it stands for, bit for bit, and ends with
//! a status of its own at the first difference: the kernel that this build has chosen
//! with the portable one, on random networks and inputs, and the square root with libm's.
#![no_std]
#![no_main]

mod image;

use cortex_m_rt::entry;
use leg_control::actor::{
    ActionScaling, Activation, Activations, Actor, ObservationScaling, Widths, packed_len,
};

/// Widths of hidden layers: full panels, narrow ones and both, groups of columns
/// and what is left of them, one layer to three, the widest.
const HIDDEN: [&[u16]; 12] = [
    &[50, 50],
    &[],
    &[1],
    &[9],
    &[10],
    &[11, 20],
    &[20, 10, 30],
    &[61, 60],
    &[128, 25],
    &[25, 128],
    &[15, 25, 35],
    &[40, 40],
];
/// Networks of each shape, each with ReLU and with another activation, and inputs to each.
const NETWORKS: usize = 20;
const INPUTS: usize = 25;
/// Floats that the largest of them has.
const ROOM: usize = 4_096;

/// Exit status: the kernels differ.
const DIFFERENT: i32 = 1;
/// Exit status: a shape is not that of an actor, or too large.
const BAD_SHAPE: i32 = 2;
/// Exit status: the square roots differ.
const DIFFERENT_ROOTS: i32 = 3;

/// Square roots that are compared: one of so many bit patterns, from 0 on.
const ROOTS_STEP: usize = 4_093;

/// Xorshift32, of George Marsaglia.
struct Random(u32);

impl Random {
    fn bits(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }

    /// From -1 to 1, now and then a zero of either sign.
    fn weight(&mut self) -> f32 {
        match self.bits() % 64 {
            0 => 0.0,
            1 => -0.0,
            _ => self.bits().cast_signed() as f32 / 2_147_483_648.0,
        }
    }

    /// Mostly what a leg can meet; else any bits: infinite, NaN, denormal, huge.
    fn input(&mut self) -> f32 {
        match self.bits() % 8 {
            0 => f32::from_bits(self.bits()),
            _ => 20.0 * self.weight(),
        }
    }
}

#[entry]
fn main() -> ! {
    let mut random = Random(0x9e37_79b9);
    let mut room = [0.0_f32; ROOM];
    for hidden in HIDDEN {
        let mut widths = Widths::new();
        widths.extend([3].into_iter().chain(hidden.iter().copied()).chain([2]));
        let weights = packed_len(&widths).ok().and_then(|len| room.get_mut(..len));
        let Some(weights) = weights else { semihosting::process::exit(BAD_SHAPE) };
        for _ in 0..NETWORKS {
            weights.fill_with(|| random.weight());
            if !agree(&widths, weights, &mut random) {
                semihosting::process::exit(DIFFERENT)
            }
        }
    }
    if !(0..=u32::MAX).step_by(ROOTS_STEP).map(f32::from_bits).all(roots_agree) {
        semihosting::process::exit(DIFFERENT_ROOTS)
    }
    semihosting::process::exit(0)
}

/// Returns the bits of a float. Any NaN is as good as another: the language leaves its
/// sign and payload open.
fn bits(x: f32) -> u32 {
    if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() }
}

fn roots_agree(x: f32) -> bool {
    bits(leg_kernel_m4f::sqrt(x)) == bits(libm::sqrtf(x))
}

/// Whether both kernels give the same bits for random inputs.
fn agree(widths: &Widths, weights: &[f32], random: &mut Random) -> bool {
    let action = ActionScaling { scale: [1.0; 2], offset: [0.0; 2], low: [0.0; 2], high: [1.0; 2] };
    let identity = ObservationScaling::IDENTITY;
    // A kernel computes layers with ReLU one way and all others another way.
    [Activation::Relu, Activation::LeakyRelu(0.5)].into_iter().all(|hidden| {
        let activations = Activations { hidden, ..Activations::default() };
        let Ok(actor) = Actor::new(widths.clone(), activations, identity, action, weights) else {
            semihosting::process::exit(BAD_SHAPE)
        };
        (0..INPUTS).all(|_| {
            let input = [(); 3].map(|()| random.input());
            actor.sums(input).map(bits) == actor.sums_portable(input).map(bits)
        })
    })
}
