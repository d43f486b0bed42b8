//! Hyper-parameters as the plugin `HParams` of TensorBoard reads them.
//!
//! The fields are those of `tensorboard/plugins/hparams/plugin_data.proto` and of
//! `google/protobuf/struct.proto` that are used here.

use super::event::Value;
use crate::train::Training;
use prost::Message;
use std::collections::BTreeMap;

const PLUGIN: &str = "hparams";
const SUCCESS: i32 = 1;
const FAILURE: i32 = 2;

/// What the plugin reads of a training.
#[derive(Clone, PartialEq, Message)]
struct PluginData {
    #[prost(message, optional, tag = "3")]
    start: Option<SessionStart>,
    #[prost(message, optional, tag = "4")]
    end: Option<SessionEnd>,
}

#[derive(Clone, PartialEq, Message)]
struct SessionStart {
    /// Every parameter by its name.
    #[prost(btree_map = "string, message", tag = "1")]
    hparams: BTreeMap<String, Parameter>,
    #[prost(double, tag = "5")]
    start_time_secs: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
struct SessionEnd {
    #[prost(int32, tag = "1")]
    status: i32,
    #[prost(double, tag = "2")]
    end_time_secs: f64,
}

/// A value: one of the fields.
#[derive(Clone, PartialEq, Message)]
struct Parameter {
    #[prost(double, optional, tag = "2")]
    number: Option<f64>,
    #[prost(string, optional, tag = "3")]
    text: Option<String>,
    #[prost(bool, optional, tag = "4")]
    truth: Option<bool>,
}

/// Returns the event with the parameters of a training.
pub(super) fn session_start(training: &Training, start_time_secs: f64) -> Value {
    let config: toml::Table = training.config().to_toml().parse().expect("its own output");
    let mut hparams = BTreeMap::new();
    flatten("", &toml::Value::Table(config), &mut hparams);
    hparams.insert("seed".into(), number(training.seed() as f64));
    let start = Some(SessionStart { hparams, start_time_secs });
    data("_hparams_/session_start_info", &PluginData { start, end: None })
}

/// Returns the event that a training has ended: with its policy, or by divergence.
pub(super) fn session_end(is_good: bool, end_time_secs: f64) -> Value {
    let status = if is_good { SUCCESS } else { FAILURE };
    let end = Some(SessionEnd { status, end_time_secs });
    data("_hparams_/session_end_info", &PluginData { start: None, end })
}

fn data(tag: &str, data: &PluginData) -> Value {
    Value::data(tag, PLUGIN, data.encode_to_vec())
}

fn number(x: f64) -> Parameter {
    Parameter { number: Some(x), ..Parameter::default() }
}

/// Adds all values in `value` by their full names; the tables of a list are numbered, other lists
/// are texts.
fn flatten(name: &str, value: &toml::Value, all: &mut BTreeMap<String, Parameter>) {
    let below = |key: &str| if name.is_empty() { key.into() } else { format!("{name}.{key}") };
    let parameter = match value {
        toml::Value::Table(table) => {
            return table.iter().for_each(|(key, value)| flatten(&below(key), value, all));
        }
        toml::Value::Array(list) if list.iter().any(toml::Value::is_table) => {
            let numbered = list.iter().enumerate();
            return numbered.for_each(|(i, value)| flatten(&below(&i.to_string()), value, all));
        }
        toml::Value::Integer(n) => number(*n as f64),
        toml::Value::Float(x) => number(*x),
        toml::Value::Boolean(truth) => Parameter { truth: Some(*truth), ..Parameter::default() },
        toml::Value::String(text) => Parameter { text: Some(text.clone()), ..Parameter::default() },
        other => Parameter { text: Some(other.to_string()), ..Parameter::default() },
    };
    all.insert(name.into(), parameter);
}
