//! The values that flow through an actor's graph: an observation, then the sums of a layer,
//! rectified or not, then an action.
//!
//! Each operation turns one of these into the next, or is refused. Scalings are accumulated in
//! f64 and rounded once.

use super::tensor::Constant;
use crate::bridge::imported::{Assumption, ImportedActor, Subject};
use crate::net::mlp::Layer;
use crate::preset::{ACTION_HIGH, ACTION_LOW};
use leg_control::actor::{INPUTS, MAX_LAYERS, OUTPUTS, ObservationScaling};
use std::rc::Rc;

/// A scaling step between actor and clip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    Add,
    Sub,
    Mul,
    Div,
}

/// The kind of value on an edge.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Signal {
    /// A scaled observation: (observation - offset) * scale.
    Observation(Input),
    /// The sums of a layer.
    Sums(Trunk),
    /// The sums of a layer after ReLU.
    Rectified(Trunk),
    /// An action: clip(offset + scale * tanh(sums), low, high).
    Action(Trunk, Output),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Input {
    offset: [f64; 3],
    scale: [f64; 3],
}

impl Input {
    pub(super) const PLAIN: Self = Self { offset: [0.0; 3], scale: [1.0; 3] };
}

/// The layers of the network up to here.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Trunk {
    input: Input,
    layers: Vec<Rc<Layer>>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Output {
    scale: [f64; 2],
    offset: [f64; 2],
    low: [f64; 2],
    high: [f64; 2],
}

impl Output {
    const TANH: Self = Self {
        scale: [1.0; 2],
        offset: [0.0; 2],
        low: [f64::NEG_INFINITY; 2],
        high: [f64::INFINITY; 2],
    };
}

impl Signal {
    fn kind(&self) -> &'static str {
        match self {
            Self::Observation(_) => "the observation",
            Self::Sums(_) => "a layer before its ReLU",
            Self::Rectified(_) => "a layer after its ReLU",
            Self::Action(..) => "the action",
        }
    }

    /// Returns the number of values in a row.
    pub(super) fn width(&self) -> usize {
        match self {
            Self::Observation(_) => INPUTS,
            Self::Sums(trunk) | Self::Rectified(trunk) => trunk_outputs(&trunk.layers),
            Self::Action(..) => OUTPUTS,
        }
    }

    fn unfit(&self, op: &str) -> String {
        format!("{op} of {} is not what an actor does", self.kind())
    }

    /// Adds, subtracts, multiplies by or divides by a constant.
    pub(super) fn step(self, step: Step, by: &Constant) -> Result<Self, String> {
        match self {
            Self::Observation(mut input) => {
                let by = by.spread::<3>()?;
                for ((offset, scale), c) in input.offset.iter_mut().zip(&mut input.scale).zip(by) {
                    match step {
                        Step::Add => *offset -= c / *scale,
                        Step::Sub => *offset += c / *scale,
                        Step::Mul => *scale *= c,
                        Step::Div => *scale /= c,
                    }
                }
                Ok(Self::Observation(input))
            }
            Self::Sums(mut trunk) if matches!(step, Step::Add | Step::Sub) => {
                let sign = if step == Step::Add { 1.0 } else { -1.0 };
                let layer = trunk.layers.last_mut().map(Rc::make_mut).ok_or("no layer")?;
                let by = by.spread_over(layer.bias.len())?;
                for (bias, c) in layer.bias.iter_mut().zip(by) {
                    *bias = (f64::from(*bias) + sign * c) as f32;
                }
                Ok(Self::Sums(trunk))
            }
            Self::Action(trunk, mut output) => {
                let by = by.spread::<2>()?;
                for (i, &c) in by.iter().enumerate() {
                    output.step(i, step, c);
                }
                Ok(Self::Action(trunk, output))
            }
            other => Err(other.unfit(&format!("{step:?}"))),
        }
    }

    /// Appends a layer; `weights` are of shape (outputs, inputs), row by row.
    pub(super) fn dense(
        self,
        [outputs, inputs]: [usize; 2],
        weights: Vec<f32>,
        bias: Vec<f32>,
    ) -> Result<Self, String> {
        let mut trunk = match self {
            Self::Observation(input) => Trunk { input, layers: vec![] },
            Self::Rectified(trunk) => trunk,
            Self::Sums(_) => return Err("two layers without a ReLU between them".into()),
            Self::Action(..) => {
                return Err("a layer after Tanh; hidden layers must end with Relu".into());
            }
        };
        let expected = trunk.layers.last().map_or(INPUTS, |l| l.bias.len());
        if inputs != expected {
            return Err(format!("a layer of {inputs} inputs where {expected} arrive"));
        }
        if trunk.layers.len() == MAX_LAYERS {
            return Err(format!("more than {MAX_LAYERS} layers"));
        }
        debug_assert_eq!((weights.len(), bias.len()), (outputs * inputs, outputs));
        trunk.layers.push(Rc::new(Layer { inputs, weights, bias }));
        Ok(Self::Sums(trunk))
    }

    pub(super) fn relu(self) -> Result<Self, String> {
        match self {
            Self::Sums(trunk) | Self::Rectified(trunk) => Ok(Self::Rectified(trunk)),
            other => Err(other.unfit("Relu")),
        }
    }

    pub(super) fn tanh(self) -> Result<Self, String> {
        match self {
            Self::Sums(trunk) => Ok(Self::Action(trunk, Output::TANH)),
            other => Err(other.unfit("Tanh")),
        }
    }

    /// Raises the lower bound.
    pub(super) fn at_least(self, low: &Constant) -> Result<Self, String> {
        self.bounded(low, f64::max)
    }

    /// Lowers the upper bound.
    pub(super) fn at_most(self, high: &Constant) -> Result<Self, String> {
        self.bounded(high, f64::min)
    }

    fn bounded(self, bound: &Constant, nearer: fn(f64, f64) -> f64) -> Result<Self, String> {
        let Self::Action(trunk, mut output) = self else { return Err(self.unfit("a clip")) };
        let bound = bound.spread::<2>()?;
        for ends in [&mut output.low, &mut output.high] {
            for (end, b) in ends.iter_mut().zip(bound) {
                *end = nearer(*end, b);
            }
        }
        Ok(Self::Action(trunk, output))
    }

    /// Returns the actor, if this is an action.
    pub(super) fn imported_actor(self) -> Result<ImportedActor, String> {
        let Self::Action(Trunk { input, layers }, output) = self else {
            return Err(format!("it is {}, with no Tanh at the end", self.kind()));
        };
        if trunk_outputs(&layers) != OUTPUTS {
            return Err(format!("rows of {}, expected {OUTPUTS}", trunk_outputs(&layers)));
        }
        // A scaling that changes nothing says nothing about the units.
        let observation = (input != Input::PLAIN).then(|| ObservationScaling {
            offset: input.offset.map(|x| x as f32),
            scale: input.scale.map(|x| x as f32),
        });
        let layers = layers.into_iter().map(Rc::unwrap_or_clone).collect();
        let mut actor = ImportedActor { layers, observation, ..ImportedActor::default() };
        output.complete(&mut actor);
        Ok(actor)
    }
}

