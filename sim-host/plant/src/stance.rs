//! Stance, one smooth segment at a time.
//!
//! These are the paper's equations (2.1) with the foot fixed. (In water the paper and the USLIP
//! literature call this phase punting.) The right-hand side has corners: the drag `v |v|` where a
//! velocity changes its sign, and the rest length where the actuator starts or stops. A series of
//! high order is not valid across a corner, so every segment ends at the next one.

use crate::elongation::{Elongation, Ramp};
use crate::roots::{ValueSlope, first_crossing};
use crate::taylor::{Field, Jet, Rates, State};

/// Duration of a stance above which it counts as a fall.
const MAX_STANCE_S: f64 = 25.0;

/// Number of segments that bounds the work for very stiff legs.
const MAX_SEGMENTS: u32 = 100_000;

/// The event that ends a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Corner {
    /// No event: the limit of the series or of the time.
    Limit,
    /// The horizontal velocity changes its sign.
    HorizontalTurn,
    /// The mass starts to rise.
    Bottom,
    /// The mass stops rising.
    Apex,
    /// The leg reaches its rest length.
    LiftOff,
}

/// End of a smooth segment of stance.
pub(crate) struct Segment {
    pub(crate) t_s: f64,
    pub(crate) state: State,
    pub(crate) corner: Corner,
}

impl Segment {
    /// Integrates from `start` to the first corner, at most for `limit_s`, and leaves the series
    /// in `jet`.
    ///
    /// At touchdown the leg length is known exactly. The caller then passes it in
    /// `known_length_m`, so that rounding cannot decide whether the foot holds.
    pub(crate) fn integrate(
        jet: &mut Jet,
        field: &Field,
        start: &State,
        ramp: Ramp,
        known_length_m: Option<f64>,
        limit_s: f64,
        tolerance_m_s: f64,
    ) -> Self {
        jet.expand(field, start, ramp);
        let mut from = Instant { t_s: 0.0, state: *start, rates: jet.start_rates() };
        if let Some(length_m) = known_length_m {
            from.rates.excess_m = length_m - ramp.length_m;
        }
        // A leg at or beyond its rest length that does not shorten carries no load.
        let (excess_m, excess_m_s) = from.excess();
        if excess_m > 0.0 || (excess_m == 0.0 && excess_m_s >= 0.0) {
            return from.ending_in(Corner::LiftOff);
        }
        let reach_s = jet.reach_s(tolerance_m_s).min(limit_s);
        let mut to = Instant::at(jet, field, reach_s);
        let mut corner = Corner::Limit;

        let first = |event: fn(&Instant) -> ValueSlope, to: &Instant| {
            let mut latest = *to;
            let t_s = first_crossing(event(&from), event(to), to.t_s, |t_s| {
                latest = Instant::at(jet, field, t_s);
                event(&latest)
            })?;
            Some(latest.moved_to(t_s))
        };
        if let Some(at) = first(Instant::excess, &to) {
            (to, corner) = (at, Corner::LiftOff);
        }
        let (vy_m_s, ay_m_s2) = from.vertical();
        let rises = vy_m_s > 0.0 || (vy_m_s == 0.0 && ay_m_s2 > 0.0);
        // Without drag the lowest point is no corner, so the segment may go on beyond it.
        let passes_bottom = !field.has_drag()
            && !rises
            && to.vertical().0 > 0.0
            && from.stays_above_ground_until(&to);
        if !passes_bottom && let Some(at) = first(Instant::vertical, &to) {
            to = at;
            to.state.velocity_m_s[1] = 0.0;
            corner = if rises { Corner::Apex } else { Corner::Bottom };
        }
        if field.has_drag()
            && let Some(at) = first(Instant::horizontal, &to)
        {
            to = at;
            to.state.velocity_m_s[0] = 0.0;
            corner = Corner::HorizontalTurn;
        }
        to.ending_in(corner)
    }
}

/// State and rates at one instant of a segment.
#[derive(Clone, Copy)]
struct Instant {
    t_s: f64,
    state: State,
    rates: Rates,
}

impl Instant {
    fn at(jet: &Jet, field: &Field, t_s: f64) -> Self {
        let state = jet.at(t_s);
        Self { t_s, state, rates: jet.rates(field, &state, t_s) }
    }

