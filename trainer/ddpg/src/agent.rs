//! The agent and its update.

mod state;

pub use state::AgentState;

use rand::Rng;
use rand_pcg::Pcg64;

use crate::net::adam::{Adam, Step, soft_update};
use crate::net::mlp::{Layer, Mlp, Pass};
use crate::net::tanh::tanh;
use crate::replay::{Batch, Replay};
use leg_simd::{Isa, Kernel, Lanes, Simd, Vector, dispatch};

/// Units in each hidden layer of the actor, padded to a multiple of 8.
pub const ACTOR_HIDDEN: usize = 50;
const ACTOR_PADDED: usize = 56;
/// Batch size of the evaluation of one observation: the width of the narrowest vector.
const ONE: usize = 8;

/// Signs under the mirror symmetry of the leg. The velocity among the observations and the
/// touchdown angle (measured from the vertical) among the actions are odd.
const ODD_OBSERVATIONS: [bool; 3] = [true, false, false];
const ODD_ACTIONS: [bool; 2] = [true, false];

type Actor = Mlp<3, ACTOR_HIDDEN, 0, 2, ACTOR_PADDED>;
type ActorPass<const B: usize> = Pass<3, ACTOR_HIDDEN, 0, 2, ACTOR_PADDED, B>;

/// The output stage of an actor: maps its outputs z to an action in unit space by clip(gain
/// tanh z, -bound, bound).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnitOutput {
    /// Gain of the touchdown angle and of the elongation speed.
    pub gain: [f32; 2],
    /// Bound of the action; infinite where only the environment clips, so that the critic sees
    /// actions outside the range.
    pub bound: f32,
}

/// The parameters of an update.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Adam's learning rate for the actor.
    pub actor_learning_rate: f32,
    /// Adam's learning rate for the critic.
    pub critic_learning_rate: f32,
    /// Weight of the next step's value, from 0 to below 1.
    pub discount: f32,
    /// Rate of the soft update of both target networks, per update.
    pub target_smoothing: f32,
    /// Rate at which the averaged actor follows the actor, per update; 0 for no averaging.
    pub actor_averaging: f32,
    /// Largest norm of a gradient; longer gradients are scaled down to it.
    pub max_gradient_norm: f32,
    /// Whether sampled transitions are mirrored with probability 1/2.
    pub mirror: bool,
}

/// The gradients of an update.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    /// Norm of the critic's gradient before clipping.
    pub critic_gradient_norm: f32,
    /// Norm of the actor's gradient before clipping.
    pub actor_gradient_norm: f32,
}

/// A DDPG agent of any network shape.
pub trait Agent: Send {
    /// Returns the action in unit space for a scaled observation, without exploration.
    fn act(&mut self, observation: [f32; 3]) -> [f32; 2];
    /// Returns the critic's value of an action in unit space.
    fn value(&mut self, observation: [f32; 3], action: [f32; 2]) -> f32;
    /// Draws a batch and updates both networks and their targets.
    fn update(&mut self, replay: &Replay, rates: &Rates, rng: &mut Pcg64) -> Update;
    /// Returns the actor's layers: the latest weights, or their running average.
    fn actor(&self, averaged: bool) -> [Layer; 3];
    /// Returns the number of samples in a batch.
    fn batch(&self) -> usize;
    /// Returns everything that outlives an update, to store in a checkpoint.
    fn state(&self) -> AgentState;
    /// Restores the state of an agent of the same shape; returns false when the shape differs.
    fn restore(&mut self, state: &AgentState) -> bool;
}

/// A DDPG agent whose critic is `Mlp<X, H, E, 1, P>`, with batches of `B`.
#[derive(Clone, Debug)]
pub(crate) struct Ddpg<
    const X: usize,
    const H: usize,
    const E: usize,
    const P: usize,
    const B: usize,
> {
    isa: Isa,
    output: UnitOutput,
    symmetric_actor: bool,
    actor: Actor,
    actor_target: Actor,
    actor_average: Actor,
    actor_adam: Adam<ACTOR_PADDED>,
    critic: Mlp<X, H, E, 1, P>,
    critic_target: Mlp<X, H, E, 1, P>,
    critic_adam: Adam<P>,
    // Buffers of an update; no value in them outlives it.
    batch: Batch<B>,
    actor_pass: ActorPass<B>,
    critic_pass: Pass<X, H, E, 1, P, B>,
    actor_gradient: Actor,
    critic_gradient: Mlp<X, H, E, 1, P>,
    actor_one: ActorPass<ONE>,
    critic_one: Pass<X, H, E, 1, P, ONE>,
}

/// An agent whose critic takes the action at its second layer, as in the paper.
pub(crate) type PaperDdpg<const B: usize> = Ddpg<3, 50, 2, 56, B>;
/// An agent whose critic takes the action as an input and is 50 units wide.
pub(crate) type JointDdpg50<const B: usize> = Ddpg<5, 50, 0, 56, B>;
/// An agent whose critic takes the action as an input and is 100 units wide.
pub(crate) type JointDdpg100<const B: usize> = Ddpg<5, 100, 0, 104, B>;

