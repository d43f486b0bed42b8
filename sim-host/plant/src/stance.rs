//! Punting: the stance, one smooth stretch at a time.
//!
//! The right-hand side has corners: the drag `v |v|` where a velocity changes its sign, and the
//! rest length where the actuator starts or stops. Across a corner a series of high order is
//! worth nothing, so every stretch ends on the next one, and is exact in between.

use super::elongation::{Elongation, Ramp};
use super::roots::{Edge, first_crossing};
use super::taylor::{Field, Jet, Rates, State};

/// A stance that takes longer than this counts as a fall.
const LONGEST_STANCE_S: f64 = 25.0;

/// Bounds the work for the stiffest of legs.
const MOST_STRETCHES: u32 = 100_000;

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
    pub(super) fn follow(
        jet: &mut Jet,
        field: &Field,
        start: &State,
        ramp: Ramp,
        known_length_m: Option<f64>,
        limit_s: f64,
        tolerance_m_s: f64,
    ) -> Self {
        jet.expand(field, start, ramp);
        let mut from = Moment { t_s: 0.0, state: *start, rates: jet.start_rates() };
        if let Some(length_m) = known_length_m {
            from.rates.excess_m = length_m - ramp.length_m;
        }
        // A leg at its rest length, or beyond, that does not get shorter bears nothing.
        let (excess_m, excess_m_s) = from.excess();
        if excess_m > 0.0 || (excess_m == 0.0 && excess_m_s >= 0.0) {
            return from.with(Corner::LiftOff);
        }
        let reach_s = jet.reach_s(tolerance_m_s).min(limit_s);
        let mut to = Moment::of(jet, field, reach_s);
        let mut corner = Corner::Limit;

        let first = |edge: fn(&Moment) -> Edge, to: &Moment| {
            let mut seen = *to;
            let t_s = first_crossing(edge(&from), edge(to), to.t_s, |t_s| {
                seen = Moment::of(jet, field, t_s);
                edge(&seen)
            })?;
            Some(seen.moved_to(t_s))
        };
        if let Some(at) = first(Moment::excess, &to) {
            (to, corner) = (at, Corner::LiftOff);
        }
        let (vy_m_s, ay_m_s2) = from.vertical();
        let rises = vy_m_s > 0.0 || (vy_m_s == 0.0 && ay_m_s2 > 0.0);
        // Without drag the bottom is no corner, and may be passed over.
        let passes_bottom =
            !field.drags() && !rises && to.vertical().0 > 0.0 && from.stays_up_to(&to);
        if !passes_bottom && let Some(at) = first(Moment::vertical, &to) {
            to = at;
            to.state.velocity_m_s[1] = 0.0;
            corner = if rises { Corner::Apex } else { Corner::Bottom };
        }
        if field.drags()
            && let Some(at) = first(Moment::horizontal, &to)
        {
            to = at;
            to.state.velocity_m_s[0] = 0.0;
            corner = Corner::Swing;
        }
        to.with(corner)
    }
}

/// One moment of a stretch, and how things change there.
#[derive(Clone, Copy)]
struct Moment {
    t_s: f64,
    state: State,
    rates: Rates,
}

impl Moment {
    fn of(jet: &Jet, field: &Field, t_s: f64) -> Self {
        let state = jet.at(t_s);
        Self { t_s, state, rates: jet.rates(field, &state, t_s) }
    }

    /// The same a root finder's last step away, which is too short for a curvature.
    fn moved_to(&self, t_s: f64) -> Self {
        let by_s = t_s - self.t_s;
        let State { place_m, velocity_m_s } = self.state;
        Self {
            t_s,
            state: State {
                place_m: place_m + velocity_m_s.scaled(by_s),
                velocity_m_s: velocity_m_s + self.rates.acceleration_m_s2.scaled(by_s),
            },
            rates: self.rates,
        }
    }

    fn with(&self, corner: Corner) -> Stretch {
        Stretch { t_s: self.t_s, state: self.state, corner }
    }

    fn excess(&self) -> Edge {
        (self.rates.excess_m, self.rates.excess_m_s)
    }

    fn horizontal(&self) -> Edge {
        (self.state.velocity_m_s[0], self.rates.acceleration_m_s2[0])
    }

    fn vertical(&self) -> Edge {
        (self.state.velocity_m_s[1], self.rates.acceleration_m_s2[1])
    }

    /// Whether the height keeps clear of 0 up to `end`, even if it is lowest in between.
    fn stays_up_to(&self, end: &Self) -> bool {
        let lowest_m = self.state.place_m[1].min(end.state.place_m[1]);
        let fastest_m_s = self.vertical().0.abs().max(end.vertical().0.abs());
        lowest_m > fastest_m_s * end.t_s
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
    let mut jet = Jet::new();
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
        t_s = if stretch.t_s == limit_s { kink_s } else { t_s + stretch.t_s };
        // The height is lowest at an end of the stretch, or clear of the ground.
        let stands = state.place_m[1] > 0.0 && t_s <= LONGEST_STANCE_S;
        if !stands {
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

#[cfg(test)]
mod tests {
    use super::super::{flight::Swim, leg::Leg, medium::Medium, pair::Pair};
    use super::*;

    #[test]
    fn a_mirrored_stance_is_the_same_to_the_last_bit() {
        let leg = Leg::human();
        let elongation = Elongation { rest_length_m: 1.0, max_m: 0.2, start_m: 0.0, rate_m_s: 1.2 };
        for medium in [Medium::AIR, Medium::WATER] {
            let field = Field::new(&leg, &Swim::new(&leg, medium));
            let end = |side: f64| {
                let touchdown = State {
                    place_m: Pair([side * 0.28, 0.96]),
                    velocity_m_s: Pair([side * -1.9, -3.1]),
                };
                match punt(&field, touchdown, &elongation, 1e-10) {
                    StanceEnd::LiftOff { t_s, state } => (t_s, state),
                    end => panic!("{end:?}"),
                }
            };
            let ((right_s, right), (left_s, left)) = (end(1.0), end(-1.0));
            let mirror = Pair([-1.0, 1.0]);
            assert_eq!(right_s, left_s);
            assert_eq!(right.place_m * mirror, left.place_m);
            assert_eq!(right.velocity_m_s * mirror, left.velocity_m_s);
        }
    }
}
