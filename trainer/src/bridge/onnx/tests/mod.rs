//! Graphs as other programs write them.

mod activations;
mod exporters;
mod outputs;

use super::proto::{
    ATTRIBUTE_INT, Attribute, EXTERNAL, Entry, FLOAT, Graph, Model, Node, Tensor, ValueInfo,
};
use super::{OnnxOptions, import};
use crate::bridge::imported::{ImportOptions, ImportedActor};
use leg_control::actor::{Action, Observation};
use prost::Message;
use std::path::PathBuf;

fn tensor(name: &str, dims: &[i64], numbers: &[f32]) -> Tensor {
    Tensor {
        name: name.into(),
        dims: dims.into(),
        data_type: FLOAT,
        float_data: numbers.into(),
        ..Default::default()
    }
}

/// Parses a node `op in in ... > out`, with an integer attribute after a colon:
/// `Gemm:transB=1`.
fn node(text: &str) -> Node {
    let (left, output) = text.split_once(" > ").unwrap();
    let mut words = left.split(' ');
    let (op, attribute) = {
        let op = words.next().unwrap();
        op.split_once(':').map_or((op, None), |(op, a)| (op, a.split_once('=')))
    };
    let attribute = attribute.map(|(name, value)| Attribute {
        name: name.into(),
        i: Some(value.parse().unwrap()),
        kind: ATTRIBUTE_INT,
        ..Default::default()
    });
    Node {
        input: words.map(|w| if w == "_" { String::new() } else { w.into() }).collect(),
        output: vec![output.into()],
        name: format!("n_{output}"),
        op_type: op.into(),
        attribute: attribute.into_iter().collect(),
        ..Default::default()
    }
}

fn constants() -> Vec<Tensor> {
    vec![
        tensor("w1", &[2, 3], &[1.0, 0.5, 0.25, -1.0, 2.0, 3.0]),
        tensor("w1t", &[3, 2], &[1.0, -1.0, 0.5, 2.0, 0.25, 3.0]),
        tensor("b1", &[2], &[0.125, -0.5]),
        tensor("w2", &[2, 2], &[0.5, -0.25, 0.125, 1.0]),
        tensor("w2t", &[2, 2], &[0.5, 0.125, -0.25, 1.0]),
        tensor("b2", &[1, 2], &[0.0625, -0.5]),
        tensor("mean", &[1, 3], &[0.5, 2.0, 0.0]),
        tensor("deviation", &[3], &[2.0, 4.0, 0.5]),
        tensor("half", &[], &[0.5]),
        tensor("one", &[1], &[1.0]),
        tensor("minus", &[], &[-1.0]),
        tensor("range", &[2], &[2.0, 2.0]),
        tensor("low", &[2], &[0.5, 0.0]),
        tensor("high", &[2], &[2.5, 2.0]),
    ]
}

fn model(nodes: &[&str], constants: Vec<Tensor>) -> Vec<u8> {
    let value = |name: &str| ValueInfo { name: name.into(), kind: None };
    let graph = Graph {
        node: nodes.iter().map(|n| node(n)).collect(),
        name: "g".into(),
        initializer: constants,
        input: vec![value("obs")],
        output: vec![value("act")],
    };
    Model { ir_version: 7, graph: Some(graph), ..Default::default() }.encode_to_vec()
}

fn read(nodes: &[&str]) -> Result<ImportedActor, String> {
    import(&model(nodes, constants()), &OnnxOptions::default()).map_err(|e| e.to_string())
}

fn act(imported: ImportedActor, [vx, y, rho]: [f32; 3]) -> [f32; 2] {
    let packed = imported.complete(&ImportOptions::default()).unwrap().actor;
    let observation = Observation { apex_vx_m_s: vx, apex_y_m: y, density_ratio: rho };
    let Action { touchdown_angle_rad, elongation_speed_m_s } = packed.actor().act(observation);
    [touchdown_angle_rad, elongation_speed_m_s]
}

