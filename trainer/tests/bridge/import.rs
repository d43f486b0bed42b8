//! Actors as other trainers save them: imported as they answer there, or refused by name.

use leg_control::policy::{Policy, SHIPPED};
use leg_process::policy_file::AlignedBytes;
use safetensors::Dtype;
use safetensors::tensor::TensorView;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;
use trainer::Layer;

/// The observation of every comparison: m/s, m, density ratio.
const OBSERVATION: [f32; 3] = [0.5, 2.0, 0.3];

/// Returns the layers 3-8-8-2 of every actor here.
fn layers() -> [Layer; 3] {
    let mut state = 1_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 16_777_216.0 - 0.5
    };
    [(3, 8), (8, 8), (8, 2)].map(|(inputs, outputs)| Layer {
        inputs,
        weights: (0..inputs * outputs).map(|_| random()).collect(),
        bias: (0..outputs).map(|_| random()).collect(),
    })
}

/// Returns the tanh of the actor's outputs for [`OBSERVATION`], in f64, with `between` applied to
/// the sums of each hidden layer.
fn answer(between: impl Fn(f64) -> f64) -> [f64; 2] {
    let mut x = OBSERVATION.map(f64::from).to_vec();
    for (i, layer) in layers().iter().enumerate() {
        let rows = layer.weights.chunks(layer.inputs).zip(&layer.bias);
        let sums = rows.map(|(row, &bias)| {
            row.iter().zip(&x).map(|(&w, x)| f64::from(w) * x).sum::<f64>() + f64::from(bias)
        });
        x = sums.map(|z| if i < 2 { between(z) } else { z.tanh() }).collect();
    }
    [x[0], x[1]]
}

type Tensors = Vec<(String, Vec<usize>, Vec<f32>)>;

/// Returns the tensors of the layers under these paths.
fn named(paths: [&str; 3]) -> Tensors {
    let pairs = paths.into_iter().zip(layers());
    pairs
        .flat_map(|(path, layer)| {
            let outputs = layer.bias.len();
            [
                (format!("{path}.weight"), vec![outputs, layer.inputs], layer.weights),
                (format!("{path}.bias"), vec![outputs], layer.bias),
            ]
        })
        .collect()
}

fn row(name: &str, numbers: &[f32]) -> (String, Vec<usize>, Vec<f32>) {
    (name.into(), vec![numbers.len()], numbers.into())
}

fn file(tensors: &Tensors) -> Vec<u8> {
    let data: Vec<Vec<u8>> = tensors
        .iter()
        .map(|(_, _, numbers)| numbers.iter().flat_map(|x| x.to_le_bytes()).collect())
        .collect();
    let views = tensors.iter().zip(&data).map(|((name, shape, _), data)| {
        (name.as_str(), TensorView::new(Dtype::F32, shape.clone(), data).unwrap())
    });
    safetensors::serialize(views, None).unwrap()
}

/// A folder with files to import.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path().join(name), bytes).unwrap();
    }

    /// Runs `trainer import` to `p.bin` with quick gains; returns its output or its errors.
    fn import(&self, line: &str) -> Result<String, String> {
        let output = Command::new(env!("CARGO_BIN_EXE_trainer"))
            .args(["import", "--out", "p.bin", "--ki", "0.05"])
            .args(line.split(' '))
            .current_dir(self.path())
            .output()
            .unwrap();
        let [text, error] = [output.stdout, output.stderr].map(|b| String::from_utf8(b).unwrap());
        match output.status.code() {
            Some(0) => Ok(text),
            code => {
                assert_eq!(code, Some(2), "{error}");
                Err(error)
            }
        }
    }

    /// Writes observations with actions.
    fn observations(&self, rows: &[[f64; 5]]) {
        let lines = rows.iter().map(|row| row.map(|x| x.to_string()).join(","));
        let lines: Vec<String> = std::iter::once("vx,y,rho,alpha,rs".into()).chain(lines).collect();
        self.write("obs.csv", lines.join("\n"));
    }

    /// Writes one observation with its action.
    fn one(&self, [alpha, rs]: [f64; 2]) {
        let [vx, y, rho] = OBSERVATION.map(f64::from);
        self.observations(&[[vx, y, rho, alpha, rs]]);
    }
}

