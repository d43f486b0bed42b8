//! The policy file: from trained layers to the blob that the controller runs, and back.

use crate::config::Config;
use crate::environment::leg_model;
use leg_control::actor::{
    ActionScaling, Activations, Actor, ObservationScaling, PANEL_ROWS, ShapeError, Widths, pack,
};
use leg_control::policy::{
    GainPoint, GainSchedule, Manifest, Media, Policy, Provenance, WriteError, write,
};
use leg_ddpg::Layer;
use leg_process::policy_file::AlignedBytes;

/// An actor on its own: its weights in the controller's order, and its scalings.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedActor {
    /// Width of every layer, from the inputs to the outputs.
    pub widths: Widths,
    /// Functions between the layers and at the end.
    pub activations: Activations,
    /// Maps an observation (m/s, m, density ratio) to the network's inputs.
    pub observation: ObservationScaling,
    /// Maps the network's outputs to an action (rad, m/s).
    pub action: ActionScaling,
    /// Weights and biases as the controller's kernel reads them, in panels of
    /// [`PANEL_ROWS`] rows.
    pub weights: Vec<f32>,
}

impl PackedActor {
    /// Packs layers whose weights are stored row by row, one row an output.
    ///
    /// # Errors
    /// [`ShapeError`] when the number of layers or a width is not one of an actor, or the
    /// parameter of an activation is out of range.
    pub fn new(
        layers: &[Layer],
        activations: Activations,
        observation: ObservationScaling,
        action: ActionScaling,
    ) -> Result<Self, ShapeError> {
        let width = |n: usize| u16::try_from(n).unwrap_or(u16::MAX);
        let too_many = || ShapeError::Layers(layers.len());
        let mut widths = Widths::new();
        for inputs in layers.iter().map(|l| l.inputs).take(1) {
            widths.push(width(inputs)).map_err(|_| too_many())?;
        }
        let mut weights = Vec::new();
        for layer in layers {
            widths.push(width(layer.bias.len())).map_err(|_| too_many())?;
            pack(&layer.weights, &layer.bias, layer.inputs, |x| weights.push(x));
        }
        let packed = Self { widths, activations, observation, action, weights };
        Actor::new(packed.widths.clone(), activations, observation, action, &packed.weights)?;
        Ok(packed)
    }

    /// Packs layers that were trained under `config`, with its scalings.
    ///
    /// # Panics
    /// Never: every agent of this crate is a valid actor.
    #[must_use]
    pub fn trained(config: &Config, layers: &[Layer; 3]) -> Self {
        let n = &config.network;
        let observation =
            ObservationScaling { offset: n.observation_offset, scale: n.observation_scale };
        let action = ActionScaling {
            scale: [0, 1].map(|i| n.action_scale[i] * n.output_gain[i]),
            offset: n.action_offset,
            low: n.action_low,
            high: n.action_high,
        };
        Self::new(layers, Activations::default(), observation, action).expect("an actor 3-50-50-2")
    }

    /// Returns the layers in the form that [`Self::new`] takes.
    #[must_use]
    pub fn layers(&self) -> Vec<Layer> {
        let mut rest = self.weights.as_slice();
        let pairs = self.widths.iter().zip(self.widths.iter().skip(1));
        pairs
            .map(|(&inputs, &outputs)| {
                let (inputs, outputs) = (usize::from(inputs), usize::from(outputs));
                let own = rest.split_off(..(inputs + 1) * outputs).unwrap_or_default();
                unpack(own, inputs, outputs)
            })
            .collect()
    }

    /// Returns the actor as the controller evaluates it.
    ///
    /// # Panics
    /// If the public fields were changed so that they no longer fit together.
    #[must_use]
    pub fn actor(&self) -> Actor<'_> {
        let Self { activations, observation, action, .. } = *self;
        Actor::new(self.widths.clone(), activations, observation, action, &self.weights)
            .expect("checked by PackedActor::new")
    }
}

impl From<&Policy<'_>> for PackedActor {
    fn from(policy: &Policy<'_>) -> Self {
        let manifest = policy.manifest();
        Self {
            widths: manifest.widths.clone(),
            activations: manifest.activations,
            observation: manifest.observation,
            action: manifest.action,
            weights: policy.actor().weights().to_vec(),
        }
    }
}

