//! Actors in JSON, in the layout of the published actors (doi 10.5281/zenodo.4607469) as read
//! out of their files:
//!
//! ```json
//! {"hidden_activation": "relu",
//!  "output": "clip(output_scale*tanh(z), low, high)",
//!  "output_scale": 2.617993877991494, "low": [0.314, 0.0], "high": [2.618, 2.0],
//!  "layers": [{"weights": [[...], ...], "bias": [...]}, ...],
//!  "test_vectors": [{"observation": [vx, y, rho], "action": [alpha, rs]}, ...]}
//! ```
//!
//! Weights are row by output. Test vectors are optional; the imported actor must reproduce
//! their actions within 1e-5. Lists `observation` and `action` may name inputs and outputs, in
//! this order: `apex_vx_m_s`, `apex_y_m`, `density_ratio`; `touchdown_angle_rad`,
//! `elongation_speed_m_s`. Any other key is an error.

use super::ImportError;
use super::imported::ImportedActor;
use super::{activation, unique_json};
use crate::policy::PackedActor;
use leg_control::actor::{ActionScaling, Activations, Observation, ObservationScaling};
use leg_ddpg::Layer;
use serde_json::Value;

/// Largest error of an imported actor against its test vectors, rad and m/s.
const TOLERANCE: f64 = 1e-5;
/// The only output stage of this layout.
const OUTPUT: &str = "clip(output_scale*tanh(z), low, high)";

/// The keys of the layout.
const KEYS: [&str; 9] = [
    "observation",
    "action",
    "hidden_activation",
    "output",
    "output_scale",
    "low",
    "high",
    "layers",
    "test_vectors",
];
/// The names of the inputs, where a file gives them.
const OBSERVATION: [&str; 3] = ["apex_vx_m_s", "apex_y_m", "density_ratio"];
/// The names of the outputs, where a file gives them.
const ACTION: [&str; 2] = ["touchdown_angle_rad", "elongation_speed_m_s"];

/// A value and its path.
struct At<'a> {
    key: String,
    value: Option<&'a Value>,
}

impl At<'_> {
    fn error(&self, expected: impl Into<String>) -> ImportError {
        let found = match self.value {
            None => "missing".into(),
            Some(Value::Array(a)) => format!("a list of {}", a.len()),
            Some(Value::Object(_)) => "an object".into(),
            Some(other) => other.to_string(),
        };
        ImportError::Value { key: self.key.clone(), found, expected: expected.into() }
    }

    fn field(&self, name: &str) -> Self {
        let dot = if self.key.is_empty() { "" } else { "." };
        Self {
            key: format!("{}{dot}{name}", self.key),
            value: self.value.and_then(|v| v.get(name)),
        }
    }

    /// Refuses an object with a key that is none of these.
    fn only(&self, keys: &[&str]) -> Result<(), ImportError> {
        let Some(object) = self.value.and_then(Value::as_object) else {
            return Err(self.error("an object"));
        };
        match object.keys().find(|key| !keys.contains(&key.as_str())) {
            None => Ok(()),
            Some(key) => {
                let key = self.field(key).key.escape_debug().to_string();
                Err(ImportError::value(key, "an unknown key", format!("only {}", keys.join(", "))))
            }
        }
    }

    /// Refuses a list of names other than these, where there is one.
    fn names(&self, wanted: &[&str]) -> Result<(), ImportError> {
        match self.value {
            None => Ok(()),
            Some(Value::Array(names)) if names.iter().eq(wanted.iter()) => Ok(()),
            Some(_) => Err(self.error(format!("the list {wanted:?}, in this order"))),
        }
    }

    fn list(&self) -> Result<Vec<Self>, ImportError> {
        let list = self.value.and_then(Value::as_array).ok_or_else(|| self.error("a list"))?;
        Ok(list
            .iter()
            .enumerate()
            .map(|(i, value)| Self { key: format!("{}[{i}]", self.key), value: Some(value) })
            .collect())
    }

    fn number(&self) -> Result<f64, ImportError> {
        let number = self.value.and_then(Value::as_f64);
        number.filter(|x| (*x as f32).is_finite()).ok_or_else(|| self.error("a finite number"))
    }

    fn numbers(&self, count: usize) -> Result<Vec<f64>, ImportError> {
        let list = self.list()?;
        if list.len() != count {
            return Err(self.error(format!("a list of {count}")));
        }
        list.iter().map(Self::number).collect()
    }

    fn array<const N: usize>(&self) -> Result<[f64; N], ImportError> {
        let numbers = self.numbers(N)?;
        Ok(std::array::from_fn(|i| numbers[i]))
    }

    fn text(&self, wanted: &str) -> Result<(), ImportError> {
        if self.value.and_then(Value::as_str) == Some(wanted) {
            return Ok(());
        }
        Err(self.error(format!("\"{wanted}\"")))
    }

    fn layer(&self, inputs: usize) -> Result<Layer, ImportError> {
        self.only(&["weights", "bias"])?;
        let rows = self.field("weights").list()?;
        let mut weights = Vec::new();
        for row in &rows {
            weights.extend(row.numbers(inputs)?.iter().map(|&x| x as f32));
        }
        let bias = self.field("bias").numbers(rows.len())?;
        Ok(Layer { inputs, weights, bias: bias.iter().map(|&x| x as f32).collect() })
    }
}

