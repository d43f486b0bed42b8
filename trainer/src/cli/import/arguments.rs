//! The command line of `trainer import`.

use super::check;
use crate::bridge::imported::{ImportOptions, ImportedActor};
use crate::bridge::onnx::OnnxOptions;
use crate::bridge::safetensors::StateDictOptions;
use crate::bridge::{ImportError, activation, json, onnx, safetensors};
use clap::{Args, value_parser};
use leg_control::actor::{Activation, OutputActivation};
use leg_control::policy::GainPoint;
use std::path::{Path, PathBuf};

/// Summary of the layouts; the documentation of `trainer::bridge` is the reference.
const LAYOUT: &str = r#"A safetensors file holds linear layers, such as 0.weight (outputs, inputs) and 0.bias.
The actor is the only module whose layers lead from 3 inputs to 2 outputs, in the order
of the numbers in their names; where there are several, or several orders, or its layers
are in several modules, --layers names them in order. ReLU between the layers and tanh
after the last are assumed; --hidden-activation and --output-activation name others. The tensors action_scale and action_bias are applied. Those
of critics, targets and optimisers are left out; any other tensor is an error, unless
--ignore names it or its module.

An ONNX file holds a graph from one input, rows of 3, to rows of 2: Gemm or MatMul and
Add with the same activation between all layers (relu, leaky_relu, elu, tanh, silu or
gelu_tanh, however it is written), tanh or nothing at the end, and scalings and clips
before and after. Of several outputs the first is the action. Its weights may lie in a
second file beside it, X.onnx.data: both travel together.

The inputs are vx (m/s), y (m) and density ratio rho; the network sees (input - offset)
* scale. The outputs are the touchdown angle alpha (rad) and the elongation speed rs
(m/s), clip(offset + scale * tanh(z), low, high), or the same without tanh. The options give what the file does
not state. The defaults are unscaled inputs, low and high of pi/10 to pi/1.2 rad and 0 to
2 m/s, tanh from -1 to 1 spread from low to high, as SB3 does for a Box action, and
outputs without tanh in rad and m/s. All that is assumed is printed, with the options that replace it.

--check compares the actor with the framework that trained it: a CSV file with columns
vx, y, rho, alpha and rs, observations and their actions. An actor that answers
differently is not written. A line of the output states from how many starts the leg
keeps hopping.

The gains of the cascade are those of --ki and --feed-forward; else those of the policy
that the file was exported from, if its actor is unchanged; else they are searched, as by
`trainer train`, in some ten seconds.

The JSON layout:
  {"hidden_activation": "relu",
   "output": "clip(output_scale*tanh(z), low, high)",
   "output_scale": 2.617993877991494, "low": [0.314, 0.0], "high": [2.618, 2.0],
   "layers": [{"weights": [[...], ...], "bias": [...]}, ...],
   "test_vectors": [{"observation": [vx, y, rho], "action": [alpha, rs]}, ...]}

Weights are row by output. Test vectors are optional; the imported actor must reproduce
their actions within 1e-5. Lists "observation" and "action" may name inputs and outputs.
Any other key is an error."#;
/// Integral gain at every density ratio where only the feed-forward is given.
const KI: f32 = 0.05;

/// Help of `--hidden-activation`.
const HIDDEN_ACTIVATION: &str = "Activation between the layers of a safetensors file: relu, \
    leaky_relu(SLOPE), elu(SCALE), tanh, silu or gelu_tanh [assumed: relu]";

#[derive(Debug, Args)]
#[command(after_help = LAYOUT)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    source: Source,
    /// Policy file to write
    #[arg(long)]
    pub(super) out: PathBuf,
    /// Name of the policy, at most 64 bytes [default: the file's name]
    #[arg(long)]
    pub(super) name: Option<String>,
    /// Layers of a safetensors file in order, such as mu.0,mu.2,mu.4
    #[arg(long, value_delimiter = ',', conflicts_with_all = ["onnx", "json"])]
    layers: Option<Vec<String>>,
    /// Tensors or modules of a safetensors file that do not change the actions
    #[arg(long, value_delimiter = ',', conflicts_with_all = ["onnx", "json"])]
    ignore: Vec<String>,
    #[arg(long, value_parser = activation::hidden, value_name = "NAME",
        conflicts_with_all = ["onnx", "json"], help = HIDDEN_ACTIVATION)]
    hidden_activation: Option<Activation>,
    /// Activation after the last layer of a safetensors file, tanh or linear [assumed: tanh]
    #[arg(long, value_parser = activation::output, value_name = "NAME",
        conflicts_with_all = ["onnx", "json"])]
    output_activation: Option<OutputActivation>,
    /// Output of an ONNX file that is the action [assumed: the first]
    #[arg(long, value_name = "NAME", conflicts_with_all = ["safetensors", "json"])]
    output: Option<String>,
    /// CSV file with columns vx, y, rho, alpha, rs: the actor must give these actions
    #[arg(long, value_name = "FILE")]
    pub(super) check: Option<PathBuf>,
    /// Largest difference from the actions of --check, rad and m/s
    #[arg(long, default_value_t = check::TOLERANCE, value_parser = tolerance, requires = "check")]
    pub(super) check_tolerance: f64,
    /// Offset that is subtracted from the inputs: m/s, m, ratio
    #[arg(long, value_name = "VX,Y,RHO", value_parser = numbers::<3>, allow_hyphen_values = true)]
    observation_offset: Option<Numbers<3>>,
    /// Scale that the inputs are then multiplied by
    #[arg(long, value_name = "VX,Y,RHO", value_parser = numbers::<3>, allow_hyphen_values = true)]
    observation_scale: Option<Numbers<3>>,
    /// Offset that is added to the scaled outputs: rad, m/s
    #[arg(long, value_name = "ALPHA,RS", value_parser = numbers::<2>, allow_hyphen_values = true)]
    action_offset: Option<Numbers<2>>,
    /// Scale of the outputs: rad, m/s
    #[arg(long, value_name = "ALPHA,RS", value_parser = numbers::<2>, allow_hyphen_values = true)]
    action_scale: Option<Numbers<2>>,
    /// Lowest action: rad, m/s
    #[arg(long, value_name = "ALPHA,RS", value_parser = numbers::<2>, allow_hyphen_values = true)]
    action_low: Option<Numbers<2>>,
    /// Highest action: rad, m/s
    #[arg(long, value_name = "ALPHA,RS", value_parser = numbers::<2>, allow_hyphen_values = true)]
    action_high: Option<Numbers<2>>,
    /// Integral gain of the velocity cascade at every density ratio [with --feed-forward: 0.05]
    #[arg(long, value_parser = value_parser!(f32))]
    ki: Option<f32>,
    /// Feed-forward of the set-point at every density ratio [with --ki: 0]
    #[arg(long, value_parser = value_parser!(f32))]
    feed_forward: Option<f32>,
}

