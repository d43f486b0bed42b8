//! Activations in all their spellings, and outputs without tanh.

use super::{X, act, constants, model, read, tensor, with_network};
use crate::bridge::imported::{ImportOptions, ImportedActor};
use crate::bridge::onnx::proto::{Attribute, FLOAT16, Model, Tensor};
use crate::bridge::onnx::{OnnxOptions, import};
use leg_control::actor::{Activation, Activations, OutputActivation};
use prost::Message;

/// Numbers that the spellings below use.
fn numbers() -> Vec<Tensor> {
    let scalar = |name: &str, x: f32| tensor(name, &[], &[x]);
    let more = [
        scalar("zero", 0.0),
        scalar("two", 2.0),
        scalar("three", 3.0),
        scalar("six", 6.0),
        scalar("tenth", 0.1),
        scalar("infinity", f32::INFINITY),
        scalar("below", f32::NEG_INFINITY),
        scalar("cube", 0.044_715),
        scalar("slope", 0.797_884_6),
        scalar("root_half", std::f32::consts::FRAC_1_SQRT_2),
    ];
    constants().into_iter().chain(more).collect()
}

/// Reads a network with these nodes from the sums `a` of its first layer to `b`.
fn with_hidden(nodes: &[&str], change: impl FnOnce(&mut Model)) -> Result<ImportedActor, String> {
    let first = ["Gemm:transB=1 obs w1 b1 > a"];
    let last = ["Gemm:transB=1 b w2 b2 > c", "Tanh c > act"];
    let nodes = [&first[..], nodes, &last].concat();
    let mut decoded = Model::decode(model(&nodes, numbers()).as_slice()).unwrap();
    change(&mut decoded);
    import(&decoded.encode_to_vec(), &OnnxOptions::default()).map_err(|e| e.to_string())
}

fn hidden(nodes: &[&str]) -> Result<Activation, String> {
    with_hidden(nodes, |_| ()).map(|actor| actor.activations.hidden)
}

/// Gives the node of the edge `b` an attribute.
fn with_attribute(attribute: Attribute) -> impl FnOnce(&mut Model) {
    move |model| {
        let nodes = &mut model.graph.as_mut().unwrap().node;
        nodes.iter_mut().find(|n| n.output[0] == "b").unwrap().attribute.push(attribute);
    }
}

fn float(name: &str, x: f32) -> Attribute {
    Attribute { name: name.into(), f: Some(x), ..Attribute::default() }
}

