//! Safetensors: an actor as the state dict of a PyTorch `nn.Sequential`.
//!
//! An actor 3-50-50-2 has the tensors `0.weight` (50, 3), `0.bias` (50), `2.weight`
//! (50, 50), `2.bias` (50), `4.weight` (2, 50) and `4.bias` (2), all F32. These are what
//! `nn.Sequential(Linear, ReLU, Linear, ReLU, Linear, Tanh)` loads. Scalings, gains and
//! origin are in the metadata, see [`super::model_card`].

mod container;

use super::ImportError;
use super::imported::ImportedActor;
use super::model_card::{KEY, ModelCard};
use super::state_dict;
use crate::net::mlp::Layer;
use crate::policy::PackedActor;
use container::Container;
use leg_control::policy::Policy;

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

/// Reads an actor. `layers` names its layers in order; `None` takes the only ones that can
/// be an actor.
///
/// # Errors
/// [`ImportError`] names the tensor, what was found and what was expected.
pub fn import(bytes: &[u8], layers: Option<&[String]>) -> Result<ImportedActor, ImportError> {
    let file = container::read(bytes).map_err(ImportError::Safetensors)?;
    let card = file.metadata.get(KEY).map(|json| ModelCard::parse(json)).transpose()?;
    let linears = state_dict::linears(
        file.tensors.iter().map(|(name, entry)| (name.as_str(), entry.shape.as_slice())),
    );
    let row = match layers {
        Some(paths) => state_dict::named(&linears, paths)?,
        None => state_dict::only_actor(&linears)?,
    };
    let layers = row.iter().map(|linear| layer(&file, linear)).collect::<Result<_, _>>()?;
    let assumed = if card.is_some() {
        vec![]
    } else {
        vec!["ReLU between the layers, tanh after the last".to_owned()]
    };
    Ok(ImportedActor {
        layers,
        observation: card.as_ref().map(|c| c.observation),
        action: card.as_ref().map(|c| [c.action.scale, c.action.offset]),
        bounds: card.as_ref().map(|c| [c.action.low, c.action.high]),
        card,
        assumed,
    })
}

fn layer(file: &Container<'_>, linear: &state_dict::Linear) -> Result<Layer, ImportError> {
    let weights = numbers(file, &linear.tensor("weight"), &[linear.outputs, linear.inputs])?;
    let bias = numbers(file, &linear.tensor("bias"), &[linear.outputs])?;
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
        other => return Err(error(format!("dtype {other}"), "F32 or F64".into())),
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
