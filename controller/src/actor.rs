//! The frozen actor: a small multi-layer perceptron, read in place.
//!
//! ReLU between layers, tanh at the end, in f32. The order of operations is
//! fixed (bias first, then the inputs in ascending order, each product rounded
//! before its sum) and nothing is fused, so that every target returns the same
//! bits. Weights lie as the kernel reads them: see [`packed_len`] and [`pack`].

use heapless::Vec;
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Most layers of weights in an actor.
pub const MAX_LAYERS: usize = 4;
/// Widest layer, inputs included.
pub const MAX_WIDTH: usize = 128;
/// Rows that lie side by side in the packed weights: as many accumulators as a
/// Cortex-M4F keeps in registers beside five inputs and their products.
pub const PANEL_ROWS: usize = 10;
/// Inputs: apex velocity, apex height, density ratio.
pub const INPUTS: usize = 3;
/// Outputs: touchdown angle, elongation speed.
pub const OUTPUTS: usize = 2;

/// Widths from the inputs to the outputs, such as 3, 50, 50, 2.
pub type Widths = Vec<u16, { MAX_LAYERS + 1 }>;

/// What the actor sees, once an apex.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// Horizontal velocity at the apex, less the cascade's offset, m/s.
    pub apex_vx_m_s: f32,
    /// Height of the apex above the ground, m.
    pub apex_y_m: f32,
    /// Fluid density over that of water.
    pub density_ratio: f32,
}

/// What the leg does until the next apex.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Action {
    /// Leg angle at touchdown from the +x axis, rad.
    pub touchdown_angle_rad: f32,
    /// Rate of the rest length from touchdown on, m/s.
    pub elongation_speed_m_s: f32,
}

impl Observation {
    fn vector(self) -> Vector3<f32> {
        Vector3::new(self.apex_vx_m_s, self.apex_y_m, self.density_ratio)
    }
}

/// Network input = (observation - offset) * scale, per component.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObservationScaling {
    /// Subtracted first: m/s, m, ratio.
    pub offset: [f32; INPUTS],
    /// Then multiplied: s/m, 1/m, 1.
    pub scale: [f32; INPUTS],
}

impl ObservationScaling {
    /// Observations as they are.
    pub const IDENTITY: Self = Self { offset: [0.0; INPUTS], scale: [1.0; INPUTS] };
}

/// Action = clip(offset + scale * tanh(network output), low, high), per component.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionScaling {
    /// Of the tanh: rad, m/s.
    pub scale: [f32; OUTPUTS],
    /// Added to it: rad, m/s.
    pub offset: [f32; OUTPUTS],
    /// Lowest action: rad, m/s.
    pub low: [f32; OUTPUTS],
    /// Highest action: rad, m/s.
    pub high: [f32; OUTPUTS],
}

/// A frozen actor over weights that lie elsewhere (flash, or a loaded file).
#[derive(Clone, Debug)]
pub struct Actor<'a> {
    widths: Widths,
    observation: ObservationScaling,
    action: ActionScaling,
    weights: &'a [f32],
}

/// Why an architecture or its weights are refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ShapeError {
    /// Not 1 to [`MAX_LAYERS`] layers.
    Layers(usize),
    /// A width of 0 or above [`MAX_WIDTH`].
    Width(u16),
    /// Not [`INPUTS`] inputs.
    Inputs(u16),
    /// Not [`OUTPUTS`] outputs.
    Outputs(u16),
    /// The weights are not as many as the widths ask for.
    Weights {
        /// Floats that the widths ask for.
        expected: usize,
        /// Floats that are there.
        found: usize,
    },
}

impl core::fmt::Display for ShapeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Layers(n) => write!(f, "{n} layers of weights, allowed are 1 to {MAX_LAYERS}"),
            Self::Width(w) => write!(f, "a layer {w} wide, allowed are 1 to {MAX_WIDTH}"),
            Self::Inputs(n) => write!(f, "{n} inputs, the gait gives {INPUTS}"),
            Self::Outputs(n) => write!(f, "{n} outputs, the leg takes {OUTPUTS}"),
            Self::Weights { expected, found } => {
                write!(f, "{found} weights and biases, the widths ask for {expected}")
            }
        }
    }
}

impl core::error::Error for ShapeError {}

/// Floats in the packed weights of these widths, after checking the widths.
///
/// # Errors
/// [`ShapeError`] when the widths are not those of an actor.
pub fn packed_len(widths: &[u16]) -> Result<usize, ShapeError> {
    let layers = widths.len().saturating_sub(1);
    if layers == 0 || layers > MAX_LAYERS {
        return Err(ShapeError::Layers(layers));
    }
    if let Some(&width) = widths.iter().find(|&&w| w == 0 || usize::from(w) > MAX_WIDTH) {
        return Err(ShapeError::Width(width));
    }
    match (widths.first(), widths.last()) {
        (Some(&n), _) if usize::from(n) != INPUTS => return Err(ShapeError::Inputs(n)),
        (_, Some(&n)) if usize::from(n) != OUTPUTS => return Err(ShapeError::Outputs(n)),
        _ => {}
    }
    let pairs = widths.iter().zip(widths.iter().skip(1));
    Ok(pairs.map(|(&i, &o)| (usize::from(i) + 1) * usize::from(o)).sum())
}

