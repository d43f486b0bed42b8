//! The values of a graph's edges.
//!
//! The nodes are evaluated in their order, which ONNX requires to be a topological one. Each
//! edge is a constant, a [`Signal`] between observation and action, or an unsupported value. Of
//! the last only the reason is stored: it matters only where an output depends on it.

use super::function::{FUSED, elu, function, fused_alpha, leaky_relu};
use super::proto::{Attribute, DOUBLE, FLOAT, Graph, Node, Tensor};
use super::read::label;
use super::signal::{Input, Signal, Step};
use super::tensor::{Constant, flag, integers};
use crate::bridge::ImportError;
use crate::bridge::activation::{ELU_SCALE, LEAKY_RELU_SLOPE};
use leg_control::actor::OUTPUTS;
use std::collections::HashMap;
use std::path::PathBuf;
use std::rc::Rc;

/// The supported operations, for messages.
const KNOWN: &str = "Add, BatchNormalization, Cast, Clip, Constant, ConstantOfShape, Div, \
                     Dropout, Elu, Erf, Exp, Expand, Flatten, Gelu, Gemm, Greater, GreaterOrEqual, Identity, LeakyRelu, \
                     Less, LessOrEqual, MatMul, Max, Min, Mul, Neg, Pow, Reciprocal, Relu, \
                     Reshape, Sigmoid, Sqrt, Sub, Swish, Tanh, Transpose, Where, Scaler of \
                     ai.onnx.ml, FusedGemm of com.microsoft";
/// First operator set in which Dropout has no attribute `is_test`.
const DROPOUT_WITHOUT_TEST: i64 = 7;

/// The value of an edge.
#[derive(Clone, Debug)]
pub(super) enum Edge<'a> {
    /// A constant in the file that is not read yet.
    Stored(&'a Tensor),
    Constant(Rc<Constant>),
    Signal(Signal),
    /// The shape of rows of this width, or a part of a shape.
    Shape(Option<usize>),
    /// An unsupported value: the reason, and the width of its rows where it is known.
    Other(Rc<str>, Option<usize>),
}

/// The evaluation of a graph.
pub(super) struct Walk<'a> {
    folders: &'a [PathBuf],
    opset: i64,
    edges: HashMap<&'a str, Edge<'a>>,
}

impl<'a> Walk<'a> {
    pub(super) fn new(folders: &'a [PathBuf], opset: i64) -> Self {
        Self { folders, opset, edges: HashMap::new() }
    }

    /// Evaluates every node, and returns all edges by their names.
    pub(super) fn through(
        mut self,
        graph: &'a Graph,
    ) -> Result<HashMap<&'a str, Edge<'a>>, ImportError> {
        for tensor in &graph.initializer {
            self.define(&tensor.name, Edge::Stored(tensor))?;
        }
        // Old files list their initializers among the inputs.
        let inputs: Vec<&str> = graph.input.iter().map(|i| i.name.as_str()).collect();
        let free: Vec<&str> =
            inputs.into_iter().filter(|name| !self.edges.contains_key(name)).collect();
        let [observation] = free[..] else {
            let found = format!("{} inputs", free.len());
            return Err(ImportError::value("graph", found, "one, the observation"));
        };
        self.edges.insert(observation, Edge::Signal(Signal::Observation(Input::PLAIN)));
        for node in &graph.node {
            let edge = self.run(node).unwrap_or_else(|why| Edge::Other(why, self.width(node)));
            for (i, output) in node.output.iter().enumerate() {
                let edge = if i == 0 {
                    edge.clone()
                } else {
                    let why = format!("{}: its output {i} is not an actor's", label(node));
                    Edge::Other(why.into(), None)
                };
                self.define(output, edge)?;
            }
        }
        Ok(self.edges)
    }

    /// Gives an edge its value; an output that a node leaves out has no name.
    fn define(&mut self, name: &'a str, edge: Edge<'a>) -> Result<(), ImportError> {
        if self.edges.insert(name, edge).is_some() && !name.is_empty() {
            return Err(ImportError::Graph(format!("{name:?} is given twice")));
        }
        Ok(())
    }

