//! Safetensors: an actor as the state dict of a PyTorch `nn.Sequential`.
//!
//! An actor 3-50-50-2 has the tensors `0.weight` (50, 3), `0.bias` (50), `2.weight`
//! (50, 50), `2.bias` (50), `4.weight` (2, 50) and `4.bias` (2), all F32. These are what
//! `nn.Sequential(Linear, ReLU, Linear, ReLU, Linear, Tanh)` loads. Scalings, gains and
//! origin are in the metadata, see [`super::model_card`].

mod container;

use super::ImportError;
use super::half::{from_bfloat16, from_float16};
use super::imported::{Assumption, ImportedActor, Subject};
use super::model_card::{KEY, ModelCard};
use super::state_dict::{self, Found, Linear, Named, has_gaps, names_of};
use crate::policy::PackedActor;
use container::Container;
use leg_control::actor::{Activations, OutputActivation};
use leg_control::policy::Policy;
use leg_ddpg::Layer;

pub use super::state_dict::StateDictOptions;

/// Writes a policy as a safetensors file. The same policy gives the same bytes.
#[must_use]
pub fn export(policy: &Policy<'_>) -> Vec<u8> {
    let layers = PackedActor::from(policy).layers();
    let tensors = layers.into_iter().enumerate().flat_map(|(i, layer)| {
        let shape = vec![layer.bias.len(), layer.inputs];
        let bias_shape = vec![layer.bias.len()];
        [
            (format!("{}.weight", 2 * i), (shape, layer.weights)),
            (format!("{}.bias", 2 * i), (bias_shape, layer.bias)),
        ]
    });
    let metadata = [(KEY.to_owned(), ModelCard::from(policy).to_json())].into();
    container::write(tensors.collect(), metadata)
}

/// Reads an actor.
///
/// # Errors
/// [`ImportError`] names the tensor, what was found and what was expected.
pub fn import(bytes: &[u8], options: &StateDictOptions<'_>) -> Result<ImportedActor, ImportError> {
    let file = container::read(bytes).map_err(ImportError::Safetensors)?;
    let card = file.metadata.get(KEY).map(|json| ModelCard::parse(json)).transpose()?;
    let tensors: Vec<Named<'_>> =
        file.tensors.iter().map(|(name, entry)| (name.as_str(), entry.shape.as_slice())).collect();
    let known = StateDictOptions {
        hidden: card.as_ref().map(|c| c.activations().hidden).or(options.hidden),
        output: card.as_ref().map(|c| c.activations().output).or(options.output),
        ..*options
    };
    let Found { row, scale_and_bias, ignored } = state_dict::find(&tensors, &known)?;
    let layers = row.iter().map(|linear| layer(&file, linear)).collect::<Result<_, _>>()?;
    let mut taken = vec![format!("layers {}", names_of(&row))];
    if card.is_some() {
        taken.push("the scalings of its metadata".into());
    }
    let mut action = card.as_ref().map(|c| [c.action.scale, c.action.offset]);
    if let Some(names) = scale_and_bias {
        if action.is_some() {
            let found = "a scaling of the actions beside that of the metadata";
            return Err(ImportError::value(format!("{:?}", names[0]), found, "one of the two"));
        }
        let [scale, bias] = &names;
        action = Some([pair(&file, scale)?, pair(&file, bias)?]);
        taken.push(format!("{scale} and {bias}"));
    }
    if !ignored.is_empty() {
        let names = ignored.iter().map(|name| name.escape_debug().to_string());
        taken.push(format!("not {}", state_dict::shortened(names)));
    }
    let unbiased = row.iter().map(|l| l.tensor("bias"));
    let unbiased: Vec<String> = unbiased.filter(|name| !file.tensors.contains_key(name)).collect();
    if !unbiased.is_empty() {
        taken.push(format!("biases of 0 for {}", state_dict::shortened(unbiased.into_iter())));
    }
    let activations = Activations {
        hidden: known.hidden.unwrap_or_default(),
        output: known.output.unwrap_or_default(),
    };
    Ok(ImportedActor {
        layers,
        activations,
        is_normalised: activations.output == OutputActivation::Tanh,
        observation: card.as_ref().map(|c| c.observation),
        action,
        low: card.as_ref().map(|c| c.action.low),
        high: card.as_ref().map(|c| c.action.high),
        card,
        taken,
        assumed: assumed(&known, &row),
    })
}

