//! The assembly, and why it is sound.
//!
//! # What it is for
//! The compiler loads weights one by one; VLDM takes as many cycles but a tenth of
//! the instructions. Nor does it mix VMLA (one instruction, three cycles) with VMUL
//! and VADD (two of each), which is what balances instructions against cycles.
//!
//! # Audit
//! Of [`layer`], for a [`Job`] that meets the conditions stated at its fields:
//!
//! | | |
//! |---|---|
//! | reads | the six words of the job; for each panel, in ascending order, `40 * (1 + count)` bytes of `weights`, each once, and `4 * count` bytes of `inputs`, from their beginnings on |
//! | writes | `40 * panels` bytes of `outputs`, each once; 68 bytes of its own stack, which it pops |
//! | alignment | LDM, VLDM and VSTM want multiples of 4, which pointers and `f32` have in Rust |
//! | registers | `r0` to `r3`, `r12`, `s0` to `s15` and the flags, which the calling convention lets it change; `r4` to `r6` and `s16` to `s29`, which it saves and restores. FPSCR: cumulative exception bits only, which Rust gives no meaning to |
//! | ends | each loop counts its own count down: panels from above 0 to 0, columns in tens until below 0, what is left of them from below ten to 0, none if there is none |
//! | instructions | VLDM, VSTM, VMLA, VMUL, VADD, VCMP, VMRS and VMOV in single precision (VFPv2 and later) and plain integer ones: on every core with this target's ABI, in Thumb and in Arm state |
//! | result | row by row the products in ascending order, each rounded before its sum: VMLA is not fused (VFMA would be). Then, unless the job is linear, 0 for what is not above 0, NaN among it: VCMP with a NaN sets V and clears N, which is `le` |
//! | interrupts | nothing that may not be interrupted: no exclusive access, nothing below the stack pointer; the core stacks FP registers as for any other code |
//! | unwinding | calls nothing, so nothing unwinds through it |

use crate::ROWS;
use core::arch::naked_asm;
use heapless::Vec;

/// What the assembly works on, in the order in which it loads it.
#[repr(C)]
struct Job {
    /// Room for `panels` columns of [`ROWS`] floats; need not hold anything.
    outputs: *mut [f32; ROWS],
    /// `panels` times biases and `count` columns, of [`ROWS`] floats each.
    weights: *const [f32; ROWS],
    /// `count` floats.
    inputs: *const f32,
    /// Above 0.
    panels: usize,
    /// 0 to rectify the sums.
    linear: usize,
    /// Columns of a panel beside its biases; at most `isize::MAX`.
    count: usize,
}

/// Pushes the outputs of a layer: for each panel of `1 + inputs.len()` columns of
/// `weights`, of which the first are its biases, `max(0, bias + sum of weight *
/// input)` of its rows, with the products in ascending order, each rounded before
/// its sum, and with 0 for NaN. Stops at the last whole panel, or when `outputs`
/// is full.
#[inline]
pub fn push_outputs<const N: usize>(
    outputs: &mut Vec<[f32; ROWS], N>,
    weights: &[[f32; ROWS]],
    inputs: &[f32],
) {
    push(outputs, weights, inputs, 0);
}

/// Pushes the sums of a layer: those of [`push_outputs`] as they are, negative ones and NaN
/// among them.
#[inline]
pub fn push_sums<const N: usize>(
    sums: &mut Vec<[f32; ROWS], N>,
    weights: &[[f32; ROWS]],
    inputs: &[f32],
) {
    push(sums, weights, inputs, 1);
}

#[inline]
fn push<const N: usize>(
    outputs: &mut Vec<[f32; ROWS], N>,
    weights: &[[f32; ROWS]],
    inputs: &[f32],
    linear: usize,
) {
    let room = outputs.spare_capacity_mut();
    let panels = room.len().min(weights.len() / (inputs.len() + 1));
    if panels == 0 {
        return;
    }
    let job = Job {
        outputs: room.as_mut_ptr().cast(),
        weights: weights.as_ptr(),
        inputs: inputs.as_ptr(),
        panels,
        linear,
        count: inputs.len(),
    };
    // SAFETY: `room` is room for `panels` columns, `weights` holds `panels *
    // (1 + count)` of them and `inputs` `count` floats, by the division above; the
    // first is borrowed mutably and the others immutably until after the call.
    // A slice of floats has at most `isize::MAX / 4` of them. `panels` is not 0.
    unsafe { layer(&raw const job) };
    let len = outputs.len() + panels;
    // SAFETY: `panels` more columns were room in the vector and are now written.
    unsafe { outputs.set_len(len) };
}