#[test]
fn one_activation_is_read_in_all_its_spellings() {
    let spellings: [(Activation, &[&[&str]]); 6] = [
        (
            Activation::Relu,
            &[
                &["Relu a > b"],
                &["Max a zero > b"],
                &["Max zero a > b"],
                &["Clip a zero > b"],
                &["Clip a zero infinity > b"],
                &["Greater a zero > p", "Where p a zero > b"],
                &["Relu a > r", "Relu r > b"],
            ],
        ),
        (
            Activation::LeakyRelu(0.1),
            &[
                &["Mul a tenth > s", "Max a s > b"],
                &["Less a zero > n", "Mul tenth a > s", "Where n s a > b"],
                &["GreaterOrEqual a zero > p", "Mul tenth a > s", "Where p a s > b"],
                &["LessOrEqual a zero > n", "Mul tenth a > s", "Where n s a > b"],
            ],
        ),
        (
            Activation::Elu(1.0),
            &[
                &["Elu a > b"],
                &["Exp a > e", "Sub e one > f", "Greater a zero > p", "Where p a f > b"],
                // As jax2onnx writes it, with zeros in the shape of the sums.
                &[
                    "Greater a zero > p",
                    "Shape a > s",
                    "Gather s half > g",
                    "Concat g g > k",
                    "Expand zero k > z",
                    "Where p z a > n",
                    "Exp n > e",
                    "Sub e one > f",
                    "Where p a f > b",
                ],
                // exp of what is not positive.
                &["Min a zero > n", "Exp n > e", "Sub e one > f", "Max a zero > p", "Add p f > b"],
            ],
        ),
        (
            Activation::Tanh,
            &[
                &["Tanh a > b"],
                &["Mul a two > d", "Sigmoid d > s", "Mul s two > t", "Sub t one > b"],
            ],
        ),
        (
            Activation::Silu,
            &[
                &["Sigmoid a > s", "Mul a s > b"],
                &["Swish a > b"],
                &["Neg a > n", "Exp n > e", "Add one e > d", "Div a d > b"],
                &["Neg a > n", "Exp n > e", "Add e one > d", "Reciprocal d > s", "Mul s a > b"],
            ],
        ),
        (
            Activation::GeluTanh,
            &[
                &[
                    "Pow a three > k",
                    "Mul k cube > l",
                    "Add a l > m",
                    "Mul m slope > n",
                    "Tanh n > t",
                    "Add t one > u",
                    "Mul u half > v",
                    "Mul a v > b",
                ],
                &[
                    "Mul a a > q",
                    "Mul q a > k",
                    "Mul cube k > l",
                    "Add l a > m",
                    "Mul slope m > n",
                    "Tanh n > t",
                    "Add one t > u",
                    "Mul half a > v",
                    "Mul v u > b",
                ],
            ],
        ),
    ];
    for (activation, spellings) in spellings {
        for nodes in spellings {
            assert_eq!(hidden(nodes), Ok(activation), "{nodes:?}");
        }
    }
}

#[test]
fn parameters_are_read_from_attributes_and_from_the_arithmetic() {
    let read = |op: &str, attribute| {
        let nodes = [&*format!("{op} a > b")];
        with_hidden(&nodes, with_attribute(attribute)).map(|actor| actor.activations.hidden)
    };
    assert_eq!(read("LeakyRelu", float("alpha", 0.2)), Ok(Activation::LeakyRelu(0.2)));
    assert_eq!(hidden(&["LeakyRelu a > b"]), Ok(Activation::LeakyRelu(0.01)));
    assert_eq!(read("Elu", float("alpha", 0.5)), Ok(Activation::Elu(0.5)));
    let tanh =
        Attribute { name: "approximate".into(), s: Some("tanh".into()), ..Attribute::default() };
    assert_eq!(read("Gelu", tanh), Ok(Activation::GeluTanh));
    let halves =
        ["Exp a > e", "Sub e one > f", "Mul f half > g", "Greater a zero > p", "Where p a g > b"];
    assert_eq!(hidden(&halves), Ok(Activation::Elu(0.5)));
}

#[test]
fn another_function_is_refused_with_the_nearest_activation() {
    for (nodes, expected) in [
        (&["Sigmoid a > b"][..], "none of an actor's activations; the nearest is"),
        (&["Clip a zero six > b"], "none of an actor's activations; the nearest is"),
        (&["Gelu a > b"], "approximate=\"tanh\""),
        (
            &["Mul a root_half > d", "Erf d > e", "Add e one > f", "Mul a f > g", "Mul g half > b"],
            "approximate=\"tanh\"",
        ),
        (&["Mul a two > b"], "none of an actor's activations"),
        (&["Tanh a > t", "Mul t range > s", "Add s b1 > b"], "a layer of the action is not"),
        (&["Identity a > b"], "two layers without an activation between them"),
    ] {
        let error = hidden(nodes).unwrap_err();
        assert!(error.starts_with("output \"act\": node Gemm \"n_c\": "), "{nodes:?}: {error}");
        assert!(error.contains(expected), "{nodes:?}: {error}");
    }
    let mixed = [
        "Gemm:transB=1 obs w1 b1 > a",
        "Relu a > b",
        "Gemm:transB=1 b w2 b2 > c",
        "Elu c > d",
        "Gemm:transB=1 d w2 b2 > e",
        "Tanh e > act",
    ];
    let error = read(&mixed).unwrap_err();
    assert!(error.contains("elu(1) before it, and relu before the layer before it"), "{error}");
}

