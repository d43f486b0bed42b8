//! What an actor is worth: survival, stopping, tracking and speed, with the very
//! actor and cascade that fly in the controller.
//!
//! Results do not depend on the number of threads: every start is drawn before
//! any is run, and results are gathered in their order.

pub mod compare;
pub mod conditions;
mod crossing;
pub mod gains;
pub mod goals;
pub mod intervals;
pub mod report;
pub mod selection;
pub mod survival;
pub mod tracking;

use leg_control::actor::{Actor, Observation};
use leg_plant::{Action, Apex, Hopper, Leg, Medium};

/// The density ratios of the paper's figures and in between, lowest first.
pub const DENSITIES: [f64; 8] = [0.0, 0.05, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0];

/// The paper's leg in a medium of this density ratio on earth.
///
/// # Panics
/// If `density_ratio` is negative or not finite.
#[must_use]
pub fn hopper(density_ratio: f64) -> Hopper {
    let medium = Medium::AIR.with_density_ratio(density_ratio).expect("a density ratio");
    Hopper::new(&Leg::human(), medium)
}

/// What the actor does at an apex, its observed velocity less by `offset_m_s`.
#[must_use]
pub fn act(actor: &Actor<'_>, density_ratio: f64, apex: Apex, offset_m_s: f32) -> Action {
    let action = actor.act(Observation {
        apex_vx_m_s: apex.vx_m_s as f32 - offset_m_s,
        apex_y_m: apex.y_m as f32,
        density_ratio: density_ratio as f32,
    });
    Action {
        touchdown_angle_rad: f64::from(action.touchdown_angle_rad),
        elongation_speed_m_s: f64::from(action.elongation_speed_m_s),
    }
}

/// One hop of the actor, whose observed velocity is less by `offset_m_s`.
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