/// Spreads a tanh over the leg's actions.
fn spread([a, r]: [f64; 2]) -> [f64; 2] {
    let pi = std::f64::consts::PI;
    let (low, high) = (pi / 10.0, pi / 1.2);
    [low + (high - low) * (a / 2.0 + 0.5), r + 1.0]
}

fn relu(x: f64) -> f64 {
    x.max(0.0)
}

#[test]
fn a_plain_actor_answers_as_in_its_framework() {
    let place = Place::new();
    place.write("a.safetensors", file(&named(["0", "2", "4"])));
    place.one(spread(answer(relu)));
    let text = place.import("--safetensors a.safetensors --check obs.csv").unwrap();
    assert!(text.contains("\nTaken: layers 0,2,4\n"), "{text}");
    assert!(text.contains("\nChecked: 1 actions of obs.csv are the same within 1e-4"), "{text}");
    assert!(text.contains("tanh after the last layer (--output-activation)"), "{text}");
    let stated = "--hidden-activation relu --output-activation tanh --action-low 0.5,0 \
                  --action-high 2,1 --observation-offset 0,0,0 --observation-scale 1,1,1 \
                  --action-offset 1,0.5 --action-scale 1,1";
    let text = place.import(&format!("--safetensors a.safetensors {stated}")).unwrap();
    assert!(!text.contains("Assumed"), "{text}");
    let formula = "Actor: (vx, y, rho) less (0, 0, 0), times (1, 1, 1); relu; \
                   alpha = 1 + 1 tanh, from 0.5 to 2 rad; rs = 0.5 + 1 tanh, from 0 to 1 m/s\n";
    assert!(text.contains(formula), "{text}");
}

#[test]
fn a_check_refuses_an_actor_that_answers_differently() {
    let place = Place::new();
    place.write("a.safetensors", file(&named(["0", "2", "4"])));
    // The framework has tanh between the layers, which a state dict does not show.
    place.one(spread(answer(f64::tanh)));
    let error = place.import("--safetensors a.safetensors --check obs.csv").unwrap_err();
    assert!(error.contains("obs.csv: 1 of 1 actions differ by more than 1e-4"), "{error}");
    assert!(error.contains("In line 2 it has alpha"), "{error}");
    assert!(!place.path().join("p.bin").exists());
    // The tolerance is that of the option.
    let [alpha, rs] = spread(answer(relu));
    place.one([alpha + 3e-3, rs]);
    let checked = |option: &str| place.import(&format!("--safetensors a.safetensors {option}"));
    assert!(checked("--check obs.csv").is_err());
    assert!(checked("--check obs.csv --check-tolerance 2e-3").is_err());
    assert!(checked("--check obs.csv --check-tolerance 4e-3").is_ok());
    // As a spreadsheet writes it.
    let text = std::fs::read_to_string(place.path().join("obs.csv")).unwrap();
    place.write("obs.csv", format!("\u{feff}{}\r\n", text.replace('\n', "\r\n")));
    let error = checked("--check obs.csv").unwrap_err();
    assert!(error.contains("1 of 1 actions differ") && error.contains("In line 2"), "{error}");
    place.observations(&[]);
    let error = checked("--check obs.csv").unwrap_err();
    assert!(error.contains("--check: obs.csv: no row to compare with"), "{error}");
    place.write("obs.csv", "vx,y,rho,alpha\n1,2,0,1\n");
    let error = checked("--check obs.csv").unwrap_err();
    assert!(error.contains("no column rs; the first line must name vx, y, rho, alpha and rs"));
    for (option, wanted) in [
        ("--check none.csv", "none.csv: No such file"),
        ("--check-tolerance 1", "--check"),
        ("--check obs.csv --check-tolerance NaN", "a tolerance is a finite number of 0 or more"),
    ] {
        let error = checked(option).unwrap_err();
        assert!(error.contains(wanted), "{error}");
    }
}

