//! The plant one tick at a time: what a controller drives.
//!
//! The same equations as the apex map, with the command of a tick held over it and every event
//! inside it placed to the integrator's tolerance; a tick may be of any length. Two things
//! exist here that the apex map does not have:
//!
//! * **The elongation is commanded**, as a ramp over the tick. In flight it lengthens the leg
//!   only as a length sensor sees it; the foot comes down on the unextended leg, and from
//!   touchdown on the spring's rest length is what the ramp gives. A ramp that starts below 0
//!   and passes it at touchdown is the apex map's.
//! * **The leg angle may change in flight.** The leg is massless and takes any angle at once.
//!   On the way up the foot may pass through the ground (the leg folds). On the way down the
//!   ground stops it: a swing that would carry the foot from above the ground to below it
//!   ends where they meet, and that is the touchdown. A foot that is below the ground when
//!   the descent begins stays folded and bears nothing until it is clear of the ground again;
//!   where that does not happen, the body comes down, which is the apex map's rule for an
//!   apex lower than the leg.

use smallvec::SmallVec;

use super::apex::Tolerance;
use super::elongation::Elongation;
use super::flight::Swim;
use super::ground::Ground;
use super::leg::Leg;
use super::medium::Medium;
use super::pair::Pair;
use super::roots::falling_root;
use super::stance::{Corner, Stretch};
use super::taylor::{Field, Jet, State};

/// Bounds the work of one tick; beyond it, as after an overflow, the leg counts as fallen.
const MOST_STRETCHES: u32 = 100_000;

/// The point mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Place.
    pub x_m: f64,
    /// Horizontal velocity.
    pub vx_m_s: f64,
    /// Height over the datum of the ground function.
    pub y_m: f64,
    /// Vertical velocity, upwards.
    pub vy_m_s: f64,
}

/// What the controller asks of the leg over one tick.
///
/// Numbers that are not finite are not followed: without an angle the leg stays folded,
/// without an elongation it keeps its rest length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegCommand {
    /// Angle of the leg in flight, from the +x axis; over pi/2 the foot is ahead of the mass.
    pub leg_angle_rad: f64,
    /// Elongation at the start of the tick. May be out of range: what acts is the ramp
    /// `elongation_m + elongation_rate_m_s * t`, clamped to what the leg has.
    pub elongation_m: f64,
    /// Speed of the elongation over the tick.
    pub elongation_rate_m_s: f64,
}

/// What the leg is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    /// The foot is in the air.
    Flight,
    /// The foot is on the ground.
    Stance {
        /// Place of the foot.
        foot_x_m: f64,
        /// Height of the foot.
        foot_y_m: f64,
    },
    /// The body lies on the ground, for good.
    Fallen,
}

/// What happened inside a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// What it was.
    pub kind: EventKind,
    /// When, from the start of the tick.
    pub t_s: f64,
    /// The body at that moment.
    pub body: Body,
}

/// The kinds of [`Event`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EventKind {
    /// The foot came down.
    Touchdown {
        /// Place of the foot.
        foot_x_m: f64,
        /// Height of the foot.
        foot_y_m: f64,
    },
    /// The leg reached its rest length.
    LiftOff,
    /// The body stopped rising, in flight or in stance.
    Apex,
    /// The body came down to the ground.
    Fall,
}

/// The events of one tick in their order. Up to [`TickEvents::INLINE`] of them, more
/// than a tick of a millisecond has, allocate nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TickEvents(SmallVec<[Event; Self::INLINE]>);

impl std::ops::Deref for TickEvents {
    type Target = [Event];

    fn deref(&self) -> &[Event] {
        &self.0
    }
}

/// A leg that is stepped in ticks.
#[derive(Clone, Debug)]
pub struct TickPlant {
    leg: Leg,
    body: Body,
    phase: Phase,
    /// Of the spring with its elongation, at the end of the last tick.
    unloaded_length_m: f64,
    /// The leg angle at which the foot was last seen above the ground in this descent.
    clear_angle_rad: Option<f64>,
    tolerance: Tolerance,
}

/// What stays the same over one tick.
struct Tick<'a, G> {
    swim: Swim,
    field: Field,
    elongation: Elongation,
    angle_rad: f64,
    ground: &'a G,
    end_s: f64,
}

impl TickPlant {
    /// A leg in flight.
    #[must_use]
    pub fn new(leg: Leg, body: Body) -> Self {
        Self {
            leg,
            body,
            phase: Phase::Flight,
            unloaded_length_m: leg.parameters().rest_length_m,
            clear_angle_rad: None,
            tolerance: Tolerance::default(),
        }
    }

    /// The body at the end of the last tick.
    #[must_use]
    pub const fn body(&self) -> Body {
        self.body
    }

    /// What the leg is doing at the end of the last tick.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// The leg.
    #[must_use]
    pub const fn leg(&self) -> &Leg {
        &self.leg
    }

