//! Finds the actor in a state dict, and accounts for every tensor of it.
//!
//! A PyTorch module names its linear layers by their path: `0.weight`, `actor.mu.2.weight`,
//! `fc1.weight`. The layers of one module form a row. A row from 3 inputs to 2 outputs, in
//! which each layer fits the next, can be the actor. What the row does not use is sorted by
//! [`unused`]: a tensor that could change the actions is never left out silently.

mod unused;

use super::ImportError;
use leg_control::actor::{Activation, INPUTS, MAX_LAYERS, OUTPUTS, OutputActivation};
use unused::Rest;

/// Largest number of layers or tensors that an error lists.
const MOST_LISTED: usize = 12;

/// The name of a tensor and its shape.
pub(super) type Named<'a> = (&'a str, &'a [usize]);

/// What the user states about a state dict.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StateDictOptions<'a> {
    /// Layers of the actor in order; `None` takes the only ones that can be an actor.
    pub layers: Option<&'a [String]>,
    /// Tensors, or modules of tensors, that do not change the actions.
    pub ignored: &'a [String],
    /// The activation between the layers; `None` takes ReLU.
    pub hidden: Option<Activation>,
    /// The activation after the last layer; `None` takes tanh.
    pub output: Option<OutputActivation>,
}

/// The actor's part of a state dict.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Found {
    /// Layers in their order.
    pub(super) row: Vec<Linear>,
    /// Tensors that scale the tanh, and are then added to it.
    pub(super) scale_and_bias: Option<[String; 2]>,
    /// Tensors that do not change the actions.
    pub(super) ignored: Vec<String>,
}

/// Finds the actor among tensors of these names and shapes.
///
/// # Errors
/// [`ImportError`] when there is not exactly one, and when a tensor is left over that could
/// change its actions.
pub(super) fn find(
    tensors: &[Named<'_>],
    options: &StateDictOptions<'_>,
) -> Result<Found, ImportError> {
    let linears = linears(tensors);
    let row = match options.layers {
        Some(paths) => named(&linears, paths)?,
        None => only_actor(&linears)?,
    };
    let Rest { scale_and_bias, ignored } = unused::sort(tensors, &row, options)?;
    Ok(Found { row, scale_and_bias, ignored })
}

/// A linear layer: `path.weight` of shape (outputs, inputs), and `path.bias`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Linear {
    pub(super) path: String,
    pub(super) inputs: usize,
    pub(super) outputs: usize,
}

impl Linear {
    pub(super) fn tensor(&self, kind: &str) -> String {
        format!("{}.{kind}", self.path)
    }

    /// Returns the path of its module, and its own name there.
    pub(super) fn place(&self) -> (&str, &str) {
        self.path.rsplit_once('.').unwrap_or(("", &self.path))
    }

    /// Returns its name with `#` for each number, and the numbers: `fc2` and `fc10` differ in
    /// their numbers only, which say their order. A name without its last number comes first:
    /// `hidden`, `hidden_2`.
    fn numbered(&self) -> (String, Vec<u64>) {
        let (mut pattern, mut numbers) = (String::new(), Vec::new());
        for digits in self.place().1.split_inclusive(|c: char| !c.is_ascii_digit()) {
            let (digits, other) = match digits.char_indices().next_back() {
                Some((at, c)) if !c.is_ascii_digit() => digits.split_at(at),
                _ => (digits, ""),
            };
            if !digits.is_empty() {
                numbers.push(digits.parse().unwrap_or(u64::MAX));
                pattern.push('#');
            }
            pattern.push_str(other);
        }
        let stem = pattern.trim_end_matches('#').trim_end_matches(['_', '-']);
        (stem.into(), numbers)
    }

    /// Returns whether the names say that this layer comes after another.
    fn comes_after(&self, other: &Self) -> bool {
        let ((stem, numbers), (other_stem, other_numbers)) = (self.numbered(), other.numbered());
        stem == other_stem && numbers > other_numbers
    }
}