#[test]
fn every_other_tensor_of_the_actor_is_applied_or_refused_by_name() {
    let place = Place::new();
    let refused = |paths: [&str; 3], more: &[(String, Vec<usize>, Vec<f32>)]| {
        place.write("a.safetensors", file(&[named(paths), more.to_vec()].concat()));
        let error = place.import("--safetensors a.safetensors").unwrap_err();
        assert!(!place.path().join("p.bin").exists());
        error
    };
    let norm = [1, 4]
        .map(|n| [row(&format!("{n}.weight"), &[2.0; 8]), row(&format!("{n}.bias"), &[0.3; 8])]);
    let norm = norm.concat();
    let error = refused(["0", "3", "6"], &norm);
    let names = "\"1.bias\" [8], \"1.weight\" [8], \"4.bias\" [8], \"4.weight\" [8]: beside the \
                 layers 0,3,6";
    assert!(error.contains(names) && error.contains("perhaps a normalisation"), "{error}");
    assert!(error.contains("leave out by --ignore what does not change the actions"), "{error}");
    let statistics = [row("1.running_mean", &[1.0; 8]), row("1.running_var", &[4.0; 8])];
    let error = refused(["0", "3", "6"], &statistics);
    assert!(error.contains("batch normalisation; fold it into the layer before it"), "{error}");
    let error = refused(["0", "2", "4"], &[row("obs_rms.mean", &[0.0, 2.0, 0.5])]);
    assert!(error.contains("perhaps a scaling of the observation"), "{error}");
    let error = refused(["actor.0", "actor.2", "actor.4"], &[row("log_std", &[0.0; 2])]);
    assert!(
        error.contains("as in actors of PPO")
            && error.contains("--output-activation tanh or linear")
    );
    // What the user states is left out, and the output says so.
    let text = place.import("--safetensors a.safetensors --output-activation tanh").unwrap();
    assert!(text.contains("\nTaken: layers actor.0,actor.2,actor.4; not log_std\n"), "{text}");
    place.write("a.safetensors", file(&[named(["0", "3", "6"]), norm].concat()));
    let text = place.import("--safetensors a.safetensors --ignore 1,4").unwrap();
    assert!(text.contains("layers 0,3,6; not 1.bias, 1.weight, 4.bias, 4.weight"), "{text}");
    assert!(text.contains("their numbers leave room for more"), "{text}");
}

#[test]
fn actors_with_other_activations_answer_as_in_their_framework() {
    let place = Place::new();
    place.write("a.safetensors", file(&named(["0", "2", "4"])));
    let silu = |x: f64| x / (1.0 + (-x).exp());
    let elu = |x: f64| if x > 0.0 { x } else { 0.5 * x.exp_m1() };
    let leaky = |x: f64| if x > 0.0 { x } else { 0.01 * x };
    let functions: [(&str, &dyn Fn(f64) -> f64); 4] =
        [("tanh", &f64::tanh), ("silu", &silu), ("elu(0.5)", &elu), ("leaky_relu", &leaky)];
    for (name, function) in functions {
        place.one(spread(answer(function)));
        let line =
            format!("--safetensors a.safetensors --check obs.csv --hidden-activation {name}");
        place.import(&line).unwrap();
        // Those of another activation are not the same.
        place.one(spread(answer(f64::abs)));
        assert!(place.import(&line).is_err());
    }
    // The mean of a Gaussian policy of PPO, in rad and m/s.
    let layers = ["mlp_extractor.policy_net.0", "mlp_extractor.policy_net.2", "action_net"];
    let ppo = [named(layers), vec![row("log_std", &[0.0; 2])]].concat();
    place.write("ppo.safetensors", file(&ppo));
    let [a, r] = answer(f64::tanh).map(f64::atanh);
    let pi = std::f64::consts::PI;
    place.one([a.clamp(pi / 10.0, pi / 1.2), r.clamp(0.0, 2.0)]);
    let line =
        format!("--safetensors ppo.safetensors --layers {} --check obs.csv", layers.join(","));
    let stated = "--hidden-activation tanh --output-activation linear";
    let text = place.import(&format!("{line} {stated}")).unwrap();
    assert!(text.contains("outputs in rad and m/s (--action-offset, --action-scale)"), "{text}");
    assert!(text.contains("tanh; alpha = 0 + 1 z, from 0.31415927 to"), "{text}");
}

