//! The ground under the leg.

/// A height profile of the ground. Implemented for every `Fn(f64) -> f64`.
///
/// Heights and places are in metres, in the frame of [`Body`](crate::Body).
pub trait Ground {
    /// Returns the height at `x_m`, m.
    fn height_m(&self, x_m: f64) -> f64;
}

/// Level ground at height 0, as in the apex map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flat;

impl Ground for Flat {
    fn height_m(&self, _x_m: f64) -> f64 {
        0.0
    }
}

impl<F: Fn(f64) -> f64> Ground for F {
    fn height_m(&self, x_m: f64) -> f64 {
        self(x_m)
    }
}