/// Reads an actor from a JSON file, which states everything.
///
/// # Errors
/// [`ImportError`] names the key, what was found and what was expected.
pub fn import(bytes: &[u8]) -> Result<ImportedActor, ImportError> {
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let found = format!("byte {} is not UTF-8", e.valid_up_to());
        ImportError::value("text", found, "JSON in UTF-8")
    })?;
    let packed = from_json(text)?;
    let ActionScaling { scale, offset, low, high } = packed.action;
    Ok(ImportedActor {
        layers: packed.layers(),
        observation: Some(packed.observation),
        action: Some([scale, offset]),
        low: Some(low),
        high: Some(high),
        activations: packed.activations,
        ..ImportedActor::default()
    })
}

/// Reads an actor from JSON.
///
/// # Errors
/// [`ImportError`] names the key, what was found and what was expected.
pub fn from_json(text: &str) -> Result<PackedActor, ImportError> {
    let value = unique_json::parse(text)?;
    let root = At { key: String::new(), value: Some(&value) };
    root.only(&KEYS)?;
    root.field("observation").names(&OBSERVATION)?;
    root.field("action").names(&ACTION)?;
    let hidden = root.field("hidden_activation");
    let name = hidden.value.and_then(Value::as_str);
    let named = name.and_then(|name| activation::hidden(name).ok());
    let named = named.ok_or_else(|| hidden.error(format!("one of {}", activation::NAMES)))?;
    let activations = Activations { hidden: named, ..Activations::default() };
    root.field("output").text(OUTPUT)?;
    let scale = root.field("output_scale").number()? as f32;
    let f32s = |x: [f64; 2]| x.map(|x| x as f32);
    let action = ActionScaling {
        scale: [scale; 2],
        offset: [0.0; 2],
        low: f32s(root.field("low").array()?),
        high: f32s(root.field("high").array()?),
    };
    for i in 0..2 {
        if action.low[i] > action.high[i] {
            let expected = format!("at most high[{i}], {}", action.high[i]);
            return Err(root.field("low").list()?[i].error(expected));
        }
    }
    let mut layers: Vec<Layer> = Vec::new();
    for layer in root.field("layers").list()? {
        let inputs = layers.last().map_or(3, |l| l.bias.len());
        layers.push(layer.layer(inputs)?);
    }
    let packed = PackedActor::new(&layers, activations, ObservationScaling::IDENTITY, action)?;
    let vectors = root.field("test_vectors");
    if vectors.value.is_some() {
        let actor = packed.actor();
        for (index, vector) in vectors.list()?.iter().enumerate() {
            vector.only(&["observation", "action"])?;
            let [vx, y, rho] = vector.field("observation").array::<3>()?.map(|x| x as f32);
            let expected: [f64; 2] = vector.field("action").array()?;
            let action =
                actor.act(Observation { apex_vx_m_s: vx, apex_y_m: y, density_ratio: rho });
            let found = [action.touchdown_angle_rad, action.elongation_speed_m_s].map(f64::from);
            if (0..2).any(|i| (found[i] - expected[i]).abs() > TOLERANCE) {
                return Err(ImportError::TestVector {
                    index,
                    expected,
                    found,
                    tolerance: TOLERANCE,
                });
            }
        }
    }
    Ok(packed)
}

