//! From an ONNX file to an actor.

use super::proto::{Model, Node};
use super::walk::{Edge, Walk};
use crate::bridge::ImportError;
use crate::bridge::imported::{Assumption, ImportedActor, Subject};
use crate::bridge::model_card::{KEY, ModelCard};
use leg_control::actor::OutputActivation;
use prost::Message;
use std::collections::HashMap;
use std::path::PathBuf;

/// Longest list of reasons in an error.
const MOST_REASONS: usize = 4;
/// Operator set of a file that does not state one: newer than all changes of interest here.
const NEWEST: i64 = i64::MAX;

/// What the user states about an ONNX file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OnnxOptions<'a> {
    /// Folders in which weights in other files may lie: that of the file by its name and, where
    /// this is a symbolic link, that of the file itself.
    pub folders: &'a [PathBuf],
    /// The output that is the action; `None` takes the first one.
    pub output: Option<&'a str>,
}

/// Reads an actor.
///
/// # Errors
/// [`ImportError`] names the node that an actor cannot have.
pub fn import(bytes: &[u8], options: &OnnxOptions<'_>) -> Result<ImportedActor, ImportError> {
    let model = Model::decode(bytes)?;
    let graph = model.graph.ok_or_else(|| ImportError::Graph("no graph in it".into()))?;
    let card = model.metadata_props.iter().find(|e| e.key == KEY);
    let card = card.map(|e| ModelCard::parse(&e.value)).transpose()?;
    let plain = model.opset_import.iter().find(|o| matches!(o.domain.as_str(), "" | "ai.onnx"));
    let opset = plain.map_or(NEWEST, |o| o.version);
    let edges = Walk::new(options.folders, opset).through(&graph)?;
    let names: Vec<&str> = graph.output.iter().map(|o| o.name.as_str()).collect();
    Ok(ImportedActor { card, ..chosen(&names, &edges, options.output)? })
}

/// Returns the actor of the output that is the action.
fn chosen(
    outputs: &[&str],
    edges: &HashMap<&str, Edge<'_>>,
    wanted: Option<&str>,
) -> Result<ImportedActor, ImportError> {
    let read = |name: &str| {
        let actor = match edges.get(name) {
            Some(Edge::Signal(signal)) => signal.clone().imported_actor(),
            Some(Edge::Other(why, _)) => Err(why.to_string()),
            Some(Edge::Stored(_) | Edge::Constant(_) | Edge::Shape(_)) => {
                Err("it does not depend on the observation".into())
            }
            None => Err("no node gives it".into()),
        };
        actor.map_err(|why| format!("output {name:?}: {why}"))
    };
    let Some(&first) = outputs.first() else {
        return Err(ImportError::Graph("it has no output".into()));
    };
    let name = match wanted {
        None => first,
        Some(wanted) => *outputs.iter().find(|name| **name == wanted).ok_or_else(|| {
            let expected = format!("one of {}", outputs.join(", "));
            ImportError::value("output", format!("{wanted:?}"), expected)
        })?,
    };
    let others = outputs.iter().copied().filter(|other| *other != name);
    // Beside a tanh, sums on their own are those before it, or of a deviation.
    let chosen = read(name);
    let is_tanh = |actor: &ImportedActor| actor.activations.output == OutputActivation::Tanh;
    let competes = |other: &ImportedActor| !chosen.as_ref().is_ok_and(is_tanh) || is_tanh(other);
    let readable: Vec<&str> =
        others.clone().filter(|other| read(other).is_ok_and(|actor| competes(&actor))).collect();
    let mut actor = match (chosen.clone(), wanted, readable.first()) {
        (Ok(actor), None, Some(_)) => {
            drop(actor);
            let names = std::iter::once(name).chain(readable).map(|n| format!("{n:?}")).collect();
            return Err(ImportError::Outputs { names });
        }
        (Ok(actor), ..) => actor,
        (Err(reason), None, Some(&other)) => {
            return Err(ImportError::OtherOutput { reason, other: other.into() });
        }
        (Err(reason), None, None) => {
            let reasons = others.filter_map(|other| read(other).err()).take(MOST_REASONS - 1);
            let reasons: Vec<String> = std::iter::once(reason).chain(reasons).collect();
            return Err(ImportError::Graph(reasons.join("; ")));
        }
        (Err(reason), Some(_), _) => return Err(ImportError::Graph(reason)),
    };
    if outputs.len() > 1 {
        let rest: Vec<String> = others.map(|other| format!("{other:?}")).collect();
        let text = format!("output {name:?}, not {}", rest.join(", "));
        match wanted {
            None => actor.assumed.push(Assumption::new(Subject::Output, text)),
            Some(_) => actor.taken.push(text),
        }
    }
    Ok(actor)
}

/// Describes a node in a message.
pub(super) fn label(node: &Node) -> String {
    format!("node {} {:?}", node.op_type.escape_debug(), node.name)
}
