//! Gradients against finite differences in `f64`, and the same bits everywhere.

use super::{Agent, Ddpg, JointDdpg50, Rates, UnitOutput};
use crate::net::mlp::Layer;
use crate::replay::{Replay, Transition};
use leg_simd::Isa;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const RATES: Rates = Rates {
    actor_learning_rate: 1e-3,
    critic_learning_rate: 1e-2,
    discount: 0.6,
    target_smoothing: 1e-3,
    actor_averaging: 1e-3,
    max_gradient_norm: 10.0,
    mirror: true,
};
const FREE: UnitOutput = UnitOutput { gain: [2.6, 1.5], bound: f32::INFINITY };
const CLIPPED: UnitOutput = UnitOutput { gain: [1.0, 1.5], bound: 1.0 };

fn random(rng: &mut Pcg64) -> f32 {
    rng.random::<f32>() * 2.0 - 1.0
}

fn layers(widths: [(usize, usize); 3], rng: &mut Pcg64) -> [Layer; 3] {
    widths.map(|(inputs, outputs)| {
        let scale = 1.5 / (inputs as f32).sqrt();
        Layer {
            inputs,
            weights: (0..inputs * outputs).map(|_| scale * random(rng)).collect(),
            bias: (0..outputs).map(|_| 0.2 * random(rng)).collect(),
        }
    })
}

fn replay(rng: &mut Pcg64) -> Replay {
    let mut replay = Replay::new(1000);
    for _ in 0..300 {
        let mut three = || [random(rng), random(rng), random(rng)];
        let (observation, next, [a, b, reward]) = (three(), three(), three());
        let continues = f32::from(reward > -0.5);
        replay.push(Transition { observation, action: [a, b], reward, next, continues });
    }
    replay
}

fn agent<const X: usize, const H: usize, const E: usize, const P: usize, const B: usize>(
    isa: Isa,
    output: UnitOutput,
) -> (Ddpg<X, H, E, P, B>, Replay, Pcg64) {
    let mut rng = Pcg64::seed_from_u64(5);
    let actor = layers([(3, 50), (50, 50), (50, 2)], &mut rng);
    let critic = layers([(X, H), (H + E, H), (H, 1)], &mut rng);
    let replay = replay(&mut rng);
    (Ddpg::new(isa, output, &actor, &critic), replay, rng)
}

/// A network in `f64`; `extra` joins at the second layer.
fn forward(layers: &[Vec<f64>; 3], hidden: usize, input: &[f64], extra: &[f64]) -> Vec<f64> {
    let mut x = input.to_vec();
    for (l, parameters) in layers.iter().enumerate() {
        if l == 1 {
            x.extend(extra);
        }
        let outputs = parameters.len() / (x.len() + 1);
        assert!(l == 2 || outputs == hidden);
        let (weights, bias) = parameters.split_at(outputs * x.len());
        x = weights
            .chunks(x.len())
            .zip(bias)
            .map(|(row, b)| row.iter().zip(&x).map(|(w, x)| w * x).sum::<f64>() + b)
            .map(|sum| if l < 2 { sum.max(0.0) } else { sum })
            .collect();
    }
    x
}

/// Weights, then biases, of each layer.
fn wide(layers: [Layer; 3]) -> [Vec<f64>; 3] {
    layers.map(|l| l.weights.into_iter().chain(l.bias).map(f64::from).collect())
}

/// Both losses of the paper's algorithm in `f64`, over the agent's last batch.
struct Losses {
    samples: Vec<([f64; 3], [f64; 2])>,
    targets: Vec<f64>,
    hidden: usize,
    joins: bool,
}

impl Losses {
    fn value(&self, critic: &[Vec<f64>; 3], s: [f64; 3], a: [f64; 2]) -> f64 {
        let joint = [s[0], s[1], s[2], a[0], a[1]];
        if self.joins {
            forward(critic, self.hidden, &s, &a)[0]
        } else {
            forward(critic, self.hidden, &joint, &[])[0]
        }
    }

    fn act(actor: &[Vec<f64>; 3], s: [f64; 3]) -> [f64; 2] {
        let z = forward(actor, 50, &s, &[]);
        [0, 1].map(|i| f64::from(FREE.gain[i]) * z[i].tanh())
    }

    fn critic(&self, critic: &[Vec<f64>; 3]) -> f64 {
        let errors = self.samples.iter().zip(&self.targets);
        let sum: f64 = errors.map(|(&(s, a), t)| (self.value(critic, s, a) - t).powi(2)).sum();
        sum / self.samples.len() as f64
    }

    fn actor(&self, actor: &[Vec<f64>; 3], critic: &[Vec<f64>; 3]) -> f64 {
        let values = self.samples.iter();
        let sum: f64 = values.map(|&(s, _)| self.value(critic, s, Self::act(actor, s))).sum();
        -sum / self.samples.len() as f64
    }
}

