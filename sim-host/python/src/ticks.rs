//! The class `Ticks`: legs that are stepped tick by tick.

use crate::arrays::{Rows, array, array_of_rows, rows, same_rows};
use crate::convert::bad_value;
use crate::plant::media;
use crate::workers;
use leg_plant::{
    Body, EventKind, Flat, Leg, LegCommand, Losses, Medium, Phase, TickEvents, TickPlant, Tolerance,
};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Mutex, MutexGuard};

/// A leg with the events of its last tick.
#[derive(Debug)]
struct Stepped {
    plant: TickPlant,
    events: TickEvents,
}

/// Legs that are stepped together, tick by tick; `Plant.ticks` makes them.
#[pyclass(frozen, module = "spring_leg._leg")]
pub(crate) struct Ticks {
    medium: Medium,
    is_one: bool,
    legs: Mutex<Vec<Stepped>>,
}

impl Ticks {
    pub(crate) fn new(
        leg: Leg,
        losses: Losses,
        medium: Medium,
        tolerance: Tolerance,
        states: &Rows<4, f64>,
    ) -> Self {
        let legs = states.rows.iter().map(|&[x_m, vx_m_s, y_m, vy_m_s]| {
            let plant = TickPlant::new(leg, Body { x_m, vx_m_s, y_m, vy_m_s });
            let plant = plant.with_losses(losses).with_tolerance(tolerance);
            Stepped { plant, events: TickEvents::default() }
        });
        Self { medium, is_one: states.is_one, legs: Mutex::new(legs.collect()) }
    }

    /// Returns the legs.
    ///
    /// # Errors
    /// `RuntimeError` while another thread steps them.
    fn legs(&self) -> PyResult<MutexGuard<'_, Vec<Stepped>>> {
        // Without waiting: the thread that steps needs the GIL of this one to end.
        self.legs.try_lock().map_err(|_| {
            PyRuntimeError::new_err("these legs are being stepped by another thread; wait for it")
        })
    }
}

fn state(body: Body) -> [f64; 4] {
    let Body { x_m, vx_m_s, y_m, vy_m_s } = body;
    [x_m, vx_m_s, y_m, vy_m_s]
}

#[pymethods]
impl Ticks {
    /// Advances each leg by `dt_s` under its command of shape (3,) or (n, 3): leg angle in rad,
    /// elongation in m at the start of the tick, its rate in m/s. Returns the new states.
    #[pyo3(signature = (dt_s, commands, density_ratio = None))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        dt_s: f64,
        commands: &Bound<'py, PyAny>,
        density_ratio: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        if !(dt_s > 0.0 && dt_s.is_finite()) {
            return Err(bad_value(format!("dt_s is {dt_s}; it must be a finite time above 0")));
        }
        let commands = rows::<3, f64>("commands", commands)?;
        let mut legs = self.legs()?;
        same_rows(("the batch", legs.len()), ("commands", commands.rows.len()))?;
        let media = media(self.medium, density_ratio, legs.len())?;
        let mut all: Vec<_> = legs.iter_mut().zip(&commands.rows).enumerate().collect();
        // All or none: after an interrupt each leg has taken the same number of ticks.
        workers::for_each_uninterrupted(py, &mut all, |(row, (leg, command))| {
            let [leg_angle_rad, elongation_m, elongation_rate_m_s] = **command;
            let command = LegCommand { leg_angle_rad, elongation_m, elongation_rate_m_s };
            let medium = media.as_ref().map_or(self.medium, |media| media[*row]);
            leg.events = leg.plant.step(dt_s, command, medium, &Flat);
        });
        let states: Vec<_> = legs.iter().map(|leg| state(leg.plant.body())).collect();
        array_of_rows(py, &states, self.is_one)
    }

    fn __len__(&self) -> PyResult<usize> {
        Ok(self.legs()?.len())
    }

    /// The states, of shape (4,) or (n, 4).
    #[getter]
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let states: Vec<_> = self.legs()?.iter().map(|leg| state(leg.plant.body())).collect();
        array_of_rows(py, &states, self.is_one)
    }

    /// The phase of each leg: 0 in flight, 1 in stance, 2 fallen.
    #[getter]
    fn phases<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let phase = |leg: &Stepped| match leg.plant.phase() {
            Phase::Flight => 0,
            Phase::Stance { .. } => 1,
            Phase::Fallen => 2,
        };
        let phases: Vec<i8> = self.legs()?.iter().map(phase).collect();
        array(py, &phases, &[phases.len()])
    }

    /// The place of each foot on the ground, of shape (n, 2), in m; NaN in the air.
    #[getter]
    fn feet<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let foot = |leg: &Stepped| match leg.plant.phase() {
            Phase::Stance { foot_x_m, foot_y_m } => [foot_x_m, foot_y_m],
            Phase::Flight | Phase::Fallen => [f64::NAN; 2],
        };
        let feet: Vec<_> = self.legs()?.iter().map(foot).collect();
        array_of_rows(py, &feet, false)
    }

    /// The length that a sensor on each leg measures, m.
    #[getter]
    fn leg_lengths_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let lengths: Vec<_> = self.legs()?.iter().map(|leg| leg.plant.leg_length_m()).collect();
        array(py, &lengths, &[lengths.len()])
    }

    /// The events of the last tick: a list of dictionaries with `leg`, the number of the row,
    /// `kind` (`touchdown`, `lift-off`, `apex` or `fall`), the time `t_s` from the start of the
    /// tick, and the `state` there.
    #[getter]
    fn events<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let legs = self.legs()?;
        let all = legs.iter().enumerate();
        all.flat_map(|(row, leg)| leg.events.iter().map(move |event| (row, event)))
            .map(|(row, event)| {
                let kind = match event.kind {
                    EventKind::Touchdown { .. } => "touchdown",
                    EventKind::LiftOff => "lift-off",
                    EventKind::Apex => "apex",
                    EventKind::Fall => "fall",
                };
                let entry = PyDict::new(py);
                entry.set_item("leg", row)?;
                entry.set_item("kind", kind)?;
                entry.set_item("t_s", event.t_s)?;
                entry.set_item("state", array(py, &state(event.body), &[4])?)?;
                Ok(entry)
            })
            .collect()
    }
}
