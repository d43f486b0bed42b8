//! The class `Controller`.

use crate::convert::{bad_value, from_python};
use crate::messages::{Command, Sample};
use crate::policy::Policy;
use clap::ValueEnum;
use leg_control::config::Config;
use leg_control::serial::node::SessionParams;
use leg_control::wire;
use leg_control::wire_controller::WireController;
use leg_host::law::{EstimatorKind, LawSettings};
use leg_plant::EARTH_GRAVITY_M_S2;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Mutex, MutexGuard};
use typed_arena::Arena;

self_cell::self_cell!(
    /// The control law with every policy that it was given.
    pub(crate) struct Law {
        owner: Arena<Policy>,

        #[not_covariant]
        dependent: WireController,
    }
);

/// The control law: takes the sample of each tick and returns its command, with the bits of
/// firmware and host.
#[pyclass(frozen, module = "spring_leg")]
pub(crate) struct Controller {
    law: Mutex<Law>,
}

impl Controller {
    /// Returns a controller at the start of its first run.
    pub(crate) fn with_config(policy: Policy, config: Config) -> Self {
        let law = Law::new(Arena::with_capacity(1), |policies| {
            WireController::new(policies.alloc(policy).parsed().clone(), config)
        });
        Self { law: Mutex::new(law) }
    }

    /// Runs a tick without the GIL of a caller in Rust.
    pub(crate) fn tick_in(
        law: &mut Law,
        sample: Option<&wire::Sample>,
        set_point_m_s: Option<f32>,
    ) -> wire::Command {
        law.with_dependent_mut(|_, law| {
            let own = sample.map(|sample| sample.set_point_m_s);
            law.tick_at(sample, set_point_m_s.or(own))
        })
    }

    /// Returns the law.
    ///
    /// # Errors
    /// `RuntimeError` while another thread uses it.
    pub(crate) fn law(&self) -> PyResult<MutexGuard<'_, Law>> {
        self.law.try_lock().map_err(|_| {
            PyRuntimeError::new_err("this controller is in use by another thread; wait for it")
        })
    }
}

/// Returns the configuration of these settings.
fn config(
    rate_hz: u32,
    gravity_m_s2: f32,
    estimator: Option<&str>,
    noise: Option<&Bound<'_, PyDict>>,
    stale_limit_ms: Option<f64>,
) -> PyResult<Config> {
    let estimator = estimator.map(|name| EstimatorKind::from_str(name, false)).transpose();
    let estimator = estimator.map_err(|_| {
        bad_value("there is no such estimator; choose 'readings', 'state' or 'inertial'")
    })?;
    let noise = noise.map(|noise| from_python("noise", noise)).transpose()?;
    let law = LawSettings { estimator, noise, stale_limit_ms };
    let params = SessionParams {
        rate_hz,
        gravity_m_s2,
        stale_limit_ns: law.stale_limit_ns().map_err(bad_value)? as u32,
        estimator: law.estimator().map_err(bad_value)?.unwrap_or_default(),
    };
    params.config().map_err(bad_value)
}

#[pymethods]
impl Controller {
    /// `policy` is the shipped one by default. `estimator` is what the law takes for the state:
    /// `readings`, `state` or `inertial`, with the standard deviations `noise` of its sensors.
    #[new]
    #[pyo3(signature = (policy = None, *, rate_hz = 1000, gravity_m_s2 = EARTH_GRAVITY_M_S2 as f32,
        estimator = None, noise = None, stale_limit_ms = None))]
    fn new(
        policy: Option<Policy>,
        rate_hz: u32,
        gravity_m_s2: f32,
        estimator: Option<&str>,
        noise: Option<&Bound<'_, PyDict>>,
        stale_limit_ms: Option<f64>,
    ) -> PyResult<Self> {
        let config = config(rate_hz, gravity_m_s2, estimator, noise, stale_limit_ms)?;
        Ok(Self::with_config(Policy::or_shipped(policy)?, config))
    }

    /// Runs a tick: takes its sample, or `None` where none came; returns the command. The set-point
    /// is that of the sample unless one is given, m/s.
    #[pyo3(signature = (sample, set_point_m_s = None))]
    fn tick(&self, sample: Option<&Sample>, set_point_m_s: Option<f32>) -> PyResult<Command> {
        let mut law = self.law()?;
        Ok(Command(Self::tick_in(&mut law, sample.map(|sample| &sample.0), set_point_m_s)))
    }

    /// Switches to another policy at the next apex, or at once while no action is in force.
    fn swap(&self, policy: Policy) -> PyResult<()> {
        self.law()?.with_dependent_mut(|policies, law| {
            law.swap(policies.alloc(policy).parsed().clone());
        });
        Ok(())
    }

    /// Whether a policy waits for the next apex.
    #[getter]
    fn swap_is_pending(&self) -> PyResult<bool> {
        Ok(self.law()?.with_dependent(|_, law| law.swap_is_pending()))
    }

    /// The name of the policy in force.
    #[getter]
    fn policy_name(&self) -> PyResult<String> {
        Ok(self.law()?.with_dependent(|_, law| law.policy().manifest().name.to_owned()))
    }

    /// What was rejected since the start of the run, by reason.
    #[getter]
    fn counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let counts = self.law()?.with_dependent(|_, law| *law.counts());
        let all = PyDict::new(py);
        for (name, count) in [
            ("rejected", counts.rejected()),
            ("missing", counts.missing),
            ("version", counts.version),
            ("non_finite", counts.non_finite),
            ("out_of_range", counts.out_of_range),
            ("no_contact_sense", counts.no_contact_sense),
            ("old_run", counts.old_run),
            ("stale", counts.stale),
            ("out_of_order", counts.out_of_order),
            ("gap", counts.gap),
            ("safe_entered", counts.safe_entered),
            ("used_in_part", counts.used_in_part),
            ("estimates_lost", counts.estimates_lost),
            ("set_points_refused", counts.set_points_refused),
        ] {
            all.set_item(name, count)?;
        }
        Ok(all)
    }

    /// What the estimator held at the last sample; `None` without one, and before its estimate
    /// begins.
    #[getter]
    fn estimate<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let estimate = self.law()?.with_dependent(|_, law| law.estimate());
        let Some(estimate) = estimate else { return Ok(None) };
        let all = PyDict::new(py);
        all.set_item("t_ns", estimate.t_ns)?;
        all.set_item("in_stance", estimate.in_stance)?;
        for (name, value) in [
            ("vx_m_s", estimate.vx_m_s),
            ("y_m", estimate.y_m),
            ("vy_m_s", estimate.vy_m_s),
            ("density_ratio", estimate.density_ratio),
            ("vx_variance_m2_s2", estimate.vx_variance),
            ("y_variance_m2", estimate.y_variance),
            ("vy_variance_m2_s2", estimate.vy_variance),
            ("density_variance", estimate.density_variance),
            ("innovation", estimate.innovation),
        ] {
            all.set_item(name, value)?;
        }
        Ok(Some(all))
    }
}