    /// Length of the leg, as a sensor on it measures: from foot to mass while the foot is down;
    /// else that of the unloaded leg, extended as far as the last command took it.
    #[must_use]
    pub fn leg_length_m(&self) -> f64 {
        match self.phase {
            Phase::Stance { foot_x_m, foot_y_m } => {
                libm::hypot(self.body.x_m - foot_x_m, self.body.y_m - foot_y_m)
            }
            Phase::Flight | Phase::Fallen => self.unloaded_length_m,
        }
    }

    /// Goes on by `dt_s`. Does nothing for a time that is not positive and finite, and nothing
    /// after a fall.
    ///
    /// The ground is looked at where the foot comes down, and under the body at the ends of
    /// the smooth stretches that make up a tick; a spike that passes in between goes unseen.
    pub fn step(
        &mut self,
        dt_s: f64,
        command: LegCommand,
        medium: Medium,
        ground: &impl Ground,
    ) -> TickEvents {
        let mut events = TickEvents::default();
        if !(dt_s > 0.0 && dt_s.is_finite()) {
            return events;
        }
        let p = self.leg.parameters();
        let swim = Swim::new(&self.leg, medium);
        let follows = command.elongation_m.is_finite() && command.elongation_rate_m_s.is_finite();
        let tick = Tick {
            swim,
            field: Field::new(&self.leg, &swim),
            elongation: Elongation {
                rest_length_m: p.rest_length_m,
                max_m: p.max_elongation_m,
                start_m: if follows { command.elongation_m } else { 0.0 },
                rate_m_s: if follows { command.elongation_rate_m_s } else { 0.0 },
            },
            angle_rad: command.leg_angle_rad,
            ground,
            end_s: dt_s,
        };
        self.unloaded_length_m = tick.elongation.ramp(dt_s).0.length_m;
        let mut t_s = 0.0;
        let mut stretches = 0;
        // The foot's length is known exactly only in the moment of touchdown.
        let mut known_length_m = None;
        // A foot that slipped off at once does not come down again in the same tick.
        let mut may_land = true;
        while t_s < dt_s {
            stretches += 1;
            if stretches > MOST_STRETCHES || !self.body.is_finite() {
                let body = self.body;
                self.fall(t_s, body, &mut events);
            }
            t_s = match self.phase {
                Phase::Fallen => dt_s,
                Phase::Flight => {
                    let t_s = self.swim(&tick, t_s, may_land, &mut events);
                    known_length_m = Some(tick.elongation.rest_length_m);
                    t_s
                }
                Phase::Stance { foot_x_m, foot_y_m } => {
                    let foot = [foot_x_m, foot_y_m];
                    let from_s = t_s;
                    let known = known_length_m.take();
                    let t_s = self.punt(&tick, t_s, foot, known, &mut events);
                    if known.is_some() && t_s == from_s {
                        may_land = false;
                    }
                    t_s
                }
            };
        }
        events
    }

    /// Flight up to the end of the tick, the turning point or touchdown; returns when.
    fn swim<G: Ground>(
        &mut self,
        tick: &Tick<'_, G>,
        from_s: f64,
        may_land: bool,
        events: &mut TickEvents,
    ) -> f64 {
        let start = self.body;
        let at = |t_s: f64| fly(&tick.swim, &start, t_s - from_s);
        let turn_s = tick.swim.turn_s(start.vy_m_s).map(|t_s| from_s + t_s);
        let turn_s = turn_s.filter(|&t_s| t_s <= tick.end_s);
        let end_s = turn_s.unwrap_or(tick.end_s);
        let end = at(end_s);
        let sinks = start.vy_m_s < 0.0 || (start.vy_m_s == 0.0 && end.vy_m_s < 0.0);

        if sinks && may_land && tick.angle_rad.is_finite() {
            let here = tick.foot_over_ground(&start, tick.angle_rad, &self.leg);
            if here >= 0.0 {
                self.clear_angle_rad = Some(tick.angle_rad);
                if tick.foot_over_ground(&end, tick.angle_rad, &self.leg) <= 0.0 {
                    let height = |t_s| tick.foot_over_ground(&at(t_s), tick.angle_rad, &self.leg);
                    let t_s = falling_root(height, from_s, end_s);
                    self.land(t_s, at(t_s), tick.angle_rad, events);
                    return t_s;
                }
            } else if let Some(clear_rad) = self.clear_angle_rad {
                // The swing from the old angle to the new one is stopped by the ground.
                let angle_rad = |part: f64| clear_rad + part * (tick.angle_rad - clear_rad);
                let height = |part| tick.foot_over_ground(&start, angle_rad(part), &self.leg);
                let part = falling_root(height, 0.0, 1.0);
                self.land(from_s, start, angle_rad(part), events);
                return from_s;
            }
        } else {
            self.clear_angle_rad = None;
        }
        if tick.over_ground(&end) <= 0.0 {
            let t_s = falling_root(|t_s| tick.over_ground(&at(t_s)), from_s, end_s);
            self.fall(t_s, at(t_s), events);
            return t_s;
        }
        self.body = end;
        if turn_s.is_some() {
            self.body.vy_m_s = 0.0;
            if start.vy_m_s > 0.0 {
                events.push(EventKind::Apex, end_s, self.body);
            }
        }
        end_s
    }

