//! The model card: what an exported actor states about itself beside its weights.

use super::{ImportError, activation};
use crate::policy::{PackedActor, blob_with_manifest};
use leg_control::actor::{ActionScaling, Activations, ObservationScaling, OutputActivation};
use leg_control::leg::LegModel;
use leg_control::policy::{GainPoint, MAX_GAIN_POINTS, Manifest, Media, Policy, Provenance};
use leg_process::policy_file::AlignedBytes;
use serde::{Deserialize, Serialize};

/// Key of the card in a file's metadata.
///
/// The card is one entry, because readers and writers keep metadata in hash maps, whose order
/// would change the file from one run to the next.
pub const KEY: &str = "leg_actor";

/// The formulas from the last sums to the action, by the activation after the last layer.
const OUTPUTS: [(OutputActivation, &str); 2] = [
    (OutputActivation::Tanh, "clip(offset + scale * tanh(z), low, high)"),
    (OutputActivation::Linear, "clip(offset + scale * z, low, high)"),
];

/// Everything in a policy except weights and test vectors, as one JSON object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelCard {
    /// Name of the policy.
    pub name: String,
    /// Activation between layers, such as `relu` or `elu(1)`.
    pub hidden_activation: String,
    /// Formula from the last sums z to the action, with tanh or without.
    pub output: String,
    /// Scaling of the inputs: network input = (observation - offset) * scale.
    pub observation: ObservationScaling,
    /// Scaling of the outputs, of the formula.
    pub action: ActionScaling,
    /// Recommended gains of the velocity cascade, by ascending density ratio.
    pub gains: Vec<GainPoint>,
    /// Leg of the training.
    pub leg: LegModel,
    /// Media of the training.
    pub media: Media,
    /// Preset of the training, or the source of an imported actor.
    pub preset: String,
    /// Seed of the training.
    pub seed: u64,
    /// Environment steps trained.
    pub steps: u64,
    /// Version of the trainer.
    pub trainer_version: String,
    /// Configuration of the training, TOML.
    pub config: String,
    /// CRC-32 of the policy file, hexadecimal.
    pub policy_crc32: String,
}

fn formula(activation: OutputActivation) -> &'static str {
    OUTPUTS.iter().find(|(a, _)| *a == activation).map_or("", |(_, formula)| *formula)
}

impl From<&Policy<'_>> for ModelCard {
    fn from(policy: &Policy<'_>) -> Self {
        let m = policy.manifest();
        Self {
            name: m.name.into(),
            hidden_activation: m.activations.hidden.to_string(),
            output: formula(m.activations.output).into(),
            observation: m.observation,
            action: m.action,
            gains: m.gains.to_vec(),
            leg: m.leg,
            media: m.media,
            preset: m.provenance.preset.into(),
            seed: m.provenance.seed,
            steps: m.provenance.steps,
            trainer_version: m.provenance.trainer_version.into(),
            config: m.provenance.config.into(),
            policy_crc32: format!("{:08x}", policy.crc32()),
        }
    }
}

impl ModelCard {
    /// Returns the card as JSON, on one line.
    ///
    /// # Panics
    /// Never: the numbers of a policy are finite.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("strings and finite numbers")
    }

    /// Parses a card.
    ///
    /// # Errors
    /// [`ImportError::Value`] when it is no card, or that of another kind of network.
    pub fn parse(json: &str) -> Result<Self, ImportError> {
        let key = |name: &str| format!("metadata {KEY}{name}");
        let card: Self = serde_json::from_str(json)
            .map_err(|e| ImportError::value(key(""), e.to_string(), "what an export writes"))?;
        if activation::hidden(&card.hidden_activation).is_err() {
            let found = format!("{:?}", card.hidden_activation);
            let expected = format!("one of {}", activation::NAMES);
            return Err(ImportError::value(key(".hidden_activation"), found, expected));
        }
        if !OUTPUTS.iter().any(|(_, formula)| *formula == card.output) {
            let found = format!("{:?}", card.output);
            let [(_, tanh), (_, linear)] = OUTPUTS;
            let expected = format!("{tanh:?} or {linear:?}");
            return Err(ImportError::value(key(".output"), found, expected));
        }
        if card.gains.len() > MAX_GAIN_POINTS {
            let (found, most) = (format!("{} points", card.gains.len()), MAX_GAIN_POINTS);
            return Err(ImportError::value(key(".gains"), found, format!("at most {most}")));
        }
        Ok(card)
    }

    /// Returns the activations that the card states.
    #[must_use]
    pub fn activations(&self) -> Activations {
        let output = OUTPUTS.iter().find(|(_, formula)| *formula == self.output);
        Activations {
            hidden: activation::hidden(&self.hidden_activation).unwrap_or_default(),
            output: output.map(|(activation, _)| *activation).unwrap_or_default(),
        }
    }

    /// Returns the policy that the card describes, with this actor. `None` when the checksum
    /// shows that the actor was changed since the card was written, so that the card no longer
    /// holds.
    #[must_use]
    pub fn policy(&self, packed: &PackedActor) -> Option<AlignedBytes> {
        let bytes = blob_with_manifest(&self.manifest(packed), &packed.weights).ok()?;
        let crc32 = Policy::parse(bytes.as_slice()).ok()?.crc32();
        (format!("{crc32:08x}") == self.policy_crc32).then_some(bytes)
    }

    /// Returns the manifest of a policy with this actor.
    #[must_use]
    pub fn manifest(&self, packed: &PackedActor) -> Manifest<'_> {
        Manifest {
            name: &self.name,
            widths: packed.widths.clone(),
            activations: packed.activations,
            observation: packed.observation,
            action: packed.action,
            leg: self.leg,
            media: self.media,
            provenance: Provenance {
                preset: &self.preset,
                seed: self.seed,
                steps: self.steps,
                trainer_version: &self.trainer_version,
                config: &self.config,
            },
            gains: self.gains.iter().copied().take(MAX_GAIN_POINTS).collect(),
        }
    }
}