    /// Moves by the last step of a root finder, which is so short that first order suffices.
    fn moved_to(&self, t_s: f64) -> Self {
        let by_s = t_s - self.t_s;
        let State { position_m, velocity_m_s } = self.state;
        Self {
            t_s,
            state: State {
                position_m: position_m + velocity_m_s.scaled(by_s),
                velocity_m_s: velocity_m_s + self.rates.acceleration_m_s2.scaled(by_s),
            },
            rates: self.rates,
        }
    }

    fn ending_in(&self, corner: Corner) -> Segment {
        Segment { t_s: self.t_s, state: self.state, corner }
    }

    fn excess(&self) -> ValueSlope {
        (self.rates.excess_m, self.rates.excess_m_s)
    }

    fn horizontal(&self) -> ValueSlope {
        (self.state.velocity_m_s[0], self.rates.acceleration_m_s2[0])
    }

    fn vertical(&self) -> ValueSlope {
        (self.state.velocity_m_s[1], self.rates.acceleration_m_s2[1])
    }

    /// Returns true if the height surely stays above 0 up to `end`.
    fn stays_above_ground_until(&self, end: &Self) -> bool {
        let lowest_m = self.state.position_m[1].min(end.state.position_m[1]);
        let fastest_m_s = self.vertical().0.abs().max(end.vertical().0.abs());
        lowest_m > fastest_m_s * end.t_s
    }
}

/// End of a stance; times count from touchdown.
#[derive(Clone, Copy, Debug)]
pub(crate) enum StanceEnd {
    /// The leg reached its rest length.
    LiftOff { t_s: f64, state: State },
    /// The mass stopped rising while the foot was still down.
    Apex { t_s: f64, state: State },
    /// The mass came down to the ground, or the stance went on too long.
    Fall,
}

/// Integrates a stance on level ground from touchdown, where the leg has its rest length.
///
/// Shows `observe` the series of each segment and how long it is followed, s.
pub(crate) fn integrate(
    field: &Field,
    touchdown: State,
    elongation: &Elongation,
    tolerance_m_s: f64,
    mut observe: impl FnMut(&Jet, f64),
) -> StanceEnd {
    let (mut t_s, mut state) = (0.0, touchdown);
    let mut known_length_m = Some(elongation.rest_length_m);
    let mut jet = Jet::new();
    for _ in 0..MAX_SEGMENTS {
        let (ramp, corner_s) = elongation.ramp(t_s);
        let limit_s = corner_s - t_s;
        let segment = Segment::integrate(
            &mut jet,
            field,
            &state,
            ramp,
            known_length_m.take(),
            limit_s,
            tolerance_m_s,
        );
        observe(&jet, segment.t_s);
        state = segment.state;
        t_s = if segment.t_s == limit_s { corner_s } else { t_s + segment.t_s };
        // Within a segment the height is lowest at an end or surely above the ground.
        let upright = state.position_m[1] > 0.0 && t_s <= MAX_STANCE_S;
        if !upright {
            return StanceEnd::Fall;
        }
        match segment.corner {
            Corner::LiftOff => return StanceEnd::LiftOff { t_s, state },
            Corner::Apex => return StanceEnd::Apex { t_s, state },
            Corner::Limit | Corner::HorizontalTurn | Corner::Bottom => {}
        }
    }
    StanceEnd::Fall
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{flight::Flight, leg::Leg, medium::Medium, pair::Pair};

    #[test]
    fn a_mirrored_stance_gives_mirrored_bits() {
        let leg = Leg::human();
        let elongation = Elongation { rest_length_m: 1.0, max_m: 0.2, start_m: 0.0, rate_m_s: 1.2 };
        for medium in [Medium::AIR, Medium::WATER] {
            let field = Field::new(&leg, &Flight::new(&leg, medium));
            let end = |side: f64| {
                let touchdown = State {
                    position_m: Pair([side * 0.28, 0.96]),
                    velocity_m_s: Pair([side * -1.9, -3.1]),
                };
                match integrate(&field, touchdown, &elongation, 1e-10, |_, _| ()) {
                    StanceEnd::LiftOff { t_s, state } => (t_s, state),
                    end => panic!("{end:?}"),
                }
            };
            let ((right_s, right), (left_s, left)) = (end(1.0), end(-1.0));
            let mirror = Pair([-1.0, 1.0]);
            assert_eq!(right_s, left_s);
            assert_eq!(right.position_m * mirror, left.position_m);
            assert_eq!(right.velocity_m_s * mirror, left.velocity_m_s);
        }
    }
}
