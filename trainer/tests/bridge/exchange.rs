//! Export and import of policies by safetensors and ONNX, with files of other programs and
//! damaged files.

use crate::activations::actors;
use leg_control::policy::{Policy, SHIPPED};
use leg_process::policy_file::AlignedBytes;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use std::collections::HashMap;
use std::path::Path;
use std::process::{Command, Output};
use trainer::bridge::imported::{ImportOptions, ImportedActor};
use trainer::bridge::model_card::KEY;
use trainer::bridge::onnx::OnnxOptions;
use trainer::bridge::safetensors::StateDictOptions;
use trainer::bridge::{ImportError, onnx, safetensors as st};
use trainer::policy::PackedActor;

fn shipped() -> Policy<'static> {
    Policy::parse(SHIPPED).unwrap()
}

type Import = fn(&[u8]) -> Result<ImportedActor, ImportError>;

fn imports() -> [(Vec<u8>, Import); 2] {
    let policy = shipped();
    [
        (st::export(&policy), |bytes| st::import(bytes, &StateDictOptions::default())),
        (onnx::export(&policy), |bytes| onnx::import(bytes, &OnnxOptions::default())),
    ]
}

#[test]
fn an_import_restores_the_exported_policy_bit_for_bit() {
    for (bytes, import) in imports() {
        let imported = import(&bytes).unwrap().complete(&ImportOptions::default()).unwrap();
        assert_eq!(imported.actor, PackedActor::from(&shipped()));
        assert!(imported.assumed.is_empty(), "{:?}", imported.assumed);
        let card = imported.card.expect("the weights are those it was written for");
        assert_eq!(card.policy(&imported.actor).unwrap().as_slice(), SHIPPED);
    }
    // The bytes must not depend on the order of a hash map.
    for (first, second) in imports().into_iter().zip(imports()) {
        assert!(first.0 == second.0);
    }
}

#[test]
fn every_activation_survives_both_formats() {
    for (packed, blob) in actors() {
        let policy = Policy::parse(blob.as_slice()).unwrap();
        let read = [
            st::import(&st::export(&policy), &StateDictOptions::default()),
            onnx::import(&onnx::export(&policy), &OnnxOptions::default()),
        ];
        for imported in read {
            let complete = imported.unwrap().complete(&ImportOptions::default()).unwrap();
            assert_eq!(complete.actor, packed);
            let card = complete.card.expect("the actor is that of the card");
            assert_eq!(card.policy(&complete.actor).unwrap().as_slice(), blob.as_slice());
        }
    }
}

#[test]
fn a_model_card_is_dropped_when_the_weights_changed() {
    let (bytes, import) = imports().into_iter().next().unwrap();
    let mut read = import(&bytes).unwrap();
    read.layers[1].weights[7] += 1e-3;
    let imported = read.complete(&ImportOptions::default()).unwrap();
    assert_eq!(imported.card, None);
    assert_eq!(imported.actor.observation, PackedActor::from(&shipped()).observation);
}

#[test]
fn refuses_a_value_that_the_file_states() {
    for (bytes, import) in imports() {
        let given = ImportOptions { action_scale: Some([1.0, 1.0]), ..ImportOptions::default() };
        let error = import(&bytes).unwrap().complete(&given).unwrap_err();
        assert_eq!(error.to_string(), "action scale: the file states its own");
    }
}

/// Writes the shipped actor as another program would.
fn foreign(prefix: &str, dtype: Dtype, change: impl Fn(&str, &mut Vec<f64>)) -> Vec<u8> {
    let layers = PackedActor::from(&shipped()).layers();
    let mut tensors = Vec::new();
    for (i, layer) in layers.iter().enumerate() {
        let outputs = layer.bias.len();
        for (kind, numbers, shape) in [
            ("weight", &layer.weights, vec![outputs, layer.inputs]),
            ("bias", &layer.bias, vec![outputs]),
        ] {
            let name = format!("{prefix}{}.{kind}", 2 * i);
            let mut numbers = numbers.iter().map(|&x| f64::from(x)).collect();
            change(&name, &mut numbers);
            let data: Vec<u8> = match dtype {
                Dtype::F64 => numbers.iter().flat_map(|x| x.to_le_bytes()).collect(),
                Dtype::F32 => numbers.iter().flat_map(|x| (*x as f32).to_le_bytes()).collect(),
                _ => numbers.iter().flat_map(|_| [0, 0]).collect(),
            };
            tensors.push((name, shape, data));
        }
    }
    let views = tensors.iter().map(|(name, shape, data)| {
        (name.as_str(), TensorView::new(dtype, shape.clone(), data).unwrap())
    });
    safetensors::serialize(views, None).unwrap()
}

