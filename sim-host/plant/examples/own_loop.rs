//! Drives the plant from one's own program: a leg under a hand-written control law, which lets it
//! travel from water onto land. Prints every apex, and beside it the apex map's prediction from
//! the apex before.
//!
//! `cargo run -p leg-plant --example own_loop`

use std::f64::consts::FRAC_PI_2;

use leg_plant::{
    Action, Apex, Body, EventKind, Flat, Hopper, Leg, LegCommand, Medium, ParameterError, TickPlant,
};

/// Length of a tick, s.
const TICK_S: f64 = 1e-3;

/// Chooses the next hop as Raibert's hopper does: a foot that lands farther ahead brakes more.
/// The drag of the water needs a leg that pushes; on land the spring returns the energy.
fn choose(apex: Apex, target_m_s: f64, density_ratio: f64) -> Action {
    let lean_rad = 0.1 * apex.vx_m_s + 0.1 * (apex.vx_m_s - target_m_s);
    let push_m_s = 0.9 * density_ratio * (2.5 - apex.y_m).clamp(0.0, 1.0);
    Action { touchdown_angle_rad: FRAC_PI_2 + lean_rad, elongation_speed_m_s: push_m_s }
}

/// Returns the density ratio at a place: water up to 4 m, land from 8 m on.
fn density_ratio(x_m: f64) -> f64 {
    ((8.0 - x_m) / 4.0).clamp(0.0, 1.0)
}

fn main() -> Result<(), ParameterError> {
    let leg = Leg::human();
    let start = Body { x_m: 0.0, vx_m_s: 0.3, y_m: 1.6, vy_m_s: 0.0 };
    let mut plant = TickPlant::new(leg, start);
    let mut apex = Apex { vx_m_s: start.vx_m_s, y_m: start.y_m };
    let mut action = choose(apex, 0.5, density_ratio(start.x_m));
    // Time since touchdown, s; the leg elongates from there on.
    let mut in_stance_s = None;

    println!("{:>7} {:>7} {:>8} {:>7}   apex map: vx, y", "t, s", "x, m", "vx, m/s", "y, m");
    let mut hops = 0;
    for tick in 0_u32.. {
        let medium = Medium::AIR.with_density_ratio(density_ratio(plant.body().x_m))?;
        let rate_m_s = if in_stance_s.is_some() { action.elongation_speed_m_s } else { 0.0 };
        let command = LegCommand {
            leg_angle_rad: action.touchdown_angle_rad,
            elongation_m: rate_m_s * in_stance_s.unwrap_or(0.0),
            elongation_rate_m_s: rate_m_s,
        };
        in_stance_s = in_stance_s.map(|t_s: f64| t_s + TICK_S);
        for event in &*plant.step(TICK_S, command, medium, &Flat) {
            match event.kind {
                EventKind::Touchdown { .. } => in_stance_s = Some(TICK_S - event.t_s),
                EventKind::LiftOff => in_stance_s = None,
                EventKind::Apex => {
                    let predicted = Hopper::new(&leg, medium).hop(apex, action).outcome.next();
                    let predicted = predicted
                        .map_or("a fall".to_owned(), |p| format!("{:.3}, {:.3}", p.vx_m_s, p.y_m));
                    let Body { x_m, vx_m_s, y_m, .. } = event.body;
                    let t_s = f64::from(tick) * TICK_S + event.t_s;
                    println!("{t_s:7.3} {x_m:7.3} {vx_m_s:8.3} {y_m:7.3}   {predicted}");
                    apex = Apex { vx_m_s, y_m };
                    action = choose(apex, 0.5, density_ratio(x_m));
                    hops += 1;
                }
                EventKind::Fall => {
                    println!("fell at x = {:.3} m", event.body.x_m);
                    return Ok(());
                }
            }
        }
        if hops == 24 {
            break;
        }
    }
    Ok(())
}