/// Feeds one layer, row-major `weights` of shape (outputs, inputs) and `bias`
/// of length outputs, to `put` in the order of the kernel: for each panel of
/// [`PANEL_ROWS`] rows (the last may be narrower) its biases, then its first
/// column, its second, and so on.
pub fn pack(weights: &[f32], bias: &[f32], inputs: usize, mut put: impl FnMut(f32)) {
    let rows_of_panel = weights.chunks(PANEL_ROWS * inputs.max(1));
    for (rows, biases) in rows_of_panel.zip(bias.chunks(PANEL_ROWS)) {
        for &b in biases {
            put(b);
        }
        for column in 0..inputs {
            rows.iter().skip(column).step_by(inputs).for_each(|&w| put(w));
        }
    }
}

impl<'a> Actor<'a> {
    /// An actor over packed weights.
    ///
    /// # Errors
    /// [`ShapeError`] when widths and weights do not belong together.
    pub fn new(
        widths: Widths,
        observation: ObservationScaling,
        action: ActionScaling,
        weights: &'a [f32],
    ) -> Result<Self, ShapeError> {
        let expected = packed_len(&widths)?;
        if weights.len() != expected {
            return Err(ShapeError::Weights { expected, found: weights.len() });
        }
        Ok(Self { widths, observation, action, weights })
    }

    /// Widths from the inputs to the outputs.
    #[must_use]
    pub fn widths(&self) -> &[u16] {
        &self.widths
    }

    /// The packed weights, in the order of the kernel.
    #[must_use]
    pub fn weights(&self) -> &'a [f32] {
        self.weights
    }

    /// The action for an observation. Always finite and within the clip, even
    /// where the observation is not finite.
    #[must_use]
    pub fn act(&self, observation: Observation) -> Action {
        let scaling = &self.observation;
        let input = (observation.vector() - Vector3::from(scaling.offset))
            .component_mul(&Vector3::from(scaling.scale));
        let z = self.forward(&input);
        let ActionScaling { scale, offset, low, high } = self.action;
        Action {
            touchdown_angle_rad: clip(offset[0] + scale[0] * libm::tanhf(z.x), low[0], high[0]),
            elongation_speed_m_s: clip(offset[1] + scale[1] * libm::tanhf(z.y), low[1], high[1]),
        }
    }

    /// The network up to its last sums, before tanh.
    fn forward(&self, input: &Vector3<f32>) -> Vector2<f32> {
        let mut front = [0.0_f32; MAX_WIDTH];
        let mut back = [0.0_f32; MAX_WIDTH];
        for (to, &from) in front.iter_mut().zip(input.iter()) {
            *to = from;
        }
        let mut weights = self.weights;
        let last = self.widths.len().saturating_sub(2);
        let pairs = self.widths.iter().zip(self.widths.iter().skip(1)).enumerate();
        for (layer, (&inputs, &outputs)) in pairs {
            let x = front.get(..usize::from(inputs)).unwrap_or_default();
            let y = back.get_mut(..usize::from(outputs)).unwrap_or_default();
            weights = dense(weights, x, y);
            if layer < last {
                for v in y.iter_mut() {
                    *v = relu(*v);
                }
            }
            core::mem::swap(&mut front, &mut back);
        }
        let [z0, z1, ..] = front;
        Vector2::new(z0, z1)
    }
}

/// Not `f32::max`, whose result for a zero of the other sign is unspecified.
#[inline]
fn relu(x: f32) -> f32 {
    if x > 0.0 { x } else { 0.0 }
}

/// Written so that a NaN ends at the low bound.
fn clip(x: f32, low: f32, high: f32) -> f32 {
    if x >= low { if x <= high { x } else { high } } else { low }
}

/// One layer of packed weights; returns the weights that follow it.
#[inline]
fn dense<'w>(weights: &'w [f32], input: &[f32], output: &mut [f32]) -> &'w [f32] {
    let mut rest = weights;
    for panel in output.chunks_mut(PANEL_ROWS) {
        let len = panel.len() * (input.len() + 1);
        let Some((own, after)) = rest.split_at_checked(len) else {
            return rest;
        };
        rest = after;
        if let Ok(full) = <&mut [f32; PANEL_ROWS]>::try_from(&mut *panel) {
            full_panel(own, input, full);
        } else {
            narrow_panel(own, input, panel);
        }
    }
    rest
}

