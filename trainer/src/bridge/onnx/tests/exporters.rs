//! What particular exporters write around the layers.

use super::{NETWORK, X, act, constants, model, read, tanh_of_network, tensor, with_network};
use crate::bridge::imported::{ImportOptions, ImportedActor, Subject};
use crate::bridge::onnx::proto::{
    Attribute, BOOL, Entry, Graph, INT64, Model, Node, OperatorSet, Tensor,
};
use crate::bridge::onnx::{OnnxOptions, import};
use leg_control::actor::Activation;
use prost::Message;

/// Reads a graph after a change of it.
fn changed(nodes: &[&str], change: impl FnOnce(&mut Model)) -> Result<ImportedActor, String> {
    let mut decoded = Model::decode(model(nodes, constants()).as_slice()).unwrap();
    change(&mut decoded);
    let bytes = decoded.encode_to_vec();
    import(&bytes, &OnnxOptions::default()).map_err(|e| e.to_string())
}

fn graph(model: &mut Model) -> &mut Graph {
    model.graph.as_mut().unwrap()
}

/// Returns the node that gives this edge.
fn giver<'m>(model: &'m mut Model, edge: &str) -> &'m mut Node {
    graph(model).node.iter_mut().find(|n| n.output[0] == edge).unwrap()
}

fn floats(name: &str, numbers: &[f32]) -> Attribute {
    Attribute { name: name.into(), floats: numbers.into(), ..Attribute::default() }
}

fn text(name: &str, text: &str) -> Attribute {
    Attribute { name: name.into(), s: Some(text.into()), ..Attribute::default() }
}

fn integers(name: &str, numbers: &[i64], raw: bool) -> Tensor {
    let bytes = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
    Tensor {
        name: name.into(),
        dims: vec![numbers.len().try_into().unwrap()],
        data_type: INT64,
        int64_data: if raw { vec![] } else { numbers.into() },
        raw_data: raw.then_some(bytes),
        ..Tensor::default()
    }
}

#[test]
fn a_scaling_by_one_leaves_the_units_to_the_user() {
    // Tianshou multiplies the tanh by its largest action, 1.
    let plain = read(&with_network(&["Identity obs > x"], &["Identity t > act"])).unwrap();
    for after in ["Mul t one > act", "Div t one > act", "Sub t zero > act"] {
        let zero = tensor("zero", &[1], &[0.0]);
        let nodes = with_network(&["Mul obs one > x"], &[after]);
        let actor = changed(&nodes, |m| graph(m).initializer.push(zero)).unwrap();
        assert_eq!(actor, plain, "{after}");
        assert_eq!(act(actor, X), act(plain.clone(), X));
    }
    let given = ImportOptions { action_scale: Some([1.0; 2]), ..ImportOptions::default() };
    assert_eq!(plain.complete(&given).unwrap().actor.action.scale, [1.0; 2]);
}

#[test]
fn a_clip_on_one_side_leaves_the_other_to_the_user_and_says_so() {
    let before = ["Identity obs > x"];
    let half = with_network(&before, &["Mul t range > u", "Max low u > act"]);
    let actor = read(&half).unwrap();
    assert_eq!((actor.low, actor.high), (Some([0.5, 0.0]), None));
    let complete = actor.clone().complete(&ImportOptions::default()).unwrap();
    let bounds = complete.assumed.iter().find(|a| a.about == Subject::ActionBounds).unwrap();
    assert_eq!(bounds.text, "highest action 2.6180 rad and 2.0000 m/s, the leg's own");
    let given = ImportOptions { action_high: Some([2.0, 1.5]), ..ImportOptions::default() };
    let complete = actor.clone().complete(&given).unwrap();
    assert_eq!(complete.actor.action.high, [2.0, 1.5]);
    assert!(complete.assumed.iter().all(|a| a.about != Subject::ActionBounds));
    let given = ImportOptions { action_low: Some([0.5, 0.0]), ..ImportOptions::default() };
    let error = actor.complete(&given).unwrap_err().to_string();
    assert_eq!(error, "action low: the file states its own");
    // The largest float is no bound.
    let largest = tensor("largest", &[2], &[1.5, f32::MAX]);
    let nodes = with_network(&before, &["Mul t range > u", "Min largest u > act"]);
    let actor = changed(&nodes, |m| graph(m).initializer.push(largest)).unwrap();
    assert_eq!((actor.low, actor.high), (None, Some([1.5, 2.0])));
    assert_eq!(actor.assumed[0].text, "highest action[1] 2.0000 m/s, the leg's own");
}