impl<const X: usize, const H: usize, const E: usize, const P: usize, const B: usize>
    Ddpg<X, H, E, P, B>
{
    /// Creates an agent from the layers of both networks. The targets start as copies.
    #[must_use]
    pub(crate) fn new(
        isa: Isa,
        output: UnitOutput,
        actor: &[Layer; 3],
        critic: &[Layer; 3],
    ) -> Self {
        let actor = Actor::from_layers(actor);
        let critic = Mlp::from_layers(critic);
        Self {
            isa,
            output,
            symmetric_actor: false,
            actor_target: actor.clone(),
            actor_average: actor.clone(),
            actor,
            actor_adam: Adam::new(Actor::ROWS),
            critic_target: critic.clone(),
            critic,
            critic_adam: Adam::new(Mlp::<X, H, E, 1, P>::ROWS),
            batch: Batch::new(),
            actor_pass: Pass::new(0),
            critic_pass: Pass::new(2),
            actor_gradient: Actor::zeros(),
            critic_gradient: Mlp::zeros(),
            actor_one: Pass::new(0),
            critic_one: Pass::new(0),
        }
    }

    /// Makes the actor mirror-symmetric; every update keeps it so.
    #[must_use]
    pub(crate) fn with_symmetric_actor(mut self) -> Self {
        self.symmetric_actor = true;
        self.actor.symmetrise(ODD_OBSERVATIONS, ODD_ACTIONS);
        self.actor_target = self.actor.clone();
        self.actor_average = self.actor.clone();
        self
    }

    /// Maps the actor's outputs of the pass to actions in the critic's pass.
    #[inline(always)]
    fn actions<S: Simd>(&mut self, simd: S) {
        let bound = S::V8::splat(simd, self.output.bound);
        let low = S::V8::splat(simd, -self.output.bound);
        let actions = self.critic_pass.action_rows();
        for ((z, u), gain) in self.actor_pass.outputs.iter().zip(actions).zip(self.output.gain) {
            for c in (0..B).step_by(8) {
                let raw = tanh(simd, S::V8::load(simd, &z[c..])).mul(S::V8::splat(simd, gain));
                raw.min(bound).max(low).store(&mut u[c..]);
            }
        }
    }

    /// Computes the actor's output slopes from the critic's slopes by the action. Where the
    /// clip is active, only slopes that lead back inside pass.
    #[inline(always)]
    fn action_slopes<S: Simd>(&mut self, simd: S) {
        let bound = S::V8::splat(simd, self.output.bound);
        let low = S::V8::splat(simd, -self.output.bound);
        let one = S::V8::splat(simd, 1.0);
        let down = S::V8::splat(simd, -1.0 / B as f32);
        for (i, gain) in self.output.gain.into_iter().enumerate() {
            let gain = S::V8::splat(simd, gain);
            for c in (0..B).step_by(8) {
                let t = tanh(simd, S::V8::load(simd, &self.actor_pass.outputs[i][c..]));
                let raw = t.mul(gain);
                let excess = raw.sub(raw.min(bound).max(low));
                let g = S::V8::load(simd, &self.critic_pass.input_slopes[i][c..]);
                let g = g.sub(g.where_positive(g.mul(excess)));
                g.mul(down)
                    .mul(gain)
                    .mul(one.sub(t.mul(t)))
                    .store(&mut self.actor_pass.output_slopes[i][c..]);
            }
        }
    }

    /// Computes the critic's output slopes: those of the squared error against the Bellman
    /// target, with the target networks' value of the next state in `next_value`.
    #[inline(always)]
    fn critic_slopes<S: Simd>(&mut self, simd: S, discount: f32, next_value: &[f32; B]) {
        let discount = S::V8::splat(simd, discount);
        let scale = S::V8::splat(simd, 2.0 / B as f32);
        for c in (0..B).step_by(8) {
            let follows = S::V8::load(simd, &self.batch.continues[c..])
                .mul(discount)
                .mul(S::V8::load(simd, &next_value[c..]));
            let target = S::V8::load(simd, &self.batch.reward[c..]).add(follows);
            S::V8::load(simd, &self.critic_pass.outputs[0][c..])
                .sub(target)
                .mul(scale)
                .store(&mut self.critic_pass.output_slopes[0][c..]);
        }
    }

    #[inline(always)]
    fn observe(&mut self, next: bool) {
        let from = if next { &self.batch.next } else { &self.batch.observation };
        self.actor_pass.inputs[..3].copy_from_slice(from);
        self.critic_pass.inputs[..3].copy_from_slice(from);
    }

    #[inline(always)]
    fn learn<S: Simd>(&mut self, simd: S, rates: &Rates) -> Update {
        // The Bellman target uses both target networks.
        self.observe(true);
        self.actor_target.forward(simd, &mut self.actor_pass);
        self.actions(simd);
        self.critic_target.forward(simd, &mut self.critic_pass);
        let next_value = self.critic_pass.outputs[0];

        self.observe(false);
        self.critic_pass.action_rows().copy_from_slice(&self.batch.action);
        self.critic.forward(simd, &mut self.critic_pass);
        self.critic_slopes(simd, rates.discount, &next_value);
        self.critic.gradient(simd, &mut self.critic_pass, &mut self.critic_gradient);
        let mut step = Step {
            learning_rate: rates.critic_learning_rate,
            max_gradient_norm: rates.max_gradient_norm,
            target_smoothing: rates.target_smoothing,
        };
        let critic_gradient_norm = self.critic_adam.step(
            simd,
            step,
            self.critic_gradient.rows(),
            self.critic.rows_mut(),
            self.critic_target.rows_mut(),
        );

        // The actor follows the gradient of the value that the updated critic gives its
        // actions.
        self.actor.forward(simd, &mut self.actor_pass);
        self.actions(simd);
        self.critic.forward(simd, &mut self.critic_pass);
        self.critic_pass.output_slopes[0].fill(1.0);
        self.critic.back_to_inputs(simd, &mut self.critic_pass);
        self.action_slopes(simd);
        self.actor.gradient(simd, &mut self.actor_pass, &mut self.actor_gradient);
        if self.symmetric_actor {
            self.actor_gradient.symmetrise(ODD_OBSERVATIONS, ODD_ACTIONS);
        }
        step.learning_rate = rates.actor_learning_rate;
        let actor_gradient_norm = self.actor_adam.step(
            simd,
            step,
            self.actor_gradient.rows(),
            self.actor.rows_mut(),
            self.actor_target.rows_mut(),
        );
        if rates.actor_averaging > 0.0 {
            let average = self.actor_average.rows_mut();
            soft_update(simd, rates.actor_averaging, self.actor.rows(), average);
        }
        Update { critic_gradient_norm, actor_gradient_norm }
    }
}