/// Returns the output of the network of [`constants`], computed directly.
fn tanh_of_network([a, b, c]: [f32; 3]) -> [f32; 2] {
    let h = [0.125 + a + 0.5 * b + 0.25 * c, -0.5 - a + 2.0 * b + 3.0 * c].map(|x| x.max(0.0));
    [0.0625 + 0.5 * h[0] - 0.25 * h[1], -0.5 + 0.125 * h[0] + h[1]].map(libm::tanhf)
}

const X: [f32; 3] = [0.75, 0.5, 0.125];

#[test]
fn reads_the_same_network_in_all_its_spellings() {
    let spellings: [&[&str]; 4] = [
        &["Gemm:transB=1 obs w1 b1 > a", "Relu a > b", "Gemm:transB=1 b w2 b2 > c", "Tanh c > act"],
        &["Gemm obs w1t b1 > a", "Relu a > b", "Gemm:transB=0 b w2t b2 > c", "Tanh c > act"],
        &[
            "Flatten:axis=1 obs > o",
            "Transpose w1 > k",
            "MatMul o k > a",
            "Add b1 a > a2",
            "Relu a2 > b",
            "MatMul b w2t > c",
            "Add c b2 > c2",
            "Tanh c2 > act",
        ],
        &[
            "Cast:to=1 obs > o",
            "Gemm:transB=1 o w1 > a",
            "Add a b1 > a2",
            "Relu a2 > b",
            "Identity b > same",
            "Gemm:transB=1 same w2 b2c > c",
            "Tanh c > act",
        ],
    ];
    let tanh = tanh_of_network(X);
    // The graph does not scale its actions, so they are spread over the leg's bounds.
    let pi = std::f32::consts::PI;
    let [low, high] = [pi / 10.0, pi / 1.2];
    let expected = [low + (tanh[0] + 1.0) * (high - low) / 2.0, tanh[1] + 1.0];
    for nodes in spellings {
        let mut constants = constants();
        constants.push(tensor("b2c", &[2], &[0.0625, -0.5]));
        let imported = import(&model(nodes, constants), &OnnxOptions::default()).unwrap();
        assert_eq!((imported.observation, imported.action), (None, None));
        assert_eq!((imported.low, imported.high), (None, None));
        let found = act(imported, X);
        assert!((0..2).all(|i| (found[i] - expected[i]).abs() < 1e-6), "{found:?} {expected:?}");
    }
}

const NETWORK: [&str; 4] =
    ["Gemm:transB=1 x w1 b1 > a", "Relu a > b", "Gemm:transB=1 b w2 b2 > c", "Tanh c > t"];

