//! Finds the actor's layers in a state dict.
//!
//! A PyTorch module names its linear layers by their path: `0.weight`, `actor.mu.2.weight`,
//! `fc1.weight`. The layers of one module in their natural order form a row. A row from 3
//! inputs to 2 outputs, in which each layer fits the next, can be the actor.

use super::ImportError;
use leg_control::actor::{INPUTS, MAX_LAYERS, OUTPUTS};

/// Largest number of layers that an error lists.
const MOST_LISTED: usize = 12;

/// A linear layer: `path.weight` of shape (outputs, inputs), and `path.bias`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Linear {
    path: String,
    pub(super) inputs: usize,
    pub(super) outputs: usize,
}

impl Linear {
    pub(super) fn tensor(&self, kind: &str) -> String {
        format!("{}.{kind}", self.path)
    }

    /// Returns the path of its module, and its own name there.
    fn place(&self) -> (&str, &str) {
        self.path.rsplit_once('.').unwrap_or(("", &self.path))
    }

    /// Returns a sort key that puts `2` before `10`, and `fc2` before `fc10`.
    fn order(&self) -> (&str, &str, usize, &str) {
        let (module, name) = self.place();
        let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
        (module, stem, name.len(), name)
    }
}

/// Returns the linear layers among tensors of these names and shapes, in natural order.
pub(super) fn linears<'a>(tensors: impl Iterator<Item = (&'a str, &'a [usize])>) -> Vec<Linear> {
    let mut linears: Vec<Linear> = tensors
        .filter_map(|(name, shape)| match (name.strip_suffix(".weight"), shape) {
            (Some(path), &[outputs, inputs]) => Some(Linear { path: path.into(), inputs, outputs }),
            _ => None,
        })
        .collect();
    linears.sort_by(|a, b| a.order().cmp(&b.order()));
    linears
}

/// Returns the layers that the user names, in this order.
pub(super) fn named(linears: &[Linear], paths: &[String]) -> Result<Vec<Linear>, ImportError> {
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
pub(super) fn only_actor(linears: &[Linear]) -> Result<Vec<Linear>, ImportError> {
    let mut rows: Vec<&[Linear]> =
        linears.chunk_by(|a, b| a.place().0 == b.place().0).filter(|row| is_actor(row)).collect();
    match (rows.pop(), rows.is_empty()) {
        (Some(row), true) => Ok(row.to_vec()),
        (None, _) => Err(ImportError::NoActor { found: listed(linears) }),
        (Some(last), false) => {
            rows.push(last);
            Err(ImportError::Ambiguous { candidates: rows.into_iter().map(names_of).collect() })
        }
    }
}

fn is_actor(row: &[Linear]) -> bool {
    row.len() <= MAX_LAYERS
        && row.first().is_some_and(|l| l.inputs == INPUTS)
        && row.last().is_some_and(|l| l.outputs == OUTPUTS)
        && row.windows(2).all(|pair| pair[0].outputs == pair[1].inputs)
}

fn names_of(row: &[Linear]) -> String {
    let paths: Vec<&str> = row.iter().map(|l| l.path.as_str()).collect();
    paths.join(",").escape_debug().to_string()
}

fn listed(linears: &[Linear]) -> String {
    let mut list: Vec<String> = linears
        .iter()
        .take(MOST_LISTED)
        .map(|l| format!("{} ({} to {})", l.path.escape_debug(), l.inputs, l.outputs))
        .collect();
    match linears.len() {
        0 => return "no linear layers".into(),
        n if n > MOST_LISTED => list.push(format!("and {} more", n - MOST_LISTED)),
        _ => {}
    }
    list.join(", ")
}

#[cfg(test)]
mod tests {
    use super::{linears, named, only_actor};

    fn names(of: &[(&str, [usize; 2])], layers: Option<&str>) -> Result<Vec<String>, String> {
        let linears = linears(of.iter().map(|(name, shape)| (*name, shape.as_slice())));
        let row = match layers {
            None => only_actor(&linears),
            Some(paths) => named(&linears, &paths.split(',').map(String::from).collect::<Vec<_>>()),
        };
        row.map(|row| row.iter().map(|l| l.tensor("bias")).collect()).map_err(|e| e.to_string())
    }

    #[test]
    fn finds_a_sequential_in_numerical_order_of_its_layers() {
        let found =
            names(&[("10.weight", [2, 6]), ("2.weight", [6, 5]), ("0.weight", [5, 3])], None);
        assert_eq!(found.unwrap(), ["0.bias", "2.bias", "10.bias"]);
        let found = names(
            &[("a.fc_mu.weight", [2, 6]), ("a.fc1.weight", [5, 3]), ("a.fc2.weight", [6, 5])],
            None,
        );
        assert_eq!(found.unwrap(), ["a.fc1.bias", "a.fc2.bias", "a.fc_mu.bias"]);
    }

    #[test]
    fn finds_the_actor_beside_critics_but_asks_beside_its_target() {
        let critic = [("critic.0.weight", [9, 5]), ("critic.2.weight", [1, 9])];
        let actor = [("actor.mu.0.weight", [9, 3]), ("actor.mu.2.weight", [2, 9])];
        let target = [("actor_target.mu.0.weight", [9, 3]), ("actor_target.mu.2.weight", [2, 9])];
        let both = [critic, actor].concat();
        assert_eq!(names(&both, None).unwrap(), ["actor.mu.0.bias", "actor.mu.2.bias"]);
        let all = [critic, actor, target].concat();
        assert_eq!(
            names(&all, None).unwrap_err(),
            "2 rows of layers could be the actor: actor.mu.0,actor.mu.2 or \
             actor_target.mu.0,actor_target.mu.2"
        );
        let chosen = names(&all, Some("actor.mu.0,actor.mu.2"));
        assert_eq!(chosen.unwrap(), ["actor.mu.0.bias", "actor.mu.2.bias"]);
    }

    #[test]
    fn layers_of_several_modules_can_be_named() {
        // An SB3 SAC policy has these layers.
        let sac =
            [("latent_pi.0.weight", [7, 3]), ("mu.weight", [2, 7]), ("log_std.weight", [2, 7])];
        let error = names(&sac, None).unwrap_err();
        assert!(error.contains("log_std (7 to 2), mu (7 to 2), latent_pi.0 (3 to 7)"), "{error}");
        assert_eq!(names(&sac, Some("latent_pi.0,mu")).unwrap(), ["latent_pi.0.bias", "mu.bias"]);
        let error = names(&sac, Some("latent_pi.0,nu")).unwrap_err();
        assert!(
            error.starts_with("layers: no \"nu.weight\" of two dimensions, expected"),
            "{error}"
        );
        let error = names(&sac, Some("mu")).unwrap_err();
        assert!(error.starts_with("layers: mu (7 to 2), expected from 3 to 2"), "{error}");
        assert!(names(&[], None).unwrap_err().contains("it holds no linear layers"));
    }
}
