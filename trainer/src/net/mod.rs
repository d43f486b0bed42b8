//! The networks: a matrix product in registers, a perceptron with two hidden layers, its
//! gradients, and Adam.

pub mod adam;
mod mirror;
pub mod mlp;
pub mod product;
pub mod tanh;

/// A row of `N` numbers, aligned so that a vector of eight never straddles a cache line.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row<const N: usize>(pub [f32; N]);

impl<const N: usize> Row<N> {
    /// A row of zeros.
    pub const ZERO: Self = Self([0.0; N]);
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
