//! Values of Rust as values of Python and back, by way of JSON, and errors.

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fmt::Display;

/// Returns a `ValueError` with the sentence of an error.
pub(crate) fn bad_value(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Returns a `RuntimeError` with the sentence of an error.
pub(crate) fn failed(error: impl Display) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

/// Returns a value as dictionaries, lists, numbers and text.
///
/// # Errors
/// What the module `json` raises.
pub(crate) fn to_python<'py>(
    py: Python<'py>,
    value: &impl Serialize,
) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).map_err(failed)?;
    py.import("json")?.call_method1("loads", (text,))
}

/// Returns the value that a dictionary describes.
///
/// # Errors
/// `TypeError` for what has no form in JSON; `ValueError` for what is not known, or of another
/// type.
pub(crate) fn from_python<T: DeserializeOwned>(
    what: &str,
    value: &Bound<'_, PyDict>,
) -> PyResult<T> {
    let json = value.py().import("json")?;
    let text: String = json.call_method1("dumps", (value,))?.extract()?;
    serde_json::from_str(&text).map_err(|error| {
        // Without the place in a text that the caller has not written.
        let sentence = error.to_string();
        let end = sentence.rfind(" at line ").unwrap_or(sentence.len());
        bad_value(format!("{what}: {}", &sentence[..end]))
    })
}