#[test]
fn imports_the_state_dict_of_another_program() {
    let own = PackedActor::from(&shipped());
    for (prefix, dtype) in [("", Dtype::F32), ("actor.mu.", Dtype::F64), ("pi.", Dtype::F32)] {
        let imported =
            st::import(&foreign(prefix, dtype, |_, _| ()), &StateDictOptions::default()).unwrap();
        let imported = imported.complete(&ImportOptions::default()).unwrap();
        assert_eq!(imported.actor.weights, own.weights);
        // By default tanh is spread over the leg's range of actions.
        let action = imported.actor.action;
        assert_eq!((action.offset[1], action.scale[1]), (1.0, 1.0));
        assert!((action.offset[0] + action.scale[0] - action.high[0]).abs() < 1e-6);
        let assumed: Vec<&str> = imported.assumed.iter().map(|a| a.text.as_str()).collect();
        assert_eq!(
            assumed,
            [
                "ReLU between the layers, and nothing else",
                "tanh after the last layer",
                "observations as they are",
                "actions from 0.3142 to 2.6180 rad and from 0.0000 to 2.0000 m/s",
                "outputs from -1 to 1 spread over the actions",
            ]
        );
        // The given scalings replace the defaults.
        let given = ImportOptions {
            observation_offset: Some(own.observation.offset),
            observation_scale: Some(own.observation.scale),
            action_offset: Some(own.action.offset),
            action_scale: Some(own.action.scale),
            action_low: Some(own.action.low),
            action_high: Some(own.action.high),
        };
        let imported =
            st::import(&foreign(prefix, dtype, |_, _| ()), &StateDictOptions::default()).unwrap();
        let complete = imported.complete(&given).unwrap();
        assert_eq!((complete.actor, complete.assumed.len()), (own.clone(), 2));
    }
}

