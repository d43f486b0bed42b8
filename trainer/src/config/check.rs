//! The check of a configuration: every parameter against its row of the table, then the
//! relations between parameters.

use super::keys::{Limit, find};
use super::{Config, Exploration, Length, MediumDraw, Randomisation, Stage};
use std::f32::consts::PI;
use toml::Value;

/// The reason why a configuration cannot be trained.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// A parameter is out of its range.
    #[error("{key} is {value}, but must be {limit}; correct the configuration")]
    OutOfRange {
        /// Key of the parameter.
        key: String,
        /// Its value.
        value: String,
        /// Its limit.
        limit: String,
    },
}

pub(super) fn out_of_range(key: &str, value: &dyn ToString, limit: &dyn ToString) -> ConfigError {
    let (value, limit) = (value.to_string(), limit.to_string());
    ConfigError::OutOfRange { key: key.into(), value, limit }
}

impl Config {
    /// Checks every parameter and the relations between them.
    ///
    /// # Errors
    /// [`ConfigError`] with the first parameter out of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let value = Value::try_from(self)
            .map_err(|e| out_of_range("the configuration", &e, &"what TOML can hold"))?;
        check_value("", "", &value)?;
        match self.relations().into_iter().find(|(fine, ..)| !fine) {
            None => self.randomisation.as_ref().map_or(Ok(()), Randomisation::relations),
            Some((_, key, value, limit)) => Err(out_of_range(key, &value, &limit)),
        }
    }

    /// Returns the relations between parameters: whether each holds, its key, its value and its
    /// limit.
    fn relations(&self) -> Vec<(bool, &'static str, String, &'static str)> {
        let (n, l, e) = (&self.network, &self.learning, &self.episode);
        let ordered = |i: usize| n.action_low[i] <= n.action_high[i];
        let bounds = |i: usize| format!("{} to {}", n.action_low[i], n.action_high[i]);
        // Whether the actor's and the environment's ranges of unit space overlap.
        let reachable = |i: usize| {
            let unit = |x: f32| (x - n.action_offset[i]) / n.action_scale[i];
            unit(n.action_low[i]) < n.output_bound && unit(n.action_high[i]) > -n.output_bound
        };
        let starts = e.low_share + e.uniform_share;
        let counted_in_steps =
            matches!(self.stages.last(), Some(Stage { length: Length::Steps(_), .. }));
        let deviations = match self.exploration {
            Exploration::Gaussian { deviation } => deviation,
            Exploration::OrnsteinUhlenbeck { deviation, .. } => [deviation; 2],
        };
        let shares = |stage: &Stage| match stage.medium {
            MediumDraw::Mixed { air, thin, water, .. } => air + thin + water,
            _ => 0.0,
        };
        let media = self.stages.iter().map(shares).fold(0.0, f64::max);
        let densities: Vec<f32> = self.gains.iter().map(|g| g.density_ratio).collect();
        vec![
            (
                ordered(0) && n.action_high[0] <= PI,
                "network.action_low[0] to network.action_high[0]",
                bounds(0),
                "low to high, within 0 to pi rad",
            ),
            (
                ordered(1),
                "network.action_low[1] to network.action_high[1]",
                bounds(1),
                "low to high",
            ),
            (
                !n.symmetric_actor
                    || (n.observation_offset[0], n.action_offset[0]) == (0.0, PI / 2.0),
                "network.symmetric_actor",
                n.symmetric_actor.to_string(),
                "false, unless observation_offset[0] is 0 and action_offset[0] is pi/2, upright",
            ),
            (
                reachable(0) && reachable(1),
                "network.output_bound",
                n.output_bound.to_string(),
                "such that action_offset +- action_scale * output_bound meets the range from \
                 action_low to action_high",
            ),
            (
                l.replay_capacity >= l.batch,
                "learning.replay_capacity",
                l.replay_capacity.to_string(),
                "at least learning.batch",
            ),
            (
                deviations[0] <= deviations[1],
                "exploration.deviation",
                format!("{deviations:?}"),
                "lowest, then highest",
            ),
            (
                starts <= 1.0,
                "episode.low_share + episode.uniform_share",
                starts.to_string(),
                "at most 1",
            ),
            (
                0.0 < e.led_from[0] && e.led_from[0] <= e.led_from[1],
                "episode.led_from",
                format!("[{}, {}]", e.led_from[0], e.led_from[1]),
                "above 0 (the wanted speed is in proportion to 1 / density ratio), and ascending",
            ),
            (
                media <= 1.0 + 1e-9,
                "stages.medium.air + thin + water",
                media.to_string(),
                "at most 1",
            ),
            (
                self.selection.evaluations == 0 || (counted_in_steps && self.selection.starts > 0),
                "selection.evaluations",
                self.selection.evaluations.to_string(),
                "0, unless the last stage is counted in steps and selection.starts is above 0",
            ),
            (
                densities.windows(2).all(|w| w[0] < w[1]),
                "gains.density_ratio",
                format!("{densities:?}"),
                "ascending",
            ),
        ]
    }
}

/// Checks a value and everything in it. `path` is its path in the table of keys; `shown` is the
/// path for messages, with the indices of lists.
pub(super) fn check_value(path: &str, shown: &str, value: &Value) -> Result<(), ConfigError> {
    if let (Value::Table(table), "") = (value, path) {
        return table.iter().try_for_each(|(key, value)| check_value(key, key, value));
    }
    let Some(limit) = find(path).map(|key| key.limit) else {
        return Err(out_of_range(shown, value, &"a key of the table in config/keys.rs"));
    };
    let check = |fine: bool, value: String| {
        if fine { Ok(()) } else { Err(out_of_range(shown, &value, &limit)) }
    };
    match value {
        Value::Table(table) => table.iter().try_for_each(|(key, value)| {
            check_value(&format!("{path}.{key}"), &format!("{shown}.{key}"), value)
        }),
        Value::Array(items) => {
            check(limit.allows_length(items.len()), items.len().to_string())?;
            items
                .iter()
                .enumerate()
                .try_for_each(|(i, item)| check_value(path, &format!("{shown}[{i}]"), item))
        }
        Value::Float(x) => check(limit.allows_number(*x), shortest(*x)),
        Value::Integer(n) => check(limit.allows_whole(*n), n.to_string()),
        Value::String(text) => check(limit.allows_text(text), format!("{text:?}")),
        Value::Boolean(is) => check(matches!(limit, Limit::Flag), is.to_string()),
        Value::Datetime(time) => check(false, time.to_string()),
    }
}

/// Formats a number as it was written in single precision.
fn shortest(x: f64) -> String {
    let single = x as f32;
    if f64::from(single) == x { single.to_string() } else { x.to_string() }
}
