//! The class `Hoppers`: the environments behind `HopperEnv` and `HopperVectorEnv`.

use crate::arrays::{array, array_of_rows, flags, rows};
use crate::convert::bad_value;
use crate::episodes::{Episodes, OBSERVED, Step, action_scaling, config, preset, scaled};
use crate::workers;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};
use std::sync::{Mutex, MutexGuard};
use trainer::world::PathPoint;

/// One environment and its last step.
#[derive(Clone)]
struct Hopper {
    episodes: Episodes,
    action: [f32; 2],
    step: Step,
    /// What a reset in the same step began with.
    observation: [f32; 3],
}

/// Observations of shape (n, 3), rewards, terminated, truncated, and the last observation of each
/// episode that ended.
type Stepped<'py> =
    (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Environments that are stepped together. `spring_leg.HopperEnv` and `HopperVectorEnv` are made
/// of it.
#[pyclass(frozen, module = "spring_leg._leg")]
pub(crate) struct Hoppers {
    hoppers: Mutex<Vec<Hopper>>,
}

impl Hoppers {
    fn of(episodes: impl IntoIterator<Item = Episodes>) -> Self {
        let step = Step { observation: [0.0; 3], reward: 0.0, terminated: false, truncated: false };
        let hoppers = episodes.into_iter().map(|episodes| Hopper {
            episodes,
            action: [0.0; 2],
            step,
            observation: [0.0; 3],
        });
        Self { hoppers: Mutex::new(hoppers.collect()) }
    }

    /// Returns the environments.
    ///
    /// # Errors
    /// `RuntimeError` while another thread steps them.
    fn hoppers(&self) -> PyResult<MutexGuard<'_, Vec<Hopper>>> {
        self.hoppers.try_lock().map_err(|_| {
            PyRuntimeError::new_err("this environment is in use by another thread; wait for it")
        })
    }
}

#[pymethods]
impl Hoppers {
    /// Makes an environment for each seed.
    #[new]
    fn new(preset_name: &str, seeds: Vec<u64>) -> PyResult<Self> {
        let preset = preset(preset_name).map_err(bad_value)?;
        Ok(Self::of(seeds.into_iter().map(|seed| Episodes::new(preset, seed))))
    }

