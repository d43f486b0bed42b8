//! From a policy to an ONNX graph.

use super::proto::{
    ATTRIBUTE_FLOAT, ATTRIBUTE_INT, Attribute, Dimension, Entry, FLOAT, Graph, Model, Node,
    OperatorSet, Shape, Tensor, TensorType, Type, ValueInfo,
};
use crate::bridge::model_card::{KEY, ModelCard};
use crate::policy::PackedActor;
use leg_control::actor::{Activation, GELU_CUBE, GELU_SLOPE, INPUTS, OUTPUTS, OutputActivation};
use leg_control::policy::Policy;
use prost::Message;

/// Operator set of January 2021: every runtime in use has it, and it is the first in which all
/// operations used here have their present form.
const OPSET: i64 = 13;
/// Version of the file format that belongs to the operator set.
const IR_VERSION: i64 = 7;

/// Writes a policy as an ONNX file: a graph from `observation`, f32 (batch, 3), to `action`,
/// f32 (batch, 2). The same policy gives the same bytes.
///
/// The nodes are Sub, Mul, then Gemm and the activation alternating, Tanh where the actor has it,
/// Mul, Add, and Max and Min for the clip, whose bounds differ between the actions. `SiLU` and GELU
/// are written by simpler operations, which this operator set has. Only NaN is treated differently: here it
/// stays NaN, where the controller takes the lowest action.
#[must_use]
pub fn export(policy: &Policy<'_>) -> Vec<u8> {
    let packed = PackedActor::from(policy);
    let card = ModelCard::from(policy);
    let mut chain = Chain { at: "observation".into(), nodes: vec![], initializers: vec![] };
    let o = &packed.observation;
    chain.with("Sub", "observation_offset", &o.offset);
    chain.with("Mul", "observation_scale", &o.scale);
    let layers = packed.layers();
    for (i, layer) in layers.iter().enumerate() {
        let weight = chain.constant(
            &format!("{}.weight", 2 * i),
            &[layer.bias.len(), layer.inputs],
            &layer.weights,
        );
        let bias = chain.constant(&format!("{}.bias", 2 * i), &[layer.bias.len()], &layer.bias);
        chain.node("Gemm", &[weight, bias]);
        let transposed = Attribute {
            name: "transB".into(),
            i: Some(1),
            kind: ATTRIBUTE_INT,
            ..Default::default()
        };
        chain.nodes.last_mut().expect("just pushed").attribute.push(transposed);
        if i + 1 < layers.len() {
            chain.activation(packed.activations.hidden);
        } else if packed.activations.output == OutputActivation::Tanh {
            chain.node("Tanh", &[]);
        }
    }
    let a = &packed.action;
    chain.with("Mul", "action_scale", &a.scale);
    chain.with("Add", "action_offset", &a.offset);
    chain.with("Max", "action_low", &a.low);
    chain.with("Min", "action_high", &a.high);
    let Chain { mut nodes, initializers, .. } = chain;
    if let Some(last) = nodes.last_mut() {
        last.output = vec!["action".into()];
    }
    let graph = Graph {
        node: nodes,
        name: "actor".into(),
        initializer: initializers,
        input: vec![batch_of("observation", INPUTS)],
        output: vec![batch_of("action", OUTPUTS)],
    };
    Model {
        ir_version: IR_VERSION,
        producer_name: "trainer".into(),
        producer_version: env!("CARGO_PKG_VERSION").into(),
        doc_string: "A leg's actor. observation: apex vx m/s, apex y m, density ratio. \
                     action: touchdown angle rad, elongation speed m/s."
            .into(),
        graph: Some(graph),
        opset_import: vec![OperatorSet { domain: String::new(), version: OPSET }],
        metadata_props: vec![Entry { key: KEY.into(), value: card.to_json() }],
    }
    .encode_to_vec()
}

/// A chain of nodes.
struct Chain {
    /// Output of the last node.
    at: String,
    nodes: Vec<Node>,
    initializers: Vec<Tensor>,
}

impl Chain {
    fn node(&mut self, op: &str, constants: &[String]) {
        let name = format!("{}_{}", op.to_lowercase(), self.nodes.len());
        let input = std::iter::once(&self.at).chain(constants).cloned().collect();
        self.nodes.push(Node {
            input,
            output: vec![name.clone()],
            name: name.clone(),
            op_type: op.into(),
            ..Default::default()
        });
        self.at = name;
    }

    /// Appends an activation between layers.
    fn activation(&mut self, activation: Activation) {
        let alpha = |alpha: f32| Attribute {
            name: "alpha".into(),
            f: Some(alpha),
            kind: ATTRIBUTE_FLOAT,
            ..Default::default()
        };
        match activation {
            Activation::Tanh => self.node("Tanh", &[]),
            Activation::LeakyRelu(slope) => self.node_with("LeakyRelu", alpha(slope)),
            Activation::Elu(scale) => self.node_with("Elu", alpha(scale)),
            Activation::Silu => {
                let sums = self.at.clone();
                self.node("Sigmoid", &[]);
                self.node("Mul", &[sums]);
            }
            Activation::GeluTanh => {
                // x (1/2 + 1/2 tanh(slope (x + cube x^3)))
                let sums = [self.at.clone()];
                self.node("Mul", &sums);
                self.node("Mul", &sums);
                self.by("Mul", "gelu_cube", GELU_CUBE);
                self.node("Add", &sums);
                self.by("Mul", "gelu_slope", GELU_SLOPE);
                self.node("Tanh", &[]);
                self.by("Mul", "gelu_half", 0.5);
                self.by("Add", "gelu_half", 0.5);
                self.node("Mul", &sums);
            }
            _ => self.node("Relu", &[]),
        }
    }

    fn node_with(&mut self, op: &str, attribute: Attribute) {
        self.node(op, &[]);
        if let Some(node) = self.nodes.last_mut() {
            node.attribute.push(attribute);
        }
    }

    /// Applies an operation with one number, which is stored once.
    fn by(&mut self, op: &str, name: &str, number: f32) {
        if !self.initializers.iter().any(|tensor| tensor.name == name) {
            self.constant(name, &[1], &[number]);
        }
        self.node(op, &[name.to_owned()]);
    }

    fn with(&mut self, op: &str, name: &str, numbers: &[f32]) {
        let constant = self.constant(name, &[numbers.len()], numbers);
        self.node(op, &[constant]);
    }

    fn constant(&mut self, name: &str, dims: &[usize], numbers: &[f32]) -> String {
        self.initializers.push(Tensor {
            dims: dims.iter().map(|&n| dimension(n)).collect(),
            data_type: FLOAT,
            name: name.into(),
            raw_data: Some(numbers.iter().flat_map(|x| x.to_le_bytes()).collect()),
            ..Default::default()
        });
        name.into()
    }
}

/// Returns the type of any number of rows of this width.
fn batch_of(name: &str, width: usize) -> ValueInfo {
    let batch = Dimension { dim_value: None, dim_param: Some("batch".into()) };
    let width = Dimension { dim_value: Some(dimension(width)), dim_param: None };
    let shape = Some(Shape { dim: vec![batch, width] });
    let tensor_type = Some(TensorType { elem_type: FLOAT, shape });
    ValueInfo { name: name.into(), kind: Some(Type { tensor_type }) }
}

/// Converts a dimension; those of an actor are at most 128.
fn dimension(n: usize) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}