#[test]
fn layers_without_bias_and_of_half_precision_are_read() {
    let place = Place::new();
    let bytes = |numbers: &[f32]| numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    // The upper half of an f32 is a bfloat16.
    let upper = |numbers: &[f32]| -> Vec<u8> {
        numbers.iter().flat_map(|x| x.to_le_bytes()[2..].to_owned()).collect()
    };
    let first = upper(&[0.5; 6]);
    let second = bytes(&[0.25; 4]);
    let views = [
        ("0.weight", TensorView::new(Dtype::BF16, vec![2, 3], &first).unwrap()),
        ("2.weight", TensorView::new(Dtype::F32, vec![2, 2], &second).unwrap()),
    ];
    place.write("a.safetensors", safetensors::serialize(views, None).unwrap());
    let sum: f64 = OBSERVATION.iter().map(|&x| 0.5 * f64::from(x)).sum();
    place.one(spread([(0.5 * sum).tanh(); 2]));
    let text = place.import("--safetensors a.safetensors --check obs.csv").unwrap();
    assert!(text.contains("; biases of 0 for 0.bias, 2.bias"), "{text}");
}

#[test]
fn the_default_networks_of_stable_baselines3_fly_in_a_process() {
    let place = Place::new();
    for hidden in [[64, 64], [400, 300], [256, 256]] {
        let widths = [3, hidden[0], hidden[1], 2];
        let layers: Tensors = widths
            .windows(2)
            .enumerate()
            .flat_map(|(i, pair)| {
                let weights = (0..pair[0] * pair[1]).map(|k| (k % 7) as f32 * 1e-3).collect();
                [
                    (format!("{}.weight", 2 * i), vec![pair[1], pair[0]], weights),
                    (format!("{}.bias", 2 * i), vec![pair[1]], vec![0.01; pair[1]]),
                ]
            })
            .collect();
        place.write("a.safetensors", file(&layers));
        let text = place.import("--safetensors a.safetensors").unwrap();
        assert!(text.contains(&format!("3-{}-{}-2", hidden[0], hidden[1])), "{text}");
        let bytes = std::fs::read(place.path().join("p.bin")).unwrap();
        assert!(Policy::parse(AlignedBytes::from(bytes.as_slice()).as_slice()).is_ok());
    }
    let wide: Tensors = vec![
        ("0.weight".into(), vec![512, 3], vec![0.0; 1536]),
        ("2.weight".into(), vec![512, 512], vec![0.0; 512 * 512]),
        ("4.weight".into(), vec![2, 512], vec![0.0; 1024]),
    ];
    place.write("a.safetensors", file(&wide));
    let error = place.import("--safetensors a.safetensors").unwrap_err();
    assert!(error.contains("265730 weights and biases, allowed are 262144"), "{error}");
}