fn trunk_outputs(layers: &[Rc<Layer>]) -> usize {
    layers.last().map_or(INPUTS, |l| l.bias.len())
}

impl Output {
    fn step(&mut self, i: usize, step: Step, c: f64) {
        let Self { scale, offset, low, high, .. } = self;
        let ends = [&mut offset[i], &mut low[i], &mut high[i]];
        match step {
            Step::Add => ends.into_iter().for_each(|x| *x += c),
            Step::Sub => ends.into_iter().for_each(|x| *x -= c),
            Step::Mul => [&mut scale[i]].into_iter().chain(ends).for_each(|x| *x *= c),
            Step::Div => [&mut scale[i]].into_iter().chain(ends).for_each(|x| *x /= c),
        }
        if low[i] > high[i] {
            std::mem::swap(&mut low[i], &mut high[i]);
        }
    }

    /// Gives the actor the scaling and the bounds of the graph. A graph that ends with its
    /// tanh, multiplies it by 1 or clips it from -1 to 1, leaves both to the user. A bound of
    /// one action only is completed by the leg's own.
    fn complete(&self, actor: &mut ImportedActor) {
        let f32s = |x: [f64; 2]| x.map(|x| x as f32);
        let scaled = self.scale != [1.0; 2] || self.offset != [0.0; 2];
        let wide = self.low.iter().all(|&x| x <= -1.0) && self.high.iter().all(|&x| x >= 1.0);
        if !scaled && wide {
            return;
        }
        actor.action = Some([f32s(self.scale), f32s(self.offset)]);
        let sides = [
            (self.low, ACTION_LOW, "lowest", &mut actor.low),
            (self.high, ACTION_HIGH, "highest", &mut actor.high),
        ];
        for (ends, leg, which, bound) in sides {
            let stated = f32s(ends).map(|x| x.abs() < f32::MAX);
            if stated.contains(&true) {
                *bound = Some([0, 1].map(|i| if stated[i] { ends[i] as f32 } else { leg[i] }));
            }
            let units = ["rad", "m/s"];
            if let (true, Some(i)) = (stated.contains(&true), stated.iter().position(|s| !s)) {
                let text = format!("{which} action[{i}] {:.4} {}, the leg's own", leg[i], units[i]);
                actor.assumed.push(Assumption::new(Subject::ActionBounds, text));
            }
        }
    }
}
