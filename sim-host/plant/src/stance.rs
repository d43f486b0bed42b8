//! Stance, one smooth segment at a time.
//!
//! These are the paper's equations (2.1) with the foot fixed. (In water the paper and the USLIP
//! literature call this phase punting.) The right-hand side has corners: the drag `v |v|` where a
//! velocity changes its sign, and the rest length where the actuator starts or stops. A series of
//! high order is not valid across a corner, so every segment ends at the next one.

use crate::elongation::{Elongation, Ramp};
use crate::pair::Pair;
use crate::real::{Mask, Real};
use crate::roots::{Crossing, Curve, ValueSlope, select};
use crate::taylor::{Field, Jet, Rates, State};

/// Duration of a stance above which it counts as a fall.
const MAX_STANCE_S: f64 = 25.0;

/// Number of segments that bounds the work for very stiff legs.
const MAX_SEGMENTS: f64 = 100_000.0;

/// The event that ends a segment, in each lane at most one; none is the limit of the series or of
/// the time, a mass that starts to rise, or a horizontal velocity that changes its sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Corner<M = bool> {
    /// The mass stops rising.
    pub(crate) apex: M,
    /// The leg reaches its rest length.
    pub(crate) lift_off: M,
}

/// End of a smooth segment of stance.
pub(crate) struct Segment<L: Real = f64> {
    pub(crate) t_s: L,
    pub(crate) state: State<L>,
    pub(crate) corner: Corner<L::Mask>,
}

impl Segment {
    /// Integrates a single stance, see [`Segment::integrate`].
    pub(crate) fn of_one(
        jet: &mut Jet,
        field: &Field,
        start: &State,
        ramp: Ramp,
        known_length_m: Option<f64>,
        limit_s: f64,
        tolerance_m_s: f64,
    ) -> Self {
        let known = (known_length_m.is_some(), known_length_m.unwrap_or_default());
        Self::integrate(jet, field, start, ramp, known, limit_s, tolerance_m_s)
    }
}

impl<L: Real> Segment<L> {
    /// Integrates from `start` to the first corner, at most for `limit_s`, and leaves the series
    /// in `jet`.
    ///
    /// At touchdown the leg length is known exactly. The caller then passes it in
    /// `known_length_m`, so that rounding cannot decide whether the foot holds.
    #[inline(always)]
    pub(crate) fn integrate(
        jet: &mut Jet<L>,
        field: &Field<L>,
        start: &State<L>,
        ramp: Ramp<L>,
        (length_is_known, known_length_m): (L::Mask, L),
        limit_s: L,
        tolerance_m_s: L,
    ) -> Self {
        let zero = limit_s.splat(0.0);
        jet.expand(field, start, ramp);
        let mut from = Instant { t_s: zero, state: *start, rates: jet.start_rates() };
        from.rates.excess_m =
            L::select(length_is_known, known_length_m - ramp.length_m, from.rates.excess_m);
        // A leg at or beyond its rest length that does not shorten carries no load.
        let (excess_m, excess_m_s) = from.excess();
        let unloaded = zero.lt(excess_m) | (excess_m.eq(zero) & zero.le(excess_m_s));
        let loaded = !unloaded;
        let none = loaded & unloaded;
        let mut corner = Corner { apex: none, lift_off: unloaded };
        if !loaded.any() {
            return Segment { t_s: zero, state: *start, corner };
        }
        let reach_s = jet.reach_s(tolerance_m_s).min(limit_s);
        let mut to = Instant::at(jet, field, reach_s);

        let (vy_m_s, ay_m_s2) = from.vertical();
        let rises = zero.lt(vy_m_s) | (vy_m_s.eq(zero) & zero.lt(ay_m_s2));
        let has_drag = field.has_drag();
        // The lanes in which an event is still to be looked for. Each event is looked for up to
        // the one found before.
        let mut open = [loaded, loaded, loaded & has_drag];
        loop {
            // Without drag the lowest point is no corner, so the segment may go on beyond it.
            let passes_bottom =
                !has_drag & !rises & zero.lt(to.vertical().0) & from.stays_above_ground_until(&to);
            let t_s = to.t_s;
            let lift = Crossing::between(open[0], from.excess(), to.excess(), t_s);
            let may_turn = open[1] & !passes_bottom;
            let turn = Crossing::between(may_turn, from.vertical(), to.vertical(), t_s);
            let shift = Crossing::between(open[2], from.horizontal(), to.horizontal(), t_s);
            let (lifts, turns, shifts) = (lift.likely(), turn.likely(), shift.likely());
            let chosen = lifts | turns | shifts;
            if !chosen.any() {
                break;
            }
            let (lifts, turns) = (lifts, turns & !lifts);
            let shifts = chosen & !lifts & !turns;
            open = [open[0] & !chosen, open[1] & !(turns | shifts), open[2] & !shifts];
            let first = Crossing::select(lifts, &lift, &Crossing::select(turns, &turn, &shift));
            let mut probe = Probe { lifts, turns, jet, field, latest: to };
            let (found, t_s) = first.first(&mut probe);
            let found = found & chosen;
            to = Instant::select(found, &probe.latest.moved_to(t_s), &to);
            let [vx_m_s, vy_m_s] = &mut to.state.velocity_m_s.0;
            *vx_m_s = L::select(found & shifts, zero, *vx_m_s);
            *vy_m_s = L::select(found & turns, zero, *vy_m_s);
            corner.lift_off = (corner.lift_off & !found) | (found & lifts);
            corner.apex = (corner.apex & !found) | (found & turns & rises);
        }
        Segment {
            t_s: L::select(loaded, to.t_s, zero),
            state: State::select(loaded, &to.state, start),
            corner,
        }
    }
}

