//! An actor as read from a file, and its completion by what the file does not state.

use super::ImportError;
use super::model_card::ModelCard;
use crate::policy::PackedActor;
use crate::preset::{ACTION_HIGH, ACTION_LOW};
use leg_control::actor::{ActionScaling, Activations, ObservationScaling};
use leg_ddpg::Layer;

/// Two pairs of numbers, one of each pair for each action: rad, m/s.
pub type Pairs = [[f32; 2]; 2];

/// An actor as read from a file. A value that the file does not state is `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImportedActor {
    /// Layers from the inputs to the outputs.
    pub layers: Vec<Layer>,
    /// Functions between the layers and at the end.
    pub activations: Activations,
    /// Whether the outputs run from -1 to 1, as those of tanh do, and are to be spread over the
    /// actions where no scaling is stated.
    pub is_normalised: bool,
    /// Maps an observation to the network's inputs.
    pub observation: Option<ObservationScaling>,
    /// Maps the outputs to an action: scale, then offset; rad, m/s.
    pub action: Option<Pairs>,
    /// Lowest action; rad, m/s.
    pub low: Option<[f32; 2]>,
    /// Highest action; rad, m/s.
    pub high: Option<[f32; 2]>,
    /// Model card, in files of this trainer's own exports.
    pub card: Option<ModelCard>,
    /// What was taken from the file, and what was not.
    pub taken: Vec<String>,
    /// Assumptions about what the file format cannot state.
    pub assumed: Vec<Assumption>,
}

/// What was taken for a value that neither the file nor the user gave.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Assumption {
    /// What it is about.
    pub about: Subject,
    /// What was taken, in words.
    pub text: String,
}

impl Assumption {
    /// Creates an assumption.
    pub fn new(about: Subject, text: impl Into<String>) -> Self {
        Self { about, text: text.into() }
    }
}

/// What an assumption can be about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// The activation between the layers.
    HiddenActivation,
    /// The activation after the last layer.
    OutputActivation,
    /// The scaling of the observation.
    Observation,
    /// The lowest and the highest action.
    ActionBounds,
    /// The scaling of the outputs.
    ActionScaling,
    /// The output of a graph that is the action.
    Output,
}

/// Values that the user gives for files that do not state them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// Offset that is subtracted from the observation: m/s, m, ratio.
    pub observation_offset: Option<[f32; 3]>,
    /// Scale that the observation is then multiplied by.
    pub observation_scale: Option<[f32; 3]>,
    /// Offset that is added to the scaled outputs: rad, m/s.
    pub action_offset: Option<[f32; 2]>,
    /// Scale of the outputs: rad, m/s.
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
    /// What was taken from the file, and what was not.
    pub taken: Vec<String>,
    /// Assumptions about values that neither the file nor the user gave.
    pub assumed: Vec<Assumption>,
}

impl ImportedActor {
    /// Completes the actor with the given values. The defaults are unscaled observations, the
    /// leg's bounds, outputs from -1 to 1 that are spread from the lowest to the highest
    /// action (as SB3 does for a Gymnasium `Box` action), and other outputs taken as the actions
    /// themselves.
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
        refuse(self.low.is_some() && action_low.is_some(), "action low")?;
        refuse(self.high.is_some() && action_high.is_some(), "action high")?;

        let mut assumed = self.assumed;
        let mut assume = |about, text: String| assumed.push(Assumption::new(about, text));
        let identity = ObservationScaling::IDENTITY;
        let observation = self.observation.unwrap_or(ObservationScaling {
            offset: observation_offset.unwrap_or(identity.offset),
            scale: observation_scale.unwrap_or(identity.scale),
        });
        if self.observation.is_none() {
            let text = match (observation_offset, observation_scale) {
                (None, None) => Some("observations as they are"),
                (None, Some(_)) => Some("no observation offset"),
                (Some(_), None) => Some("no observation scale"),
                (Some(_), Some(_)) => None,
            };
            if let Some(text) = text {
                assume(Subject::Observation, text.into());
            }
        }
        let [low, high] = [self.low.or(action_low), self.high.or(action_high)];
        let text = match (low, high) {
            (None, None) => {
                let [a, r] =
                    [0, 1].map(|i| format!("{:.4} to {:.4}", ACTION_LOW[i], ACTION_HIGH[i]));
                Some(format!("actions from {a} rad and from {r} m/s"))
            }
            (None, _) => Some(leg_bound("lowest", ACTION_LOW)),
            (_, None) => Some(leg_bound("highest", ACTION_HIGH)),
            _ => None,
        };
        if let Some(text) = text {
            assume(Subject::ActionBounds, text);
        }
        let [low, high] = [low.unwrap_or(ACTION_LOW), high.unwrap_or(ACTION_HIGH)];
        let half = |i: usize| 0.5 * (high[i] - low[i]);
        let by_default = if self.is_normalised {
            [[0, 1].map(half), [0, 1].map(|i| low[i] + half(i))]
        } else {
            [[1.0; 2], [0.0; 2]]
        };
        let [scale, offset] = self.action.unwrap_or([
            action_scale.unwrap_or(by_default[0]),
            action_offset.unwrap_or(by_default[1]),
        ]);
        if self.action.is_none() {
            let of = |x: [f32; 2]| format!("{:.4} rad and {:.4} m/s", x[0], x[1]);
            let text = match (action_scale, action_offset, self.is_normalised) {
                (None, None, true) => Some("outputs from -1 to 1 spread over the actions".into()),
                (None, None, false) => Some("outputs in rad and m/s".into()),
                (None, _, true) => Some(format!("action scale {}, half the range", of(scale))),
                (None, _, false) => Some("action scale 1".into()),
                (_, None, true) => Some(format!("action offset {}, mid-range", of(offset))),
                (_, None, false) => Some("action offset 0".into()),
                _ => None,
            };
            if let Some(text) = text {
                assume(Subject::ActionScaling, text);
            }
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
        let actor = PackedActor::new(&self.layers, self.activations, observation, action)?;
        let card = self.card.filter(|card| card.policy(&actor).is_some());
        Ok(CompleteActor { actor, card, taken: self.taken, assumed })
    }
}

/// Describes a bound that is the leg's own.
fn leg_bound(which: &str, bound: [f32; 2]) -> String {
    format!("{which} action {:.4} rad and {:.4} m/s, the leg's own", bound[0], bound[1])
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