    /// Returns bounds and scalings of a preset: the lowest and highest observation, the offset and
    /// scale of observations and of actions, and the steps of an episode.
    #[staticmethod]
    fn scalings<'py>(py: Python<'py>, preset_name: &str) -> PyResult<Bound<'py, PyDict>> {
        let config = config(preset(preset_name).map_err(bad_value)?);
        let all = PyDict::new(py);
        let [low, high] = OBSERVED.map(|bound| scaled(config, bound));
        all.set_item("observation_low", array(py, &low, &[3])?)?;
        all.set_item("observation_high", array(py, &high, &[3])?)?;
        let network = &config.network;
        all.set_item("observation_offset", array(py, &network.observation_offset, &[3])?)?;
        all.set_item("observation_scale", array(py, &network.observation_scale, &[3])?)?;
        let (offset, scale) = action_scaling(config);
        all.set_item("action_offset", array(py, &offset, &[2])?)?;
        all.set_item("action_scale", array(py, &scale, &[2])?)?;
        all.set_item("max_steps", config.episode.max_steps)?;
        Ok(all)
    }

    /// Begins episodes and returns the observations of all environments. `seeds` has the new seed
    /// of each, or `None`; `mask` tells which begin an episode.
    #[pyo3(signature = (seeds = None, mask = None))]
    fn reset<'py>(
        &self,
        py: Python<'py>,
        seeds: Option<Vec<Option<u64>>>,
        mask: Option<Vec<bool>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mut hoppers = self.hoppers()?;
        let count = hoppers.len();
        let is_one_each = |given: Option<usize>| given.is_none_or(|given| given == count);
        if !is_one_each(seeds.as_ref().map(Vec::len)) || !is_one_each(mask.as_ref().map(Vec::len)) {
            return Err(bad_value(format!("seeds and mask must be of {count} environments")));
        }
        for (row, hopper) in hoppers.iter_mut().enumerate() {
            if mask.as_ref().is_some_and(|mask| !mask[row]) {
                continue;
            }
            if let Some(seed) = seeds.as_ref().and_then(|seeds| seeds[row]) {
                hopper.episodes.reseed(seed);
            }
            hopper.observation = hopper.episodes.begin();
        }
        let observations: Vec<_> = hoppers.iter().map(|hopper| hopper.observation).collect();
        array_of_rows(py, &observations, false)
    }

    /// Whether the episodes of all environments go on.
    #[getter]
    fn are_running(&self) -> PyResult<bool> {
        Ok(self.hoppers()?.iter().all(|hopper| hopper.episodes.is_running()))
    }

    /// Takes a step in each environment with actions of shape (n, 2), within -1 and 1. With
    /// `autoreset`, an environment whose episode ends begins the next one in the same step.
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: &Bound<'py, PyAny>,
        autoreset: bool,
    ) -> PyResult<Stepped<'py>> {
        let given = rows::<2, f32>("actions", actions)?.rows;
        let mut hoppers = self.hoppers()?;
        if given.len() != hoppers.len() {
            return Err(bad_value(format!(
                "{} actions for {} environments; each needs one",
                given.len(),
                hoppers.len()
            )));
        }
        // Before anything changes.
        for (row, action) in given.iter().enumerate() {
            if let Some(bad) = action.iter().find(|x| !(-1.0..=1.0).contains(*x)) {
                return Err(bad_value(format!(
                    "the action {action:?} of environment {row} holds {bad}; each number must be \
                     within -1 and 1"
                )));
            }
        }
        if !hoppers.iter().all(|hopper| hopper.episodes.is_running()) {
            return Err(PyRuntimeError::new_err("an episode has ended or not begun; reset first"));
        }
        for (hopper, action) in hoppers.iter_mut().zip(given) {
            hopper.action = action;
        }
        workers::for_each_uninterrupted(py, &mut hoppers, |hopper| {
            if let Some(step) = hopper.episodes.step(hopper.action) {
                hopper.step = step;
                hopper.observation = step.observation;
                if autoreset && (step.terminated || step.truncated) {
                    hopper.observation = hopper.episodes.begin();
                }
            }
        });
        let observations: Vec<_> = hoppers.iter().map(|hopper| hopper.observation).collect();
        let rewards: Vec<_> = hoppers.iter().map(|hopper| hopper.step.reward).collect();
        let terminated: Vec<_> = hoppers.iter().map(|hopper| hopper.step.terminated).collect();
        let truncated: Vec<_> = hoppers.iter().map(|hopper| hopper.step.truncated).collect();
        let ended = |step: &Step| step.terminated || step.truncated;
        let last: Vec<_> = hoppers
            .iter()
            .filter(|hopper| ended(&hopper.step))
            .map(|hopper| hopper.step.observation)
            .collect();
        Ok((
            array_of_rows(py, &observations, false)?,
            array(py, &rewards, &[rewards.len()])?,
            flags(py, &terminated)?,
            flags(py, &truncated)?,
            array_of_rows(py, &last, false)?,
        ))
    }

    /// Takes a step in the only environment; returns observation, reward, terminated, truncated.
    fn step_one<'py>(
        &self,
        py: Python<'py>,
        action: &Bound<'py, PyAny>,
    ) -> PyResult<(Bound<'py, PyAny>, f64, bool, bool)> {
        let given = rows::<2, f32>("action", action)?;
        let ([action], true) = (&given.rows[..], given.is_one) else {
            return Err(bad_value("action has an axis of rows; it must have the shape (2,)"));
        };
        if let Some(bad) = action.iter().find(|x| !(-1.0..=1.0).contains(*x)) {
            return Err(bad_value(format!(
                "the action {action:?} holds {bad}; each number must be within -1 and 1"
            )));
        }
        let mut hoppers = self.hoppers()?;
        let step = hoppers.first_mut().and_then(|hopper| hopper.episodes.step(*action));
        let step = step.ok_or_else(|| {
            PyRuntimeError::new_err("the episode has ended or not begun; reset first")
        })?;
        let observation = array(py, &step.observation, &[3])?;
        Ok((observation, step.reward, step.terminated, step.truncated))
    }

    /// Returns the true apex of an environment: horizontal velocity, m/s, height, m, density ratio.
    fn apex(&self, row: usize) -> PyResult<Option<(f64, f64, f64)>> {
        let hoppers = self.hoppers()?;
        let running = hoppers.get(row).and_then(|hopper| hopper.episodes.running());
        Ok(running.map(|environment| {
            let apex = environment.apex();
            (apex.vx_m_s, apex.y_m, environment.density_ratio())
        }))
    }

    /// Returns the way of the hop that an action of the only environment would give, of shape
    /// (n, 5) with a row at most each 20 ms: place and height of the mass, place and height of the
    /// foot while it is on the ground (else NaN), height of the ground, in m. Places count from
    /// the start of the hop.
    fn path<'py>(
        &self,
        py: Python<'py>,
        action: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let given = rows::<2, f32>("action", action)?;
        let hoppers = self.hoppers()?;
        let (Some(hopper), Some(action)) = (hoppers.first(), given.rows.first()) else {
            return Err(bad_value("there is no environment, or no action"));
        };
        let point = |point: PathPoint| {
            let [foot_x_m, foot_y_m] = point.foot.unwrap_or([f64::NAN; 2]);
            [point.x_m, point.y_m, foot_x_m, foot_y_m, point.ground_m]
        };
        let path: Vec<_> = hopper.episodes.path(*action).into_iter().map(point).collect();
        array_of_rows(py, &path, false)
    }

    /// Returns the environments of texts, as `__reduce__` gives them.
    #[classmethod]
    fn recalled(_class: &Bound<'_, PyType>, texts: Vec<String>) -> PyResult<Self> {
        let episodes: Result<Vec<_>, _> =
            texts.iter().map(|text| Episodes::recalled(text)).collect();
        let episodes = episodes.map_err(|why| bad_value(format!("no state of Hoppers: {why}")))?;
        let all = Self::of(episodes);
        for hopper in all.hoppers()?.iter_mut() {
            hopper.observation = hopper.episodes.observation();
        }
        Ok(all)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Vec<String>,))> {
        let hoppers = slf.get().hoppers()?;
        let texts = hoppers.iter().map(|hopper| hopper.episodes.remembered()).collect();
        Ok((slf.get_type().getattr("recalled")?, (texts,)))
    }

    fn __len__(&self) -> PyResult<usize> {
        Ok(self.hoppers()?.len())
    }
}
