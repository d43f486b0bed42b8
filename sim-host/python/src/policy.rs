//! The class `Policy`.

use crate::arrays::{array_of_rows, rows};
use crate::convert::{bad_value, to_python};
use crate::workers;
use leg_control::actor::Observation;
use leg_control::policy::{self, Policy as Parsed};
use leg_process::policy_file::{AlignedBytes, PolicyFile};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyType};
use std::path::PathBuf;
use std::sync::Arc;

self_cell::self_cell!(
    /// A checked policy with its bytes.
    struct Checked {
        owner: AlignedBytes,

        #[covariant]
        dependent: Parsed,
    }
);

/// A policy: a frozen actor with its scalings, gains, leg and provenance.
///
/// `Policy()` is the shipped one, `Policy(path)` that of a file, which is checked down to the last
/// bit of its test vectors.
#[pyclass(frozen, from_py_object, module = "spring_leg")]
#[derive(Clone)]
pub(crate) struct Policy(Arc<Checked>);

impl Policy {
    fn check(bytes: &[u8], what: &str) -> PyResult<Self> {
        let checked =
            Checked::try_new(AlignedBytes::from(bytes), |bytes| Parsed::parse(bytes.as_slice()));
        let error = |error| bad_value(format!("{what} is not a valid policy: {error}"));
        checked.map(|checked| Self(Arc::new(checked))).map_err(error)
    }

    /// Returns the policy, or the shipped one without one.
    ///
    /// # Errors
    /// None in practice.
    pub(crate) fn or_shipped(policy: Option<Self>) -> PyResult<Self> {
        policy.map_or_else(|| Self::new(None), Ok)
    }

    /// Returns the policy.
    pub(crate) fn parsed(&self) -> &Parsed<'_> {
        self.0.borrow_dependent()
    }

    fn blob(&self) -> &[u8] {
        self.0.borrow_owner().as_slice()
    }
}

#[pymethods]
impl Policy {
    #[new]
    #[pyo3(signature = (path = None))]
    fn new(path: Option<PathBuf>) -> PyResult<Self> {
        let Some(path) = path else { return Self::check(policy::SHIPPED, "the shipped policy") };
        let file =
            PolicyFile::read(&path).map_err(|error| PyOSError::new_err(error.to_string()))?;
        Self::check(file.as_slice(), &path.display().to_string())
    }

    /// Returns the policy of the bytes of a policy file.
    #[classmethod]
    fn from_bytes(_class: &Bound<'_, PyType>, blob: &[u8]) -> PyResult<Self> {
        Self::check(blob, "the blob")
    }

    /// Returns the bytes of the policy file.
    fn __bytes__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, self.blob())
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let py = slf.py();
        Ok((slf.get_type().getattr("from_bytes")?, (slf.get().__bytes__(py),)))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.blob() == other.blob()
    }

    fn __hash__(&self) -> u64 {
        u64::from(self.crc32())
    }

    fn __repr__(&self) -> String {
        format!(
            "<Policy '{}', {} bytes, CRC-32 {:08x}>",
            self.name(),
            self.blob().len(),
            self.crc32()
        )
    }

    /// The name in the policy file.
    #[getter]
    fn name(&self) -> &str {
        self.parsed().manifest().name
    }

    /// The checksum of the policy file.
    #[getter]
    fn crc32(&self) -> u32 {
        self.blob().last_chunk().copied().map_or(0, u32::from_le_bytes)
    }

    /// What the file holds beside the weights: widths, scalings, leg, media, provenance, gains.
    #[getter]
    fn manifest<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, self.parsed().manifest())
    }

    /// Returns the actions for observations of shape (3,) or (n, 3): velocity in m/s, height in m,
    /// density ratio. Actions have the shape (2,) or (n, 2): touchdown angle in rad, elongation
    /// speed in m/s. They are those of the controller, bit for bit.
    fn infer<'py>(
        &self,
        py: Python<'py>,
        observations: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let read = rows::<3, f32>("observations", observations)?;
        let mut both: Vec<_> = read.rows.iter().map(|&row| (row, [0.0; 2])).collect();
        let actor = self.parsed().actor();
        workers::for_each(py, &mut both, |(observation, action)| {
            let [apex_vx_m_s, apex_y_m, density_ratio] = *observation;
            let acted = actor.act(Observation { apex_vx_m_s, apex_y_m, density_ratio });
            *action = [acted.touchdown_angle_rad, acted.elongation_speed_m_s];
        })?;
        let actions: Vec<[f32; 2]> = both.into_iter().map(|(_, action)| action).collect();
        array_of_rows(py, &actions, read.is_one)
    }
}
