//! The ground under the leg.

/// Height of the ground at each place. Any function of `x_m` will do.
pub trait Ground {
    /// Height at `x_m`.
    fn height_m(&self, x_m: f64) -> f64;
}

/// Level ground at height 0, as under the apex map.
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
