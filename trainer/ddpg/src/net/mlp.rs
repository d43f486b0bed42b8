//! A perceptron with two hidden layers of equal width, evaluated over a batch.
//!
//! The network has `X` inputs, `H` ReLU units, `H` further ReLU units, and `O` linear outputs.
//! `E` further inputs may enter at the second hidden layer, where the paper's critic takes its
//! action. `P` is the padded width of every row: at least `H + E + 1`, and a multiple of 8.
//!
//! Activations have two layouts. `[unit][sample]` makes the batch the vector dimension: it
//! needs no padding, and weights are broadcast. `[sample][unit]` suits the sums over the batch,
//! that is the weight gradients. Only the first hidden layer is needed in both, and it is thin
//! enough to be computed twice.
//!
//! The weights are rows of `P`: `X` rows of the first layer by input and its bias row, `H` rows
//! of the second layer by unit (bias in lane `H + E`), and `O` rows of the third layer (bias in
//! lane `H`). Every other lane is zero and stays zero.

use super::Row;
use super::product::{Gated, Linear, PerColumn, PerRow, Product, Relu, Straight, Transposed, Zero};
use leg_simd::{Lanes, Simd, Sum};

/// The weights of a network.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Mlp<
    const X: usize,
    const H: usize,
    const E: usize,
    const O: usize,
    const P: usize,
> {
    rows: Box<[Row<P>]>,
}

/// The weights of one linear layer, in the order in which other tools store them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layer {
    /// Number of inputs.
    pub inputs: usize,
    /// Weights, row-major, of shape (outputs, inputs).
    pub weights: Vec<f32>,
    /// Biases, one for each output.
    pub bias: Vec<f32>,
}

/// The activations and slopes of a batch, for a network of the same shape.
#[derive(Clone, Debug)]
pub(crate) struct Pass<
    const X: usize,
    const H: usize,
    const E: usize,
    const O: usize,
    const P: usize,
    const B: usize,
> {
    /// Inputs and a last row of ones, `[X + 1][B]`.
    pub(crate) inputs: Box<[Row<B>]>,
    /// First hidden layer, then the further inputs, `[H + E][B]`.
    first: Box<[Row<B>]>,
    /// Second hidden layer, `[H][B]`.
    second: Box<[Row<B>]>,
    /// Outputs, `[O][B]`.
    pub(crate) outputs: Box<[Row<B>]>,
    /// First hidden layer, further inputs and a one, by sample, `[B][P]`.
    by_sample: Box<[Row<P>]>,
    /// Derivative of the loss by the outputs, `[O][B]`. The caller sets it before
    /// back-propagation.
    pub(crate) output_slopes: Box<[Row<B>]>,
    second_slopes: Box<[Row<B>]>,
    first_slopes: Box<[Row<P>]>,
    first_slopes_by_unit: Box<[Row<B>]>,
    /// Derivative of the loss by the further inputs, or by the last inputs of the first layer
    /// where there are none.
    pub(crate) input_slopes: Box<[Row<B>]>,
}

fn rows<const N: usize>(count: usize) -> Box<[Row<N>]> {
    vec![Row::ZERO; count].into()
}

