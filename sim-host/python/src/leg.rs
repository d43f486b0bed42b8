//! The class `Leg`.

use crate::arrays::array;
use crate::controller::Controller;
use crate::convert::{bad_value, failed, from_python, to_python};
use crate::messages::{Command, Sample};
use crate::policy::Policy;
use leg_control::wire;
use leg_plant::Body;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};
use sim_host::faults::add_counts;
use sim_host::faults::stage::FaultPlan;
use sim_host::scenario::{Scenario, Settings};
use sim_host::session::{Ending, Leg as Simulated, RoundTrips};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Ticks between two looks for a signal.
const BETWEEN_SIGNALS: u64 = 10_000;

/// Run id of every sample.
const RUN_ID: u32 = 1;

/// A run that goes on, with the faults of the link between leg and controller.
struct Run<'a> {
    leg: Simulated<'a>,
    link: FaultPlan,
    /// The sample of this tick after the faults of the link.
    sent: Option<wire::Sample>,
}

impl<'a> Run<'a> {
    fn new(scenario: &'a Scenario) -> Self {
        let leg = Simulated::new(scenario, RUN_ID);
        let mut run = Self { leg, link: scenario.faults.plan(), sent: None };
        run.send();
        run
    }

    /// Passes the sample of this tick through the faults of the link.
    fn send(&mut self) {
        let now = self.leg.ticks();
        let is_over = self.leg.ending().is_some();
        let sample = (!is_over).then(|| *self.leg.sample());
        self.sent = sample.and_then(|sample| self.link.samples.pass(now, Some(sample)));
    }

    /// Plays a tick under the command that came, if one did.
    fn step(&mut self, command: Option<wire::Command>) {
        let command = self.link.commands.pass(self.leg.ticks(), command);
        self.leg.step(command, Duration::ZERO, &mut |_| ());
        self.send();
    }
}

/// The run; none after its end.
type Running<'a> = Option<Run<'a>>;

self_cell::self_cell!(
    /// A run with its scenario.
    struct Session {
        owner: Box<Scenario>,

        #[not_covariant]
        dependent: Running,
    }
);

/// A simulated leg with its sensors and faults: that of `sim-host`, tick by tick, in simulated
/// time.
#[pyclass(frozen, module = "spring_leg")]
pub(crate) struct Leg {
    session: Mutex<Session>,
    began: Instant,
}

impl Leg {
    fn of(settings: &Settings) -> PyResult<Self> {
        let scenario = Scenario::from_settings(settings).map_err(bad_value)?;
        let session = Session::new(Box::new(scenario), |scenario| Some(Run::new(scenario)));
        Ok(Self { session: Mutex::new(session), began: Instant::now() })
    }

    /// Returns the session.
    ///
    /// # Errors
    /// `RuntimeError` while another thread steps it.
    fn session(&self) -> PyResult<MutexGuard<'_, Session>> {
        self.session.try_lock().map_err(|_| {
            PyRuntimeError::new_err("this leg is being stepped by another thread; wait for it")
        })
    }

    /// Calls `work` with the run.
    ///
    /// # Errors
    /// `RuntimeError` after `finish`.
    fn with<R>(&self, work: impl FnOnce(&mut Run<'_>) -> R) -> PyResult<R> {
        self.session()?.with_dependent_mut(|_, run| match run {
            Some(run) => Ok(work(run)),
            None => Err(PyRuntimeError::new_err("this run was finished; make another leg")),
        })
    }
}

fn settings(settings: Option<&Bound<'_, PyDict>>) -> PyResult<Settings> {
    Ok(settings.map(|given| from_python("settings", given)).transpose()?.unwrap_or_default())
}

fn name(ending: Ending) -> &'static str {
    match ending {
        Ending::Duration => "duration",
        Ending::Distance => "distance",
        Ending::Fall => "fall",
        Ending::Stopped => "stopped",
    }
}

#[pymethods]
impl Leg {
    /// Makes a leg at the start of its scenario: a file, settings by the names in such a file, or
    /// both, where a setting counts for more than the file.
    #[new]
    #[pyo3(signature = (scenario = None, **given))]
    fn new(scenario: Option<PathBuf>, given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let settings = settings(given)?;
        let base = scenario.map(|path| Settings::from_file(&path)).transpose();
        let base = base.map_err(bad_value)?.unwrap_or_default();
        Self::of(&settings.over(base))
    }

    /// Makes the leg of the demonstration, out of the water onto land; settings change it.
    #[classmethod]
    #[pyo3(signature = (**given))]
    fn shore(_class: &Bound<'_, PyType>, given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        Self::of(&settings(given)?.over(Settings::shore()))
    }