#[test]
fn refuses_dropout_in_training_mode() {
    let nodes = [
        "Gemm:transB=1 obs w1 b1 > a",
        "Relu a > d",
        "Dropout d > b",
        "Gemm:transB=1 b w2 b2 > c",
        "Tanh c > act",
    ];
    let truth = |value: bool, raw: bool| Tensor {
        name: "training".into(),
        data_type: BOOL,
        raw_data: raw.then(|| vec![value.into()]),
        int32_data: if raw { vec![] } else { vec![value.into()] },
        ..Tensor::default()
    };
    let with = |input: Option<Tensor>, opset: i64, is_test: Option<i64>| {
        changed(&nodes, |m| {
            m.opset_import = vec![OperatorSet { domain: String::new(), version: opset }];
            if let Some(tensor) = input {
                giver(m, "b").input.extend(["half".into(), tensor.name.clone()]);
                graph(m).initializer.push(tensor);
            }
            giver(m, "b").attribute.extend(is_test.map(|i| Attribute {
                name: "is_test".into(),
                i: Some(i),
                ..Attribute::default()
            }));
        })
    };
    for raw in [false, true] {
        assert!(with(Some(truth(false, raw)), 13, None).is_ok());
        let error = with(Some(truth(true, raw)), 13, None).unwrap_err();
        assert!(error.contains("node Dropout \"n_b\": in training mode; export"), "{error}");
    }
    assert!(with(None, 13, None).is_ok() && with(None, 7, None).is_ok());
    // Before operator set 7, training is the default.
    assert!(with(None, 6, Some(1)).is_ok());
    assert!(with(None, 6, None).unwrap_err().contains("training mode"));
    let number = tensor("training", &[], &[0.0]);
    assert!(with(Some(number), 13, None).unwrap_err().contains("training mode"));
}

#[test]
fn a_reshape_that_keeps_the_rows_does_nothing() {
    let at = |edge: &'static str, shape: &[i64], raw: bool, allowzero: i64| {
        let mut nodes: Vec<String> = with_network(&["Identity obs > x"], &["Identity t > act"])
            .iter()
            .map(|n| n.replace(&format!("> {edge}"), &format!("> {edge}0")))
            .collect();
        let position = nodes.iter().position(|n| n.ends_with(&format!("> {edge}0"))).unwrap();
        let reshape = format!("Reshape:allowzero={allowzero} {edge}0 shape > {edge}");
        nodes.insert(position + 1, reshape);
        let nodes: Vec<&str> = nodes.iter().map(String::as_str).collect();
        let shape = integers("shape", shape, raw);
        changed(&nodes, |m| graph(m).initializer.push(shape))
    };
    let plain = read(&with_network(&["Identity obs > x"], &["Identity t > act"])).unwrap();
    for (edge, width) in [("act", 2), ("x", 3), ("b", 2)] {
        for rows in [-1, 0, 1] {
            assert_eq!(at(edge, &[rows, width], rows == 0, 0).unwrap(), plain);
        }
    }
    assert_eq!(at("act", &[0, -1], true, 0).unwrap(), plain);
    for (shape, allowzero) in [
        (&[2, -1][..], 0),
        (&[-1, 3], 0),
        (&[1, 1], 0),
        (&[-1], 0),
        (&[-1, 1, 2], 0),
        (&[0, 2], 1),
        (&[-1, -1], 0),
    ] {
        let error = at("act", shape, false, allowzero).unwrap_err();
        assert!(error.contains("where rows of 2 arrive; an actor keeps them"), "{error}");
    }
    let outside = |m: &mut Model| {
        let shape = graph(m).initializer.last_mut().unwrap();
        shape.external_data = vec![Entry { key: "location".into(), value: "x".into() }];
        shape.data_type = super::FLOAT;
    };
    let nodes = with_network(&["Identity obs > x"], &["Reshape t low > act"]);
    let error = changed(&nodes, outside).unwrap_err();
    assert!(error.contains("tensor \"low\": not a row of integers"), "{error}");
}