impl<const X: usize, const H: usize, const E: usize, const O: usize, const P: usize>
    Mlp<X, H, E, O, P>
{
    /// Number of rows of weights.
    pub(crate) const ROWS: usize = X + 1 + H + O;
    const SECOND: usize = X + 1;
    const THIRD: usize = X + 1 + H;

    /// Returns a network with all weights zero.
    pub(crate) fn zeros() -> Self {
        const { assert!(P > H + E && P.is_multiple_of(8) && H.is_multiple_of(10)) };
        Self { rows: rows(Self::ROWS) }
    }

    /// Loads three layers; the second has `H + E` inputs.
    pub(crate) fn from_layers(layers: &[Layer; 3]) -> Self {
        let mut net = Self::zeros();
        let [a, b, c] = layers;
        for (o, (row, bias)) in a.weights.chunks(X).zip(&a.bias).enumerate() {
            for (i, &w) in row.iter().enumerate() {
                net.rows[i][o] = w;
            }
            net.rows[X][o] = *bias;
        }
        for (o, (row, bias)) in b.weights.chunks(H + E).zip(&b.bias).enumerate() {
            net.rows[Self::SECOND + o][..H + E].copy_from_slice(row);
            net.rows[Self::SECOND + o][H + E] = *bias;
        }
        for (o, (row, bias)) in c.weights.chunks(H).zip(&c.bias).enumerate() {
            net.rows[Self::THIRD + o][..H].copy_from_slice(row);
            net.rows[Self::THIRD + o][H] = *bias;
        }
        net
    }

    /// Returns the three layers.
    pub(crate) fn to_layers(&self) -> [Layer; 3] {
        let of = |inputs: usize, outputs: usize, at: &dyn Fn(usize, usize) -> f32| Layer {
            inputs,
            weights: (0..outputs)
                .flat_map(|o| (0..inputs).map(move |i| (o, i)))
                .map(|(o, i)| at(o, i))
                .collect(),
            bias: (0..outputs).map(|o| at(o, inputs)).collect(),
        };
        [
            of(X, H, &|o, i| self.rows[i][o]),
            of(H + E, H, &|o, i| self.rows[Self::SECOND + o][i]),
            of(H, O, &|o, i| self.rows[Self::THIRD + o][i]),
        ]
    }

    /// Returns all rows, for the optimiser.
    #[inline(always)]
    pub(crate) fn rows(&self) -> &[Row<P>] {
        &self.rows
    }

    /// Returns all rows, for the optimiser.
    #[inline(always)]
    pub(crate) fn rows_mut(&mut self) -> &mut [Row<P>] {
        &mut self.rows
    }

    /// Returns the rows of the three layers.
    #[inline(always)]
    pub(crate) fn layers_mut(&mut self) -> (&mut [Row<P>], &mut [Row<P>], &mut [Row<P>]) {
        let (first, rest) = self.rows.split_at_mut(Self::SECOND);
        let (second, third) = rest.split_at_mut(Self::THIRD - Self::SECOND);
        (first, second, third)
    }

    /// Computes `pass.outputs` from `pass.inputs`.
    #[inline(always)]
    pub(crate) fn forward<S: Simd, const B: usize>(
        &self,
        simd: S,
        pass: &mut Pass<X, H, E, O, P, B>,
    ) {
        let (first, second) = (&self.rows[..=X], &self.rows[Self::SECOND..Self::THIRD]);
        Product {
            a: Transposed::from(&first[..X], 0),
            m: &pass.inputs[..X],
            start: PerRow(|o: usize| first[X][o]),
            finish: Relu,
        }
        .into::<S, 10, 5>(simd, &mut pass.first[..H]);
        Product {
            a: Straight(second),
            m: &pass.first[..H + E],
            start: PerRow(|o: usize| second[o][H + E]),
            finish: Relu,
        }
        .into::<S, 10, 5>(simd, &mut pass.second);
        let third = &self.rows[Self::THIRD..];
        Product {
            a: Straight(third),
            m: &pass.second,
            start: PerRow(|o: usize| third[o][H]),
            finish: Linear,
        }
        .into::<S, O, O>(simd, &mut pass.outputs);
    }

    /// Computes the slopes of the second layer's sums from `pass.output_slopes`.
    #[inline(always)]
    fn back_to_second<S: Simd, const B: usize>(&self, simd: S, pass: &mut Pass<X, H, E, O, P, B>) {
        Product {
            a: Transposed::from(&self.rows[Self::THIRD..], 0),
            m: &pass.output_slopes,
            start: Zero,
            finish: Gated(&pass.second),
        }
        .into::<S, 10, 5>(simd, &mut pass.second_slopes);
    }

    /// Computes the loss's gradient by the weights, after [`Self::forward`] on the same pass.
    #[inline(always)]
    pub(crate) fn gradient<S: Simd, const B: usize>(
        &self,
        simd: S,
        pass: &mut Pass<X, H, E, O, P, B>,
        gradient: &mut Self,
    ) {
        self.back_to_second(simd, pass);
        // The third layer has few rows: sum each over the batch, lane by lane.
        for (row, slopes) in gradient.rows[Self::THIRD..].iter_mut().zip(&pass.output_slopes) {
            for (i, h) in pass.second.iter().enumerate() {
                row[i] = dot(simd, h, slopes);
            }
            row[H] = dot(simd, &Row([1.0; B]), slopes);
        }
        // The spare lanes of the first hidden layer, by sample, hold the further inputs and a
        // one.
        Product {
            a: Transposed::from(&pass.inputs[..X], 0),
            m: &self.rows[..X],
            start: PerColumn(&self.rows[X]),
            finish: Relu,
        }
        .into::<S, 8, 4>(simd, &mut pass.by_sample);
        for (b, sample) in pass.by_sample.iter_mut().enumerate() {
            for e in 0..E {
                sample[H + e] = pass.first[H + e][b];
            }
            sample[H + E] = 1.0;
        }
        Product {
            a: Straight(&pass.second_slopes),
            m: &pass.by_sample,
            start: Zero,
            finish: Linear,
        }
        .into::<S, 10, 5>(simd, &mut gradient.rows[Self::SECOND..Self::THIRD]);
        Product {
            a: Transposed::from(&pass.second_slopes, 0),
            m: &self.rows[Self::SECOND..Self::THIRD],
            start: Zero,
            finish: Gated(&pass.by_sample),
        }
        .into::<S, 8, 4>(simd, &mut pass.first_slopes);
        Product { a: Straight(&pass.inputs), m: &pass.first_slopes, start: Zero, finish: Linear }
            .into::<S, 2, 2>(simd, &mut gradient.rows[..=X]);
        // The spare lanes of the first layer are not units.
        for row in &mut gradient.rows[..=X] {
            row[H..].fill(0.0);
        }
    }

    /// Computes `pass.input_slopes`, after [`Self::forward`] on the same pass.
    #[inline(always)]
    pub(crate) fn back_to_inputs<S: Simd, const B: usize>(
        &self,
        simd: S,
        pass: &mut Pass<X, H, E, O, P, B>,
    ) {
        self.back_to_second(simd, pass);
        let second = &self.rows[Self::SECOND..Self::THIRD];
        if const { E > 0 } {
            Product {
                a: Transposed::from(second, H),
                m: &pass.second_slopes,
                start: Zero,
                finish: Linear,
            }
            .into::<S, 2, 2>(simd, &mut pass.input_slopes);
            return;
        }
        Product {
            a: Transposed::from(second, 0),
            m: &pass.second_slopes,
            start: Zero,
            finish: Gated(&pass.first),
        }
        .into::<S, 10, 5>(simd, &mut pass.first_slopes_by_unit);
        let skipped = X - pass.input_slopes.len();
        Product {
            a: Straight(&self.rows[skipped..X]),
            m: &pass.first_slopes_by_unit,
            start: Zero,
            finish: Linear,
        }
        .into::<S, 2, 2>(simd, &mut pass.input_slopes);
    }
}