/// A kernel that runs one update.
struct Learn<'a, D, R> {
    agent: &'a mut D,
    replay: &'a Replay,
    rates: &'a Rates,
    rng: &'a mut R,
}

impl<const X: usize, const H: usize, const E: usize, const P: usize, const B: usize, R: Rng> Kernel
    for Learn<'_, Ddpg<X, H, E, P, B>, R>
{
    type Output = Update;
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Update {
        let Learn { agent, replay, rates, rng } = self;
        replay.sample(rates.mirror, rng, &mut agent.batch);
        agent.learn(simd, rates)
    }
}

/// A kernel that runs the forward pass of one observation.
struct Forward<'a, const X: usize, const H: usize, const E: usize, const O: usize, const P: usize>(
    &'a Mlp<X, H, E, O, P>,
    &'a mut Pass<X, H, E, O, P, ONE>,
);

impl<const X: usize, const H: usize, const E: usize, const O: usize, const P: usize> Kernel
    for Forward<'_, X, H, E, O, P>
{
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        self.0.forward(simd, self.1);
    }
}

/// A kernel that computes tanh of two numbers.
struct Tanh([f32; 2]);

impl Kernel for Tanh {
    type Output = [f32; 2];
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> [f32; 2] {
        let mut lanes = [0.0; 8];
        lanes[..2].copy_from_slice(&self.0);
        tanh(simd, S::V8::load(simd, &lanes)).store(&mut lanes);
        [lanes[0], lanes[1]]
    }
}

impl<const X: usize, const H: usize, const E: usize, const P: usize, const B: usize> Agent
    for Ddpg<X, H, E, P, B>
{
    fn act(&mut self, observation: [f32; 3]) -> [f32; 2] {
        for (row, x) in self.actor_one.inputs.iter_mut().zip(observation) {
            row.fill(x);
        }
        dispatch(self.isa, Forward(&self.actor, &mut self.actor_one));
        let z = [0, 1].map(|i| self.actor_one.outputs[i][0]);
        let t = dispatch(self.isa, Tanh(z));
        let UnitOutput { gain, bound } = self.output;
        [0, 1].map(|i| (t[i] * gain[i]).min(bound).max(-bound))
    }

    fn value(&mut self, observation: [f32; 3], action: [f32; 2]) -> f32 {
        for (row, x) in self.critic_one.inputs.iter_mut().zip(observation) {
            row.fill(x);
        }
        for (row, u) in self.critic_one.action_rows().iter_mut().zip(action) {
            row.fill(u);
        }
        dispatch(self.isa, Forward(&self.critic, &mut self.critic_one));
        self.critic_one.outputs[0][0]
    }

    fn update(&mut self, replay: &Replay, rates: &Rates, rng: &mut Pcg64) -> Update {
        let isa = self.isa;
        let agent = self;
        dispatch(isa, Learn { agent, replay, rates, rng })
    }

    fn actor(&self, averaged: bool) -> [Layer; 3] {
        if averaged { &self.actor_average } else { &self.actor }.to_layers()
    }

    fn batch(&self) -> usize {
        B
    }

    fn state(&self) -> AgentState {
        self.state()
    }

    fn restore(&mut self, state: &AgentState) -> bool {
        self.restore(state)
    }
}

#[cfg(test)]
mod tests;