    /// Evaluates a node and returns its first output.
    fn run(&self, node: &'a Node) -> Result<Edge<'a>, Rc<str>> {
        // An unsupported input passes its reason on; only its shape may be needed.
        let arrives = |name: &String| match self.edges.get(name.as_str()) {
            Some(Edge::Other(_, Some(_))) if node.op_type == "Shape" => None,
            Some(Edge::Other(why, _)) => Some(why.clone()),
            _ => None,
        };
        if let Some(why) = node.input.iter().find_map(arrives) {
            return Err(why);
        }
        self.operation(node).map_err(|why| format!("{}: {why}", label(node)).into())
    }

    fn operation(&self, node: &'a Node) -> Result<Edge<'a>, String> {
        let first = || self.edge(node, 0)?.ok_or_else(|| "its first input is missing".to_owned());
        let signal = || match first()? {
            Edge::Signal(signal) => Ok(signal),
            _ => Err("its first input is a constant, expected the observation's way".to_owned()),
        };
        match (node.domain.as_str(), node.op_type.as_str()) {
            ("" | "ai.onnx", _) => {}
            ("ai.onnx.ml", "Scaler") => return scaler(node, signal()?).map(Edge::Signal),
            ("com.microsoft", "FusedGemm") => {
                return self.fused_gemm(node, signal()?).map(Edge::Signal);
            }
            (domain, _) => {
                let message = "not an operation that an actor may have; these are";
                return Err(format!("of {domain:?}, {message} {KNOWN}"));
            }
        }
        let result = match node.op_type.as_str() {
            "Identity" => return first(),
            "Dropout" => {
                self.check_dropout(node)?;
                return first();
            }
            "Reshape" => self.reshape(node, signal()?),
            "Cast" => {
                return match attribute(node, "to")
                    .and_then(|a| a.i)
                    .and_then(|i| i32::try_from(i).ok())
                {
                    Some(FLOAT | DOUBLE) => first(),
                    _ => Err("to something other than float or double".into()),
                };
            }
            "Constant" => return constant(node),
            "Transpose" => {
                let axes = attribute(node, "perm").map_or(&[][..], |a| &a.ints);
                let matrix = self.constant(node, 0)?.ok_or("its input is missing")?;
                if !matches!(axes, [] | [1, 0]) {
                    return Err(format!("perm {axes:?}, expected [1, 0]"));
                }
                return Ok(Edge::Constant(Rc::new(matrix.transposed()?)));
            }
            "Flatten" => match attribute(node, "axis").and_then(|a| a.i) {
                None | Some(1) => signal(),
                Some(axis) => Err(format!("axis {axis}, expected 1")),
            },
            "Gemm" => self.gemm(node, signal()?),
            "MatMul" => {
                let weights = self.constant(node, 1)?.ok_or("its second input is missing")?;
                let weights = weights.transposed()?;
                let shape = weights.matrix()?;
                signal()?.dense(shape, weights.finite()?.f32s(), vec![0.0; shape[0]])
            }
            "BatchNormalization" => self.batch_normalisation(node, signal()?),
            "Shape" => {
                let width = match first()? {
                    Edge::Other(_, Some(width)) => width,
                    _ => signal()?.width(),
                };
                return Ok(Edge::Shape(Some(width)));
            }
            "ConstantOfShape" => return self.constant_of_shape(node),
            "Gather" | "Concat" | "Slice" | "Squeeze" | "Unsqueeze"
                if self.is_of_shapes(node)? =>
            {
                return Ok(Edge::Shape(None));
            }
            "Expand" => {
                if let Edge::Signal(signal) = first()? {
                    return self.expand(node, signal).map(Edge::Signal);
                }
                // A number in as many places as there are sums.
                let constant = self.constant(node, 0)?.ok_or("its input is missing")?;
                constant.uniform()?;
                return Ok(Edge::Constant(constant));
            }
            "Clip" => self.clip(node, signal()?),
            "Where" => self.choice(node),
            "Add" | "Sub" | "Mul" | "Div" | "Pow" | "Max" | "Min" | "Greater"
            | "GreaterOrEqual" | "Less" | "LessOrEqual" => {
                return self.of_two(node);
            }
            op => match function(op, node) {
                Some(f) => return self.of_one(node, op, f?),
                None => Err(format!("not an operation that an actor may have; these are {KNOWN}")),
            },
        };
        result.map(Edge::Signal)
    }

    /// Returns the width of the rows that a node computes number by number, where that of every
    /// input is known.
    ///
    /// A Gaussian policy spreads its mean over the shape of mean and deviation, so that shape
    /// matters where the deviation does not.
    fn width(&self, node: &Node) -> Option<usize> {
        const BY_NUMBER: [&str; 8] = ["Add", "Sub", "Mul", "Div", "Pow", "Exp", "Clip", "Neg"];
        if !node.domain.is_empty() || !BY_NUMBER.contains(&node.op_type.as_str()) {
            return None;
        }
        let widths = node.input.iter().filter(|name| !name.is_empty()).map(|name| {
            match self.edges.get(name.as_str())? {
                Edge::Signal(signal) => Some(signal.width()),
                Edge::Constant(constant) => Some(constant.dims.last().copied().unwrap_or(1)),
                Edge::Stored(tensor) => tensor.dims.last().map_or(Some(1), |&n| n.try_into().ok()),
                Edge::Other(_, width) => *width,
                Edge::Shape(_) => None,
            }
        });
        widths.collect::<Option<Vec<usize>>>()?.into_iter().max()
    }

    /// Evaluates a row of one number in the shape of another row.
    fn constant_of_shape(&self, node: &'a Node) -> Result<Edge<'a>, String> {
        let Some(Edge::Shape(Some(width))) = self.edge(node, 0)? else {
            return Err("of a shape that is not that of rows".into());
        };
        let number = match attribute(node, "value").and_then(|a| a.t.as_ref()) {
            Some(tensor) => Constant::read(tensor, self.folders)?.uniform()? as f32,
            None => 0.0,
        };
        Ok(Edge::Constant(Rc::new(Constant::row(&vec![number; width])?)))
    }

    /// Returns an input; `None` where it is left out.
    pub(super) fn edge(&self, node: &Node, index: usize) -> Result<Option<Edge<'a>>, String> {
        match node.input.get(index).map(String::as_str) {
            None | Some("") => Ok(None),
            Some(name) => match self.edges.get(name) {
                Some(edge) => Ok(Some(edge.clone())),
                None => Err(format!("its input {name:?} is given by no node before it")),
            },
        }
    }

    /// Returns an input that must be a constant; `None` where it is left out.
    pub(super) fn constant(
        &self,
        node: &Node,
        index: usize,
    ) -> Result<Option<Rc<Constant>>, String> {
        match self.edge(node, index)? {
            None => Ok(None),
            Some(Edge::Constant(constant)) => Ok(Some(constant)),
            Some(Edge::Stored(tensor)) => Constant::read(tensor, self.folders)
                .map(|c| Some(Rc::new(c)))
                .map_err(|why| format!("tensor {:?}: {why}", tensor.name)),
            Some(_) => Err(format!("its input {index} is computed, expected a constant")),
        }
    }

    fn gemm(&self, node: &Node, signal: Signal) -> Result<Signal, String> {
        let factor = |name: &str| match attribute(node, name).and_then(|a| a.f) {
            Some(x) if !x.is_finite() => Err(format!("{name} {x}, expected a finite number")),
            other => Ok(f64::from(other.unwrap_or(1.0))),
        };
        let (alpha, beta) = (factor("alpha")?, factor("beta")?);
        let flag = |name: &str| attribute(node, name).and_then(|a| a.i).unwrap_or(0) != 0;
        if flag("transA") {
            return Err("transA, expected the observation by rows".into());
        }
        let mut weights = self.constant(node, 1)?.ok_or("its second input is missing")?;
        if !flag("transB") {
            weights = Rc::new(weights.transposed()?);
        }
        let [outputs, inputs] = weights.matrix()?;
        let bias = match self.constant(node, 2)? {
            // A factor of 0 leaves the bias out, as jax2onnx writes a product without one.
            Some(bias) if beta != 0.0 => bias.finite()?.spread_over(outputs)?,
            _ => vec![0.0; outputs],
        };
        let bias = bias.into_iter().map(|x| (beta * x) as f32).collect();
        let weights = weights.finite()?.map(|w| alpha * w)?;
        signal.dense([outputs, inputs], weights.f32s(), bias)
    }

    /// Evaluates a Gemm with an activation behind it, as ONNX Runtime writes it when it
    /// optimises a graph.
    fn fused_gemm(&self, node: &Node, signal: Signal) -> Result<Signal, String> {
        let sums = self.gemm(node, signal)?;
        match attribute(node, "activation").and_then(|a| a.s.as_deref()) {
            Some(name) => {
                let op = String::from_utf8_lossy(name);
                let unknown =
                    || format!("activation \"{}\", expected one of {FUSED}", op.escape_debug());
                let f = match &*op {
                    "Relu" | "Tanh" | "Sigmoid" => function(&op, node).ok_or_else(unknown)??,
                    "LeakyRelu" => leaky_relu(fused_alpha(node).unwrap_or(LEAKY_RELU_SLOPE)),
                    "Elu" => elu(fused_alpha(node).unwrap_or(ELU_SCALE)),
                    _ => return Err(unknown()),
                };
                sums.elementwise(&op, f)
            }
            None => Err(format!("no activation, expected one of {FUSED}")),
        }
    }

    /// Accepts a reshape that keeps the rows as they are.
    fn reshape(&self, node: &Node, signal: Signal) -> Result<Signal, String> {
        let shape = match self.edge(node, 1)? {
            Some(Edge::Stored(tensor)) => integers(tensor)?,
            _ => return Err("its shape is not a constant in the file".into()),
        };
        let width = i64::try_from(signal.width()).unwrap_or(i64::MAX);
        let zero_is_zero = attribute(node, "allowzero").and_then(|a| a.i).unwrap_or(0) != 0;
        match shape[..] {
            // One row, any number of rows, or as many as there are.
            [1 | -1, w] if w == width => Ok(signal),
            [0, w] if !zero_is_zero && (w == width || w == -1) => Ok(signal),
            [1, -1] => Ok(signal),
            // The two actions of a row one below the other, as skl2onnx ends a network.
            [-1, 1] if signal.width() == OUTPUTS => Ok(signal),
            _ => Err(format!("to {shape:?}, where rows of {width} arrive; an actor keeps them")),
        }
    }

    /// Refuses a Dropout in training mode, which zeroes values at random.
    fn check_dropout(&self, node: &Node) -> Result<(), String> {
        let training = match self.edge(node, 2)? {
            None if self.opset < DROPOUT_WITHOUT_TEST => {
                attribute(node, "is_test").and_then(|a| a.i).unwrap_or(0) == 0
            }
            None => false,
            Some(Edge::Stored(tensor)) => flag(tensor) != Some(false),
            Some(_) => true,
        };
        if training {
            return Err("in training mode; export the actor in evaluation mode".into());
        }
        Ok(())
    }

    fn clip(&self, node: &Node, mut signal: Signal) -> Result<Signal, String> {
        // An infinite bound bounds nothing. The bounds are attributes before opset 11, and inputs since.
        let bound = |name: &str, index| match attribute(node, name).and_then(|a| a.f) {
            Some(x) => Constant::scalar(x).map(|c| Some(Rc::new(c))),
            None => self.constant(node, index),
        };
        if let Some(low) = bound("min", 1)? {
            signal = signal.at_least(&low)?;
        }
        if let Some(high) = bound("max", 2)? {
            signal = signal.at_most(&high)?;
        }
        Ok(signal)
    }
}

/// Returns the value of a Constant node.
fn constant(node: &Node) -> Result<Edge<'_>, String> {
    if let Some(tensor) = attribute(node, "value").and_then(|a| a.t.as_ref()) {
        return Ok(Edge::Stored(tensor));
    }
    match attribute(node, "value_float").and_then(|a| a.f) {
        Some(x) => Ok(Edge::Constant(Rc::new(Constant::scalar(x)?))),
        None => Err("neither a tensor nor a number".into()),
    }
}

/// Evaluates (x - offset) * scale.
fn scaler(node: &Node, signal: Signal) -> Result<Signal, String> {
    let numbers = |name: &str| {
        let numbers = attribute(node, name).map_or(&[][..], |a| &a.floats);
        let constant = || Constant::row(numbers).map_err(|why| format!("{name}: {why}"));
        if numbers.is_empty() { Ok(None) } else { constant().map(Some) }
    };
    let shifted = match numbers("offset")? {
        Some(offset) => signal.step(Step::Sub, &offset)?,
        None => signal,
    };
    match numbers("scale")? {
        Some(scale) => shifted.step(Step::Mul, &scale),
        None => Ok(shifted),
    }
}

pub(super) fn attribute<'n>(node: &'n Node, name: &str) -> Option<&'n Attribute> {
    node.attribute.iter().find(|a| a.name == name)
}
