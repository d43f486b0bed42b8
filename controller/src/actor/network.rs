//! From the inputs to the last sums, layer by layer and panel by panel.
#![expect(clippy::inline_always, reason = "sums must stay in registers")]

use super::activation::Activation;
use super::kernel::{Column, Kernel, Outputs, Sums, fold, relu};
use super::packing::PANEL_ROWS;
use super::shape::INPUTS;

/// Computes the last sums of a network with ReLU. [`super::Actor::new`] has checked that the weights are as many
/// as the widths need; if they were not, the sums would be meaningless, without a panic.
#[inline(always)]
pub(super) fn sums<K: Kernel>(widths: &[u16], weights: &[f32], input: [f32; INPUTS]) -> Sums {
    let mut rest = weights;
    match widths {
        [_, first, between @ .., last, _] => {
            let mut x = Outputs::new();
            hidden_layer::<K>(&mut rest, &input, usize::from(*first), &mut x);
            let mut inputs = usize::from(*first);
            for &width in between {
                let width = usize::from(width);
                let mut y = Outputs::new();
                hidden_layer::<K>(&mut rest, flat(&x, inputs), width, &mut y);
                (x, inputs) = (y, width);
            }
            last_two_layers::<K>(rest, flat(&x, inputs), usize::from(*last))
        }
        [_, only, _] => last_two_layers::<K>(rest, &input, usize::from(*only)),
        _ => {
            let (biases, columns) = last_layer(weights);
            fold(biases, columns, &input)
        }
    }
}

/// Computes the last sums of a network with any function between its layers: slower than
/// [`sums`], whose layers rectify while they are in registers.
#[inline(never)]
pub(super) fn activated_sums<K: Kernel>(
    widths: &[u16],
    activation: Activation,
    mut weights: &[f32],
    input: [f32; INPUTS],
) -> Sums {
    let [_, hidden @ .., _] = widths else { return Sums::default() };
    let (mut x, mut inputs) = (Outputs::new(), INPUTS);
    let mut first = Column::default();
    first.iter_mut().zip(input).for_each(|(place, x)| *place = x);
    let _ = x.push(first);
    for &width in hidden {
        let width = usize::from(width);
        let mut y = Outputs::new();
        layer_sums::<K>(&mut weights, flat(&x, inputs), width, &mut y);
        activation.apply(y.as_flattened_mut().get_mut(..width).unwrap_or_default());
        (x, inputs) = (y, width);
    }
    let (biases, columns) = last_layer(weights);
    fold(biases, columns, flat(&x, inputs))
}

/// Takes a layer's weights from the front of `rest` and pushes its sums.
#[inline(always)]
fn layer_sums<K: Kernel>(rest: &mut &[f32], x: &[f32], width: usize, y: &mut Outputs) {
    let narrow_rows = width % PANEL_ROWS;
    let full = take(rest, width - narrow_rows, x.len());
    let narrow = take(rest, narrow_rows, x.len());
    K::push_sums(y, full.as_chunks().0, x);
    if narrow_rows > 0 {
        // There is room: a width is at most `MAX_WIDTH`.
        let _ = y.push(narrow_sums(narrow, narrow_rows, x));
    }
}

/// Returns the first `len` outputs, without the padding of the last panel.
fn flat(outputs: &Outputs, len: usize) -> &[f32] {
    outputs.as_flattened().get(..len).unwrap_or_default()
}

/// Takes a hidden layer's weights from the front of `rest` and pushes its outputs.
#[inline(always)]
fn hidden_layer<K: Kernel>(rest: &mut &[f32], x: &[f32], width: usize, y: &mut Outputs) {
    let narrow_rows = width % PANEL_ROWS;
    let full = take(rest, width - narrow_rows, x.len());
    let narrow = take(rest, narrow_rows, x.len());
    K::push_outputs(y, full.as_chunks().0, x);
    if narrow_rows > 0 {
        // There is room: a width is at most `MAX_WIDTH`.
        let _ = y.push(narrow_sums(narrow, narrow_rows, x).map(relu));
    }
}

/// Computes the last hidden layer and the last layer together: each panel's outputs are
/// added to the last layer's sums at once, in ascending order, without going to memory.
#[inline(always)]
fn last_two_layers<K: Kernel>(mut rest: &[f32], x: &[f32], width: usize) -> Sums {
    let narrow_rows = width % PANEL_ROWS;
    let full = take(&mut rest, width - narrow_rows, x.len());
    let narrow = take(&mut rest, narrow_rows, x.len());
    let (z, last) = last_layer(rest);
    let (last_of_full, last_of_narrow) = last.as_chunks::<PANEL_ROWS>();
    let z = K::fold_outputs(z, last_of_full, full.as_chunks().0, x);
    if narrow_rows == 0 {
        return z;
    }
    fold(z, last_of_narrow, &narrow_sums(narrow, narrow_rows, x).map(relu))
}

/// Splits the weights of `rows` rows off the front.
fn take<'w>(rest: &mut &'w [f32], rows: usize, inputs: usize) -> &'w [f32] {
    rest.split_off(..rows * (inputs + 1)).unwrap_or_default()
}

/// Returns the last layer's biases and columns: it is one narrow panel.
fn last_layer(weights: &[f32]) -> (Sums, &[Sums]) {
    weights.as_chunks().0.split_first().map_or_else(Default::default, |(b, w)| (*b, w))
}

/// Computes the sums of the last panel of a layer whose width is not a multiple of
/// [`PANEL_ROWS`], padded with zeros.
#[inline(never)]
fn narrow_sums(weights: &[f32], rows: usize, x: &[f32]) -> Column {
    let mut sums = Column::default();
    let mut columns = weights.chunks_exact(rows.max(1));
    for (sum, &bias) in sums.iter_mut().zip(columns.next().unwrap_or_default()) {
        *sum = bias;
    }
    for (column, &x) in columns.zip(x) {
        for (sum, &w) in sums.iter_mut().zip(column) {
            *sum += w * x;
        }
    }
    sums
}
