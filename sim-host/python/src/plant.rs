//! The class `Plant`.

use crate::arrays::{array, array_of_rows, flags, for_rows, rows, same_rows};
use crate::convert::{bad_value, from_python, to_python};
use crate::ticks::Ticks;
use crate::workers;
use leg_plant::{
    Action, Apex, EARTH_GRAVITY_M_S2, Hop, Hopper, Leg, LegParameters, Losses, Medium, Outcome,
    Tolerance,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The physics of a leg in a medium, on batches: the apex map, and the leg tick by tick.
#[pyclass(frozen, module = "spring_leg")]
pub(crate) struct Plant {
    leg: Leg,
    medium: Medium,
    tolerance: Tolerance,
}

impl Plant {
    /// Computes hops; returns them, and whether the arguments were one row.
    fn hops(
        &self,
        apexes: &Bound<'_, PyAny>,
        actions: &Bound<'_, PyAny>,
        density_ratio: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(Vec<Hop>, bool)> {
        let py = apexes.py();
        let apexes = rows::<2, f64>("apexes", apexes)?;
        let actions = rows::<2, f64>("actions", actions)?;
        same_rows(("apexes", apexes.rows.len()), ("actions", actions.rows.len()))?;
        let hopper = |medium| Hopper::new(&self.leg, medium).with_tolerance(self.tolerance);
        let of_all = hopper(self.medium);
        let media = media(self.medium, density_ratio, apexes.rows.len())?;
        let mut hops: Vec<_> = (apexes.rows.iter().zip(&actions.rows).enumerate())
            .map(|(row, (&apex, &action))| (row, apex, action, FALL))
            .collect();
        workers::for_each(py, &mut hops, |(row, [vx_m_s, y_m], action, hop)| {
            let apex = Apex { vx_m_s: *vx_m_s, y_m: *y_m };
            let [touchdown_angle_rad, elongation_speed_m_s] = *action;
            let action = Action { touchdown_angle_rad, elongation_speed_m_s };
            let own = media.as_ref().map(|media| hopper(media[*row]));
            *hop = own.as_ref().unwrap_or(&of_all).hop(apex, action);
        })?;
        let hops = hops.into_iter().map(|(.., hop)| hop).collect();
        Ok((hops, apexes.is_one && actions.is_one))
    }
}

const FALL: Hop =
    Hop { outcome: Outcome::Fall, stance_phases: 0, touchdown: None, liftoff_t_s: None };

/// Returns the medium of each row; `None` where all are in that of the plant.
pub(crate) fn media(
    medium: Medium,
    density_ratio: Option<&Bound<'_, PyAny>>,
    count: usize,
) -> PyResult<Option<Vec<Medium>>> {
    let Some(density_ratio) = density_ratio else { return Ok(None) };
    let ratios = for_rows::<f64>("density_ratio", density_ratio, count)?;
    let media: Result<Vec<_>, _> =
        ratios.into_iter().map(|ratio| medium.with_density_ratio(ratio)).collect();
    media.map(Some).map_err(bad_value)
}

#[pymethods]
impl Plant {
    /// `leg` is `"human"`, `"crab"` or a dictionary of all parameters.
    #[new]
    #[pyo3(signature = (leg = None, *, density_ratio = 0.0, gravity_m_s2 = EARTH_GRAVITY_M_S2, tolerance_m_s = None))]
    fn new(
        leg: Option<&Bound<'_, PyAny>>,
        density_ratio: f64,
        gravity_m_s2: f64,
        tolerance_m_s: Option<f64>,
    ) -> PyResult<Self> {
        let medium = Medium::new(density_ratio, gravity_m_s2).map_err(bad_value)?;
        let tolerance = tolerance_m_s.map(Tolerance::new).transpose().map_err(bad_value)?;
        let leg = leg.map(leg_of).transpose()?.unwrap_or_default();
        Ok(Self { leg, medium, tolerance: tolerance.unwrap_or_default() })
    }

    /// The parameters of the leg.
    #[getter]
    fn leg<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &self.leg)
    }

    /// Density of the medium over that of water.
    #[getter]
    fn density_ratio(&self) -> f64 {
        self.medium.density_ratio()
    }

    /// Gravity, m/s2.
    #[getter]
    fn gravity_m_s2(&self) -> f64 {
        self.medium.gravity_m_s2()
    }

    fn __repr__(&self) -> String {
        let (ratio, gravity) = (self.medium.density_ratio(), self.medium.gravity_m_s2());
        format!("<Plant, density ratio {ratio}, gravity {gravity} m/s2>")
    }

    /// Returns the next apexes, of shape (2,) or (n, 2), NaN after a fall: one hop each from an
    /// apex (horizontal velocity in m/s, height in m) by an action (touchdown angle in rad,
    /// elongation speed in m/s).
    #[pyo3(signature = (apexes, actions, density_ratio = None))]
    fn hop<'py>(
        &self,
        py: Python<'py>,
        apexes: &Bound<'py, PyAny>,
        actions: &Bound<'py, PyAny>,
        density_ratio: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (hops, is_one) = self.hops(apexes, actions, density_ratio)?;
        let next: Vec<[f64; 2]> = hops
            .iter()
            .map(|hop| hop.outcome.next().map_or([f64::NAN; 2], |apex| [apex.vx_m_s, apex.y_m]))
            .collect();
        array_of_rows(py, &next, is_one)
    }

    /// Returns the course of hops as a dictionary of arrays of shape (n,): `vx_m_s`, `y_m`, `t_s`
    /// and `x_m` of the next apex and `in_stance`, whether the foot was still on the ground there;
    /// `fell`; the number of `stances`; `touchdown_t_s`, `foot_x_m` and `liftoff_t_s` of the first
    /// stance. What did not happen is NaN. Times and places count from the start of the hop.
    #[pyo3(signature = (apexes, actions, density_ratio = None))]
    fn course<'py>(
        &self,
        py: Python<'py>,
        apexes: &Bound<'py, PyAny>,
        actions: &Bound<'py, PyAny>,
        density_ratio: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (hops, _) = self.hops(apexes, actions, density_ratio)?;
        let course = PyDict::new(py);
        let next = |hop: &Hop| match hop.outcome {
            Outcome::Apex(next) => Some(next),
            Outcome::Fall => None,
        };
        let number = |name: &str, of: &dyn Fn(&Hop) -> Option<f64>| {
            let column: Vec<f64> = hops.iter().map(|hop| of(hop).unwrap_or(f64::NAN)).collect();
            course.set_item(name, array(py, &column, &[column.len()])?)
        };
        number("vx_m_s", &|hop| next(hop).map(|apex| apex.vx_m_s))?;
        number("y_m", &|hop| next(hop).map(|apex| apex.y_m))?;
        number("t_s", &|hop| next(hop).map(|apex| apex.t_s))?;
        number("x_m", &|hop| next(hop).map(|apex| apex.x_m))?;
        number("touchdown_t_s", &|hop| hop.touchdown.map(|touchdown| touchdown.t_s))?;
        number("foot_x_m", &|hop| hop.touchdown.map(|touchdown| touchdown.foot_x_m))?;
        number("liftoff_t_s", &|hop| hop.liftoff_t_s)?;
        let flag = |name: &str, of: &dyn Fn(&Hop) -> bool| {
            let column: Vec<bool> = hops.iter().map(of).collect();
            course.set_item(name, flags(py, &column)?)
        };
        flag("fell", &|hop| next(hop).is_none())?;
        flag("in_stance", &|hop| next(hop).is_some_and(|apex| apex.in_stance))?;
        let stances: Vec<i64> = hops.iter().map(|hop| hop.stance_phases.into()).collect();
        course.set_item("stances", array(py, &stances, &[stances.len()])?)?;
        Ok(course)
    }

    /// Returns legs to step tick by tick, in flight, from states of shape (4,) or (n, 4): place in
    /// m, horizontal velocity in m/s, height in m, vertical velocity in m/s. They may have losses:
    /// damping along the leg, a foot with a mass, friction, a limit of the force of the drive.
    #[pyo3(signature = (states, *, damping_n_s_m = 0.0, foot_mass_kg = 0.0, friction = None, drive_force_n = None))]
    fn ticks(
        &self,
        states: &Bound<'_, PyAny>,
        damping_n_s_m: f64,
        foot_mass_kg: f64,
        friction: Option<f64>,
        drive_force_n: Option<f64>,
    ) -> PyResult<Ticks> {
        let losses = Losses::NONE
            .with_damping(damping_n_s_m)
            .and_then(|losses| losses.with_foot_mass(foot_mass_kg))
            .and_then(|losses| match friction {
                Some(friction) => losses.with_friction(friction),
                None => Ok(losses),
            })
            .and_then(|losses| match drive_force_n {
                Some(force) => losses.with_drive_force(force),
                None => Ok(losses),
            })
            .map_err(bad_value)?;
        let states = rows::<4, f64>("states", states)?;
        Ok(Ticks::new(self.leg, losses, self.medium, self.tolerance, &states))
    }
}

/// Returns the leg of a name or of its parameters.
fn leg_of(leg: &Bound<'_, PyAny>) -> PyResult<Leg> {
    if let Ok(parameters) = leg.cast::<PyDict>() {
        return Leg::new(from_python::<LegParameters>("leg", parameters)?).map_err(bad_value);
    }
    match leg.extract::<&str>()? {
        "human" => Ok(Leg::human()),
        "crab" => Ok(Leg::crab()),
        other => Err(bad_value(format!(
            "there is no leg '{other}'; choose 'human', 'crab' or a dictionary of its parameters"
        ))),
    }
}
