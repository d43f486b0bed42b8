//! Punting: the stance, one smooth stretch at a time.
//!
//! The right-hand side has corners: the drag `v |v|` where a velocity changes its sign, and the
//! rest length where the actuator starts or stops. Across a corner a series of high order is
//! worth nothing, so every stretch ends on the next one, and is exact in between.

use super::elongation::{Elongation, Ramp};
use super::roots::first_crossing;
use super::taylor::{Field, Jet, Rates, State};

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

/// Where a smooth stretch of stance ends.
pub(super) struct Stretch {
    pub(super) t_s: f64,
    pub(super) state: State,
    pub(super) corner: Corner,
}

impl Stretch {
    /// Goes from `start` to the first corner, `limit_s` at most; leaves the series in `jet`.
    ///
    /// At touchdown the leg length is known exactly, which says whether the foot holds at all:
    /// `known_length_m` is it then.
    pub(super) fn follow<const N: usize>(
        jet: &mut Jet<N>,
        field: &Field,
        start: &State,
        ramp: Ramp,
        known_length_m: Option<f64>,
        limit_s: f64,
        tolerance_m_s: f64,
    ) -> Self {
        jet.expand(field, start, ramp);
        let mut at_start = jet.start();
        if let Some(length_m) = known_length_m {
            at_start.excess_m = length_m - ramp.length_m;
        }
        // A leg at its rest length, or beyond, that does not get shorter bears nothing.
        if at_start.excess_m > 0.0 || (at_start.excess_m == 0.0 && at_start.excess_m_s >= 0.0) {
            return Self {
                t_s: 0.0,
                state: *start,
                corner: Corner::LiftOff,
            };
        }
        let mut stretch = Self {
            t_s: jet.reach_s(tolerance_m_s).min(limit_s),
            state: *start,
            corner: Corner::Limit,
        };
        let mut at_end = stretch.arrive(jet, field);

        let excess = |r: &Rates| (r.excess_m, r.excess_m_s);
        let lift_off = first_crossing(excess(&at_start), excess(&at_end), stretch.t_s, |t_s| {
            jet.excess(t_s)
        });
        if let Some(t_s) = lift_off {
            (stretch.t_s, stretch.corner) = (t_s, Corner::LiftOff);
            at_end = stretch.arrive(jet, field);
        }
        let speed = |state: &State, rates: &Rates, axis: usize| {
            (state.velocity_m_s[axis], rates.acceleration_m_s2[axis])
        };
        let (from, to) = (
            speed(start, &at_start, 1),
            speed(&stretch.state, &at_end, 1),
        );
        let rises = from.0 > 0.0 || (from.0 == 0.0 && from.1 > 0.0);
        // Without drag the bottom is no corner, and may be passed over.
        let passes_bottom = !field.drags() && !rises && to.0 > 0.0 && stretch.stays_up(start);
        if !passes_bottom
            && let Some(t_s) = first_crossing(from, to, stretch.t_s, |t_s| jet.speed(1, t_s))
        {
            stretch.t_s = t_s;
            stretch.corner = if rises { Corner::Apex } else { Corner::Bottom };
            at_end = stretch.arrive(jet, field);
            stretch.state.velocity_m_s[1] = 0.0;
        }
        if field.drags() {
            let (from, to) = (
                speed(start, &at_start, 0),
                speed(&stretch.state, &at_end, 0),
            );
            if let Some(t_s) = first_crossing(from, to, stretch.t_s, |t_s| jet.speed(0, t_s)) {
                (stretch.t_s, stretch.corner) = (t_s, Corner::Swing);
                stretch.arrive(jet, field);
                stretch.state.velocity_m_s[0] = 0.0;
            }
        }
        stretch
    }

    /// Takes the state at the end from the series.
    fn arrive<const N: usize>(&mut self, jet: &Jet<N>, field: &Field) -> Rates {
        self.state = jet.at(self.t_s);
        jet.rates(field, &self.state, self.t_s)
    }

    /// Whether the height keeps clear of 0 even where its lowest point lies inside the stretch
    /// and not at an end. Only without drag may it lie there, for the bottom is no corner then.
    fn stays_up(&self, start: &State) -> bool {
        let lowest_m = start.place_m[1].min(self.state.place_m[1]);
        let fastest_m_s = start.velocity_m_s[1]
            .abs()
            .max(self.state.velocity_m_s[1].abs());
        lowest_m > fastest_m_s * self.t_s
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
    let mut jet = Jet::<COEFFICIENTS>::new();
    for _ in 0..MOST_STRETCHES {
        let (ramp, kink_s) = elongation.ramp(t_s);
        let limit_s = kink_s - t_s;
        let stretch = Stretch::follow(
            &mut jet,
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
        // The height is lowest at an end of the stretch, or clear of the ground.
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
