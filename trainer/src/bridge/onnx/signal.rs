//! The values that flow through an actor's graph: an observation, then the sums of a layer,
//! rectified or not, then an action.
//!
//! Each operation turns one of these into the next, or is refused. Scalings are accumulated in
//! f64 and rounded once.

use super::tensor::Constant;
use crate::bridge::imported::{ImportedActor, Pairs};
use crate::net::mlp::Layer;
use crate::preset::{ACTION_HIGH, ACTION_LOW};
use leg_control::actor::{INPUTS, MAX_LAYERS, ObservationScaling};
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
    /// Whether the graph has a scaling at all.
    own: bool,
}

impl Input {
    pub(super) const PLAIN: Self = Self { offset: [0.0; 3], scale: [1.0; 3], own: false };
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
    /// Whether the graph has a scaling at all.
    own: bool,
}

impl Output {
    const TANH: Self = Self {
        scale: [1.0; 2],
        offset: [0.0; 2],
        low: [f64::NEG_INFINITY; 2],
        high: [f64::INFINITY; 2],
        own: false,
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
                Ok(Self::Observation(Input { own: true, ..input }))
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
                Ok(Self::Action(trunk, Output { own: true, ..output }))
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
        let observation = input.own.then(|| ObservationScaling {
            offset: input.offset.map(|x| x as f32),
            scale: input.scale.map(|x| x as f32),
        });
        let layers = layers.into_iter().map(Rc::unwrap_or_clone).collect();
        let (action, bounds) = output.scalings();
        Ok(ImportedActor { layers, observation, action, bounds, ..ImportedActor::default() })
    }
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

    /// Returns the scaling and the bounds, each `None` where the graph has none. A graph that
    /// ends with its tanh, or clips it from -1 to 1, leaves both to the user.
    fn scalings(&self) -> (Option<Pairs>, Option<Pairs>) {
        let f32s = |x: [f64; 2]| x.map(|x| x as f32);
        let wide = self.low.iter().all(|&x| x <= -1.0) && self.high.iter().all(|&x| x >= 1.0);
        if !self.own && wide {
            return (None, None);
        }
        let action = Some([f32s(self.scale), f32s(self.offset)]);
        let infinite = |ends: [f64; 2]| ends.iter().all(|x| x.is_infinite());
        if infinite(self.low) && infinite(self.high) {
            return (action, None);
        }
        let or = |ends: [f64; 2], leg: [f32; 2]| {
            [0, 1].map(|i| if ends[i].is_infinite() { leg[i] } else { ends[i] as f32 })
        };
        (action, Some([or(self.low, ACTION_LOW), or(self.high, ACTION_HIGH)]))
    }
}
