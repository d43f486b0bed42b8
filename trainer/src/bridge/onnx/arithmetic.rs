//! Operations on one value or two, each computed or constant, and on shapes.

use super::function::Function;
use super::proto::Node;
use super::signal::{Signal, Step};
use super::tensor::{Constant, integers};
use super::walk::{Edge, Walk, attribute};
use std::rc::Rc;

impl<'a> Walk<'a> {
    /// Applies a function to a computed value or a constant.
    pub(super) fn of_one(&self, node: &Node, op: &str, f: Function) -> Result<Edge<'a>, String> {
        match self.edge(node, 0)?.ok_or("its input is missing")? {
            // The only function of an observation that is a scaling.
            Edge::Signal(signal @ Signal::Observation(_)) if op == "Neg" => {
                signal.step(Step::Mul, &Constant::scalar(-1.0)?).map(Edge::Signal)
            }
            Edge::Signal(signal @ Signal::Action(..)) if op == "Neg" => {
                signal.step(Step::Mul, &Constant::scalar(-1.0)?).map(Edge::Signal)
            }
            Edge::Signal(signal) => signal.elementwise(op, f).map(Edge::Signal),
            _ => {
                let constant = self.constant(node, 0)?.ok_or("its input is missing")?;
                Ok(Edge::Constant(Rc::new(constant.map(f)?)))
            }
        }
    }

    /// Applies an operation to two values, each computed or constant.
    pub(super) fn of_two(&self, node: &Node) -> Result<Edge<'a>, String> {
        if node.input.len() != 2 {
            return Err(format!("{} inputs, expected 2", node.input.len()));
        }
        let op = node.op_type.as_str();
        let f: fn(f64, f64) -> f64 = match op {
            "Add" => |a, b| a + b,
            "Sub" => |a, b| a - b,
            "Mul" => |a, b| a * b,
            "Div" => |a, b| a / b,
            "Pow" => f64::powf,
            "Max" => f64::max,
            "Min" => f64::min,
            "Greater" => |a, b| f64::from(a > b),
            "GreaterOrEqual" => |a, b| f64::from(a >= b),
            "LessOrEqual" => |a, b| f64::from(a <= b),
            _ => |a, b| f64::from(a < b),
        };
        let missing = "an input is missing";
        let constant = |index| self.constant(node, index)?.ok_or_else(|| missing.to_owned());
        let signal = match (self.edge(node, 0)?, self.edge(node, 1)?) {
            (Some(Edge::Signal(a)), Some(Edge::Signal(b))) => a.with(b, op, f)?,
            (Some(Edge::Signal(signal)), _) => {
                let by = constant(1)?;
                match op {
                    "Add" => signal.step(Step::Add, by.finite()?)?,
                    "Sub" => signal.step(Step::Sub, by.finite()?)?,
                    "Mul" => signal.step(Step::Mul, by.finite()?)?,
                    "Div" => signal.step(Step::Div, by.finite()?)?,
                    "Max" => signal.at_least(&by)?,
                    "Min" => signal.at_most(&by)?,
                    _ => {
                        let by = by.uniform()?;
                        signal.elementwise(op, |x| f(x, by))?
                    }
                }
            }
            (_, Some(Edge::Signal(signal))) => {
                let by = constant(0)?;
                match op {
                    "Add" => signal.step(Step::Add, by.finite()?)?,
                    "Mul" => signal.step(Step::Mul, by.finite()?)?,
                    // A constant minus x is -x plus the constant.
                    "Sub" => signal
                        .step(Step::Mul, &Constant::scalar(-1.0)?)?
                        .step(Step::Add, by.finite()?)?,
                    "Max" => signal.at_least(&by)?,
                    "Min" => signal.at_most(&by)?,
                    _ => {
                        let by = by.uniform()?;
                        signal.elementwise(op, |x| f(by, x))?
                    }
                }
            }
            _ => {
                let folded = constant(0)?.with(&*constant(1)?, f)?;
                return Ok(Edge::Constant(Rc::new(folded)));
            }
        };
        Ok(Edge::Signal(signal))
    }

    /// Evaluates a choice between two functions of the same sums.
    pub(super) fn choice(&self, node: &Node) -> Result<Signal, String> {
        let computed = |index| match self.edge(node, index)? {
            Some(Edge::Signal(signal)) => Ok(Some(signal)),
            Some(_) => Ok::<_, String>(None),
            None => Err("an input is missing".into()),
        };
        let condition = computed(0)?.ok_or("its condition is a constant")?;
        // A constant is the same for every sum.
        let value = |index| {
            if let Some(signal) = computed(index)? {
                return Ok(signal);
            }
            let x = self.constant(node, index)?.ok_or("an input is missing")?.uniform()?;
            condition.clone().elementwise("Where", |_| x)
        };
        let (yes, no) = (value(1)?, value(2)?);
        condition.choose(yes, no)
    }

    /// Evaluates a normalisation with fixed statistics.
    pub(super) fn batch_normalisation(
        &self,
        node: &Node,
        signal: Signal,
    ) -> Result<Signal, String> {
        let training = attribute(node, "training_mode").and_then(|a| a.i).unwrap_or(0) != 0;
        if training || node.output.iter().skip(1).any(|name| !name.is_empty()) {
            return Err("in training mode; export the actor in evaluation mode".into());
        }
        let number = |index, name: &str| {
            self.constant(node, index)?.ok_or_else(|| format!("its {name} is missing"))
        };
        let (scale, shift) = (number(1, "scale")?, number(2, "shift")?);
        let (mean, variance) = (number(3, "mean")?, number(4, "variance")?);
        let epsilon = attribute(node, "epsilon").and_then(|a| a.f).unwrap_or(1e-5);
        let deviation = variance.map(|v| (v + f64::from(epsilon)).sqrt())?;
        let scale = scale.with(&deviation, |s, d| s / d)?;
        let shift = shift.with(&mean.with(&scale, |m, s| m * s)?, |b, ms| b - ms)?;
        signal.normalised(scale.finite()?, shift.finite()?)
    }

    /// Accepts an Expand to the shape that the rows have already.
    pub(super) fn expand(&self, node: &Node, signal: Signal) -> Result<Signal, String> {
        let width = signal.width();
        let fits = match self.edge(node, 1)? {
            Some(Edge::Shape(of)) => of == Some(width),
            Some(Edge::Stored(tensor)) => match integers(tensor)?[..] {
                [w] | [1, w] => w == 1 || usize::try_from(w).is_ok_and(|w| w == width),
                _ => false,
            },
            _ => false,
        };
        if fits { Ok(signal) } else { Err(format!("to something other than rows of {width}")) }
    }

    /// Returns whether an input is a shape or a part of one.
    pub(super) fn is_of_shapes(&self, node: &Node) -> Result<bool, String> {
        for index in 0..node.input.len() {
            if let Some(Edge::Shape(_)) = self.edge(node, index)? {
                return Ok(true);
            }
        }
        Ok(false)
    }
}