/// Undoes [`pack`] for one layer of `inputs` by `outputs`.
fn unpack(packed: &[f32], inputs: usize, outputs: usize) -> Layer {
    let mut layer =
        Layer { inputs, weights: vec![0.0; inputs * outputs], bias: Vec::with_capacity(outputs) };
    let panels = packed.chunks(PANEL_ROWS * (inputs + 1));
    for (panel, rows) in panels.zip(layer.weights.chunks_mut(PANEL_ROWS * inputs)) {
        let height = rows.len() / inputs;
        let (biases, columns) = panel.split_at(height);
        layer.bias.extend_from_slice(biases);
        for (i, column) in columns.chunks(height).enumerate() {
            for (j, &weight) in column.iter().enumerate() {
                rows[j * inputs + i] = weight;
            }
        }
    }
    layer
}

/// What a policy file states about its actor: name, origin and recommended gains.
#[derive(Clone, Debug, PartialEq)]
pub struct PolicyInfo<'a> {
    /// Name of the policy.
    pub name: &'a str,
    /// Preset of the training, or the source of an imported actor.
    pub preset: &'a str,
    /// Seed of the training.
    pub seed: u64,
    /// Environment steps trained.
    pub steps: u64,
    /// Lowest and highest density ratio of the training.
    pub density_ratio: [f32; 2],
    /// Lowest and highest gravity of the training, m/s2.
    pub gravity_m_s2: [f32; 2],
    /// Configuration of the training, TOML.
    pub config: &'a str,
    /// Recommended gains of the velocity cascade, by ascending density ratio.
    pub gains: &'a [GainPoint],
}

/// Writes the policy blob of an actor, at a 4-byte aligned address. The leg is
/// that which every training uses ([`crate::environment`]).
///
/// # Errors
/// [`WriteError`] when the controller would refuse the blob.
pub fn blob(actor: &PackedActor, info: &PolicyInfo<'_>) -> Result<AlignedBytes, WriteError> {
    let gains: GainSchedule = info.gains.iter().copied().collect();
    let manifest = Manifest {
        name: info.name,
        widths: actor.widths.clone(),
        activations: actor.activations,
        observation: actor.observation,
        action: actor.action,
        leg: leg_model(),
        media: Media { density_ratio: info.density_ratio, gravity_m_s2: info.gravity_m_s2 },
        provenance: Provenance {
            preset: info.preset,
            seed: info.seed,
            steps: info.steps,
            trainer_version: env!("CARGO_PKG_VERSION"),
            config: info.config,
        },
        gains,
    };
    blob_with_manifest(&manifest, &actor.weights)
}

/// Writes the policy blob of packed weights under a manifest, at a 4-byte aligned address.
///
/// # Errors
/// [`WriteError`] when the controller would refuse the blob.
pub fn blob_with_manifest(
    manifest: &Manifest<'_>,
    weights: &[f32],
) -> Result<AlignedBytes, WriteError> {
    let capacity = 4 * weights.len() + manifest.provenance.config.len() + 4096;
    let mut bytes = AlignedBytes::zeros(capacity);
    let len = write(manifest, weights, bytes.as_mut_slice())?;
    bytes.truncate(len);
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::PackedActor;
    use leg_control::actor::{ActionScaling, Activations, ObservationScaling};
    use leg_ddpg::Layer;

    #[test]
    fn unpacking_returns_the_layers_that_were_packed() {
        // Widths that fill a panel, fall short of one, and run over several.
        for hidden in [1, 9, 10, 11, 50, 128] {
            let layer = |inputs: usize, outputs: usize| Layer {
                inputs,
                weights: (0..inputs * outputs).map(|i| i as f32 + 0.5).collect(),
                bias: (0..outputs).map(|i| -(i as f32)).collect(),
            };
            let layers = [layer(3, hidden), layer(hidden, 37), layer(37, 2)];
            let action =
                ActionScaling { scale: [1.0; 2], offset: [0.0; 2], low: [0.0; 2], high: [1.0; 2] };
            let (relu, identity) = (Activations::default(), ObservationScaling::IDENTITY);
            let packed = PackedActor::new(&layers, relu, identity, action).unwrap();
            assert_eq!(packed.layers(), layers);
        }
    }
}