fn with_network<'a>(before: &[&'a str], after: &[&'a str]) -> Vec<&'a str> {
    [before, &NETWORK, after].concat()
}

#[test]
fn takes_scalings_and_clips_from_the_graph() {
    let scaled = [0, 1, 2].map(|i| (X[i] - [0.5, 2.0, 0.0][i]) / [2.0, 4.0, 0.5][i]);
    let tanh = tanh_of_network(scaled);
    let before = ["Sub obs mean > s", "Div s deviation > x"];
    // A Box action is unscaled by low + (high - low) (tanh + 1) / 2.
    let after = ["Add t one > u", "Mul u half > v", "Mul range v > w", "Add w low > act"];
    let imported = read(&with_network(&before, &after)).unwrap();
    assert_eq!((imported.low, imported.high), (None, None));
    let found = act(imported, X);
    for i in 0..2 {
        let expected = [0.5, 0.0][i] + (tanh[i] + 1.0);
        assert!((found[i] - expected).abs() < 1e-6, "{found:?}");
    }
    // A clip before the scaling, and one after it.
    let clipped = ["Clip t minus one > u", "Mul u range > v", "Max low v > w", "Min w high > act"];
    let imported = read(&with_network(&before, &clipped)).unwrap();
    assert_eq!(imported.action, Some([[2.0; 2], [0.0; 2]]));
    assert_eq!((imported.low, imported.high), (Some([0.5, 0.0]), Some([2.0, 2.0])));
    // A clip without effect states no bounds.
    let imported = read(&with_network(&before, &["Clip t minus one > act"])).unwrap();
    assert_eq!((imported.action, imported.low, imported.high), (None, None, None));
    // A constant minus the observation.
    let imported = read(&with_network(&["Sub mean obs > x"], &["Sub high t > act"])).unwrap();
    let scaling = imported.observation.unwrap();
    assert_eq!((scaling.offset, scaling.scale), ([0.5, 2.0, 0.0], [-1.0; 3]));
    assert_eq!(imported.action, Some([[-1.0; 2], [2.5, 2.0]]));
}

#[test]
fn names_the_operation_that_an_actor_cannot_have() {
    let refused = |nodes: &[&str]| read(nodes).unwrap_err();
    let sine =
        ["Gemm:transB=1 obs w1 b1 > a", "Sin a > b", "Gemm:transB=1 b w2 b2 > c", "Tanh c > act"];
    assert!(
        refused(&sine).starts_with(
            "output \"act\": node Sin \"n_b\": not an operation that an actor may have; these are Add"
        ),
        "{}",
        refused(&sine)
    );
    let straight = ["Gemm:transB=1 obs w1 b1 > a", "Gemm:transB=1 a w2 b2 > c", "Tanh c > act"];
    assert!(refused(&straight).contains("two layers without an activation between them"));
    let wrong = ["Gemm obs w1 > a", "Tanh a > act"];
    assert!(refused(&wrong).contains("a layer of 2 inputs where 3 arrive"));
    let exp = ["Gemm:transB=1 obs w1 b1 > a", "Exp a > act"];
    assert!(refused(&exp).contains("it is another function of the last sums than tanh"));
    let two =
        ["Gemm:transB=1 obs w1 b1 > a", "Relu a > b", "Gemm:transB=1 b w2 b2 > c", "Add b c > act"];
    assert!(refused(&two).contains("Add of two different layers is not what an actor does"));
    assert!(refused(&["Relu nothing > act"]).contains("its input \"nothing\" is given by no node"));
    assert!(refused(&["Relu w1 > act"]).contains("it does not depend on the observation"));
    assert!(refused(&["Relu obs > other"]).contains("output \"act\": no node gives it"));
    assert!(refused(&["Mul obs b1 > act"]).contains("a constant of shape [2] beside rows of 3"));
    assert!(refused(&["Gemm:transA=1 obs w1 b1 > act"]).contains("transA"));
    assert!(refused(&["Gemm obs _ b1 > act"]).contains("its second input is missing"));
}

/// Reads the graph of one layer with this tensor as its weights.
fn of_weights(weights: Tensor, folders: &[PathBuf]) -> Result<ImportedActor, String> {
    let nodes = ["Gemm:transB=1 obs w > a", "Tanh a > act"];
    let options = OnnxOptions { folders, ..OnnxOptions::default() };
    import(&model(&nodes, vec![weights]), &options).map_err(|e| e.to_string())
}

#[test]
fn refuses_damaged_tensors() {
    let good = || tensor("w", &[2, 3], &[1.0; 6]);
    assert!(of_weights(good(), &[]).is_ok());
    let refused = |change: &dyn Fn(&mut Tensor), expected: &str| {
        let mut weights = good();
        change(&mut weights);
        let error = of_weights(weights, &[]).unwrap_err();
        assert!(error.contains("node Gemm") && error.contains(expected), "{error}");
    };
    refused(&|t| t.dims = vec![i64::MAX, 3], "at most 262144 values");
    refused(&|t| t.dims = vec![1 << 32, 1 << 32], "at most 262144 values");
    refused(&|t| t.dims = vec![-2, -3], "at most 262144 values");
    refused(&|t| t.dims = vec![0, 3], "6 values where its shape [0, 3] has 0");
    refused(&|t| t.dims = vec![6], "expected a matrix");
    refused(&|t| t.float_data[4] = f32::NAN, "value 4 is NaN");
    refused(&|t| t.float_data[4] = f32::INFINITY, "value 4 is inf");
    refused(&|t| t.data_type = 3, "data type 3, readable are");
    refused(&|t| t.raw_data = Some(vec![0; 23]), "23 bytes where its shape [2, 3] has 24");
    refused(&|t| t.data_location = EXTERNAL, "without a location");
}

/// Returns weights that lie in another file.
fn external(entries: &[(&str, &str)]) -> Tensor {
    let external_data =
        entries.iter().map(|&(k, v)| Entry { key: k.into(), value: v.into() }).collect();
    Tensor {
        data_location: EXTERNAL,
        float_data: vec![],
        external_data,
        ..tensor("w", &[2, 3], &[])
    }
}

#[test]
fn reads_external_weights_behind_the_links_of_a_cache() {
    // The cache of Hugging Face: names are links, the files lie together elsewhere.
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    for folder in ["snapshots/1", "blobs", "other"] {
        std::fs::create_dir_all(path(folder)).unwrap();
    }
    let numbers: Vec<f32> = (0..6).map(|i| i as f32).collect();
    for place in ["blobs/ab12", "other/ab12"] {
        std::fs::write(path(place), bytemuck::cast_slice::<f32, u8>(&numbers)).unwrap();
    }
    let link = |to: &str| {
        let _ = std::fs::remove_file(path("snapshots/1/w.data"));
        std::os::unix::fs::symlink(to, path("snapshots/1/w.data")).unwrap();
    };
    let by_name = path("snapshots/1");
    let both = [by_name.clone(), path("blobs")];
    let read = |folders: &[PathBuf]| of_weights(external(&[("location", "w.data")]), folders);
    link("../../blobs/ab12");
    assert_eq!(read(&both).unwrap().layers[0].weights, numbers);
    // The graph is no link: then the weights must be below its folder.
    let error = read(&[by_name]).unwrap_err();
    assert!(error.contains("not a file below the folder"), "{error}");
    link("../../other/ab12");
    assert!(read(&both).unwrap_err().contains("not a file below the folder"));
    // Only the graph is a link: its weights lie beside the file itself.
    std::fs::remove_file(path("snapshots/1/w.data")).unwrap();
    std::fs::copy(path("blobs/ab12"), path("blobs/w.data")).unwrap();
    assert_eq!(read(&both).unwrap().layers[0].weights, numbers);
}

#[test]
fn reads_external_weights_only_below_the_files_folder() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path().join("model");
    std::fs::create_dir(&folder).unwrap();
    let numbers: Vec<f32> = (0..7).map(|i| i as f32).collect();
    std::fs::write(folder.join("w.data"), bytemuck::cast_slice::<f32, u8>(&numbers)).unwrap();
    std::fs::write(directory.path().join("secret"), [0; 24]).unwrap();
    std::os::unix::fs::symlink("../secret", folder.join("link")).unwrap();
    let of =
        |entries: &[(&str, &str)]| of_weights(external(entries), std::slice::from_ref(&folder));
    let imported = of(&[("location", "w.data"), ("offset", "4"), ("length", "24")]).unwrap();
    assert_eq!(imported.layers[0].weights, numbers[1..]);
    for (entries, expected) in [
        (&[("location", "w.data"), ("offset", "8")][..], "it ends after 20 of 24 bytes"),
        (&[("location", "w.data"), ("offset", "18446744073709551615")], "external data in"),
        (&[("location", "w.data"), ("offset", "-4")], "offset \"-4\", expected a number"),
        (&[("location", "w.data"), ("length", "9999999999")], "9999999999 bytes of external data"),
        (&[("location", "../secret")], "not below the file's folder"),
        (&[("location", "/etc/passwd")], "not below the file's folder"),
        (&[("location", "link")], "not a file below the folder"),
        (&[("location", "none")], "No such file"),
        (&[("location", "")], "not below"),
    ] {
        let error = of(entries).unwrap_err();
        assert!(error.contains(expected), "{entries:?}: {error}");
    }
}
