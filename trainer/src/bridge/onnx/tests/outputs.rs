//! Graphs with several outputs.

use super::{constants, model};
use crate::bridge::imported::{ImportedActor, Subject};
use crate::bridge::onnx::proto::{Model, ValueInfo};
use crate::bridge::onnx::{OnnxOptions, import};
use prost::Message;

const NODES: [&str; 6] = [
    "Gemm:transB=1 obs w1 b1 > a",
    "Relu a > b",
    "Gemm:transB=1 b w2 b2 > c",
    "Tanh c > act",
    "Mul act range > wide",
    "Exp c > spread",
];

/// Reads a graph with these outputs.
fn read(outputs: &[&str], output: Option<&str>) -> Result<ImportedActor, String> {
    let mut decoded = Model::decode(model(&NODES, constants()).as_slice()).unwrap();
    let value = |name: &&str| ValueInfo { name: (*name).into(), kind: None };
    decoded.graph.as_mut().unwrap().output = outputs.iter().map(value).collect();
    let options = OnnxOptions { output, ..OnnxOptions::default() };
    import(&decoded.encode_to_vec(), &options).map_err(|e| e.to_string())
}

#[test]
fn takes_the_first_output_and_names_the_others() {
    let actor = read(&["act", "spread", "c"], None).unwrap();
    let [output] = &actor.assumed[..] else { panic!("{:?}", actor.assumed) };
    assert_eq!(output.about, Subject::Output);
    assert_eq!(output.text, "output \"act\", not \"spread\", \"c\"");
    let actor = read(&["act", "spread"], Some("act")).unwrap();
    assert!(actor.assumed.is_empty());
    assert_eq!(actor.taken, ["output \"act\", not \"spread\""]);
    assert!(read(&["act"], None).unwrap().taken.is_empty());
}

#[test]
fn refuses_a_value_that_is_given_twice() {
    let with = |change: &dyn Fn(&mut Model)| {
        let mut decoded = Model::decode(model(&NODES, constants()).as_slice()).unwrap();
        change(&mut decoded);
        import(&decoded.encode_to_vec(), &OnnxOptions::default()).map_err(|e| e.to_string())
    };
    assert!(with(&|_| ()).is_ok());
    let twice = with(&|m| {
        let graph = m.graph.as_mut().unwrap();
        graph.initializer.push(graph.initializer[0].clone());
    });
    assert_eq!(twice.unwrap_err(), "\"w1\" is given twice");
    let twice = with(&|m| {
        let graph = m.graph.as_mut().unwrap();
        graph.node.push(graph.node[3].clone());
    });
    assert_eq!(twice.unwrap_err(), "\"act\" is given twice");
    let left_out = with(&|m| {
        for node in &mut m.graph.as_mut().unwrap().node {
            node.output.push(String::new());
        }
    });
    assert!(left_out.is_ok());
}

#[test]
fn asks_where_the_first_output_is_no_action() {
    let error = read(&["spread", "act"], None).unwrap_err();
    assert!(
        error.starts_with("output \"spread\": it is another function of the last sums"),
        "{error}"
    );
    assert!(error.ends_with("; \"act\" could be read, if it is the action"), "{error}");
    assert!(read(&["spread", "act"], Some("act")).is_ok());
    let error = read(&["act", "wide"], None).unwrap_err();
    assert_eq!(error, "2 outputs are actions, expected one: \"act\", \"wide\"");
    assert_eq!(read(&["act", "wide"], Some("wide")).unwrap().action.unwrap()[0], [2.0; 2]);
    let error = read(&["act", "wide"], Some("action")).unwrap_err();
    assert_eq!(error, "output: \"action\", expected one of act, wide");
    let error = read(&["spread", "b"], None).unwrap_err();
    assert!(error.contains("; output \"b\": it is another function of the last"), "{error}");
    // Sums that are another output than the first may be the action of another kind of actor.
    let error = read(&["c", "act"], None).unwrap_err();
    assert_eq!(error, "2 outputs are actions, expected one: \"c\", \"act\"");
    let error = read(&["spread", "act"], Some("spread")).unwrap_err();
    assert!(error.contains("another function") && !error.contains("could be read"), "{error}");
    assert_eq!(read(&[], None).unwrap_err(), "it has no output");
}
