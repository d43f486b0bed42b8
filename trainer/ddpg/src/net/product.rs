//! The matrix product `out = finish(start + A M)`, which the forward pass, back-propagation and
//! weight gradients share.
//!
//! A tile of rows and columns of `out` is summed in registers over the whole inner dimension:
//! each step loads one piece of a row of `M` and broadcasts one number of each row of `A`.
//! Every element of `out` is summed in the order of the inner dimension, whatever the tiling,
//! so the bits do not depend on the tiling.

use super::Row;
use leg_simd::{Lanes, Pair, Simd, Vector};

/// The left factor `A` of a product.
pub(crate) trait Left: Copy {
    /// A group of `R` rows of `A`.
    type Rows<const R: usize>: Factors<R>;
    /// Returns rows `first..first + R`.
    fn rows<const R: usize>(self, first: usize) -> Self::Rows<R>;
}

/// A group of `R` rows of the left factor. It is a trait and not a closure because a closure
/// need not be inlined, see [`leg_simd::Kernel::run`].
pub(crate) trait Factors<const R: usize>: Copy {
    /// Returns the numbers of these rows in column `k`.
    fn column(self, k: usize) -> [f32; R];
}

/// The left factor as it is stored.
#[derive(Clone, Copy)]
pub(crate) struct Straight<'a, const P: usize>(pub(crate) &'a [Row<P>]);

impl<'a, const P: usize> Left for Straight<'a, P> {
    type Rows<const R: usize> = &'a [Row<P>; R];
    #[inline(always)]
    fn rows<const R: usize>(self, first: usize) -> &'a [Row<P>; R] {
        self.0[first..].first_chunk().expect("R rows of A")
    }
}

impl<const R: usize, const P: usize> Factors<R> for &[Row<P>; R] {
    #[inline(always)]
    fn column(self, k: usize) -> [f32; R] {
        let mut column = [0.0; R];
        for r in 0..R {
            column[r] = self[r][k];
        }
        column
    }
}

/// The transposed left factor: row `k` of the storage, from index `from` on, is column `k` of
/// `A`.
#[derive(Clone, Copy)]
pub(crate) struct Transposed<'a, const P: usize> {
    columns: &'a [Row<P>],
    from: usize,
}

impl<'a, const P: usize> Transposed<'a, P> {
    /// Returns the factor whose first row is at index `from` of the storage's rows.
    #[inline(always)]
    pub(crate) fn from(columns: &'a [Row<P>], from: usize) -> Self {
        Self { columns, from }
    }
}

impl<const P: usize> Left for Transposed<'_, P> {
    type Rows<const R: usize> = Self;
    #[inline(always)]
    fn rows<const R: usize>(self, first: usize) -> Self {
        Self::from(self.columns, self.from + first)
    }
}

impl<const R: usize, const P: usize> Factors<R> for Transposed<'_, P> {
    #[inline(always)]
    fn column(self, k: usize) -> [f32; R] {
        *self.columns[k][self.from..].first_chunk().expect("R columns")
    }
}

/// The value at which the sums begin.
pub(crate) trait Start: Copy {
    /// Returns the start of `row`, from `column` on.
    fn at<V: Vector>(self, token: V::Token, row: usize, column: usize) -> V;
}

/// Sums that begin at zero.
#[derive(Clone, Copy)]
pub(crate) struct Zero;

impl Start for Zero {
    #[inline(always)]
    fn at<V: Vector>(self, token: V::Token, _: usize, _: usize) -> V {
        V::splat(token, 0.0)
    }
}

/// Sums that begin at a number per row, given by a function of the row.
#[derive(Clone, Copy)]
pub(crate) struct PerRow<F>(pub(crate) F);

impl<F: Fn(usize) -> f32 + Copy> Start for PerRow<F> {
    #[inline(always)]
    fn at<V: Vector>(self, token: V::Token, row: usize, _: usize) -> V {
        V::splat(token, (self.0)(row))
    }
}

/// Sums that begin at a number per column.
#[derive(Clone, Copy)]
pub(crate) struct PerColumn<'a, const N: usize>(pub(crate) &'a Row<N>);

impl<const N: usize> Start for PerColumn<'_, N> {
    #[inline(always)]
    fn at<V: Vector>(self, token: V::Token, _: usize, column: usize) -> V {
        V::load(token, &self.0[column..])
    }
}

/// The function that is applied to the sums before they are written.
pub(crate) trait Finish: Copy {
    /// Applies the function to the sum at `row`, from `column` on.
    fn apply<V: Vector>(self, token: V::Token, sum: V, row: usize, column: usize) -> V;
}