/// A column's ten products by VMLA: one instruction and three cycles each.
macro_rules! multiply_accumulate {
    ($x:literal) => {
        concat!(
            "vldmia r1!, {{s10-s19}}\n",
            "vmla.f32 s0, s10, ",
            $x,
            "\n",
            "vmla.f32 s1, s11, ",
            $x,
            "\n",
            "vmla.f32 s2, s12, ",
            $x,
            "\n",
            "vmla.f32 s3, s13, ",
            $x,
            "\n",
            "vmla.f32 s4, s14, ",
            $x,
            "\n",
            "vmla.f32 s5, s15, ",
            $x,
            "\n",
            "vmla.f32 s6, s16, ",
            $x,
            "\n",
            "vmla.f32 s7, s17, ",
            $x,
            "\n",
            "vmla.f32 s8, s18, ",
            $x,
            "\n",
            "vmla.f32 s9, s19, ",
            $x,
            "\n",
        )
    };
}

/// The same by VMUL and VADD: two instructions and two cycles each.
macro_rules! multiply_then_add {
    ($x:literal) => {
        concat!(
            "vldmia r1!, {{s10-s19}}\n",
            "vmul.f32 s10, s10, ",
            $x,
            "\n",
            "vmul.f32 s11, s11, ",
            $x,
            "\n",
            "vmul.f32 s12, s12, ",
            $x,
            "\n",
            "vmul.f32 s13, s13, ",
            $x,
            "\n",
            "vmul.f32 s14, s14, ",
            $x,
            "\n",
            "vmul.f32 s15, s15, ",
            $x,
            "\n",
            "vmul.f32 s16, s16, ",
            $x,
            "\n",
            "vmul.f32 s17, s17, ",
            $x,
            "\n",
            "vmul.f32 s18, s18, ",
            $x,
            "\n",
            "vmul.f32 s19, s19, ",
            $x,
            "\n",
            "vadd.f32 s0, s0, s10\n",
            "vadd.f32 s1, s1, s11\n",
            "vadd.f32 s2, s2, s12\n",
            "vadd.f32 s3, s3, s13\n",
            "vadd.f32 s4, s4, s14\n",
            "vadd.f32 s5, s5, s15\n",
            "vadd.f32 s6, s6, s16\n",
            "vadd.f32 s7, s7, s17\n",
            "vadd.f32 s8, s8, s18\n",
            "vadd.f32 s9, s9, s19\n",
        )
    };
}

/// A sum that is not above 0, or is NaN, becomes the 0 in `s10`.
macro_rules! relu {
    ($($sum:literal),*) => {
        concat!($(
            "vcmp.f32 ", $sum, ", #0.0\n",
            "vmrs APSR_nzcv, fpscr\n",
            "it le\n",
            "vmovle.f32 ", $sum, ", s10\n",
        )*)
    };
}

/// Does the job.
///
/// # Safety
/// The job must meet the conditions stated at its fields, and nobody else may
/// access its outputs, nor change its weights and inputs, until this returns.
#[unsafe(naked)]
unsafe extern "C" fn layer(job: *const Job) {
    naked_asm!(
        // The assembler does not know the target's features; every target with this ABI has this one.
        ".fpu vfpv2",
        "push {{r4, r5, r6}}",
        "vpush {{s16-s29}}",
        // r0 outputs, r1 weights, r2 inputs, r3 panels, r6 linear, r12 count.
        "ldm r0, {{r0, r1, r2, r3, r6, r12}}",
        // A panel: its biases, then r4 inputs and r5 columns that are left.
        "2:",
        "vldmia r1!, {{s0-s9}}",
        "mov r4, r2",
        "subs r5, r12, #10",
        "blo 4f",
        // Ten columns.
        "3:",
        "vldmia r4!, {{s20-s29}}",
        multiply_accumulate!("s20"),
        multiply_then_add!("s21"),
        multiply_then_add!("s22"),
        multiply_accumulate!("s23"),
        multiply_then_add!("s24"),
        multiply_then_add!("s25"),
        multiply_accumulate!("s26"),
        multiply_then_add!("s27"),
        multiply_then_add!("s28"),
        multiply_then_add!("s29"),
        "subs r5, r5, #10",
        "bhs 3b",
        "4:",
        "adds r5, r5, #10",
        "beq 6f",
        // One column.
        "5:",
        "vldmia r4!, {{s20}}",
        multiply_accumulate!("s20"),
        "subs r5, r5, #1",
        "bne 5b",
        "6:",
        // Where the sums are rectified this is 0.
        "movs r4, r6",
        "bne 7f",
        "vmov s10, r4",
        relu!("s0", "s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8", "s9"),
        "7:",
        "vstmia r0!, {{s0-s9}}",
        "subs r3, r3, #1",
        "bne 2b",
        "vpop {{s16-s29}}",
        "pop {{r4, r5, r6}}",
        "bx lr",
    )
}