/// Compares some components of `gradient` with central differences of `loss` at `at`.
fn check(gradient: [Layer; 3], at: &[Vec<f64>; 3], loss: impl Fn(&[Vec<f64>; 3]) -> f64) {
    for (l, expected) in wide(gradient).iter().enumerate() {
        let mut agree = 0;
        let picked: Vec<usize> = (0..expected.len())
            .step_by(expected.len().div_ceil(80))
            .chain(expected.len() - 1..expected.len())
            .collect();
        for &i in &picked {
            let difference = |h: f64| {
                let mut moved = at.clone();
                moved[l][i] += h;
                loss(&moved)
            };
            let slope = (difference(1e-5) - difference(-1e-5)) / 2e-5;
            agree += usize::from((slope - expected[i]).abs() < 1e-5 + 1e-3 * slope.abs());
        }
        // A rectifier may switch within the difference; rarely.
        assert!(agree + 2 >= picked.len(), "layer {l}: {agree} of {}", picked.len());
    }
}

fn gradients_are_right<
    const X: usize,
    const H: usize,
    const E: usize,
    const P: usize,
    const B: usize,
>() {
    let (mut agent, replay, mut rng) = agent::<X, H, E, P, B>(Isa::best(), FREE);
    let actor = wide(agent.actor.to_layers());
    let critic = wide(agent.critic.to_layers());
    let rates = Rates { critic_learning_rate: 0.0, ..RATES };
    agent.update(&replay, &rates, &mut rng);
    let batch = &agent.batch;
    let mut losses = Losses {
        samples: (0..B)
            .map(|b| {
                let s = [0, 1, 2].map(|i| f64::from(batch.observation[i][b]));
                (s, [0, 1].map(|i| f64::from(batch.action[i][b])))
            })
            .collect(),
        targets: Vec::new(),
        hidden: H,
        joins: E > 0,
    };
    losses.targets = (0..B)
        .map(|b| {
            let s = [0, 1, 2].map(|i| f64::from(batch.next[i][b]));
            let value = losses.value(&critic, s, Losses::act(&actor, s));
            f64::from(batch.reward[b]) + 0.6 * f64::from(batch.continues[b]) * value
        })
        .collect();
    check(agent.critic_gradient.to_layers(), &critic, |c| losses.critic(c));
    check(agent.actor_gradient.to_layers(), &actor, |a| losses.actor(a, &critic));
    // The value that is logged is the same network.
    let (s, a) = losses.samples[0];
    let logged = agent.value(s.map(|x| x as f32), a.map(|x| x as f32));
    assert!((f64::from(logged) - losses.value(&critic, s, a)).abs() < 1e-5);
}

#[test]
fn the_papers_critic_has_the_right_gradients() {
    gradients_are_right::<3, 50, 2, 56, 32>();
}

#[test]
fn the_joint_critics_have_the_right_gradients() {
    gradients_are_right::<5, 50, 0, 56, 64>();
    gradients_are_right::<5, 100, 0, 104, 64>();
}

/// All bits of an agent after some updates.
fn bits(mut agent: impl Agent, replay: &Replay, mut rng: Pcg64) -> Vec<u32> {
    for _ in 0..60 {
        let update = agent.update(replay, &RATES, &mut rng);
        assert!(update.critic_gradient_norm.is_finite() && update.actor_gradient_norm.is_finite());
    }
    let layers = [agent.actor(false), agent.actor(true)].concat();
    let weights = layers.into_iter().flat_map(|l| [l.weights, l.bias].concat());
    let mut bits: Vec<u32> = weights.map(f32::to_bits).collect();
    let s = [0.3, -0.2, 0.9];
    bits.extend(agent.act(s).map(f32::to_bits));
    bits.push(agent.value(s, [0.1, 0.7]).to_bits());
    bits
}

#[test]
fn every_instruction_set_learns_the_same_bits() {
    let learn = |isa| {
        let (paper, replay, rng) = agent::<3, 50, 2, 56, 32>(isa, FREE);
        let mut all = bits(paper, &replay, rng);
        let (joint, replay, rng) = agent::<5, 50, 0, 56, 64>(isa, CLIPPED);
        all.extend(bits(joint, &replay, rng));
        let (joint, replay, rng) = agent::<5, 100, 0, 104, 64>(isa, CLIPPED);
        all.extend(bits(joint, &replay, rng));
        all
    };
    let baseline = learn(Isa::Baseline);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.available()) {
        assert!(learn(isa) == baseline, "{} learns other bits", isa.name());
    }
}

/// The slopes of the actor's outputs, as a kernel.
struct Slopes<'a>(&'a mut JointDdpg50<64>);

impl leg_simd::Kernel for Slopes<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: leg_simd::Simd>(self, simd: S) {
        self.0.action_slopes(simd);
    }
}

#[test]
fn the_clip_blocks_only_what_leads_further_out() {
    let (mut agent, _, _) = agent::<5, 50, 0, 56, 64>(Isa::best(), CLIPPED);
    // The second output: 1.5 tanh(2) is above the bound of 1; tanh(0.1) is not.
    for b in 0..64 {
        agent.actor_pass.outputs[1][b] = if b < 32 { 2.0 } else { 0.1 };
        agent.critic_pass.input_slopes[1][b] = if b % 2 == 0 { 1.0 } else { -1.0 };
    }
    leg_simd::dispatch(Isa::best(), Slopes(&mut agent));
    for b in 0..64 {
        let slope = agent.actor_pass.output_slopes[1][b];
        assert_eq!(slope == 0.0, b < 32 && b % 2 == 0, "sample {b}");
        // The loss is the value's negative.
        assert!(slope == 0.0 || (slope > 0.0) == (b % 2 == 1));
    }
}
