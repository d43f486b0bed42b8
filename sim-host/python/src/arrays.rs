//! Arrays of numpy, read into vectors and made of them.

use bytemuck::Pod;
use pyo3::buffer::{Element, PyBuffer};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

/// A type of the elements of an array.
pub(crate) trait Number: Element + Pod {
    /// Its name in numpy.
    const NAME: &'static str;
}

impl Number for f32 {
    const NAME: &'static str = "float32";
}

impl Number for f64 {
    const NAME: &'static str = "float64";
}

impl Number for i8 {
    const NAME: &'static str = "int8";
}

impl Number for i64 {
    const NAME: &'static str = "int64";
}

impl Number for u64 {
    const NAME: &'static str = "uint64";
}

/// Returns a function of numpy.
fn function<'py>(
    py: Python<'py>,
    cell: &'static PyOnceLock<Py<PyAny>>,
    name: &str,
) -> PyResult<&'py Bound<'py, PyAny>> {
    let import = || Ok::<_, PyErr>(py.import("numpy")?.getattr(name)?.unbind());
    Ok(cell.get_or_try_init(py, import)?.bind(py))
}

/// Rows of an argument.
#[derive(Debug)]
pub(crate) struct Rows<const N: usize, T> {
    pub(crate) rows: Vec<[T; N]>,
    /// Whether the argument is one row, without an axis of rows.
    pub(crate) is_one: bool,
}

/// Returns the numbers and the shape of an argument.
///
/// # Errors
/// What numpy raises of what is no array of numbers.
fn numbers<T: Number>(argument: &Bound<'_, PyAny>) -> PyResult<(Vec<T>, Vec<usize>)> {
    static AS_ARRAY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let py = argument.py();
    // `ascontiguousarray` would give a number an axis, so that its shape would be lost.
    let array = function(py, &AS_ARRAY, "asarray")?.call1((argument, T::NAME, "C"))?;
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    // A buffer without an axis is refused.
    let flat = if shape.is_empty() { array.call_method1("reshape", (1,))? } else { array };
    Ok((PyBuffer::<T>::get(&flat)?.to_vec(py)?, shape))
}

/// Reads the argument `name` of shape (`N`,) or (rows, `N`).
///
/// # Errors
/// `ValueError` for another shape.
pub(crate) fn rows<const N: usize, T: Number>(
    name: &str,
    argument: &Bound<'_, PyAny>,
) -> PyResult<Rows<N, T>> {
    let (numbers, shape) = numbers::<T>(argument)?;
    let is_one = match shape[..] {
        [columns] if columns == N => true,
        [_, columns] if columns == N => false,
        _ => {
            return Err(PyValueError::new_err(format!(
                "{name} has the shape {}; it must be ({N},) or (rows, {N})",
                shown(&shape)
            )));
        }
    };
    let rows = numbers.as_chunks().0.to_vec();
    Ok(Rows { rows, is_one })
}

/// Reads the argument `name`: one number for all, or one for each of `count` rows.
///
/// # Errors
/// `ValueError` for another shape.
pub(crate) fn for_rows<T: Number>(
    name: &str,
    argument: &Bound<'_, PyAny>,
    count: usize,
) -> PyResult<Vec<T>> {
    let (numbers, shape) = numbers::<T>(argument)?;
    match shape[..] {
        [] => Ok(vec![numbers[0]; count]),
        [rows] if rows == count => Ok(numbers),
        _ => Err(PyValueError::new_err(format!(
            "{name} has the shape {}; it must be one number, or have the shape ({count},)",
            shown(&shape)
        ))),
    }
}

/// Returns a shape as Python shows it.
pub(crate) fn shown(shape: &[usize]) -> String {
    match shape {
        [one] => format!("({one},)"),
        all => format!("({})", all.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// Returns an error unless two arguments have equally many rows.
///
/// # Errors
/// `ValueError`.
pub(crate) fn same_rows(a: (&str, usize), b: (&str, usize)) -> PyResult<()> {
    if a.1 == b.1 {
        return Ok(());
    }
    let [(a, rows_a), (b, rows_b)] = [a, b];
    Err(PyValueError::new_err(format!(
        "{a} has {rows_a} rows and {b} {rows_b}; both must have equally many"
    )))
}

/// Returns a new array of this shape.
///
/// # Errors
/// What numpy raises, as where there is no memory.
pub(crate) fn array<'py, T: Number>(
    py: Python<'py>,
    numbers: &[T],
    shape: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    static EMPTY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let shape = pyo3::types::PyTuple::new(py, shape)?;
    let array = function(py, &EMPTY, "empty")?.call1((shape, T::NAME))?;
    // numpy exports no buffer of an empty array with strides that suit.
    if !numbers.is_empty() {
        PyBuffer::<T>::get(&array)?.copy_from_slice(py, numbers)?;
    }
    Ok(array)
}

/// Returns a new array of booleans.
///
/// # Errors
/// What numpy raises, as where there is no memory.
pub(crate) fn flags<'py>(py: Python<'py>, flags: &[bool]) -> PyResult<Bound<'py, PyAny>> {
    let bytes: Vec<i8> = flags.iter().map(|&flag| i8::from(flag)).collect();
    array(py, &bytes, &[flags.len()])?.call_method1("view", ("bool",))
}

/// Returns rows as a new array of shape (rows, `N`), or (`N`,) where they are one.
///
/// # Errors
/// What numpy raises, as where there is no memory.
pub(crate) fn array_of_rows<'py, const N: usize, T: Number>(
    py: Python<'py>,
    rows: &[[T; N]],
    is_one: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let numbers = rows.as_flattened();
    if is_one { array(py, numbers, &[N]) } else { array(py, numbers, &[rows.len(), N]) }
}