#[test]
fn an_output_without_tanh_is_the_action_in_its_units() {
    let linear = Activations { output: OutputActivation::Linear, ..Activations::default() };
    let network = ["Gemm:transB=1 obs w1 b1 > a", "Relu a > b", "Gemm:transB=1 b w2 b2 > t"];
    let with = |after: &[&str]| {
        let bytes = model(&[&network[..], after].concat(), numbers());
        import(&bytes, &OnnxOptions::default()).map_err(|e| e.to_string())
    };
    let plain = with(&["Identity t > act"]).unwrap();
    assert_eq!((plain.activations, plain.is_normalised), (linear, false));
    let complete = plain.complete(&ImportOptions::default()).unwrap();
    assert_eq!(complete.actor.action.scale, [1.0; 2]);
    assert!(complete.assumed.iter().any(|a| a.text == "outputs in rad and m/s"));
    // Clipped to a Box from -1 to 1: spread over the actions.
    let boxed = with(&["Clip t minus one > act"]).unwrap();
    assert!(boxed.is_normalised && boxed.action.is_none());
    let complete = boxed.complete(&ImportOptions::default()).unwrap();
    assert_eq!(complete.actor.action.scale[1], 1.0);
    let clipped = with(&["Max t low > u", "Min u high > act"]).unwrap();
    assert_eq!((clipped.low, clipped.high), (Some([0.5, 0.0]), Some([2.5, 2.0])));
    let scaled = with(&["Mul t half > u", "Add u one > act"]).unwrap();
    assert_eq!(scaled.action, Some([[0.5; 2], [1.0; 2]]));
    let sums = [0.125 + 0.75 + 0.25 + 0.031_25, -0.5 - 0.75 + 1.0 + 0.375_f32].map(|x| x.max(0.0));
    let z = -0.5 + 0.125 * sums[0] + sums[1];
    assert!((act(scaled, X)[1] - (0.5 * z + 1.0)).abs() < 1e-6);
}

#[test]
fn normalisations_of_fixed_statistics_are_taken_into_the_actor() {
    let mut constants = numbers();
    constants.push(tensor("gain", &[3], &[2.0, 1.0, 0.5]));
    constants.push(tensor("shift", &[3], &[0.25, 0.0, -1.0]));
    constants.push(tensor("middle", &[3], &[0.5, 2.0, 0.0]));
    constants.push(tensor("variance", &[3], &[4.0, 1.0, 0.25]));
    constants.push(tensor("epsilon", &[], &[1e-5]));
    let read = |nodes: &[&str]| {
        import(&model(nodes, constants.clone()), &OnnxOptions::default()).map_err(|e| e.to_string())
    };
    let deviation = [4.0_f32, 1.0, 0.25].map(|v| (v + 1e-5).sqrt());
    let normalised = [0, 1, 2].map(|i| (X[i] - [0.5, 2.0, 0.0][i]) / deviation[i]);
    let plain = read(&with_network(&["Identity obs > x"], &["Identity t > act"])).unwrap();
    let near = |actor: ImportedActor, x: [f32; 3]| {
        let (found, expected) = (act(actor, X), act(plain.clone(), x));
        assert!((0..2).all(|i| (found[i] - expected[i]).abs() < 2e-6), "{found:?} {expected:?}");
    };
    // As VecNormalize computes it: by constants of the graph.
    let by_hand = ["Add variance epsilon > v", "Sqrt v > d", "Sub obs middle > s", "Div s d > x"];
    near(read(&with_network(&by_hand, &["Identity t > act"])).unwrap(), normalised);
    let batch = ["BatchNormalization obs gain shift middle variance > x"];
    let shifted = [0, 1, 2].map(|i| normalised[i] * [2.0, 1.0, 0.5][i] + [0.25, 0.0, -1.0][i]);
    near(read(&with_network(&batch, &["Identity t > act"])).unwrap(), shifted);
    let training = ["BatchNormalization:training_mode=1 obs gain shift middle variance > x"];
    let error = read(&with_network(&training, &["Identity t > act"])).unwrap_err();
    assert!(error.contains("in training mode"), "{error}");
}

