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
    "Exp c > deviation",
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
    let actor = read(&["act", "deviation", "c"], None).unwrap();
    let [output] = &actor.assumed[..] else { panic!("{:?}", actor.assumed) };
    assert_eq!(output.about, Subject::Output);
    assert_eq!(output.text, "output \"act\", not \"deviation\", \"c\"");
    let actor = read(&["act", "deviation"], Some("act")).unwrap();
    assert!(actor.assumed.is_empty());
    assert_eq!(actor.taken, ["output \"act\", not \"deviation\""]);
    assert!(read(&["act"], None).unwrap().taken.is_empty());
}

#[test]
fn asks_where_the_first_output_is_no_action() {
    let error = read(&["deviation", "act"], None).unwrap_err();
    assert!(error.starts_with("output \"deviation\": node Exp"), "{error}");
    assert!(error.ends_with("; \"act\" could be read, if it is the action"), "{error}");
    assert!(read(&["deviation", "act"], Some("act")).is_ok());
    let error = read(&["act", "wide"], None).unwrap_err();
    assert_eq!(error, "2 outputs are actions, expected one: \"act\", \"wide\"");
    assert_eq!(read(&["act", "wide"], Some("wide")).unwrap().action.unwrap()[0], [2.0; 2]);
    let error = read(&["act", "wide"], Some("action")).unwrap_err();
    assert_eq!(error, "output: \"action\", expected one of act, wide");
    let error = read(&["deviation", "c"], None).unwrap_err();
    assert!(error.contains("; output \"c\": it is a layer before its ReLU"), "{error}");
    let error = read(&["deviation", "act"], Some("deviation")).unwrap_err();
    assert!(error.contains("not an operation") && !error.contains("could be read"), "{error}");
    assert_eq!(read(&[], None).unwrap_err(), "it has no output");
}