/// Returns the linear layers, module by module.
fn linears(tensors: &[Named<'_>]) -> Vec<Linear> {
    let mut linears: Vec<Linear> = tensors
        .iter()
        .filter_map(|(name, shape)| match (name.strip_suffix(".weight"), *shape) {
            (Some(path), &[outputs, inputs]) => Some(Linear { path: path.into(), inputs, outputs }),
            _ => None,
        })
        .collect();
    linears.sort_by(|a, b| {
        let module = a.place().0.cmp(b.place().0);
        module.then_with(|| a.numbered().cmp(&b.numbered()))
    });
    linears
}

/// Returns the layers that the user names, in this order.
fn named(linears: &[Linear], paths: &[String]) -> Result<Vec<Linear>, ImportError> {
    let row = paths.iter().map(|path| {
        linears.iter().find(|l| l.path == *path).cloned().ok_or_else(|| {
            let found = format!("no \"{path}.weight\" of two dimensions");
            ImportError::value("layers", found, format!("some of {}", listed(linears)))
        })
    });
    let row: Vec<Linear> = row.collect::<Result<_, _>>()?;
    if is_actor(&row) {
        return Ok(row);
    }
    let expected = format!("from {INPUTS} to {OUTPUTS}, each fitting the next");
    Err(ImportError::value("layers", listed(&row), expected))
}

/// Returns the row that can be the actor, if there is exactly one.
fn only_actor(linears: &[Linear]) -> Result<Vec<Linear>, ImportError> {
    let modules = linears.chunk_by(|a, b| a.place().0 == b.place().0);
    let mut rows: Vec<Vec<Linear>> = modules.flat_map(rows_of).collect();
    match (rows.pop(), rows.is_empty()) {
        (Some(row), true) => Ok(row),
        (None, _) => Err(ImportError::NoActor { found: listed(linears) }),
        (Some(last), false) => {
            rows.push(last);
            Err(ImportError::Ambiguous { candidates: rows.iter().map(|r| names_of(r)).collect() })
        }
    }
}

/// Returns every order of a module's layers in which it can be an actor, and which their names
/// do not contradict.
fn rows_of(layers: &[Linear]) -> Vec<Vec<Linear>> {
    if layers.len() > MAX_LAYERS {
        return vec![];
    }
    let mut rows = vec![vec![]];
    for _ in layers {
        let longer = |row: &Vec<Linear>| {
            let rest: Vec<&Linear> = layers.iter().filter(|l| !row.contains(l)).collect();
            let next = rest.iter().filter(|l| !rest.iter().any(|other| l.comes_after(other)));
            next.map(|&next| [row.as_slice(), std::slice::from_ref(next)].concat()).collect()
        };
        rows = rows.iter().flat_map(|row| -> Vec<Vec<Linear>> { longer(row) }).collect();
    }
    rows.retain(|row| is_actor(row));
    rows
}

fn is_actor(row: &[Linear]) -> bool {
    row.len() <= MAX_LAYERS
        && row.first().is_some_and(|l| l.inputs == INPUTS)
        && row.last().is_some_and(|l| l.outputs == OUTPUTS)
        && row.windows(2).all(|pair| pair[0].outputs == pair[1].inputs)
}

/// Returns the paths of the layers, by commas.
pub(super) fn names_of(row: &[Linear]) -> String {
    let paths: Vec<&str> = row.iter().map(|l| l.path.as_str()).collect();
    paths.join(",").escape_debug().to_string()
}

/// Returns whether the layers are numbered as in an `nn.Sequential` with more between them than
/// one activation.
pub(super) fn has_gaps(row: &[Linear]) -> bool {
    let numbers: Option<Vec<u64>> = row.iter().map(|l| l.place().1.parse().ok()).collect();
    numbers.is_some_and(|n| n.windows(2).any(|pair| pair[1] > pair[0] + 2))
}

fn listed(linears: &[Linear]) -> String {
    let one = |l: &Linear| format!("{} ({} to {})", l.path.escape_debug(), l.inputs, l.outputs);
    match linears {
        [] => "no linear layers".into(),
        _ => shortened(linears.iter().map(one)),
    }
}

/// Joins a list by commas, and counts what is too much.
pub(super) fn shortened(list: impl ExactSizeIterator<Item = String>) -> String {
    let count = list.len();
    let mut shown: Vec<String> = list.take(MOST_LISTED).collect();
    if count > MOST_LISTED {
        shown.push(format!("and {} more", count - MOST_LISTED));
    }
    shown.join(", ")
}

#[cfg(test)]
mod tests;
