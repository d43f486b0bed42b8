//! The frozen actor: a small multi-layer perceptron, read in place.
//!
//! One function between all layers, tanh or nothing at the end, in f32. The order of operations is
//! fixed (bias first, then the inputs in ascending order, each product rounded
//! before its sum) and nothing is fused, so that every target returns the same
//! bits. Weights lie as the kernel reads them: see [`packed_len`] and [`pack`].

mod activation;
mod kernel;
mod network;
mod packing;
mod shape;

use kernel::{Chosen, Kernel, Portable};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

pub use activation::{Activation, Activations, GELU_CUBE, GELU_SLOPE, OutputActivation};
pub use packing::{PANEL_ROWS, pack};
pub use shape::{
    INPUTS, MAX_LAYERS, MAX_WEIGHTS, MAX_WIDTH, OUTPUTS, ShapeError, Widths, packed_len,
};

/// The input of the actor, once an apex.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// Horizontal velocity at the apex, less the cascade's offset, m/s.
    pub apex_vx_m_s: f32,
    /// Height of the apex above the ground, m.
    pub apex_y_m: f32,
    /// Fluid density over that of water.
    pub density_ratio: f32,
}

/// The output of the actor: what the leg does until the next apex.
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
    /// Passes observations unchanged.
    pub const IDENTITY: Self = Self { offset: [0.0; INPUTS], scale: [1.0; INPUTS] };
}

/// Action = clip(offset + scale * f(network output), low, high), per component, with the
/// [`OutputActivation`] f.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionScaling {
    /// Of the output: rad, m/s.
    pub scale: [f32; OUTPUTS],
    /// Added to it: rad, m/s.
    pub offset: [f32; OUTPUTS],
    /// Lowest action: rad, m/s.
    pub low: [f32; OUTPUTS],
    /// Highest action: rad, m/s.
    pub high: [f32; OUTPUTS],
}

/// A frozen actor over weights in flash or in a loaded file.
#[derive(Clone, Debug)]
pub struct Actor<'a> {
    widths: Widths,
    activations: Activations,
    observation: ObservationScaling,
    action: ActionScaling,
    weights: &'a [f32],
}

impl<'a> Actor<'a> {
    /// Returns an actor over packed weights.
    ///
    /// # Errors
    /// [`ShapeError`] when the widths are not those of an actor, the number of weights
    /// is another than theirs, or the parameter of an activation is out of range.
    pub fn new(
        widths: Widths,
        activations: Activations,
        observation: ObservationScaling,
        action: ActionScaling,
        weights: &'a [f32],
    ) -> Result<Self, ShapeError> {
        let expected = packed_len(&widths)?;
        if weights.len() != expected {
            return Err(ShapeError::Weights { expected, found: weights.len() });
        }
        if !activations.hidden.is_valid() {
            return Err(ShapeError::Activation);
        }
        Ok(Self { widths, activations, observation, action, weights })
    }

    /// Returns the widths from the inputs to the outputs.
    #[must_use]
    pub fn widths(&self) -> &[u16] {
        &self.widths
    }

    /// Returns the functions between the layers and at the end.
    #[must_use]
    pub fn activations(&self) -> Activations {
        self.activations
    }

    /// Returns the packed weights, in the order of the kernel.
    #[must_use]
    pub fn weights(&self) -> &'a [f32] {
        self.weights
    }

    /// Returns the action for an observation. It is always finite and within the clip, even
    /// where the observation is not finite.
    #[must_use]
    pub fn act(&self, observation: Observation) -> Action {
        self.action(self.sums(self.scaled(observation)))
    }

    /// Returns the inputs of the network for an observation.
    #[expect(clippy::inline_always, reason = "a call costs instructions in the firmware")]
    #[inline(always)]
    #[must_use]
    pub fn scaled(&self, observation: Observation) -> [f32; INPUTS] {
        let scaling = &self.observation;
        (observation.vector() - Vector3::from(scaling.offset))
            .component_mul(&Vector3::from(scaling.scale))
            .into()
    }

    /// Returns the action for the last sums of the network.
    #[expect(clippy::inline_always, reason = "a call costs instructions in the firmware")]
    #[inline(always)]
    #[must_use]
    pub fn action(&self, sums: [f32; OUTPUTS]) -> Action {
        let [u0, u1] = sums.map(|z| self.activations.output.of(z));
        let ActionScaling { scale, offset, low, high } = self.action;
        Action {
            touchdown_angle_rad: clip(offset[0] + scale[0] * u0, low[0], high[0]),
            elongation_speed_m_s: clip(offset[1] + scale[1] * u1, low[1], high[1]),
        }
    }

    /// Returns the last sums of the network for scaled inputs.
    #[must_use]
    pub fn sums(&self, input: [f32; INPUTS]) -> [f32; OUTPUTS] {
        self.sums_by::<Chosen>(input)
    }

    /// Returns the same by the portable kernel, whatever kernel [`Self::sums`] uses in this
    /// build. The bits are the same; tests hold one against the other.
    #[must_use]
    pub fn sums_portable(&self, input: [f32; INPUTS]) -> [f32; OUTPUTS] {
        self.sums_by::<Portable>(input)
    }

    #[inline(never)]
    fn sums_by<K: Kernel>(&self, input: [f32; INPUTS]) -> [f32; OUTPUTS] {
        match self.activations.hidden {
            Activation::Relu => network::sums::<K>(&self.widths, self.weights, input),
            other => network::activated_sums::<K>(&self.widths, other, self.weights, input),
        }
    }
}

/// Clamps to a range; a NaN becomes the low bound.
fn clip(x: f32, low: f32, high: f32) -> f32 {
    if x >= low { if x <= high { x } else { high } } else { low }
}

#[cfg(test)]
mod tests;
