//! Evaluation of an actor: survival, stopping, tracking and highest speed, with the same
//! actor and cascade code that the controller runs.
//!
//! Results do not depend on the number of threads: every start is drawn before the first
//! one runs, and results are collected in their order.

mod actions;
pub mod compare;
pub mod conditions;
mod crossing;
pub mod gains;
pub mod goals;
pub mod intervals;
pub mod metric;
pub mod randomised;
pub mod report;
mod score;
pub mod selection;
pub mod survival;
pub mod tracking;

use crate::environment::leg;
use crate::world::Shown;
use leg_control::actor::{Actor, Observation};
use leg_plant::{Action, Apex, Hopper, Medium};

/// The density ratios of every evaluation, ascending: those of the paper's figures, and some
/// between them.
pub const DENSITIES: [f64; 8] = [0.0, 0.05, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0];

/// Returns the plant of an evaluation: the leg of the trainings in a medium of this density
/// ratio, on earth.
///
/// # Panics
/// If `density_ratio` is negative or not finite.
#[must_use]
pub fn hopper(density_ratio: f64) -> Hopper {
    let medium = Medium::AIR.with_density_ratio(density_ratio).expect("a density ratio");
    Hopper::new(&leg(), medium)
}

/// Returns the actor's action at an apex, with `offset_m_s` subtracted from the velocity
/// that it observes.
#[must_use]
pub fn act(actor: &Actor<'_>, density_ratio: f64, apex: Apex, offset_m_s: f32) -> Action {
    act_on(actor, [apex.vx_m_s, apex.y_m, density_ratio], offset_m_s)
}

/// Returns the actor's action for what it observes, with `offset_m_s` subtracted from the velocity.
#[must_use]
pub fn act_on(actor: &Actor<'_>, shown: Shown, offset_m_s: f32) -> Action {
    to_plant(actor.act(observation(shown, offset_m_s)))
}

/// Returns what the controller would observe, with `offset_m_s` subtracted from the velocity.
fn observation([vx_m_s, y_m, density_ratio]: Shown, offset_m_s: f32) -> Observation {
    Observation {
        apex_vx_m_s: vx_m_s as f32 - offset_m_s,
        apex_y_m: y_m as f32,
        density_ratio: density_ratio as f32,
    }
}

/// Returns the controller's action in the numbers of the plant.
fn to_plant(action: leg_control::actor::Action) -> Action {
    Action {
        touchdown_angle_rad: f64::from(action.touchdown_angle_rad),
        elongation_speed_m_s: f64::from(action.elongation_speed_m_s),
    }
}

/// Returns the next apex, or `None` after a fall, with `offset_m_s` subtracted from the
/// velocity that the actor observes.
#[must_use]
pub fn hop(
    actor: &Actor<'_>,
    hopper: &Hopper,
    density_ratio: f64,
    apex: Apex,
    offset_m_s: f32,
) -> Option<Apex> {
    hopper.hop(apex, act(actor, density_ratio, apex, offset_m_s)).outcome.next()
}