/// No function: the sum is written as it is.
#[derive(Clone, Copy)]
pub(crate) struct Linear;

impl Finish for Linear {
    #[inline(always)]
    fn apply<V: Vector>(self, _: V::Token, sum: V, _: usize, _: usize) -> V {
        sum
    }
}

/// The rectifier max(sum, 0).
#[derive(Clone, Copy)]
pub(crate) struct Relu;

impl Finish for Relu {
    #[inline(always)]
    fn apply<V: Vector>(self, token: V::Token, sum: V, _: usize, _: usize) -> V {
        sum.max(V::splat(token, 0.0))
    }
}

/// The derivative of [`Relu`]: zero where the rectifier was off.
#[derive(Clone, Copy)]
pub(crate) struct Gated<'a, const N: usize>(pub(crate) &'a [Row<N>]);

impl<const N: usize> Finish for Gated<'_, N> {
    #[inline(always)]
    fn apply<V: Vector>(self, token: V::Token, sum: V, row: usize, column: usize) -> V {
        sum.where_positive(V::load(token, &self.0[row][column..]))
    }
}

/// The operands and functions of one product.
#[derive(Clone, Copy)]
pub(crate) struct Product<'a, A, I, F, const N: usize> {
    pub(crate) a: A,
    pub(crate) m: &'a [Row<N>],
    pub(crate) start: I,
    pub(crate) finish: F,
}

impl<A: Left, I: Start, F: Finish, const N: usize> Product<'_, A, I, F, N> {
    /// Writes all rows of `out`, `MANY` at a time, or `FEW` where registers are few.
    ///
    /// A remainder would need tiles of every smaller height. No shape of a network has one, and
    /// compiling those tiles, for each product, shape and instruction set, would take most of
    /// the time that this crate takes.
    ///
    /// # Panics
    /// If the number of rows is not a multiple of `MANY`.
    #[inline(always)]
    pub(crate) fn into<S: Simd, const MANY: usize, const FEW: usize>(
        self,
        simd: S,
        out: &mut [Row<N>],
    ) {
        const { assert!(MANY.is_multiple_of(FEW), "what is whole by MANY is whole by FEW") };
        assert!(out.len().is_multiple_of(MANY), "the rows are not a whole number of tiles");
        let mut first = 0;
        if S::MANY_REGISTERS {
            while first < out.len() {
                self.row_tile::<S, MANY>(simd, out, first);
                first += MANY;
            }
        } else {
            while first < out.len() {
                self.row_tile::<S, FEW>(simd, out, first);
                first += FEW;
            }
        }
    }

    #[inline(always)]
    fn row_tile<S: Simd, const R: usize>(self, simd: S, out: &mut [Row<N>], first: usize) {
        const { assert!(N.is_multiple_of(8), "rows are padded to vectors of eight") };
        let wide = S::Wide::LANES;
        let mut column = 0;
        while column + wide <= N {
            self.tile::<S::Wide, R>(simd, out, first, column);
            column += wide;
        }
        // The remaining columns are fewer than a wide piece.
        match const { N % S::Wide::LANES } {
            24 => self.tile::<Pair<S::V16, S::V8>, R>(simd, out, first, column),
            16 => self.tile::<S::V16, R>(simd, out, first, column),
            8 => self.tile::<S::V8, R>(simd, out, first, column),
            _ => {}
        }
    }

    #[inline(always)]
    fn tile<V: Vector, const R: usize>(
        self,
        token: V::Token,
        out: &mut [Row<N>],
        first: usize,
        column: usize,
    ) {
        let rows = self.a.rows::<R>(first);
        let mut sums = [V::splat(token, 0.0); R];
        for (r, sum) in sums.iter_mut().enumerate() {
            *sum = self.start.at(token, first + r, column);
        }
        for (k, m) in self.m.iter().enumerate() {
            let piece = V::load(token, &m[column..]);
            let factors: [f32; R] = rows.column(k);
            for (sum, factor) in sums.iter_mut().zip(factors) {
                *sum = sum.add(piece.mul(V::splat(token, factor)));
            }
        }
        let out: &mut [Row<N>; R] = out[first..].first_chunk_mut().expect("R rows of out");
        for (r, (row, sum)) in out.iter_mut().zip(sums).enumerate() {
            let done = self.finish.apply(token, sum, first + r, column);
            done.store(&mut row[column..]);
        }
    }
}
