//! The networks: a matrix product in registers, a perceptron with two hidden layers, its
//! gradients, and Adam.

pub(crate) mod adam;
mod mirror;
pub(crate) mod mlp;
pub(crate) mod product;
pub(crate) mod tanh;

/// A row of `N` numbers, aligned so that a vector of eight never straddles a cache line.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Row<const N: usize>(pub(crate) [f32; N]);

impl<const N: usize> Row<N> {
    /// A row of zeros.
    pub(crate) const ZERO: Self = Self([0.0; N]);
}

impl<const N: usize> core::ops::Deref for Row<N> {
    type Target = [f32; N];
    #[inline(always)]
    fn deref(&self) -> &[f32; N] {
        &self.0
    }
}

impl<const N: usize> core::ops::DerefMut for Row<N> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f32; N] {
        &mut self.0
    }
}
