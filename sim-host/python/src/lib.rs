//! The native half of the Python package `spring_leg`.

#![allow(clippy::needless_pass_by_value, reason = "arguments that Python passes are owned")]

use pyo3::prelude::*;

mod arrays;
mod controller;
mod convert;
mod episodes;
mod hoppers;
mod leg;
mod messages;
mod plant;
mod policy;
mod recording;
mod ticks;
mod workers;

#[pymodule]
mod _leg {
    #[pymodule_export]
    use crate::controller::Controller;
    #[pymodule_export]
    use crate::hoppers::Hoppers;
    #[pymodule_export]
    use crate::leg::Leg;
    #[pymodule_export]
    use crate::messages::{Command, Sample};
    #[pymodule_export]
    use crate::plant::Plant;
    #[pymodule_export]
    use crate::policy::Policy;
    #[pymodule_export]
    use crate::recording::read_columns;
    #[pymodule_export]
    use crate::ticks::Ticks;
}