/// [`PANEL_ROWS`] rows at once, their sums in registers.
#[inline]
fn full_panel(weights: &[f32], input: &[f32], output: &mut [f32; PANEL_ROWS]) {
    let mut columns = weights.as_chunks::<PANEL_ROWS>().0.iter();
    let Some(biases) = columns.next() else { return };
    let mut sums = *biases;
    for (column, &x) in columns.zip(input) {
        for (sum, &w) in sums.iter_mut().zip(column) {
            *sum += w * x;
        }
    }
    *output = sums;
}

/// The last panel of a layer whose width is not a multiple of [`PANEL_ROWS`].
#[inline]
fn narrow_panel(weights: &[f32], input: &[f32], output: &mut [f32]) {
    let rows = output.len();
    let mut columns = weights.chunks_exact(rows.max(1));
    let Some(biases) = columns.next() else { return };
    for (sum, &b) in output.iter_mut().zip(biases) {
        *sum = b;
    }
    for (column, &x) in columns.zip(input) {
        for (sum, &w) in output.iter_mut().zip(column) {
            *sum += w * x;
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec as StdVec;

    const ACTION: ActionScaling =
        ActionScaling { scale: [1.0, 1.5], offset: [1.5, 1.0], low: [0.4, 0.0], high: [2.6, 2.0] };

    /// Row by row from the row-major weights, as a textbook writes it.
    fn reference(layers: &[(StdVec<f32>, StdVec<f32>)], input: [f32; 3]) -> StdVec<f32> {
        let mut x = input.to_vec();
        for (l, (w, b)) in layers.iter().enumerate() {
            let mut y = StdVec::new();
            for (row, &bias) in w.chunks(x.len()).zip(b) {
                let mut sum = bias;
                for (wi, xi) in row.iter().zip(&x) {
                    sum += wi * xi;
                }
                y.push(if l + 1 < layers.len() { relu(sum) } else { sum });
            }
            x = y;
        }
        x
    }

    proptest! {
        #[test]
        fn packed_weights_give_the_bits_of_the_textbook_order(
            hidden in prop::collection::vec(1_u16..=128, 0..=3), seed in any::<u32>(),
            vx in -12.0_f32..12.0, y in 0.5_f32..12.0, rho in 0.0_f32..1.0,
        ) {
            let mut widths = Widths::from_slice(&[3]).unwrap();
            widths.extend(hidden);
            widths.push(2).unwrap();
            let mut state = seed;
            let mut random = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / 16_777_216.0 - 0.5
            };
            let mut layers = StdVec::new();
            let mut packed = StdVec::new();
            for pair in widths.windows(2) {
                let (i, o) = (usize::from(pair[0]), usize::from(pair[1]));
                let w: StdVec<f32> = (0..i * o).map(|_| random()).collect();
                let b: StdVec<f32> = (0..o).map(|_| random()).collect();
                pack(&w, &b, i, |x| packed.push(x));
                layers.push((w, b));
            }
            let actor = Actor::new(widths, ObservationScaling::IDENTITY, ACTION, &packed).unwrap();
            let z = actor.forward(&Vector3::new(vx, y, rho));
            let expected = reference(&layers, [vx, y, rho]);
            prop_assert_eq!(z[0].to_bits(), expected[0].to_bits());
            prop_assert_eq!(z[1].to_bits(), expected[1].to_bits());
        }
    }

    #[test]
    fn an_observation_that_is_not_finite_still_gives_a_bounded_action() {
        let widths = Widths::from_slice(&[3, 2]).unwrap();
        let weights = [1.0_f32; 8];
        let actor = Actor::new(widths, ObservationScaling::IDENTITY, ACTION, &weights).unwrap();
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let a = actor.act(Observation { apex_vx_m_s: bad, ..Default::default() });
            assert!((0.4..=2.6).contains(&a.touchdown_angle_rad));
            assert!((0.0..=2.0).contains(&a.elongation_speed_m_s));
        }
    }

    #[test]
    fn shapes_that_are_not_an_actor_are_refused() {
        assert_eq!(packed_len(&[3]), Err(ShapeError::Layers(0)));
        assert_eq!(packed_len(&[3, 9, 9, 9, 9, 2]), Err(ShapeError::Layers(5)));
        assert_eq!(packed_len(&[3, 129, 2]), Err(ShapeError::Width(129)));
        assert_eq!(packed_len(&[3, 0, 2]), Err(ShapeError::Width(0)));
        assert_eq!(packed_len(&[4, 2]), Err(ShapeError::Inputs(4)));
        assert_eq!(packed_len(&[3, 3]), Err(ShapeError::Outputs(3)));
        assert_eq!(packed_len(&[3, 50, 50, 2]), Ok(200 + 2_550 + 102));
    }
}
