//! Searches the steady gaits of the leg for those that need the least friction of the ground, by
//! speed and density: no controller travels at that speed on ground that is more slippery, unless
//! its hops differ from one to the next.
//!
//! `cargo run --release -p leg-plant --example friction`

use leg_plant::{Action, Apex, Hopper, Leg, Medium, ParameterError};

/// Speeds, m/s.
const SPEEDS_M_S: [f64; 4] = [0.5, 0.8, 1.0, 2.0];
/// Density ratios. (Without drag no energy is lost, and the height of a gait is arbitrary.)
const DENSITIES: [f64; 4] = [0.3, 0.7, 0.9, 1.0];
/// Largest speed of elongation that is tried, m/s.
const MAX_ELONGATION_M_S: f64 = 1.2;
/// Values of each unknown at which the search begins.
const GRID: u8 = 8;

/// A gait that repeats itself after one hop at a given speed.
#[derive(Clone, Copy)]
struct Gait {
    start: Apex,
    action: Action,
}

impl Gait {
    fn new(vx_m_s: f64, [y_m, touchdown_angle_rad]: [f64; 2], elongation_speed_m_s: f64) -> Self {
        let action = Action { touchdown_angle_rad, elongation_speed_m_s };
        Self { start: Apex { vx_m_s, y_m }, action }
    }

    /// Returns how far the next apex is from this one, or `None` after a fall.
    fn error(&self, hopper: &Hopper) -> Option<[f64; 2]> {
        let next = hopper.hop(self.start, self.action).outcome.next()?;
        Some([next.vx_m_s - self.start.vx_m_s, next.y_m - self.start.y_m])
    }
}

/// Finds height and angle of a steady gait by Newton's method from a guess.
fn steady(hopper: &Hopper, vx_m_s: f64, guess: [f64; 2], elongation_m_s: f64) -> Option<Gait> {
    let mut at = guess;
    for _ in 0..12 {
        let gait = Gait::new(vx_m_s, at, elongation_m_s);
        let error = gait.error(hopper)?;
        if error.iter().all(|e| e.abs() < 1e-9) {
            return (gait.start.y_m >= 1.0).then_some(gait);
        }
        let slope = |i: usize| {
            let mut moved = at;
            moved[i] += 1e-6;
            let there = Gait::new(vx_m_s, moved, elongation_m_s).error(hopper)?;
            Some([(there[0] - error[0]) / 1e-6, (there[1] - error[1]) / 1e-6])
        };
        let (by_height, by_angle) = (slope(0)?, slope(1)?);
        let determinant = by_height[0] * by_angle[1] - by_angle[0] * by_height[1];
        at[0] -= (error[0] * by_angle[1] - by_angle[0] * error[1]) / determinant;
        at[1] -= (by_height[0] * error[1] - error[0] * by_height[1]) / determinant;
    }
    None
}

/// Returns the least friction of the steady gaits that the search finds, with its gait.
fn least(hopper: &Hopper, vx_m_s: f64) -> Option<(f64, Gait)> {
    let between = |from: f64, to: f64| {
        (0..=GRID).map(move |i| from + (to - from) * f64::from(i) / f64::from(GRID))
    };
    let starts = between(1.05, 2.6)
        .flat_map(|y_m| between(1.0, 1.65).map(move |angle_rad| [y_m, angle_rad]));
    between(0.0, MAX_ELONGATION_M_S)
        .flat_map(|speed_m_s| starts.clone().map(move |start| (start, speed_m_s)))
        .filter_map(|(start, speed_m_s)| steady(hopper, vx_m_s, start, speed_m_s))
        .filter_map(|gait| Some((hopper.friction(gait.start, gait.action)?, gait)))
        .min_by(|a, b| a.0.total_cmp(&b.0))
}

fn main() -> Result<(), ParameterError> {
    println!("least friction of a steady gait, with its height (m), angle (rad), elongation (m/s)");
    for rho in DENSITIES {
        let hopper = Hopper::new(&Leg::human(), Medium::AIR.with_density_ratio(rho)?);
        for vx_m_s in SPEEDS_M_S {
            match least(&hopper, vx_m_s) {
                Some((friction, Gait { start, action })) => println!(
                    "density ratio {rho:.1}, {vx_m_s:.1} m/s: {friction:.2} ({:.2}, {:.3}, {:.2})",
                    start.y_m, action.touchdown_angle_rad, action.elongation_speed_m_s
                ),
                None => println!("density ratio {rho:.1}, {vx_m_s:.1} m/s: none found"),
            }
        }
    }
    Ok(())
}