/// State and rates at one instant of a segment.
#[derive(Clone, Copy)]
struct Instant<L> {
    t_s: L,
    state: State<L>,
    rates: Rates<L>,
}

/// The function of an event over a segment, with the latest instant at which it was evaluated.
struct Probe<'a, L: Real> {
    /// The lanes of the lift-off.
    lifts: L::Mask,
    /// The lanes in which the vertical velocity changes its sign; of the others the horizontal.
    turns: L::Mask,
    jet: &'a Jet<L>,
    field: &'a Field<L>,
    latest: Instant<L>,
}

impl<L: Real> Curve<L> for Probe<'_, L> {
    #[inline(always)]
    fn at(&mut self, t_s: L) -> ValueSlope<L> {
        self.latest = Instant::at(self.jet, self.field, t_s);
        let others = select(self.turns, self.latest.vertical(), self.latest.horizontal());
        select(self.lifts, self.latest.excess(), others)
    }
}

impl<L: Real> Instant<L> {
    #[inline(always)]
    fn at(jet: &Jet<L>, field: &Field<L>, t_s: L) -> Self {
        let state = jet.at(t_s);
        Self { t_s, state, rates: jet.rates(field, &state, t_s) }
    }

    #[inline(always)]
    fn select(mask: L::Mask, yes: &Self, no: &Self) -> Self {
        let (a, b) = (&yes.rates, &no.rates);
        Self {
            t_s: L::select(mask, yes.t_s, no.t_s),
            state: State::select(mask, &yes.state, &no.state),
            rates: Rates {
                excess_m: L::select(mask, a.excess_m, b.excess_m),
                excess_m_s: L::select(mask, a.excess_m_s, b.excess_m_s),
                acceleration_m_s2: Pair::select(mask, a.acceleration_m_s2, b.acceleration_m_s2),
            },
        }
    }