#[test]
fn the_factors_of_a_gemm_are_taken_into_its_weights() {
    let read = |alpha: f32, beta: f32| {
        let nodes = with_network(&["Identity obs > x"], &["Identity t > act"]);
        let mut decoded = Model::decode(model(&nodes, numbers()).as_slice()).unwrap();
        let nodes = &mut decoded.graph.as_mut().unwrap().node;
        let gemm = nodes.iter_mut().find(|n| n.output[0] == "a").unwrap();
        gemm.attribute.extend([float("alpha", alpha), float("beta", beta)]);
        import(&decoded.encode_to_vec(), &OnnxOptions::default()).map_err(|e| e.to_string())
    };
    let layer = &read(2.0, 0.5).unwrap().layers[0];
    assert_eq!(layer.weights, [2.0, 1.0, 0.5, -2.0, 4.0, 6.0]);
    assert_eq!(layer.bias, [0.0625, -0.25]);
    // jax2onnx adds the bias by a node of its own.
    assert_eq!(read(1.0, 0.0).unwrap().layers[0].bias, [0.0; 2]);
    assert!(read(f32::INFINITY, 1.0).unwrap_err().contains("alpha inf, expected a finite number"));
}

#[test]
fn weights_of_half_precision_and_two_rows_below_each_other_are_read() {
    let half = Tensor {
        data_type: FLOAT16,
        float_data: vec![],
        raw_data: Some(
            [0x3c00_u16, 0x3800, 0x3400, 0xbc00, 0x4000, 0x4200]
                .iter()
                .flat_map(|bits| bits.to_le_bytes())
                .collect(),
        ),
        ..tensor("w1", &[2, 3], &[])
    };
    let mut constants = constants();
    constants[0] = half;
    let nodes = with_network(&["Identity obs > x"], &["Identity t > act"]);
    let read = import(&model(&nodes, constants), &OnnxOptions::default()).unwrap();
    assert_eq!(read.layers[0].weights, [1.0, 0.5, 0.25, -1.0, 2.0, 3.0]);
}

#[test]
fn an_expand_to_its_own_shape_does_nothing() {
    // As SAC of SB3 spreads the mean of its Gaussian over its own shape.
    let after = ["Shape t > s", "Expand t s > act"];
    let plain = read(&with_network(&["Identity obs > x"], &["Identity t > act"])).unwrap();
    assert_eq!(read(&with_network(&["Identity obs > x"], &after)).unwrap(), plain);
    // As torch writes it: PPO's deviation is a parameter, SAC's another layer of the network.
    let spread = ["Shape sum > s1", "Expand t s1 > act"];
    let ppo = [
        ["Shape t > s", "ConstantOfShape s > zeros", "Add zeros t > m", "Add m range > sum"]
            .as_slice(),
        &spread,
    ]
    .concat();
    let sac = [
        ["MatMul b w2t > log", "Exp log > d", "Mul range d > e"].as_slice(),
        &["Shape t > s", "ConstantOfShape s > zeros", "Add zeros t > m", "Add m e > sum"],
        &spread,
    ]
    .concat();
    for after in [ppo, sac] {
        assert_eq!(read(&with_network(&["Identity obs > x"], &after)).unwrap(), plain);
    }
    let other = ["Shape x > s", "Expand t s > act"];
    let error = read(&with_network(&["Identity obs > x"], &other)).unwrap_err();
    assert!(error.contains("to something other than rows of 2"), "{error}");
}
