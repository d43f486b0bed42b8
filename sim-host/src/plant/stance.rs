//! Punting: from touchdown to lift-off, an apex, or a fall.

use super::polynomial::first_root;
use super::taylor::{Field, Jet, Ramp, State};

/// Coefficients of a step: order of the series and one.
const COEFFICIENTS: usize = 20;

/// A stance that takes longer than this counts as a fall.
const LONGEST_STANCE_S: f64 = 25.0;

/// Bounds the work for the stiffest of legs.
const MOST_STEPS: u32 = 100_000;

/// How a stance ends, and when, counted from touchdown.
#[derive(Clone, Copy, Debug)]
pub(super) enum StanceEnd {
    /// The leg reached its rest length.
    LiftOff { t_s: f64, state: State },
    /// The mass stopped rising while the foot was still down.
    Apex { t_s: f64, state: State },
    /// The mass came down to the ground, or the stance went on too long.
    Fall,
}

/// The elongation over a stance: a ramp up to its end stop.
#[derive(Clone, Copy, Debug)]
pub(super) struct Elongation {
    pub(super) rest_length_m: f64,
    pub(super) max_m: f64,
    pub(super) rate_m_s: f64,
}

/// Follows the stance from touchdown, where the leg has exactly its rest length.
pub(super) fn punt(
    field: &Field,
    touchdown: State,
    elongation: &Elongation,
    tolerance_m_s: f64,
) -> StanceEnd {
    let mut state = touchdown;
    let mut ramp = Ramp {
        length_m: elongation.rest_length_m,
        rate_m_s: elongation.rate_m_s,
    };
    let stop_s = elongation.max_m / elongation.rate_m_s;
    let mut t_s = 0.0;
    for step in 0..MOST_STEPS {
        let mut jet = Jet::<COEFFICIENTS>::expand(field, &state, ramp);
        if step == 0 {
            jet.excess[0] = 0.0;
            if jet.excess[1] >= 0.0 {
                // The leg lengthens faster than its rest length: the foot does not hold.
                return StanceEnd::LiftOff { t_s, state };
            }
        }
        let mut h_s = jet.reach_s(tolerance_m_s);
        let to_stop = ramp.rate_m_s > 0.0 && t_s + h_s >= stop_s;
        if to_stop {
            h_s = stop_s - t_s;
        }
        let turn = first_root(&jet.vy, h_s);
        h_s = turn.unwrap_or(h_s);
        let swing = if field.drag_per_m[0] > 0.0 {
            first_root(&jet.vx, h_s)
        } else {
            None
        };
        h_s = swing.unwrap_or(h_s);
        let lift_off = first_root(&jet.excess, h_s);
        h_s = lift_off.unwrap_or(h_s);
        // A turn that starts from rest is preceded by motion along the acceleration.
        let was_rising = jet.vy[0] > 0.0 || (jet.vy[0] == 0.0 && jet.vy[1] > 0.0);
        state = jet.at(h_s);
        t_s += h_s;
        if state.place_m[1] <= 0.0 || t_s > LONGEST_STANCE_S || !t_s.is_finite() {
            return StanceEnd::Fall;
        }
        if lift_off.is_some() {
            return StanceEnd::LiftOff { t_s, state };
        }
        if swing.is_some() {
            state.velocity_m_s[0] = 0.0;
        } else if turn.is_some() {
            state.velocity_m_s[1] = 0.0;
            if was_rising {
                return StanceEnd::Apex { t_s, state };
            }
        } else if to_stop {
            ramp.rate_m_s = 0.0;
            t_s = stop_s;
        }
        if ramp.rate_m_s > 0.0 {
            ramp.length_m = elongation.rest_length_m + ramp.rate_m_s * t_s;
        } else if stop_s <= t_s {
            ramp.length_m = elongation.rest_length_m + elongation.max_m;
        }
    }
    StanceEnd::Fall
}