    /// Stance up to the end of the tick or the next corner; returns when.
    fn punt<G: Ground>(
        &mut self,
        tick: &Tick<'_, G>,
        from_s: f64,
        foot: [f64; 2],
        known_length_m: Option<f64>,
        events: &mut TickEvents,
    ) -> f64 {
        let start = State {
            place_m: Pair([self.body.x_m - foot[0], self.body.y_m - foot[1]]),
            velocity_m_s: Pair([self.body.vx_m_s, self.body.vy_m_s]),
        };
        let body_at = |state: &State| Body {
            x_m: foot[0] + state.place_m[0],
            vx_m_s: state.velocity_m_s[0],
            y_m: foot[1] + state.place_m[1],
            vy_m_s: state.velocity_m_s[1],
        };
        let (ramp, kink_s) = tick.elongation.ramp(from_s);
        let until_s = kink_s.min(tick.end_s);
        let limit_s = until_s - from_s;
        let mut jet = Jet::new();
        let stretch = Stretch::follow(
            &mut jet,
            &tick.field,
            &start,
            ramp,
            known_length_m,
            limit_s,
            self.tolerance.velocity_m_s,
        );
        let end = body_at(&stretch.state);
        if tick.over_ground(&end) <= 0.0 {
            let height = |t_s| tick.over_ground(&body_at(&jet.at(t_s)));
            let t_s = falling_root(height, 0.0, stretch.t_s);
            self.fall(from_s + t_s, body_at(&jet.at(t_s)), events);
            return from_s + t_s;
        }
        let t_s = if stretch.t_s == limit_s { until_s } else { from_s + stretch.t_s };
        self.body = end;
        match stretch.corner {
            Corner::LiftOff => {
                self.phase = Phase::Flight;
                self.clear_angle_rad = None;
                events.push(EventKind::LiftOff, t_s, end);
            }
            Corner::Apex => events.push(EventKind::Apex, t_s, end),
            Corner::Limit | Corner::Swing | Corner::Bottom => {}
        }
        t_s
    }

    fn land(&mut self, t_s: f64, body: Body, angle_rad: f64, events: &mut TickEvents) {
        let [foot_x_m, foot_y_m] = foot(&body, angle_rad, &self.leg);
        self.body = body;
        self.phase = Phase::Stance { foot_x_m, foot_y_m };
        events.push(EventKind::Touchdown { foot_x_m, foot_y_m }, t_s, body);
    }

    fn fall(&mut self, t_s: f64, body: Body, events: &mut TickEvents) {
        events.push(EventKind::Fall, t_s, body);
        self.phase = Phase::Fallen;
        self.body = Body { vx_m_s: 0.0, vy_m_s: 0.0, ..body };
    }
}

impl Body {
    fn is_finite(&self) -> bool {
        let Self { x_m, vx_m_s, y_m, vy_m_s } = self;
        [x_m, vx_m_s, y_m, vy_m_s].iter().all(|x| x.is_finite())
    }
}

impl TickEvents {
    /// Events that a tick has room for without allocating.
    pub const INLINE: usize = 4;

    fn push(&mut self, kind: EventKind, t_s: f64, body: Body) {
        self.0.push(Event { kind, t_s, body });
    }
}

impl<G: Ground> Tick<'_, G> {
    fn over_ground(&self, body: &Body) -> f64 {
        body.y_m - self.ground.height_m(body.x_m)
    }

    fn foot_over_ground(&self, body: &Body, angle_rad: f64, leg: &Leg) -> f64 {
        let [x_m, y_m] = foot(body, angle_rad, leg);
        y_m - self.ground.height_m(x_m)
    }
}

/// Where the foot of the unloaded leg is.
fn foot(body: &Body, angle_rad: f64, leg: &Leg) -> [f64; 2] {
    let length_m = leg.parameters().rest_length_m;
    let (sin, cos) = libm::sincos(angle_rad);
    [body.x_m - length_m * cos, body.y_m - length_m * sin]
}

/// The body after `t_s` of flight.
fn fly(swim: &Swim, start: &Body, t_s: f64) -> Body {
    let (way_x_m, vx_m_s) = swim.horizontal(start.vx_m_s, t_s);
    let (way_y_m, vy_m_s) = swim.vertical(start.vy_m_s, t_s);
    Body { x_m: start.x_m + way_x_m, vx_m_s, y_m: start.y_m + way_y_m, vy_m_s }
}