#[test]
fn refuses_a_state_dict_that_is_no_actor() {
    let refused =
        |bytes: Vec<u8>| st::import(&bytes, &StateDictOptions::default()).unwrap_err().to_string();
    let nan = foreign("", Dtype::F32, |name, numbers| {
        if name == "2.weight" {
            numbers[3] = f64::NAN;
        }
    });
    assert_eq!(refused(nan), "\"2.weight\", number 3: NaN, expected a finite number within f32");
    let large = foreign("", Dtype::F64, |name, numbers| {
        if name == "4.bias" {
            numbers[1] = 1e39;
        }
    });
    assert!(refused(large).starts_with("\"4.bias\", number 1: inf, expected a finite"));
    let whole = foreign("", Dtype::I16, |_, _| ());
    assert_eq!(refused(whole), "\"0.weight\": dtype I16, expected F16, BF16, F32 or F64");
    assert!(refused(b"PK\x03\x04 a file of torch.save".to_vec()).starts_with("not a safetensors"));
    let card = |json: &str| {
        let metadata = HashMap::from([(KEY.to_owned(), json.to_owned())]);
        let own = st::export(&shipped());
        let tensors = SafeTensors::deserialize(&own).unwrap();
        refused(safetensors::serialize(tensors.tensors(), Some(metadata)).unwrap())
    };
    assert!(card("{").starts_with("metadata leg_actor: EOF"), "{}", card("{"));
    assert!(card(r#"{"name": "x"}"#).contains("missing field"), "{}", card(r#"{"name": "x"}"#));
}

#[test]
fn importing_damaged_files_never_panics() {
    let mut rng = Pcg64::seed_from_u64(5);
    for (bytes, import) in imports() {
        let check =
            |bytes: &[u8]| match import(bytes).map(|d| d.complete(&ImportOptions::default())) {
                Ok(Ok(imported)) => {
                    let observation = leg_control::actor::Observation::default();
                    let action = imported.actor.actor().act(observation);
                    assert!(action.touchdown_angle_rad.is_finite());
                    true
                }
                Ok(Err(_)) | Err(_) => false,
            };
        // A truncated file lacks a weight or its structure. Protobuf does not state its length,
        // so the last bytes may be lost unnoticed.
        let cut: Vec<usize> = (0..200).chain((0..200).map(|i| bytes.len() * i / 200)).collect();
        for length in cut {
            assert!(!check(&bytes[..length.min(bytes.len() - 6000)]), "{length}");
        }
        let mut taken = 0;
        for _ in 0..4000 {
            let mut damaged = bytes.clone();
            // Damages the structure at the start of the file more often than the weights.
            let within = if rng.random_bool(0.7) { 600 } else { damaged.len() };
            for _ in 0..rng.random_range(1..4) {
                let at = rng.random_range(0..within);
                match rng.random_range(0..4) {
                    0 => damaged[at] ^= 1 << rng.random_range(0..8),
                    1 => damaged[at] = rng.random(),
                    2 => damaged[at] = 0xff,
                    _ => drop(damaged.drain(at..(at + 3).min(damaged.len()))),
                }
            }
            taken += usize::from(check(&damaged));
        }
        // Both outcomes must occur: a changed weight is still a valid actor.
        assert!((1..4000).contains(&taken), "{taken}");
    }
}

fn trainer(line: &str, directory: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(line.split(' '))
        .current_dir(directory)
        .output()
        .unwrap()
}

#[test]
fn the_commands_export_and_import_a_policy() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let run = |line: &str| {
        let output = trainer(line, directory.path());
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{line}: {error}");
        String::from_utf8(output.stdout).unwrap()
    };
    std::fs::write(path("p.bin"), SHIPPED).unwrap();
    for format in ["safetensors", "onnx"] {
        run(&format!("export --policy p.bin --to {format} a.{format}"));
        let message = run(&format!("import --{format} a.{format} --out back.bin"));
        assert!(message.contains("gains the policy's own"), "{message}");
        assert_eq!(std::fs::read(path("back.bin")).unwrap(), SHIPPED);
        run(&format!("import --{format} a.{format} --out back.bin --ki 0.1 --name other"));
        let bytes = AlignedBytes::from(std::fs::read(path("back.bin")).unwrap().as_slice());
        let policy = Policy::parse(bytes.as_slice()).unwrap();
        assert_eq!((policy.manifest().name, policy.manifest().gains[0].ki), ("other", 0.1));
        assert_eq!(policy.manifest().provenance, shipped().manifest().provenance);
    }
    run("export --to c actor.c");
    std::fs::write(path("f.safetensors"), foreign("mu.", Dtype::F32, |_, _| ())).unwrap();
    let message = run("import --safetensors f.safetensors --ki 0.05 --out f.bin \
                    --observation-offset=-1,0,0 --action-low 0.5,0 --action-high 2,1");
    assert!(message.contains("\nTaken: layers mu.0,mu.2,mu.4\nAssumed: ReLU"), "{message}");
    assert!(message.contains("no observation scale (--observation-offset, --obs"), "{message}");
    for (line, message) in [
        ("import --out p.bin", "--safetensors <FILE>|--onnx <FILE>|--json <FILE>"),
        ("import --onnx a.onnx --json a.json --out p.bin", "cannot be used with"),
        ("import --onnx a.safetensors --out q.bin", "a.safetensors: "),
        ("import --safetensors a.onnx --out q.bin", "a.onnx: not a safetensors file"),
        ("import --json a.onnx --out q.bin", "is not UTF-8"),
        ("import --safetensors none --out q.bin", "none: No such file"),
        ("import --onnx a.onnx --layers 0,2 --out q.bin", "cannot be used with"),
        (
            "import --safetensors f.safetensors --action-low 0.5 --out q.bin",
            "1 numbers, expected 2",
        ),
        (
            "import --safetensors f.safetensors --action-low 0.5,x --out q.bin",
            "'x' is not a finite",
        ),
        (
            "import --safetensors f.safetensors --action-low 2.9,0 --out q.bin",
            "lowest action[0]: 2.9",
        ),
        ("import --safetensors f.safetensors --action-low -1,0 --out q.bin", "clip of the angle"),
        ("import --safetensors f.safetensors --layers mu.0 --out q.bin", "layers: mu.0 (3 to 50)"),
        ("import --safetensors f.safetensors --ki 1e9 --out q.bin", "gains within"),
        ("export --policy f.safetensors --to c x.c", "is not a valid policy"),
        ("export --policy p.bin --to torch x", "invalid value 'torch'"),
    ] {
        let output = trainer(line, directory.path());
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {error}");
        assert!(error.contains(message), "{line}: {error}");
    }
    assert!(!path("q.bin").exists() && !path("x.c").exists());
}
