//! Punting: the stance, one smooth stretch at a time.
//!
//! The right-hand side has corners: the drag `v |v|` where a velocity changes its sign, and the
//! rest length where the actuator starts or stops. Across a corner a series of high order is
//! worth nothing, so every stretch ends on the next one, and is exact in between.

use super::elongation::{Elongation, Ramp};
use super::roots::first_root;
use super::taylor::{Field, Jet, State};

/// A stance that takes longer than this counts as a fall.
const LONGEST_STANCE_S: f64 = 25.0;

/// Bounds the work for the stiffest of legs.
const MOST_STRETCHES: u32 = 100_000;

/// Coefficients of the series over a whole stance.
const COEFFICIENTS: usize = 20;

/// What ends a stretch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Corner {
    /// Nothing yet: the series reaches no further, or the time is up.
    Limit,
    /// The horizontal velocity passes 0.
    Swing,
    /// The mass starts to rise.
    Bottom,
    /// The mass stops rising.
    Apex,
    /// The leg reaches its rest length.
    LiftOff,
}

/// A smooth stretch of stance.
pub(super) struct Stretch<const N: usize> {
    pub(super) jet: Jet<N>,
    pub(super) t_s: f64,
    pub(super) state: State,
    pub(super) corner: Corner,
}

impl<const N: usize> Stretch<N> {
    /// Goes from `start` to the first corner, `limit_s` at most.
    ///
    /// At touchdown the leg length is known exactly, which says whether the foot holds at all:
    /// `known_length_m` is it then.
    pub(super) fn follow(
        field: &Field,
        start: &State,
        ramp: Ramp,
        known_length_m: Option<f64>,
        limit_s: f64,
        tolerance_m_s: f64,
    ) -> Self {
        let mut jet = Jet::<N>::expand(field, start, ramp);
        if let Some(length_m) = known_length_m {
            jet.excess[0] = (length_m - ramp.length_m) * (length_m + ramp.length_m);
        }
        // A leg at its rest length, or beyond, that does not get shorter bears nothing.
        if jet.excess[0] > 0.0 || (jet.excess[0] == 0.0 && jet.excess[1] >= 0.0) {
            return Self {
                jet,
                t_s: 0.0,
                state: *start,
                corner: Corner::LiftOff,
            };
        }
        let mut t_s = jet.reach_s(tolerance_m_s).min(limit_s);
        let mut corner = Corner::Limit;
        if let Some(turn_s) = first_root(&jet.vy, t_s) {
            // A velocity that starts at 0 takes the sign of its acceleration.
            let rises = jet.vy[0] > 0.0 || (jet.vy[0] == 0.0 && jet.vy[1] > 0.0);
            corner = if rises { Corner::Apex } else { Corner::Bottom };
            t_s = turn_s;
        }
        if field.drag_per_m[0] > 0.0
            && let Some(swing_s) = first_root(&jet.vx, t_s)
        {
            (t_s, corner) = (swing_s, Corner::Swing);
        }
        if let Some(lift_off_s) = first_root(&jet.excess, t_s) {
            (t_s, corner) = (lift_off_s, Corner::LiftOff);
        }
        let mut state = jet.at(t_s);
        match corner {
            Corner::Swing => state.velocity_m_s[0] = 0.0,
            Corner::Bottom | Corner::Apex => state.velocity_m_s[1] = 0.0,
            Corner::Limit | Corner::LiftOff => {}
        }
        Self {
            jet,
            t_s,
            state,
            corner,
        }
    }
}

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

/// Follows a stance on level ground from touchdown, where the leg has its rest length.
pub(super) fn punt(
    field: &Field,
    touchdown: State,
    elongation: &Elongation,
    tolerance_m_s: f64,
) -> StanceEnd {
    let (mut t_s, mut state) = (0.0, touchdown);
    let mut known_length_m = Some(elongation.rest_length_m);
    for _ in 0..MOST_STRETCHES {
        let (ramp, kink_s) = elongation.ramp(t_s);
        let limit_s = kink_s - t_s;
        let stretch = Stretch::<COEFFICIENTS>::follow(
            field,
            &state,
            ramp,
            known_length_m.take(),
            limit_s,
            tolerance_m_s,
        );
        state = stretch.state;
        t_s = if stretch.t_s == limit_s {
            kink_s
        } else {
            t_s + stretch.t_s
        };
        // The vertical velocity keeps its sign over a stretch: the height is lowest at an end.
        if state.place_m[1] <= 0.0 || t_s > LONGEST_STANCE_S || !t_s.is_finite() {
            return StanceEnd::Fall;
        }
        match stretch.corner {
            Corner::LiftOff => return StanceEnd::LiftOff { t_s, state },
            Corner::Apex => return StanceEnd::Apex { t_s, state },
            Corner::Limit | Corner::Swing | Corner::Bottom => {}
        }
    }
    StanceEnd::Fall
}