#[test]
fn applies_the_scale_and_bias_of_the_actions() {
    let place = Place::new();
    let pair = |scale: &[f32], bias: &[f32]| {
        let two = |name: &str, n: &[f32]| (name.to_owned(), vec![1, n.len()], n.to_vec());
        let pair = vec![two("action_scale", scale), two("action_bias", bias)];
        file(&[named(["fc1", "fc2", "fc_mu"]), pair].concat())
    };
    place.write("a.safetensors", pair(&[0.5, 0.25], &[1.2, 0.4]));
    let [a, r] = answer(relu);
    place.one([0.5 * a + 1.2, 0.25 * r + 0.4]);
    let line = "--safetensors a.safetensors --check obs.csv";
    let text = place.import(line).unwrap();
    assert!(text.contains("layers fc1,fc2,fc_mu; action_scale and action_bias\n"), "{text}");
    let error = place.import(&format!("{line} --action-scale 1,1")).unwrap_err();
    assert!(error.contains("action scale: the file states its own; leave --action-scale out"));
    place.write("a.safetensors", pair(&[0.5], &[1.2, 0.4]));
    place.one([0.5 * a + 1.2, 0.5 * r + 0.4]);
    place.import(line).unwrap();
    place.write("a.safetensors", pair(&[0.5, 0.5, 0.5], &[1.2, 0.4]));
    let error = place.import(line).unwrap_err();
    assert!(
        error.contains("\"action_scale\": shape [1, 3], expected a number for each"),
        "{error}"
    );
}

#[test]
fn an_imported_policy_that_falls_is_seen_at_once() {
    let place = Place::new();
    place.write("a.safetensors", file(&named(["0", "2", "4"])));
    let text = place.import("--safetensors a.safetensors").unwrap();
    let line = text.lines().last().unwrap();
    assert!(line.starts_with("Evaluated: keeps hopping for 30 hops from "), "{text}");
    assert!(line.contains(" % on land, ") && line.contains("it falls on land"), "{text}");
    place.write("shipped.bin", SHIPPED);
    let export = Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(["export", "--policy", "shipped.bin", "--to", "onnx", "a.onnx"])
        .current_dir(place.path())
        .output()
        .unwrap();
    assert!(export.status.success());
    let text = place.import("--onnx a.onnx").unwrap();
    let line = text.lines().last().unwrap();
    assert!(line.ends_with("100.0 % in water of 200 starts") && !line.contains("falls"), "{text}");
}

#[test]
fn an_onnx_file_and_its_weights_may_be_links() {
    let place = Place::new();
    let policy = Policy::parse(SHIPPED).unwrap();
    for folder in ["blobs", "snapshots"] {
        std::fs::create_dir(place.path().join(folder)).unwrap();
    }
    place.write("blobs/ab12", trainer::bridge::onnx::export(&policy));
    std::os::unix::fs::symlink("../blobs/ab12", place.path().join("snapshots/a.onnx")).unwrap();
    place.import("--onnx snapshots/a.onnx").unwrap();
    let bytes = std::fs::read(place.path().join("p.bin")).unwrap();
    let bytes = AlignedBytes::from(bytes.as_slice());
    let imported = Policy::parse(bytes.as_slice()).unwrap();
    assert_eq!(imported.actor().weights(), policy.actor().weights());
}

#[test]
fn options_of_one_format_are_refused_with_another() {
    let place = Place::new();
    for (line, wanted) in [
        ("--onnx a --ignore b", "cannot be used with"),
        ("--onnx a --output-activation tanh", "cannot be used with"),
        ("--json a --hidden-activation relu", "cannot be used with"),
        ("--safetensors a --output b", "cannot be used with"),
        (
            "--safetensors a --hidden-activation gelu",
            "'--hidden-activation <NAME>': \"gelu\" is none of relu, leaky_relu",
        ),
        (
            "--safetensors a --output-activation softmax",
            "'--output-activation <NAME>': \"softmax\" is none of tanh, linear",
        ),
    ] {
        let error = place.import(line).unwrap_err();
        assert!(error.contains(wanted), "{line}: {error}");
    }
}