#[cfg(test)]
mod tests {
    use super::from_json;
    use serde_json::{Value, json};

    fn small() -> Value {
        json!({
            "hidden_activation": "relu", "output": super::OUTPUT, "output_scale": 2.0,
            "low": [0.3, 0.0], "high": [2.6, 2.0],
            "layers": [{"weights": [[0.5, 0.0, 0.0], [0.0, 0.25, 0.0]], "bias": [0.0, 0.5]}],
            "test_vectors": [{"observation": [1.0, 2.0, 0.0],
                              "action": [2.0 * 0.5_f64.tanh(), 2.0 * 1.0_f64.tanh()]}],
        })
    }

    #[test]
    fn an_imported_actor_reproduces_its_test_vector() {
        let packed = from_json(&small().to_string()).unwrap();
        assert_eq!(packed.widths.as_slice(), [3, 2]);
    }

    #[test]
    fn errors_name_the_key_and_its_value() {
        let refused = |change: &dyn Fn(&mut Value)| {
            let mut value = small();
            change(&mut value);
            from_json(&value.to_string()).unwrap_err().to_string()
        };
        assert_eq!(
            refused(&|v| v["layers"][0]["weights"][1][1] = json!("x")),
            "layers[0].weights[1][1]: \"x\", expected a finite number"
        );
        assert_eq!(
            refused(&|v| v["layers"][0]["bias"] = json!([1.0])),
            "layers[0].bias: a list of 1, expected a list of 2"
        );
        assert_eq!(
            refused(&|v| _ = v.as_object_mut().unwrap().remove("low")),
            "low: missing, expected a list"
        );
        assert_eq!(
            refused(&|v| v["hidden_activation"] = json!("gelu")),
            format!("hidden_activation: \"gelu\", expected one of {}", super::activation::NAMES)
        );
        assert_eq!(
            refused(&|v| v["low"] = json!([0.3, 2.5])),
            "low[1]: 2.5, expected at most high[1], 2"
        );
        assert_eq!(
            refused(&|v| v["high"][0] = json!(1e39)),
            "high[0]: 1e+39, expected a finite number"
        );
        assert!(
            refused(&|v| v["test_vectors"][0]["action"][0] = json!(0.5))
                .starts_with("test_vectors[0].action: [0.5, ")
        );
        assert_eq!(
            refused(&|v| v["layers"][0]["weigths"] = json!([])),
            "layers[0].weigths: an unknown key, expected only weights, bias"
        );
        assert!(refused(&|v| v["obs_mean"] = json!([0, 1, 0])).starts_with("obs_mean: an unknown"));
        assert!(
            refused(&|v| v["test_vectors"][0]["y"] = json!(1)).starts_with("test_vectors[0].y: an")
        );
        assert!(
            refused(&|v| v["observation"] = json!(["apex_y_m", "apex_vx_m_s", "density_ratio"]))
                .starts_with("observation: a list of 3, expected the list [\"apex_vx_m_s\"")
        );
        assert!(
            refused(&|v| v["layers"] = json!([1])).starts_with("layers[0]: 1, expected an obj")
        );
        assert!(refused(&|v| v["layers"] = json!([])).starts_with("layers: 0 layers"));
        let twice = small().to_string().replacen('{', "{\"low\": [0.3, 0.0], ", 1);
        let error = from_json(&twice).unwrap_err().to_string();
        assert!(error.starts_with("not JSON: the key \"low\" for the second time"), "{error}");
        assert!(from_json("{").unwrap_err().to_string().starts_with("not JSON"));
    }
}
