//! The square root, by the instruction that the core has for it.
//!
//! Without std Rust has no stable way to that instruction, and libm's square root of
//! integers takes 450 bytes of flash and 40 instructions more.

use core::arch::naked_asm;

/// Returns the square root of `x`, rounded to nearest; NaN below 0.
// SAFETY: argument and result are in `s0`, as the ABI has it; nothing else is read or
// written but the cumulative exception bits of the FPSCR, which Rust gives no meaning to.
#[must_use]
#[unsafe(naked)]
pub extern "C" fn sqrt(x: f32) -> f32 {
    naked_asm!(
        // As in `layer`: the assembler does not know the target's features.
        ".fpu vfpv2",
        "vsqrt.f32 s0, s0",
        "bx lr",
    )
}
