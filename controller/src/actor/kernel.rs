//! The inner loop of the network: ten rows of a layer at once.
//!
//! Every kernel adds a row's products to its bias in ascending order, each product
//! rounded before its sum, so that all give the same bits on every target.
//!
//! On a Cortex-M4F the run time depends on the order of the instructions more than on the
//! number of operations. A load costs two cycles, or one straight after another load. VMLA costs three
//! cycles and one instruction, VMUL and VADD two of each; neither is fused. The measured
//! cost of both kernels, and of other libraries, is in `controller/kernel-m4f/README.md`.
#![expect(clippy::inline_always, reason = "sums must stay in registers")]

use super::packing::PANEL_ROWS;
use super::shape::{MAX_WIDTH, OUTPUTS};
use core::sync::atomic::{Ordering, compiler_fence};
use heapless::Vec;

/// A column of a panel: one weight a row. A panel's first holds its biases.
pub(super) type Column = [f32; PANEL_ROWS];
/// The last layer's sums, or one of its columns.
pub(super) type Sums = [f32; OUTPUTS];

/// Outputs of a hidden layer, panel by panel.
pub(super) type Outputs = Vec<Column, { MAX_WIDTH.div_ceil(PANEL_ROWS) }>;

/// The computation of the full panels of a layer. Each panel's columns lie in `columns`
/// one after the other, its biases first; `x` are the layer's inputs.
pub(super) trait Kernel {
    /// Pushes the panels' outputs, ReLU and all, as far as there is room.
    fn push_outputs(y: &mut Outputs, columns: &[Column], x: &[f32]);

    /// Pushes the panels' sums, as far as there is room.
    fn push_sums(y: &mut Outputs, columns: &[Column], x: &[f32]);

    /// Adds the share of the panels' outputs to the last layer's sums `z`, each
    /// panel's by its columns of the `last` layer.
    fn fold_outputs(z: Sums, last: &[[Sums; PANEL_ROWS]], columns: &[Column], x: &[f32]) -> Sums;
}

/// Safe Rust, the same source on every target.
pub(super) struct Portable;

/// The kernel of this build: assembly where the feature `m4f-asm` asks for it and the
/// target is one that it is written for.
#[cfg(not(all(feature = "m4f-asm", target_arch = "arm", target_abi = "eabihf")))]
pub(super) type Chosen = Portable;
#[cfg(all(feature = "m4f-asm", target_arch = "arm", target_abi = "eabihf"))]
pub(super) type Chosen = Assembly;

/// Columns that the portable kernel takes in one turn of its loop.
const UNROLL: usize = 5;
/// Rows of a group's fourth column whose products wait for the next turn: as many
/// as leave registers for everything else.
const WAITING_ROWS: usize = 6;

/// Columns and their inputs, one turn of the loop.
type Group<'w, 'x> = (&'w [Column; UNROLL], &'x [f32; UNROLL]);
/// Products that a group leaves to be added in the next turn: of a part of its
/// fourth column, and of its fifth.
type Waiting = ([f32; WAITING_ROWS], Column);

impl Kernel for Portable {
    #[inline(always)]
    fn push_outputs(y: &mut Outputs, columns: &[Column], x: &[f32]) {
        for panel in columns.chunks_exact(x.len() + 1) {
            let _ = y.push(Panel::new(panel, x).outputs());
        }
    }

    #[inline(always)]
    fn push_sums(y: &mut Outputs, columns: &[Column], x: &[f32]) {
        for panel in columns.chunks_exact(x.len() + 1) {
            let _ = y.push(Panel::new(panel, x).sums());
        }
    }

    /// Panel by panel, so that the outputs never go to memory.
    #[inline(always)]
    fn fold_outputs(
        mut z: Sums,
        last: &[[Sums; PANEL_ROWS]],
        columns: &[Column],
        x: &[f32],
    ) -> Sums {
        for (panel, last) in columns.chunks_exact(x.len() + 1).zip(last) {
            z = fold(z, last, &Panel::new(panel, x).outputs());
        }
        z
    }
}

/// A full panel: its weights and their inputs.
struct Panel<'w, 'x> {
    biases: &'w Column,
    columns: &'w [Column],
    inputs: &'x [f32],
}

impl<'w, 'x> Panel<'w, 'x> {
    /// Splits a panel in memory into its biases and its columns.
    #[inline(always)]
    fn new(columns: &'w [Column], inputs: &'x [f32]) -> Self {
        const NONE: Column = [0.0; PANEL_ROWS];
        let (biases, columns) = columns.split_first().unwrap_or((&NONE, &[]));
        Self { biases, columns, inputs }
    }