    /// Moves by the last step of a root finder, which is so short that first order suffices.
    #[inline(always)]
    fn moved_to(&self, t_s: L) -> Self {
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

    #[inline(always)]
    fn excess(&self) -> ValueSlope<L> {
        (self.rates.excess_m, self.rates.excess_m_s)
    }

    #[inline(always)]
    fn horizontal(&self) -> ValueSlope<L> {
        (self.state.velocity_m_s[0], self.rates.acceleration_m_s2[0])
    }

    #[inline(always)]
    fn vertical(&self) -> ValueSlope<L> {
        (self.state.velocity_m_s[1], self.rates.acceleration_m_s2[1])
    }

    /// Returns true if the height surely stays above 0 up to `end`.
    #[inline(always)]
    fn stays_above_ground_until(&self, end: &Self) -> L::Mask {
        let lowest_m = self.state.position_m[1].min(end.state.position_m[1]);
        let fastest_m_s = self.vertical().0.abs().max(end.vertical().0.abs());
        (fastest_m_s * end.t_s).lt(lowest_m)
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

/// What all segments of a stance share.
#[derive(Clone, Copy)]
pub(crate) struct Setting<L = f64> {
    pub(crate) field: Field<L>,
    pub(crate) elongation: Elongation<L>,
    pub(crate) tolerance_m_s: L,
}

/// A stance on level ground under way.
#[derive(Clone, Copy)]
pub(crate) struct Stance<L = f64> {
    /// Number of segments so far.
    pub(crate) segments: L,
    pub(crate) t_s: L,
    pub(crate) state: State<L>,
}

/// The lanes in which a segment ended the stance, each in at most one of them.
pub(crate) struct Ended<M = bool> {
    pub(crate) corner: Corner<M>,
    pub(crate) fall: M,
}

impl<L: Real> Stance<L> {
    /// Begins a stance at touchdown, where the leg has its rest length.
    #[inline(always)]
    pub(crate) fn new(touchdown: State<L>) -> Self {
        let zero = touchdown.position_m[0].splat(0.0);
        Self { segments: zero, t_s: zero, state: touchdown }
    }

    /// Integrates the next segment, and returns its duration, s, and where the stance ends.
    #[inline(always)]
    pub(crate) fn advance(
        &mut self,
        setting: &Setting<L>,
        jet: &mut Jet<L>,
    ) -> (L, Ended<L::Mask>) {
        let zero = self.t_s.splat(0.0);
        let (ramp, corner_s) = setting.elongation.ramp(self.t_s);
        let limit_s = corner_s - self.t_s;
        let lands = (self.segments.eq(zero), setting.elongation.rest_length_m);
        let Segment { t_s: duration_s, state, corner } = Segment::integrate(
            jet,
            &setting.field,
            &self.state,
            ramp,
            lands,
            limit_s,
            setting.tolerance_m_s,
        );
        self.state = state;
        self.t_s = L::select(duration_s.eq(limit_s), corner_s, self.t_s + duration_s);
        self.segments = self.segments + zero.splat(1.0);
        // Within a segment the height is lowest at an end or surely above the ground.
        let upright = zero.lt(state.position_m[1]) & self.t_s.le(zero.splat(MAX_STANCE_S));
        let ends = corner.apex | corner.lift_off;
        let fall = !upright | (!ends & zero.splat(MAX_SEGMENTS).le(self.segments));
        let corner = Corner { apex: corner.apex & upright, lift_off: corner.lift_off & upright };
        (duration_s, Ended { corner, fall })
    }
}

impl Stance {
    /// Returns how a stance ended; `None` if it goes on.
    pub(crate) fn end(&self, ended: &Ended) -> Option<StanceEnd> {
        let Self { t_s, state, .. } = *self;
        if ended.fall {
            Some(StanceEnd::Fall)
        } else if ended.corner.lift_off {
            Some(StanceEnd::LiftOff { t_s, state })
        } else if ended.corner.apex {
            Some(StanceEnd::Apex { t_s, state })
        } else {
            None
        }
    }
}

/// Integrates a stance on level ground from touchdown, where the leg has its rest length.
///
/// Shows `observe` the series of each segment and how long it is followed, s.
pub(crate) fn integrate(
    setting: &Setting,
    touchdown: State,
    mut observe: impl FnMut(&Jet, f64),
) -> StanceEnd {
    let mut stance = Stance::new(touchdown);
    let mut jet = Jet::new(0.0);
    loop {
        let (duration_s, ended) = stance.advance(setting, &mut jet);
        observe(&jet, duration_s);
        if let Some(end) = stance.end(&ended) {
            return end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{flight::Flight, leg::Leg, medium::Medium};

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
                let setting = Setting { field, elongation, tolerance_m_s: 1e-10 };
                match integrate(&setting, touchdown, |_, _| ()) {
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
