//! An actor as read from a file, and its completion by what the file does not state.

use super::ImportError;
use super::model_card::ModelCard;
use crate::net::mlp::Layer;
use crate::policy::PackedActor;
use crate::preset::{ACTION_HIGH, ACTION_LOW};
use leg_control::actor::{ActionScaling, ObservationScaling};

/// Two pairs of numbers, one of each pair for each action: rad, m/s.
pub type Pairs = [[f32; 2]; 2];

/// An actor as read from a file. A value that the file does not state is `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImportedActor {
    /// Layers from the inputs to the outputs.
    pub layers: Vec<Layer>,
    /// Maps an observation to the network's inputs.
    pub observation: Option<ObservationScaling>,
    /// Maps the tanh of the outputs to an action: scale, then offset; rad, m/s.
    pub action: Option<Pairs>,
    /// Lowest and highest action; rad, m/s.
    pub bounds: Option<Pairs>,
    /// Model card, in files of this trainer's own exports.
    pub card: Option<ModelCard>,
    /// Assumptions about what the file format cannot state.
    pub assumed: Vec<String>,
}

/// Values that the user gives for files that do not state them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// Offset that is subtracted from the observation: m/s, m, ratio.
    pub observation_offset: Option<[f32; 3]>,
    /// Scale that the observation is then multiplied by.
    pub observation_scale: Option<[f32; 3]>,
    /// Offset that is added to the scaled tanh: rad, m/s.
    pub action_offset: Option<[f32; 2]>,
    /// Scale of the tanh: rad, m/s.
    pub action_scale: Option<[f32; 2]>,
    /// Lowest action: rad, m/s.
    pub action_low: Option<[f32; 2]>,
    /// Highest action: rad, m/s.
    pub action_high: Option<[f32; 2]>,
}

/// An actor that the controller can run.
#[derive(Clone, Debug, PartialEq)]
pub struct CompleteActor {
    /// The actor.
    pub actor: PackedActor,
    /// Model card, if it was written for exactly this actor.
    pub card: Option<ModelCard>,
    /// Assumptions about values that neither the file nor the user gave.
    pub assumed: Vec<String>,
}

impl ImportedActor {
    /// Completes the actor with the given values. The defaults are unscaled observations, the
    /// leg's bounds, and a tanh from -1 to 1 that is spread from the lowest to the highest
    /// action (as SB3 does for a Gymnasium `Box` action).
    ///
    /// # Errors
    /// [`ImportError`] when a value is given that the file states itself, when a value is not
    /// finite or out of order, and when the layers do not form an actor.
    pub fn complete(self, given: &ImportOptions) -> Result<CompleteActor, ImportError> {
        let ImportOptions { observation_offset, observation_scale, .. } = *given;
        let ImportOptions { action_offset, action_scale, action_low, action_high, .. } = *given;
        refuse(self.observation.is_some() && observation_offset.is_some(), "observation offset")?;
        refuse(self.observation.is_some() && observation_scale.is_some(), "observation scale")?;
        refuse(self.action.is_some() && action_offset.is_some(), "action offset")?;
        refuse(self.action.is_some() && action_scale.is_some(), "action scale")?;
        refuse(self.bounds.is_some() && action_low.is_some(), "action low")?;
        refuse(self.bounds.is_some() && action_high.is_some(), "action high")?;

        let mut assumed = self.assumed;
        let identity = ObservationScaling::IDENTITY;
        let observation = self.observation.unwrap_or(ObservationScaling {
            offset: observation_offset.unwrap_or(identity.offset),
            scale: observation_scale.unwrap_or(identity.scale),
        });
        if self.observation.is_none() && observation == identity {
            assumed.push("observations as they are".into());
        }
        let [low, high] = self
            .bounds
            .unwrap_or([action_low.unwrap_or(ACTION_LOW), action_high.unwrap_or(ACTION_HIGH)]);
        if self.bounds.is_none() && (action_low.is_none() || action_high.is_none()) {
            let [a, r] = [0, 1].map(|i| format!("{:.4} to {:.4}", low[i], high[i]));
            assumed.push(format!("actions from {a} rad and from {r} m/s"));
        }
        let half = |i: usize| 0.5 * (high[i] - low[i]);
        let [scale, offset] = self.action.unwrap_or([
            action_scale.unwrap_or([0, 1].map(half)),
            action_offset.unwrap_or([0, 1].map(|i| low[i] + half(i))),
        ]);
        if self.action.is_none() && (action_scale.is_none() || action_offset.is_none()) {
            assumed.push("tanh from -1 to 1 spread over the actions".into());
        }
        finite("observation offset", &observation.offset)?;
        finite("observation scale", &observation.scale)?;
        finite("action offset", &offset)?;
        finite("action scale", &scale)?;
        finite("lowest action", &low)?;
        finite("highest action", &high)?;
        if let Some(i) = (0..2).find(|&i| low[i] > high[i]) {
            let (key, found) = (format!("lowest action[{i}]"), low[i].to_string());
            return Err(ImportError::value(key, found, format!("at most {}", high[i])));
        }
        for (i, layer) in self.layers.iter().enumerate() {
            finite(&format!("weights of layer {i}"), &layer.weights)?;
            finite(&format!("biases of layer {i}"), &layer.bias)?;
        }
        let action = ActionScaling { scale, offset, low, high };
        let actor = PackedActor::new(&self.layers, observation, action)?;
        let card = self.card.filter(|card| card.policy(&actor).is_some());
        Ok(CompleteActor { actor, card, assumed })
    }
}

/// Refuses a value that is given although the file states it.
fn refuse(both: bool, name: &'static str) -> Result<(), ImportError> {
    if both { Err(ImportError::Stated { name }) } else { Ok(()) }
}

/// Refuses numbers that are not finite.
fn finite(key: &str, numbers: &[f32]) -> Result<(), ImportError> {
    match numbers.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(i) => {
            let found = numbers[i].to_string();
            Err(ImportError::value(format!("{key}[{i}]"), found, "a finite number"))
        }
    }
}
