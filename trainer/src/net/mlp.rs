//! A perceptron with two hidden layers of equal width, over a batch.
//!
//! `X` inputs, `H` ReLU units, then (with `E` further inputs beside them, as a
//! critic may take its action there) `H` ReLU units, then `O` linear outputs.
//! `P` is the padded width of every row: at least `H + E + 1`, a multiple of 8.
//!
//! Two layouts of activations meet each other here. `[unit][sample]` makes the
//! batch the vector dimension: no padding, weights broadcast. `[sample][unit]`
//! is what sums over the batch (weight gradients) need. Only the first hidden
//! layer is needed in both, and is so thin that it is computed twice.
//!
//! Weights are rows of `P`: `X` rows of the first layer by input and its bias row,
//! `H` rows of the second by unit (bias in lane `H + E`), `O` rows of the third
//! (bias in lane `H`). Every other lane is zero and stays zero.

use super::Row;
use super::product::{Gated, Linear, PerColumn, PerRow, Product, Relu, Straight, Transposed, Zero};
use crate::simd::{Simd, Sum, Vector};

/// The weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Mlp<const X: usize, const H: usize, const E: usize, const O: usize, const P: usize> {
    rows: Box<[Row<P>]>,
}

/// One layer in the natural order: weights row-major (outputs, inputs), biases.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layer {
    /// Inputs.
    pub inputs: usize,
    /// Row-major, outputs by inputs.
    pub weights: Vec<f32>,
    /// One per output.
    pub bias: Vec<f32>,
}

/// A batch on its way through a network of the same shape.
#[derive(Clone, Debug)]
pub(crate) struct Pass<
    const X: usize,
    const H: usize,
    const E: usize,
    const O: usize,
    const P: usize,
    const B: usize,
> {
    /// Inputs and a last row of ones: `[X + 1][B]`.
    pub(crate) inputs: Box<[Row<B>]>,
    /// First hidden layer and below it the further inputs: `[H + E][B]`.
    first: Box<[Row<B>]>,
    /// Second hidden layer: `[H][B]`.
    second: Box<[Row<B>]>,
    /// Outputs: `[O][B]`.
    pub(crate) outputs: Box<[Row<B>]>,
    /// The first hidden layer, further inputs and a one, by sample: `[B][P]`.
    by_sample: Box<[Row<P>]>,
    /// Derivative of the loss by the outputs: `[O][B]`. Set before going back.
    pub(crate) output_slopes: Box<[Row<B>]>,
    second_slopes: Box<[Row<B>]>,
    first_slopes: Box<[Row<P>]>,
    first_slopes_by_unit: Box<[Row<B>]>,
    /// Derivative by the last inputs of the first layer, or by the further ones.
    pub(crate) input_slopes: Box<[Row<B>]>,
}

fn rows<const N: usize>(count: usize) -> Box<[Row<N>]> {
    vec![Row::ZERO; count].into()
}

impl<const X: usize, const H: usize, const E: usize, const O: usize, const P: usize>
    Mlp<X, H, E, O, P>
{
    /// Rows of weights.
    pub(crate) const ROWS: usize = X + 1 + H + O;
    const SECOND: usize = X + 1;
    const THIRD: usize = X + 1 + H;

    /// All weights zero.
    pub(crate) fn zeros() -> Self {
        const { assert!(P > H + E && P.is_multiple_of(8) && H.is_multiple_of(10)) };
        Self { rows: rows(Self::ROWS) }
    }

    /// From the three layers in natural order; the second has `H + E` inputs.
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

    /// The three layers in natural order.
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

    /// All rows, for the optimiser.
    #[inline(always)]
    pub(crate) fn rows(&self) -> &[Row<P>] {
        &self.rows
    }

    /// All rows, for the optimiser.
    #[inline(always)]
    pub(crate) fn rows_mut(&mut self) -> &mut [Row<P>] {
        &mut self.rows
    }

    /// The rows of the three layers.
    #[inline(always)]
    pub(crate) fn layers_mut(&mut self) -> (&mut [Row<P>], &mut [Row<P>], &mut [Row<P>]) {
        let (first, rest) = self.rows.split_at_mut(Self::SECOND);
        let (second, third) = rest.split_at_mut(Self::THIRD - Self::SECOND);
        (first, second, third)
    }

    /// From `pass.inputs` to `pass.outputs`.
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
        .into::<S, 10, 5>(simd, &mut pass.outputs);
    }

    /// From `pass.output_slopes` to the slopes of the second layer's sums.
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

    /// The loss's gradient by the weights, after [`Self::forward`] on the same pass.
    #[inline(always)]
    pub(crate) fn gradient<S: Simd, const B: usize>(
        &self,
        simd: S,
        pass: &mut Pass<X, H, E, O, P, B>,
        gradient: &mut Self,
    ) {
        self.back_to_second(simd, pass);
        // Third layer: sums over the batch of few rows, lane by lane.
        for (row, slopes) in gradient.rows[Self::THIRD..].iter_mut().zip(&pass.output_slopes) {
            for (i, h) in pass.second.iter().enumerate() {
                row[i] = dot(simd, h, slopes);
            }
            row[H] = dot(simd, &Row([1.0; B]), slopes);
        }
        // First hidden layer by sample; its spare lanes carry the further inputs and a one.
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
        // The spare lanes of the first layer are no units.
        for row in &mut gradient.rows[..=X] {
            row[H..].fill(0.0);
        }
    }

    /// The slopes of the last `count` inputs (the further ones, where there are
    /// any), after [`Self::forward`] on the same pass.
    #[inline(always)]
    pub(crate) fn back_to_inputs<S: Simd, const B: usize>(
        &self,
        simd: S,
        pass: &mut Pass<X, H, E, O, P, B>,
    ) {
        self.back_to_second(simd, pass);
        let second = &self.rows[Self::SECOND..Self::THIRD];
        if E > 0 {
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

/// The sum over the batch of the products.
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
    /// Room for a batch; `free` inputs have their slopes wanted.
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

    /// The inputs that join at the second layer, or else the last inputs of the
    /// first: where a critic takes its action.
    #[inline(always)]
    pub(crate) fn action_rows(&mut self) -> &mut [Row<B>] {
        if E > 0 { &mut self.first[H..] } else { &mut self.inputs[X - 2..X] }
    }
}
