//! The values that flow through an actor's graph: an observation, then functions of the sums of
//! a layer, then an action.
//!
//! Each operation turns one of these into the next, or is refused. Scalings are accumulated in
//! f64 and rounded once.

use super::curve::Curve;
use super::tensor::Constant;
use crate::bridge::imported::{Assumption, ImportedActor, Subject};
use crate::preset::{ACTION_HIGH, ACTION_LOW};
use leg_control::actor::{
    Activation, Activations, INPUTS, MAX_LAYERS, OUTPUTS, ObservationScaling, OutputActivation,
};
use leg_ddpg::Layer;
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
    /// The same function of each sum of the last layer; at first the sums themselves.
    Sums(Trunk, Curve),
    /// An action: clip(offset + scale * f(sums), low, high), with f tanh or nothing.
    Action(Trunk, OutputActivation, Output),
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
    /// The function between the layers, as soon as there are two.
    hidden: Option<Activation>,
}

impl Trunk {
    fn outputs(&self) -> usize {
        self.layers.last().map_or(INPUTS, |layer| layer.bias.len())
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Output {
    scale: [f64; 2],
    offset: [f64; 2],
    low: [f64; 2],
    high: [f64; 2],
}

impl Output {
    const PLAIN: Self = Self {
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
            Self::Sums(..) => "the sums of a layer",
            Self::Action(..) => "the action",
        }
    }

    /// Returns the number of values in a row.
    pub(super) fn width(&self) -> usize {
        match self {
            Self::Observation(_) => INPUTS,
            Self::Sums(trunk, _) | Self::Action(trunk, ..) => trunk.outputs(),
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
            Self::Sums(mut trunk, curve)
                if matches!(step, Step::Add | Step::Sub)
                    && curve.output() == Some(OutputActivation::Linear) =>
            {
                let sign = if step == Step::Add { 1.0 } else { -1.0 };
                let layer = trunk.layers.last_mut().map(Rc::make_mut).ok_or("no layer")?;
                let by = by.spread_over(layer.bias.len())?;
                for (bias, c) in layer.bias.iter_mut().zip(by) {
                    *bias = (f64::from(*bias) + sign * c) as f32;
                }
                Ok(Self::Sums(trunk, curve))
            }
            other => match other.into_action() {
                Self::Action(trunk, activation, mut output) => {
                    let by = by.spread::<2>()?;
                    for (i, &c) in by.iter().enumerate() {
                        output.step(i, step, c);
                    }
                    Ok(Self::Action(trunk, activation, output))
                }
                other => {
                    let c = by.uniform()?;
                    other.elementwise("a constant", |x| step.of(x, c))
                }
            },
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
            Self::Observation(input) => Trunk { input, layers: vec![], hidden: None },
            other => {
                let (mut trunk, curve) = other.curve("a layer")?;
                if curve.output() == Some(OutputActivation::Linear) {
                    return Err("two layers without an activation between them".into());
                }
                let activation = curve.activation()?;
                let before = trunk.hidden.replace(activation);
                if let Some(before) = before.filter(|&before| before != activation) {
                    return Err(format!(
                        "{activation} before it, and {before} before the layer before it; an \
                         actor has the same activation between all layers"
                    ));
                }
                trunk
            }
        };
        let expected = trunk.outputs();
        if inputs != expected {
            return Err(format!("a layer of {inputs} inputs where {expected} arrive"));
        }
        if trunk.layers.len() == MAX_LAYERS {
            return Err(format!("more than {MAX_LAYERS} layers, the most that an actor has"));
        }
        debug_assert_eq!((weights.len(), bias.len()), (outputs * inputs, outputs));
        trunk.layers.push(Rc::new(Layer { inputs, weights, bias }));
        Ok(Self::Sums(trunk, Curve::identity()))
    }

    /// Scales and shifts the sums of a layer, unit by unit, as a normalisation with fixed
    /// statistics does; the layer takes both into its weights.
    pub(super) fn normalised(self, scale: &Constant, shift: &Constant) -> Result<Self, String> {
        match self {
            Self::Sums(mut trunk, curve) if curve.output() == Some(OutputActivation::Linear) => {
                let layer = trunk.layers.last_mut().map(Rc::make_mut).ok_or("no layer")?;
                let units = layer.bias.len();
                let (scale, shift) = (scale.spread_over(units)?, shift.spread_over(units)?);
                let rows = layer.weights.chunks_mut(layer.inputs).zip(&mut layer.bias);
                for ((row, bias), (scale, shift)) in rows.zip(scale.iter().zip(shift)) {
                    for w in row {
                        *w = (f64::from(*w) * scale) as f32;
                    }
                    *bias = (f64::from(*bias) * scale + shift) as f32;
                }
                Ok(Self::Sums(trunk, curve))
            }
            other => other.step(Step::Mul, scale)?.step(Step::Add, shift),
        }
    }

    /// Applies a function to each value.
    pub(super) fn elementwise(self, op: &str, f: impl Fn(f64) -> f64) -> Result<Self, String> {
        let (trunk, curve) = self.curve(op)?;
        Ok(Self::Sums(trunk, curve.map(f)))
    }

    /// Combines the values of two signals of the same layer.
    pub(super) fn with(
        self,
        other: Self,
        op: &str,
        f: impl Fn(f64, f64) -> f64,
    ) -> Result<Self, String> {
        let (trunk, curve) = self.curve(op)?;
        let (other_trunk, other_curve) = other.curve(op)?;
        if trunk != other_trunk {
            return Err(format!("{op} of two different layers is not what an actor does"));
        }
        Ok(Self::Sums(trunk, curve.with(&other_curve, f)))
    }

    /// Chooses between two signals of the same layer: `yes` where this is not 0.
    pub(super) fn choose(self, yes: Self, no: Self) -> Result<Self, String> {
        let (trunk, condition) = self.curve("Where")?;
        let ((a, yes), (b, no)) = (yes.curve("Where")?, no.curve("Where")?);
        if trunk != a || trunk != b {
            return Err("of two different layers is not what an actor does".into());
        }
        Ok(Self::Sums(trunk, condition.choose(&yes, &no)))
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
        match self.into_action() {
            Self::Action(trunk, activation, mut output) => {
                let bound = bound.spread::<2>()?;
                for ends in [&mut output.low, &mut output.high] {
                    for (end, b) in ends.iter_mut().zip(bound) {
                        *end = nearer(*end, b);
                    }
                }
                Ok(Self::Action(trunk, activation, output))
            }
            other => {
                let bound = bound.uniform()?;
                other.elementwise("a clip", |x| nearer(x, bound))
            }
        }
    }

    /// Turns what can be an action into one, so that its two values may be scaled apart.
    fn into_action(self) -> Self {
        match self {
            Self::Sums(trunk, curve) if trunk.outputs() == OUTPUTS => match curve.output() {
                Some(activation) => Self::Action(trunk, activation, Output::PLAIN),
                None => Self::Sums(trunk, curve),
            },
            other => other,
        }
    }

    /// Returns the function of the sums. That of an action is one only while both of its values
    /// are treated alike.
    fn curve(self, op: &str) -> Result<(Trunk, Curve), String> {
        match self {
            Self::Observation(_) => Err(self.unfit(op)),
            Self::Sums(trunk, curve) => Ok((trunk, curve)),
            Self::Action(trunk, activation, output) => match output.alike() {
                Some([scale, offset, low, high]) => {
                    let f = |x: f64| match activation {
                        OutputActivation::Tanh => x.tanh(),
                        _ => x,
                    };
                    let value = |x: f64| (offset + scale * f(x)).max(low).min(high);
                    Ok((trunk, Curve::identity().map(value)))
                }
                None => Err(format!("{op} of the action is not what an actor does")),
            },
        }
    }

    /// Returns the actor, if this is an action.
    pub(super) fn imported_actor(self) -> Result<ImportedActor, String> {
        let width = self.width();
        let (Trunk { input, layers, hidden }, activation, output) = match self.into_action() {
            Self::Action(trunk, activation, output) => (trunk, activation, output),
            Self::Sums(..) if width != OUTPUTS => {
                return Err(format!("rows of {width}, expected {OUTPUTS}"));
            }
            Self::Sums(..) => {
                return Err(
                    "it is another function of the last sums than tanh or themselves".into()
                );
            }
            Self::Observation(_) => return Err("it is the observation".into()),
        };
        // A scaling that changes nothing says nothing about the units.
        let observation = (input != Input::PLAIN).then(|| ObservationScaling {
            offset: input.offset.map(|x| x as f32),
            scale: input.scale.map(|x| x as f32),
        });
        let layers = layers.into_iter().map(Rc::unwrap_or_clone).collect();
        let activations = Activations { hidden: hidden.unwrap_or_default(), output: activation };
        let mut actor =
            ImportedActor { layers, activations, observation, ..ImportedActor::default() };
        output.complete(activation, &mut actor);
        Ok(actor)
    }
}

impl Step {
    fn of(self, x: f64, c: f64) -> f64 {
        match self {
            Self::Add => x + c,
            Self::Sub => x - c,
            Self::Mul => x * c,
            Self::Div => x / c,
        }
    }
}

impl Output {
    /// Returns scale, offset, lowest and highest value where both actions have the same.
    fn alike(&self) -> Option<[f64; 4]> {
        let Self { scale, offset, low, high } = self;
        let pairs = [scale, offset, low, high];
        pairs.iter().all(|[a, b]| a == b).then(|| pairs.map(|[a, _]| *a))
    }

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
    fn complete(&self, activation: OutputActivation, actor: &mut ImportedActor) {
        let f32s = |x: [f64; 2]| x.map(|x| x as f32);
        let scaled = self.scale != [1.0; 2] || self.offset != [0.0; 2];
        let (low, high) = (self.low, self.high);
        let is_open = low == Self::PLAIN.low && high == Self::PLAIN.high;
        let is_normalised = match activation {
            OutputActivation::Tanh => {
                low.iter().all(|&x| x <= -1.0) && high.iter().all(|&x| x >= 1.0)
            }
            _ => low == [-1.0; 2] && high == [1.0; 2],
        };
        if !scaled && (is_normalised || is_open) {
            actor.is_normalised = is_normalised;
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