/// Returns the sum of the products over the batch.
#[inline(always)]
fn dot<S: Simd, const B: usize>(simd: S, a: &Row<B>, b: &Row<B>) -> f32 {
    let mut c = 0;
    let mut sum = S::V16::splat(simd, 0.0);
    while c + 16 <= B {
        sum = sum.add(S::V16::load(simd, &a[c..]).mul(S::V16::load(simd, &b[c..])));
        c += 16;
    }
    if c < B {
        let rest = S::V8::load(simd, &a[c..]).mul(S::V8::load(simd, &b[c..]));
        return sum.sum() + rest.sum();
    }
    sum.sum()
}

impl<const X: usize, const H: usize, const E: usize, const O: usize, const P: usize, const B: usize>
    Pass<X, H, E, O, P, B>
{
    /// Allocates the buffers of a batch. `free` is the number of inputs whose slopes are
    /// needed.
    pub(crate) fn new(free: usize) -> Self {
        let mut inputs = rows(X + 1);
        inputs[X] = Row([1.0; B]);
        Self {
            inputs,
            first: rows(H + E),
            second: rows(H),
            outputs: rows(O),
            by_sample: rows(B),
            output_slopes: rows(O),
            second_slopes: rows(H),
            first_slopes: rows(B),
            first_slopes_by_unit: rows(H),
            input_slopes: rows(free),
        }
    }

    /// Returns the rows of a critic's action: the further inputs, or the last two inputs of the
    /// first layer where there are none.
    #[inline(always)]
    pub(crate) fn action_rows(&mut self) -> &mut [Row<B>] {
        if E > 0 { &mut self.first[H..] } else { &mut self.inputs[X - 2..X] }
    }
}