/// The source of the actor; exactly one is given.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct Source {
    /// Safetensors file to import
    #[arg(long, value_name = "FILE")]
    safetensors: Option<PathBuf>,
    /// ONNX file to import
    #[arg(long, value_name = "FILE")]
    onnx: Option<PathBuf>,
    /// JSON file to import, in the layout below
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn tolerance(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|x: &f64| x.is_finite() && *x >= 0.0);
    number.ok_or_else(|| "a tolerance is a finite number of 0 or more".into())
}

/// `N` numbers, separated by commas.
#[derive(Clone, Copy, Debug)]
struct Numbers<const N: usize>([f32; N]);

fn numbers<const N: usize>(text: &str) -> Result<Numbers<N>, String> {
    let number = |part: &str| {
        let finite = part.trim().parse().ok().filter(|x: &f32| x.is_finite());
        finite.ok_or_else(|| format!("'{part}' is not a finite number"))
    };
    let numbers: Vec<f32> = text.split(',').map(number).collect::<Result<_, _>>()?;
    let count = numbers.len();
    let numbers =
        numbers.try_into().map_err(|_| format!("{count} numbers, expected {N}, by commas"))?;
    Ok(Numbers(numbers))
}

impl Arguments {
    /// Returns the file to import.
    pub(super) fn path(&self) -> &Path {
        let Source { safetensors, onnx, json } = &self.source;
        let paths = [safetensors, onnx, json];
        paths.into_iter().flatten().next().expect("the group is required")
    }

    /// Returns every file that is read.
    pub(super) fn inputs(&self) -> impl Iterator<Item = &Path> {
        std::iter::once(self.path()).chain(self.check.as_deref())
    }

    /// Returns the values that the options state.
    pub(super) fn given(&self) -> ImportOptions {
        ImportOptions {
            observation_offset: self.observation_offset.map(|f| f.0),
            observation_scale: self.observation_scale.map(|f| f.0),
            action_offset: self.action_offset.map(|f| f.0),
            action_scale: self.action_scale.map(|f| f.0),
            action_low: self.action_low.map(|f| f.0),
            action_high: self.action_high.map(|f| f.0),
        }
    }

    /// Reads the actor from the content of the source.
    pub(super) fn imported_actor(&self, bytes: &[u8]) -> Result<ImportedActor, ImportError> {
        match &self.source {
            Source { safetensors: Some(_), .. } => {
                let options = StateDictOptions {
                    layers: self.layers.as_deref(),
                    ignored: &self.ignore,
                    hidden: self.hidden_activation,
                    output: self.output_activation,
                };
                safetensors::import(bytes, &options)
            }
            Source { onnx: Some(path), .. } => {
                let output = self.output.as_deref();
                onnx::import(bytes, &OnnxOptions { folders: &folders(path), output })
            }
            _ => json::import(bytes),
        }
    }

    /// Returns the gains of the options, which hold at every density ratio; `None` without any.
    pub(super) fn gains(&self) -> Option<Vec<GainPoint>> {
        (self.ki.is_some() || self.feed_forward.is_some()).then(|| {
            vec![GainPoint {
                density_ratio: 0.0,
                kp: 0.0,
                ki: self.ki.unwrap_or(KI),
                kd: 0.0,
                feed_forward: self.feed_forward.unwrap_or(0.0),
                limit_m_s: 10.0,
            }]
        })
    }
}

/// Returns the folder of a file by its name and, where that is a symbolic link, the folder of
/// the file itself.
fn folders(path: &Path) -> Vec<PathBuf> {
    let folder = |path: &Path| match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
        _ => PathBuf::from("."),
    };
    let real = path.canonicalize().ok();
    std::iter::once(folder(path)).chain(real.map(|real| folder(&real))).collect()
}