    /// Returns a controller for this leg: with its rate, gravity, stale limit and estimator.
    #[pyo3(signature = (policy = None))]
    fn controller(&self, policy: Option<Policy>) -> PyResult<Controller> {
        let config = self.session()?.borrow_owner().controller_config().map_err(bad_value)?;
        Ok(Controller::with_config(Policy::or_shipped(policy)?, config))
    }

    /// The sample of this tick, with the faults of sensors and link; `None` where a fault dropped
    /// it, and at the end of the run.
    #[getter]
    fn sample(&self) -> PyResult<Option<Sample>> {
        self.with(|run| run.sent.map(Sample))
    }

    /// Plays a tick under a command, or, where `None` came, under the one in force. Returns the
    /// sample of the next tick as `sample` does.
    fn step(&self, command: Option<&Command>) -> PyResult<Option<Sample>> {
        self.with(|run| {
            if let Some(ending) = run.leg.ending() {
                return Err(ended(ending));
            }
            run.step(command.map(|command| command.0));
            Ok(run.sent.map(Sample))
        })?
    }

    /// Steps leg and controller in turn, to the end of the run or for a number of ticks. Returns
    /// the number of ticks played. Other threads of Python run meanwhile.
    #[pyo3(signature = (controller, ticks = None))]
    fn play(&self, py: Python<'_>, controller: &Controller, ticks: Option<u64>) -> PyResult<u64> {
        let mut session = self.session()?;
        let mut law = controller.law()?;
        let mut played = 0;
        let wanted = ticks.unwrap_or(u64::MAX);
        loop {
            let until = wanted.min(played + BETWEEN_SIGNALS);
            let (session, law) = (&mut *session, &mut *law);
            let went_on = py.detach(|| {
                session.with_dependent_mut(|_, run| {
                    let Some(run) = run else { return false };
                    while played < until && run.leg.ending().is_none() {
                        let command = Controller::tick_in(law, run.sent.as_ref(), None);
                        run.step(Some(command));
                        played += 1;
                    }
                    run.leg.ending().is_none()
                })
            });
            py.check_signals()?;
            if !went_on || played >= wanted {
                return Ok(played);
            }
        }
    }

    /// Replaces the set-point of the scenario from now on, m/s; `None` returns to it.
    #[pyo3(signature = (set_point_m_s))]
    fn override_set_point(&self, set_point_m_s: Option<f64>) -> PyResult<()> {
        if let Some(bad) = set_point_m_s.filter(|m_s| !m_s.is_finite()) {
            return Err(bad_value(format!("the set-point is {bad}; it must be a finite number")));
        }
        self.with(|run| {
            run.leg.override_set_point(set_point_m_s);
            // The sample of this tick was not read yet.
            let now = run.leg.sample();
            if let Some(sent) = run.sent.as_mut().filter(|sent| sent.header == now.header) {
                sent.set_point_m_s = now.set_point_m_s;
            }
        })
    }

    /// Why the run is over: `duration`, `distance` or `fall`; `None` while it is not.
    #[getter]
    fn ending(&self) -> PyResult<Option<&'static str>> {
        self.with(|run| run.leg.ending().map(name))
    }

    /// Number of the tick that comes.
    #[getter]
    fn seq(&self) -> PyResult<u64> {
        self.with(|run| run.leg.seq())
    }

    /// Simulated time, s.
    #[getter]
    fn t_s(&self) -> PyResult<f64> {
        self.with(|run| run.leg.t_s())
    }

    /// The true state, of shape (4,): place in m, horizontal velocity in m/s, height in m,
    /// vertical velocity in m/s.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let Body { x_m, vx_m_s, y_m, vy_m_s } = self.with(|run| run.leg.body())?;
        array(py, &[x_m, vx_m_s, y_m, vy_m_s], &[4])
    }

    /// Ends the run and returns its report, as `sim-host run --json` prints it.
    fn finish<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let run = self.session()?.with_dependent_mut(|_, run| {
            run.take().map(|Run { leg, link, .. }| {
                let ending = leg.ending().unwrap_or(Ending::Stopped);
                let wall_time_s = self.began.elapsed().as_secs_f64();
                let mut outcome = leg.outcome(ending, wall_time_s, RoundTrips::default());
                add_counts(&mut outcome.faults, &link);
                outcome.report()
            })
        });
        let report = run.ok_or_else(|| failed("this run was finished; make another leg"))?;
        to_python(py, &report)
    }
}

fn ended(ending: Ending) -> PyErr {
    PyValueError::new_err(format!("the run is over ({}); make another leg", name(ending)))
}