/// Returns the assumptions about what a state dict cannot state.
fn assumed(known: &StateDictOptions<'_>, row: &[Linear]) -> Vec<Assumption> {
    let mut assumed = Vec::new();
    if known.hidden.is_none() {
        let more = "; their numbers leave room for more, such as a normalisation without weights";
        let more = if has_gaps(row) { more } else { "" };
        let text = format!("ReLU between the layers, and nothing else{more}");
        assumed.push(Assumption::new(Subject::HiddenActivation, text));
    }
    if known.output.is_none() {
        assumed.push(Assumption::new(Subject::OutputActivation, "tanh after the last layer"));
    }
    assumed
}

/// Returns the numbers of a tensor for both actions; one number is for both.
fn pair(file: &Container<'_>, name: &str) -> Result<[f32; 2], ImportError> {
    let shape = file.tensors.get(name).map_or(&[][..], |entry| &entry.shape);
    let leading = shape.split_last().map_or(&[][..], |(_, leading)| leading);
    let values: usize = shape.iter().product();
    if !(values == 1 || values == 2 && leading.iter().all(|&n| n == 1)) {
        let expected = "a number for each of the two actions";
        return Err(ImportError::value(format!("{name:?}"), format!("shape {shape:?}"), expected));
    }
    let numbers = numbers(file, name, shape)?;
    Ok([0, 1].map(|i| numbers[i.min(values - 1)]))
}

fn layer(file: &Container<'_>, linear: &Linear) -> Result<Layer, ImportError> {
    let weights = numbers(file, &linear.tensor("weight"), &[linear.outputs, linear.inputs])?;
    let bias = linear.tensor("bias");
    let bias = if file.tensors.contains_key(&bias) {
        numbers(file, &bias, &[linear.outputs])?
    } else {
        vec![0.0; linear.outputs]
    };
    Ok(Layer { inputs: linear.inputs, weights, bias })
}

/// Returns the numbers of a tensor of this shape; F64 is rounded to f32.
fn numbers(file: &Container<'_>, name: &str, shape: &[usize]) -> Result<Vec<f32>, ImportError> {
    let error =
        |found: String, expected: String| ImportError::value(format!("{name:?}"), found, expected);
    let Some(entry) = file.tensors.get(name) else {
        return Err(error("missing".into(), format!("a tensor of shape {shape:?}")));
    };
    if entry.shape != shape {
        return Err(error(format!("shape {:?}", entry.shape), format!("{shape:?}")));
    }
    // Not cast in place: the tensor may be at any address.
    let data = file.data(entry);
    let numbers: Vec<f32> = match entry.dtype.as_str() {
        "F32" => data.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect(),
        "F64" => data.as_chunks().0.iter().map(|&b| f64::from_le_bytes(b) as f32).collect(),
        "F16" => data.as_chunks().0.iter().map(|&b| from_float16(u16::from_le_bytes(b))).collect(),
        "BF16" => {
            data.as_chunks().0.iter().map(|&b| from_bfloat16(u16::from_le_bytes(b))).collect()
        }
        other => return Err(error(format!("dtype {other}"), "F16, BF16, F32 or F64".into())),
    };
    match numbers.iter().position(|x| !x.is_finite()) {
        None => Ok(numbers),
        Some(i) => Err(ImportError::value(
            format!("{name:?}, number {i}"),
            numbers[i].to_string(),
            "a finite number within f32",
        )),
    }
}
