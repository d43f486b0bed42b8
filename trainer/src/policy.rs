//! From trained layers to the policy file that the controller flies, and back.

use crate::config::{Config, MediumDraw, Stage};
use crate::net::mlp::Layer;
use leg_control::actor::{
    ActionScaling, Actor, ObservationScaling, PANEL_ROWS, ShapeError, Widths, pack,
};
use leg_control::leg::LegModel;
use leg_control::policy::{
    GainPoint, GainSchedule, Manifest, Media, Policy, Provenance, WriteError, write,
};
use leg_process::policy_file::AlignedBytes;

/// An actor by itself: packed weights and scalings.
#[derive(Clone, Debug, PartialEq)]
pub struct Frozen {
    /// Widths from the inputs to the outputs.
    pub widths: Widths,
    /// From an observation to the network's inputs.
    pub observation: ObservationScaling,
    /// From the network's outputs to an action.
    pub action: ActionScaling,
    /// Weights as the controller's kernel reads them.
    pub packed: Vec<f32>,
}

impl Frozen {
    /// Of layers in natural order. Only widths that an actor may have pass.
    ///
    /// # Errors
    /// [`ShapeError`] when the layers are not those of an actor.
    pub fn new(
        layers: &[Layer],
        observation: ObservationScaling,
        action: ActionScaling,
    ) -> Result<Self, ShapeError> {
        let width = |n: usize| u16::try_from(n).unwrap_or(u16::MAX);
        let too_many = || ShapeError::Layers(layers.len());
        let mut widths = Widths::new();
        for inputs in layers.iter().map(|l| l.inputs).take(1) {
            widths.push(width(inputs)).map_err(|_| too_many())?;
        }
        let mut packed = Vec::new();
        for layer in layers {
            widths.push(width(layer.bias.len())).map_err(|_| too_many())?;
            pack(&layer.weights, &layer.bias, layer.inputs, |x| packed.push(x));
        }
        let frozen = Self { widths, observation, action, packed };
        Actor::new(frozen.widths.clone(), observation, action, &frozen.packed)?;
        Ok(frozen)
    }

    /// Of layers trained under a configuration.
    ///
    /// # Panics
    /// Never: what is trained here is an actor.
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
        Self::new(layers, observation, action).expect("an actor 3-50-50-2")
    }

    /// The layers in natural order, as [`Self::new`] takes them.
    #[must_use]
    pub fn layers(&self) -> Vec<Layer> {
        let mut rest = self.packed.as_slice();
        let pairs = self.widths.iter().zip(self.widths.iter().skip(1));
        pairs
            .map(|(&inputs, &outputs)| {
                let (inputs, outputs) = (usize::from(inputs), usize::from(outputs));
                let own = rest.split_off(..(inputs + 1) * outputs).unwrap_or_default();
                unpack(own, inputs, outputs)
            })
            .collect()
    }

    /// The actor as the controller runs it.
    ///
    /// # Panics
    /// If the public fields were changed to what does not belong together.
    #[must_use]
    pub fn actor(&self) -> Actor<'_> {
        Actor::new(self.widths.clone(), self.observation, self.action, &self.packed)
            .expect("checked when made")
    }
}

impl From<&Policy<'_>> for Frozen {
    fn from(policy: &Policy<'_>) -> Self {
        let manifest = policy.manifest();
        Self {
            widths: manifest.widths.clone(),
            observation: manifest.observation,
            action: manifest.action,
            packed: policy.actor().weights().to_vec(),
        }
    }
}

/// One layer of packed weights in natural order: what [`pack`] does, undone.
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

/// What a policy file says beside its actor.
#[derive(Clone, Debug, PartialEq)]
pub struct About<'a> {
    /// What to call it.
    pub name: &'a str,
    /// Preset, or where it was imported from.
    pub preset: &'a str,
    /// Seed of the training.
    pub seed: u64,
    /// Environment steps trained.
    pub steps: u64,
    /// Density ratios trained in, lowest and highest.
    pub density_ratio: [f32; 2],
    /// Configuration, TOML.
    pub config: &'a str,
    /// Recommended gains.
    pub gains: &'a [GainPoint],
}

/// The blob of an actor, at a 4-byte aligned address.
///
/// # Errors
/// [`WriteError`] when the controller would refuse it.
pub fn blob(frozen: &Frozen, about: &About<'_>) -> Result<AlignedBytes, WriteError> {
    let gains: GainSchedule = about.gains.iter().copied().collect();
    let manifest = Manifest {
        name: about.name,
        widths: frozen.widths.clone(),
        observation: frozen.observation,
        action: frozen.action,
        leg: LegModel::HUMAN,
        media: Media { density_ratio: about.density_ratio, gravity_m_s2: [9.81; 2] },
        provenance: Provenance {
            preset: about.preset,
            seed: about.seed,
            steps: about.steps,
            trainer_version: env!("CARGO_PKG_VERSION"),
            config: about.config,
        },
        gains,
    };
    blob_of(&manifest, &frozen.packed)
}

/// The blob of packed weights under a manifest, at a 4-byte aligned address.
///
/// # Errors
/// [`WriteError`] when the controller would refuse it.
pub fn blob_of(manifest: &Manifest<'_>, packed: &[f32]) -> Result<AlignedBytes, WriteError> {
    let room = 4 * packed.len() + manifest.provenance.config.len() + 4096;
    let mut bytes = AlignedBytes::zeros(room);
    let len = write(manifest, packed, bytes.as_mut_slice())?;
    bytes.truncate(len);
    Ok(bytes)
}

impl Config {
    /// Density ratios trained in, lowest and highest of all stages (for the normal
    /// draws: within three standard deviations).
    #[must_use]
    pub fn density_range(&self) -> [f32; 2] {
        let of = |stage: &Stage| match stage.medium {
            MediumDraw::Water => [0.7, 1.0],
            MediumDraw::Land => [0.0, 0.3],
            MediumDraw::WaterAndAir | MediumDraw::Mixed { .. } => [0.0, 1.0],
        };
        let union = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        self.stages.iter().map(of).reduce(union).unwrap_or([0.0, 1.0])
    }
}

#[cfg(test)]
mod tests {
    use super::Frozen;
    use crate::net::mlp::Layer;
    use crate::preset::Preset;
    use leg_control::actor::{ActionScaling, ObservationScaling};

    #[test]
    fn layers_come_back_out_of_the_packed_weights() {
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
            let frozen = Frozen::new(&layers, ObservationScaling::IDENTITY, action).unwrap();
            assert_eq!(frozen.layers(), layers);
        }
    }

    #[test]
    fn the_densities_are_those_of_all_stages() {
        for (preset, range) in [
            (Preset::Water, [0.7, 1.0]),
            (Preset::Air, [0.0, 0.3]),
            (Preset::WaterToAir, [0.0, 1.0]),
            (Preset::Universal, [0.0, 1.0]),
            (Preset::Robust, [0.0, 1.0]),
        ] {
            assert_eq!(preset.config().density_range(), range, "{preset:?}");
        }
    }
}
