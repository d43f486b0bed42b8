//! Safetensors: an actor as the state dict of a PyTorch `nn.Sequential`.
//!
//! An actor 3-50-50-2 is `0.weight` (50, 3), `0.bias` (50), `2.weight` (50, 50),
//! `2.bias`, `4.weight` (2, 50), `4.bias`, all F32: what
//! `nn.Sequential(Linear, ReLU, Linear, ReLU, Linear, Tanh)` loads. The scalings, the
//! gains and the rest are in the metadata, see [`super::model_card`].

use super::ImportError;
use super::imported::ImportedActor;
use super::model_card::{KEY, ModelCard};
use super::state_dict;
use crate::net::mlp::Layer;
use crate::policy::PackedActor;
use leg_control::policy::Policy;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};

/// A policy as a safetensors file: the same bytes every time.
///
/// # Panics
/// Never: the shapes of an actor's layers are those of their weights.
#[must_use]
pub fn export(policy: &Policy<'_>) -> Vec<u8> {
    let layers = PackedActor::from(policy).layers();
    let tensors = layers.iter().enumerate().flat_map(|(i, layer)| {
        let view = |shape, data| TensorView::new(Dtype::F32, shape, bytemuck::cast_slice(data));
        let shape = vec![layer.bias.len(), layer.inputs];
        [
            (format!("{}.weight", 2 * i), view(shape, &layer.weights).expect("its shape")),
            (
                format!("{}.bias", 2 * i),
                view(vec![layer.bias.len()], &layer.bias).expect("its own"),
            ),
        ]
    });
    let metadata = [(KEY.to_owned(), ModelCard::from(policy).to_json())].into();
    safetensors::serialize(tensors, Some(metadata)).expect("as many bytes as the shapes say")
}

/// Reads an actor: the layers named, or else the only ones that could be an actor.
///
/// # Errors
/// [`ImportError`] names the tensor, what is there and what should be.
pub fn import(bytes: &[u8], layers: Option<&[String]>) -> Result<ImportedActor, ImportError> {
    let file = SafeTensors::deserialize(bytes)?;
    let (_, metadata) = SafeTensors::read_metadata(bytes)?;
    let card = metadata.metadata().as_ref().and_then(|m| m.get(KEY));
    let card = card.map(|json| ModelCard::parse(json)).transpose()?;
    let infos = metadata.tensors();
    let linears =
        state_dict::linears(infos.iter().map(|(name, i)| (name.as_str(), i.shape.as_slice())));
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

fn layer(file: &SafeTensors<'_>, linear: &state_dict::Linear) -> Result<Layer, ImportError> {
    let weights = numbers(file, &linear.tensor("weight"), &[linear.outputs, linear.inputs])?;
    let bias = numbers(file, &linear.tensor("bias"), &[linear.outputs])?;
    Ok(Layer { inputs: linear.inputs, weights, bias })
}

/// The numbers of a tensor of this shape; those of F64 are rounded.
fn numbers(file: &SafeTensors<'_>, name: &str, shape: &[usize]) -> Result<Vec<f32>, ImportError> {
    let error =
        |found: String, expected: String| ImportError::value(format!("{name:?}"), found, expected);
    let Ok(tensor) = file.tensor(name) else {
        return Err(error("missing".into(), format!("a tensor of shape {shape:?}")));
    };
    if tensor.shape() != shape {
        return Err(error(format!("shape {:?}", tensor.shape()), format!("{shape:?}")));
    }
    // Not cast in place: the tensor may lie at any address.
    let data = tensor.data();
    let numbers: Vec<f32> = match tensor.dtype() {
        Dtype::F32 => data.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect(),
        Dtype::F64 => data.as_chunks().0.iter().map(|&b| f64::from_le_bytes(b) as f32).collect(),
        other => return Err(error(format!("dtype {other:?}"), "F32 or F64".into())),
    };
    match numbers.iter().position(|x| !x.is_finite()) {
        None => Ok(numbers),
        Some(i) => Err(ImportError::value(
            format!("{name:?}, figure {i}"),
            numbers[i].to_string(),
            "a finite number within f32",
        )),
    }
}