#[test]
fn takes_the_scaler_of_scikit_learn() {
    let scaled = [0, 1, 2].map(|i| (X[i] - [0.5, 2.0, 0.0][i]) * [2.0, 4.0, 0.5][i]);
    let nodes = with_network(&["Scaler obs > x"], &["Identity t > act"]);
    let scaler = |offset: &[f32], scale: &[f32]| {
        let attributes = vec![floats("offset", offset), floats("scale", scale)];
        changed(&nodes, |m| {
            let node = giver(m, "x");
            node.domain = "ai.onnx.ml".into();
            node.attribute = attributes;
        })
    };
    let actor = scaler(&[0.5, 2.0, 0.0], &[2.0, 4.0, 0.5]).unwrap();
    let scaling = actor.observation.unwrap();
    assert_eq!((scaling.offset, scaling.scale), ([0.5, 2.0, 0.0], [2.0, 4.0, 0.5]));
    let plain = read(&with_network(&["Identity obs > x"], &["Identity t > act"])).unwrap();
    assert_eq!(act(actor, X), act(plain, scaled));
    assert_eq!(scaler(&[], &[0.5]).unwrap().observation.unwrap().scale, [0.5; 3]);
    let error = scaler(&[1.0, 2.0], &[1.0]).unwrap_err();
    assert!(error.contains("node Scaler \"n_x\": a constant of shape [2]"), "{error}");
    let error = scaler(&[f32::NAN], &[1.0]).unwrap_err();
    assert!(error.contains("offset: value 0 is NaN"), "{error}");
    // The same name without its domain is no operation of ONNX.
    let error = read(&nodes).unwrap_err();
    assert!(error.contains("not an operation that an actor may have"), "{error}");
}

#[test]
fn takes_the_fused_layers_of_onnx_runtime() {
    let fused = |first: &str, last: &str| {
        let nodes = ["FusedGemm:transB=1 obs w1 b1 > b", "FusedGemm:transB=1 b w2 b2 > act"];
        changed(&nodes, |m| {
            for (edge, activation) in [("b", first), ("act", last)] {
                let node = giver(m, edge);
                node.domain = "com.microsoft".into();
                node.attribute.push(text("activation", activation));
            }
        })
    };
    let plain = ["Identity obs > x"].into_iter().chain(NETWORK).chain(["Identity t > act"]);
    let plain = read(&plain.collect::<Vec<_>>()).unwrap();
    assert_eq!(fused("Relu", "Tanh").unwrap(), plain);
    let found = fused("Relu", "Tanh").unwrap();
    let tanh = tanh_of_network(X);
    assert!((act(found, X)[1] - (tanh[1] + 1.0)).abs() < 1e-6);
    let leaky = fused("LeakyRelu", "Tanh").unwrap();
    assert_eq!(leaky.activations.hidden, Activation::LeakyRelu(0.01));
    let error = fused("Softplus", "Tanh").unwrap_err();
    assert!(error.contains("activation \"Softplus\", expected one of Elu, LeakyRelu"), "{error}");
    assert!(fused("Relu", "Relu").unwrap_err().contains("another function of the last sums"));
    let other = changed(&["Gemm obs w1t b1 > act"], |m| giver(m, "act").domain = "my.own".into());
    assert!(other.unwrap_err().contains("of \"my.own\", not an operation"));
}
