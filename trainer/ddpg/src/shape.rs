//! The shapes of agents, and an agent of any of them.

use leg_simd::Isa;
use serde::{Deserialize, Serialize};

use crate::agent::{ACTOR_HIDDEN, Agent, Ddpg, JointDdpg50, JointDdpg100, PaperDdpg, UnitOutput};
use crate::net::mlp::Layer;

/// The numbers of samples that a batch can have.
pub const BATCHES: [usize; 2] = [32, 64];

/// The critic's architecture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Critic {
    /// The paper's critic: the state passes 3-50 ReLU-50, the action 2-50; their sum passes a
    /// ReLU and the output layer. The two layers that are added share one bias.
    ActionAtSecondLayer,
    /// A critic 5-50-50-1 on state and action.
    #[serde(rename = "joint-50")]
    Joint50,
    /// A critic 5-100-100-1 on state and action.
    #[serde(rename = "joint-100")]
    Joint100,
}

impl Critic {
    /// Returns the inputs and outputs of each layer.
    #[must_use]
    pub const fn layers(self) -> [[usize; 2]; 3] {
        match self {
            Self::ActionAtSecondLayer => [[3, 50], [52, 50], [50, 1]],
            Self::Joint50 => [[5, 50], [50, 50], [50, 1]],
            Self::Joint100 => [[5, 100], [100, 100], [100, 1]],
        }
    }
}

/// What an agent consists of, beside its weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Architecture of the critic.
    pub critic: Critic,
    /// Number of samples in a batch, one of [`BATCHES`].
    pub batch: usize,
    /// Output stage of the actor.
    pub output: UnitOutput,
    /// Whether the actor is made mirror-symmetric, and kept so by every update.
    pub symmetric_actor: bool,
}

impl Shape {
    /// Inputs and outputs of each layer of the actor.
    pub const ACTOR_LAYERS: [[usize; 2]; 3] =
        [[3, ACTOR_HIDDEN], [ACTOR_HIDDEN, ACTOR_HIDDEN], [ACTOR_HIDDEN, 2]];
}

/// Creates an agent from the layers of both networks. The targets start as copies.
///
/// # Panics
/// If `shape.batch` is none of [`BATCHES`], or the layers are not those of [`Shape::ACTOR_LAYERS`]
/// and [`Critic::layers`].
#[must_use]
pub fn agent(isa: Isa, shape: &Shape, actor: &[Layer; 3], critic: &[Layer; 3]) -> Box<dyn Agent> {
    let output = shape.output;
    match (shape.critic, shape.batch) {
        (Critic::ActionAtSecondLayer, 32) => {
            ready(shape, PaperDdpg::<32>::new(isa, output, actor, critic))
        }
        (Critic::ActionAtSecondLayer, 64) => {
            ready(shape, PaperDdpg::<64>::new(isa, output, actor, critic))
        }
        (Critic::Joint50, 32) => ready(shape, JointDdpg50::<32>::new(isa, output, actor, critic)),
        (Critic::Joint50, 64) => ready(shape, JointDdpg50::<64>::new(isa, output, actor, critic)),
        (Critic::Joint100, 32) => ready(shape, JointDdpg100::<32>::new(isa, output, actor, critic)),
        (Critic::Joint100, 64) => ready(shape, JointDdpg100::<64>::new(isa, output, actor, critic)),
        (_, batch) => panic!("a batch of {batch} samples; batches have one of {BATCHES:?}"),
    }
}

fn ready<const X: usize, const H: usize, const E: usize, const P: usize, const B: usize>(
    shape: &Shape,
    ddpg: Ddpg<X, H, E, P, B>,
) -> Box<dyn Agent> {
    Box::new(if shape.symmetric_actor { ddpg.with_symmetric_actor() } else { ddpg })
}
