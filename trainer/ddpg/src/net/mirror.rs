//! Mirror-symmetric networks.
//!
//! The mirror image of the leg is a leg. Where an observation or an action changes sign in the
//! mirror (it is *odd*), the network should respond accordingly. Such a network has hidden
//! units in pairs, unit i and unit i + H / 2, which are each other's mirror image: they share
//! every weight, with the opposite sign from odd inputs and to odd outputs. These networks form
//! a linear subspace, so a projected gradient keeps a symmetric network symmetric.

use super::mlp::Mlp;

/// Replaces two weights by their mean, with opposite signs where `odd`.
#[inline(always)]
fn agree(row: &mut [f32], i: usize, j: usize, odd: bool) {
    let sign = if odd { -1.0 } else { 1.0 };
    let mean = 0.5 * (row[i] + sign * row[j]);
    row[i] = mean;
    row[j] = sign * mean;
}

impl<const X: usize, const H: usize, const O: usize, const P: usize> Mlp<X, H, 0, O, P> {
    /// Projects weights, or their gradient, onto the networks that are symmetric under
    /// a change of sign of the odd inputs and outputs.
    #[inline(always)]
    pub(crate) fn symmetrise(&mut self, odd_inputs: [bool; X], odd_outputs: [bool; O]) {
        const { assert!(H.is_multiple_of(2)) };
        let half = H / 2;
        let (first, second, third) = self.layers_mut();
        for (x, row) in first.iter_mut().enumerate() {
            // The last row is the bias.
            let odd = odd_inputs.get(x).is_some_and(|odd| *odd);
            (0..half).for_each(|i| agree(&mut row[..], i, half + i, odd));
        }
        let (upper, lower) = second.split_at_mut(half);
        for (one, other) in upper.iter_mut().zip(lower) {
            for i in 0..half {
                for (a, b) in [(i, half + i), (half + i, i)] {
                    let mean = 0.5 * (one[a] + other[b]);
                    (one[a], other[b]) = (mean, mean);
                }
            }
            let mean = 0.5 * (one[H] + other[H]);
            (one[H], other[H]) = (mean, mean);
        }
        for (row, odd) in third.iter_mut().zip(odd_outputs) {
            (0..half).for_each(|i| agree(&mut row[..], i, half + i, odd));
            if odd {
                row[H] = 0.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::net::mlp::{Layer, Mlp, Pass};
    use leg_simd::{Isa, Kernel, Simd, dispatch};

    type Net = Mlp<3, 50, 0, 2, 56>;

    struct Forward<'a>(&'a Net, &'a mut Pass<3, 50, 0, 2, 56, 8>);

    impl Kernel for Forward<'_> {
        type Output = ();
        #[inline(always)]
        fn run<S: Simd>(self, simd: S) {
            self.0.forward(simd, self.1);
        }
    }

    fn outputs(net: &Net, observation: [f32; 3]) -> [f32; 2] {
        let mut pass = Pass::new(0);
        for (row, x) in pass.inputs.iter_mut().zip(observation) {
            row.fill(x);
        }
        dispatch(Isa::Baseline, Forward(net, &mut pass));
        [0, 1].map(|o| pass.outputs[o][0])
    }

    #[test]
    fn a_projected_network_is_symmetric_and_stays_as_it_is() {
        let mut x = 1_u32;
        let mut draw = move || {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            x as f32 / u32::MAX as f32 - 0.5
        };
        let mut layer = |inputs: usize, outputs: usize| Layer {
            inputs,
            weights: (0..inputs * outputs).map(|_| draw()).collect(),
            bias: (0..outputs).map(|_| draw()).collect(),
        };
        let mut net = Net::from_layers(&[layer(3, 50), layer(50, 50), layer(50, 2)]);
        let (right, left) = ([0.7, 0.3, -0.4], [-0.7, 0.3, -0.4]);
        let before = (outputs(&net, right), outputs(&net, left));
        assert!((before.0[0] + before.1[0]).abs() > 1e-3, "by chance symmetric: {before:?}");
        net.symmetrise([true, false, false], [true, false]);
        let (there, here) = (outputs(&net, right), outputs(&net, left));
        assert!(there[0].abs() > 1e-3);
        assert!((there[0] + here[0]).abs() < 1e-5, "{there:?} {here:?}");
        assert!((there[1] - here[1]).abs() < 1e-5, "{there:?} {here:?}");
        let once = net.clone();
        net.symmetrise([true, false, false], [true, false]);
        assert_eq!(net, once);
    }
}