    /// Computes the sums, and rectifies them.
    #[inline(always)]
    fn outputs(&self) -> Column {
        self.sums().map(relu)
    }

    /// Computes the sums of the panel. For speed on a Cortex-M4F:
    /// - the sums stay in registers while the columns go by, five in a turn;
    /// - a column's weights and its input are loaded in one go ([`products`]);
    /// - of five columns about three multiply and add at once, which the compiler
    ///   joins into VMLA where it may (`-Ctarget-feature=-slowfpvmlx`); the others
    ///   multiply at a turn's end and add at the next one's beginning, which it
    ///   cannot join.
    #[inline(always)]
    fn sums(&self) -> Column {
        let mut sums = *self.biases;
        let (columns, other_columns) = self.columns.as_chunks();
        let (inputs, other_inputs) = self.inputs.as_chunks();
        let mut groups = columns.iter().zip(inputs);
        if let Some(first) = groups.next() {
            let mut waiting = add_group(&mut sums, &first);
            for group in groups {
                add(&mut sums, waiting.0);
                add(&mut sums, waiting.1);
                waiting = add_group(&mut sums, &group);
            }
            add(&mut sums, waiting.0);
            add(&mut sums, waiting.1);
        }
        for term in other_columns.iter().zip(other_inputs) {
            add(&mut sums, products(&term));
        }
        sums
    }
}

/// Adds a group's products to the sums, but for those that it leaves to be added.
#[inline(always)]
fn add_group(sums: &mut Column, &(columns, inputs): &Group<'_, '_>) -> Waiting {
    let [w0, w1, w2, w3, w4] = columns;
    let [x0, x1, x2, x3, x4] = inputs;
    add(sums, products(&(w0, x0)));
    add(sums, products(&(w1, x1)));
    add(sums, products(&(w2, x2)));
    let product_3 = products(&(w3, x3));
    let mut waiting_3 = [0.0; WAITING_ROWS];
    for (row, (sum, product)) in sums.iter_mut().zip(product_3).enumerate() {
        match waiting_3.get_mut(row) {
            Some(later) => *later = product,
            None => *sum += product,
        }
    }
    (waiting_3, products(&(w4, x4)))
}

/// A column's products with its input.
///
/// The fence emits nothing. It keeps the compiler from moving loads past it, and
/// without the input there is nothing to compute before it: so all eleven loads
/// stand together. (The two come as a reference to a pair, for of a reference that
/// is itself an argument the compiler knows that nobody else writes through it,
/// and the fence would not bind it.)
#[inline(always)]
fn products(&(column, input): &(&Column, &f32)) -> Column {
    let weights = *column;
    compiler_fence(Ordering::SeqCst);
    let input = *input;
    weights.map(|w| w * input)
}

/// Adds products to the first sums.
#[inline(always)]
fn add<const N: usize>(sums: &mut Column, more: [f32; N]) {
    for (sum, x) in sums.iter_mut().zip(more) {
        *sum += x;
    }
}

/// Adds the share of some inputs to the last layer's sums.
#[inline(always)]
pub(super) fn fold(mut z: Sums, columns: &[Sums], x: &[f32]) -> Sums {
    for (column, &x) in columns.iter().zip(x) {
        let [z0, z1] = z;
        let [w0, w1] = column;
        z = [z0 + w0 * x, z1 + w1 * x];
    }
    z
}

/// Not `f32::max`, whose result for a zero of the other sign is unspecified. NaN
/// gives 0 on every target, whatever its sign there.
#[inline(always)]
pub(super) fn relu(x: f32) -> f32 {
    if x > 0.0 { x } else { 0.0 }
}

/// One audited block of assembly: see the crate.
#[cfg(all(feature = "m4f-asm", target_arch = "arm", target_abi = "eabihf"))]
pub(super) struct Assembly;

#[cfg(all(feature = "m4f-asm", target_arch = "arm", target_abi = "eabihf"))]
impl Kernel for Assembly {
    #[inline(always)]
    fn push_outputs(y: &mut Outputs, columns: &[Column], x: &[f32]) {
        leg_kernel_m4f::push_outputs(y, columns, x);
    }

    #[inline(always)]
    fn push_sums(y: &mut Outputs, columns: &[Column], x: &[f32]) {
        leg_kernel_m4f::push_sums(y, columns, x);
    }

    #[inline(always)]
    fn fold_outputs(
        mut z: Sums,
        last: &[[Sums; PANEL_ROWS]],
        columns: &[Column],
        x: &[f32],
    ) -> Sums {
        let mut y = Outputs::new();
        Self::push_outputs(&mut y, columns, x);
        for (last, y) in last.iter().zip(&y) {
            z = fold(z, last, y);
        }
        z
    }
}
