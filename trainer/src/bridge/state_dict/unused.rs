//! What becomes of the tensors of a state dict that are not the actor's layers.

use super::{Linear, Named, StateDictOptions, names_of, shortened};
use crate::bridge::ImportError;
use leg_control::actor::{INPUTS, OUTPUTS};

/// Names of the tensors by which `CleanRL` scales the tanh of its actors.
const SCALE_AND_BIAS: [&str; 2] = ["action_scale", "action_bias"];
/// What a module's name contains that belongs to another network.
const OTHER_NETWORKS: [&str; 4] = ["critic", "value", "target", "optim"];
/// What else the modules of critics are called, less a number at the end.
const CRITICS: [&str; 8] = ["q", "qf", "qs", "q_net", "qnet", "q_network", "v", "vf"];

/// The tensors beside the actor's layers.
#[derive(Debug, Default)]
pub(super) struct Rest {
    pub(super) scale_and_bias: Option<[String; 2]>,
    pub(super) ignored: Vec<String>,
}

/// What a tensor beside the layers is.
enum Role {
    /// A part of another network, or what the user says does not count.
    Ignored,
    /// A standard deviation of the actions that is no function of the observation.
    Deviation,
    /// Anything else: it could change the actions.
    Unknown,
}

/// Sorts the tensors that are not those of `row`.
///
/// # Errors
/// [`ImportError::Unused`] when one could change the actions, [`ImportError::Gaussian`] for an
/// actor whose actions have a fixed standard deviation, unless what follows its last layer is known.
pub(super) fn sort(
    tensors: &[Named<'_>],
    row: &[Linear],
    options: &StateDictOptions<'_>,
) -> Result<Rest, ImportError> {
    let module = common_module(row);
    let is_layer =
        |name: &str| row.iter().any(|l| name == l.tensor("weight") || name == l.tensor("bias"));
    let scale_and_bias = scale_and_bias(tensors, &module);
    let is_applied = |name: &str| scale_and_bias.iter().flatten().any(|n| n == name);
    let mut rest = Rest::default();
    let (mut unknown, mut deviation) = (Vec::new(), None);
    for &(name, shape) in tensors {
        if is_layer(name) || is_applied(name) {
            continue;
        }
        match role(name, shape, &module, options.ignored) {
            Role::Deviation if options.output.is_none() => deviation = Some(name.to_owned()),
            Role::Ignored | Role::Deviation => rest.ignored.push(name.to_owned()),
            Role::Unknown => unknown.push((name, shape)),
        }
    }
    if !unknown.is_empty() {
        return Err(ImportError::Unused {
            tensors: shortened(unknown.iter().map(|(name, shape)| format!("{name:?} {shape:?}"))),
            layers: names_of(row),
            kind: kind(&unknown),
        });
    }
    if let Some(tensor) = deviation {
        return Err(ImportError::Gaussian { tensor });
    }
    rest.scale_and_bias = scale_and_bias;
    Ok(rest)
}

fn role(name: &str, shape: &[usize], module: &[&str], ignored: &[String]) -> Role {
    let within = |path: &String| {
        name.strip_prefix(path.as_str())
            .is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    if ignored.iter().any(within) {
        return Role::Ignored;
    }
    let path: Vec<&str> = name.split('.').collect();
    // Only what is not the way to the actor tells another network.
    let same = path.iter().zip(module).take_while(|(a, b)| a == b).count();
    let own = same == module.len();
    if (!own || module.is_empty()) && path.iter().skip(same).any(|part| is_other_network(part)) {
        return Role::Ignored;
    }
    if path.iter().skip(same).any(|part| is_deviation(part)) {
        let values: usize = shape.iter().product();
        return match (path.last(), shape) {
            // A layer of its own, as in SAC: it gives the deviation only.
            (Some(&"weight"), [OUTPUTS, _]) | (Some(&"bias"), [OUTPUTS]) => Role::Ignored,
            _ if values == OUTPUTS || values == 1 => Role::Deviation,
            _ => Role::Unknown,
        };
    }
    Role::Unknown
}

fn is_other_network(part: &str) -> bool {
    let part = part.to_ascii_lowercase();
    let stem = part.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches('_');
    OTHER_NETWORKS.iter().any(|name| part.contains(name)) || CRITICS.contains(&stem)
}

fn is_deviation(part: &str) -> bool {
    let part = part.to_ascii_lowercase();
    ["log_std", "logstd", "log_sigma", "sigma"].iter().any(|name| part.contains(name))
        || part == "std"
}

/// Returns a guess at what tensors belong to.
fn kind(tensors: &[Named<'_>]) -> &'static str {
    let last = |name: &str| name.rsplit('.').next().unwrap_or_default().to_owned();
    let any = |holds: &dyn Fn(&str, &[usize]) -> bool| {
        tensors.iter().any(|(name, shape)| holds(&last(name), shape))
    };
    if any(&|_, shape| shape == [INPUTS]) {
        "perhaps a scaling of the observation"
    } else if any(&|name, _| name.starts_with("weight_ih") || name.starts_with("weight_hh")) {
        "a recurrent layer, which the controller does not have"
    } else if any(&|name, _| ["weight_g", "weight_v", "original0", "original1"].contains(&name)) {
        "weight normalisation; remove its parametrisation before saving"
    } else if any(&|name, _| name.starts_with("running_") || name == "num_batches_tracked") {
        "batch normalisation; fold it into the layer before it"
    } else if any(&|name, _| SCALE_AND_BIAS.contains(&name)) {
        "a scaling of the actions, not in a pair"
    } else if any(&|name, shape| name == "weight" && shape.len() == 2) {
        "perhaps another layer"
    } else if any(&|name, _| name == "weight" || name == "bias") {
        "perhaps a normalisation, which the controller does not have"
    } else {
        "what it does is not known"
    }
}

/// Returns the path that all modules of the layers share.
fn common_module(row: &[Linear]) -> Vec<&str> {
    let Some((first, others)) = row.split_first() else { return vec![] };
    let mut shared: Vec<&str> = first.place().0.split('.').filter(|p| !p.is_empty()).collect();
    for other in others {
        let other = other.place().0.split('.');
        let same = shared.iter().zip(other).take_while(|(a, b)| **a == *b).count();
        shared.truncate(same);
    }
    shared
}

/// Returns the pair of tensors that scale the actions, from the module of the actor or one
/// around it.
fn scale_and_bias(tensors: &[Named<'_>], module: &[&str]) -> Option<[String; 2]> {
    let pair = |depth: usize| {
        let path = module.get(..depth)?;
        let names = SCALE_AND_BIAS.map(|name| [path, &[name][..]].concat().join("."));
        names.iter().all(|name| tensors.iter().any(|(n, _)| n == name)).then_some(names)
    };
    (0..=module.len()).rev().find_map(pair)
}
