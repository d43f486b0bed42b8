//! The plant one tick at a time, as a controller drives it.
//!
//! The equations are those of the apex map. The command is held over a tick, a tick may be of any
//! length, and the events inside it are located to the integrator's tolerance. Three things go
//! beyond the apex map:
//!
//! * **The elongation is commanded** as a ramp over the tick. In flight it changes only what a
//!   leg length sensor measures: touchdown happens on the unextended leg, and from then on the
//!   ramp adds to the spring's rest length. A ramp that passes 0 at touchdown reproduces the
//!   apex map's action.
//! * **The leg angle may change in flight.** The leg is massless and takes any angle at once. While
//!   the body rises the foot may pass through the ground (the leg folds). While the body descends,
//!   a swing that would carry the foot from above the ground to below it ends at the ground, and
//!   that is the touchdown. A foot that is below the ground when the descent begins stays folded
//!   and carries no load until it is above the ground again. If it never is, the body falls, as in
//!   the apex map from an apex lower than the leg.
//! * **The leg may have [`Losses`]**: damping, a foot with a mass, and friction. Without them,
//!   which is the default, nothing of this is computed.

mod standing;

use smallvec::SmallVec;

use crate::apex::Tolerance;
use crate::elongation::Elongation;
use crate::flight::Flight;
use crate::ground::Ground;
use crate::leg::Leg;
use crate::losses::Losses;
use crate::medium::Medium;
use crate::roots::falling_root;
use crate::taylor::Field;

/// Number of segments that bounds the work of one tick. A leg that needs more counts as fallen, as
/// it does after an overflow.
const MAX_SEGMENTS: u32 = 100_000;

/// State of the point mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Horizontal place.
    pub x_m: f64,
    /// Horizontal velocity.
    pub vx_m_s: f64,
    /// Height, from the same origin as [`Ground::height_m`].
    pub y_m: f64,
    /// Vertical velocity, upwards.
    pub vy_m_s: f64,
}

/// The command to the leg for one tick.
///
/// An angle that is not finite keeps the leg folded. An elongation or rate that is not finite
/// counts as no elongation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegCommand {
    /// Angle of the leg in flight, from the +x axis; above pi/2 the foot is ahead of the mass,
    /// towards +x.
    pub leg_angle_rad: f64,
    /// Elongation at the start of the tick. It may be out of range: the leg follows the ramp
    /// `elongation_m + elongation_rate_m_s * t`, clamped to 0 and the leg's largest elongation.
    pub elongation_m: f64,
    /// Rate of the elongation over the tick.
    pub elongation_rate_m_s: f64,
}

/// Phase of the gait.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    /// The foot is in the air.
    Flight,
    /// The foot is on the ground.
    Stance {
        /// Horizontal place of the foot.
        foot_x_m: f64,
        /// Height of the foot.
        foot_y_m: f64,
    },
    /// The body lies on the ground. This phase is final.
    Fallen,
}

/// An event inside a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// Kind of the event.
    pub kind: EventKind,
    /// Time from the start of the tick.
    pub t_s: f64,
    /// State of the body at that time.
    pub body: Body,
}

/// The kinds of [`Event`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EventKind {
    /// The foot touched the ground.
    Touchdown {
        /// Horizontal place of the foot.
        foot_x_m: f64,
        /// Height of the foot.
        foot_y_m: f64,
    },
    /// The leg reached its rest length and left the ground.
    LiftOff,
    /// The body stopped rising, in flight or in stance.
    Apex,
    /// The body reached the ground.
    Fall,
}

/// The events of one tick in their order. Up to [`TickEvents::INLINE`] events, more than occur in
/// a millisecond, need no allocation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TickEvents(SmallVec<[Event; Self::INLINE]>);

impl core::ops::Deref for TickEvents {
    type Target = [Event];

    fn deref(&self) -> &[Event] {
        &self.0
    }
}

/// A leg that is stepped tick by tick.
#[derive(Clone, Debug)]
pub struct TickPlant {
    leg: Leg,
    losses: Losses,
    body: Body,
    phase: Phase,
    /// Velocity of a foot that slides, 0 otherwise.
    foot_vx_m_s: f64,
    /// A foot at rest is about to slide.
    foot_slips: bool,
    slid_m: f64,
    /// Elongation that the drive missed in this stance, where the spring was too strong for it.
    missed_elongation_m: f64,
    /// Rest length with the elongation at the end of the last tick.
    unloaded_length_m: f64,
    /// The last leg angle of this descent at which the foot was above the ground.
    clear_angle_rad: Option<f64>,
    tolerance: Tolerance,
}

/// Values that are constant over one tick.
struct Tick<'a, G> {
    flight: Flight,
    field: Field,
    elongation: Elongation,
    angle_rad: f64,
    gravity_m_s2: f64,
    ground: &'a G,
    end_s: f64,
}

impl TickPlant {
    /// Creates a plant in flight.
    #[must_use]
    pub fn new(leg: Leg, body: Body) -> Self {
        Self {
            leg,
            losses: Losses::NONE,
            body,
            phase: Phase::Flight,
            foot_vx_m_s: 0.0,
            foot_slips: false,
            slid_m: 0.0,
            missed_elongation_m: 0.0,
            unloaded_length_m: leg.parameters().rest_length_m,
            clear_angle_rad: None,
            tolerance: Tolerance::default(),
        }
    }

    /// Sets the losses of the leg.
    #[must_use]
    pub const fn with_losses(mut self, losses: Losses) -> Self {
        self.losses = losses;
        self
    }

    /// Sets the tolerance.
    #[must_use]
    pub const fn with_tolerance(mut self, tolerance: Tolerance) -> Self {
        self.tolerance = tolerance;
        self
    }

    /// Returns the body at the end of the last tick.
    #[must_use]
    pub const fn body(&self) -> Body {
        self.body
    }

    /// Returns the phase at the end of the last tick.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// Returns the leg.
    #[must_use]
    pub const fn leg(&self) -> &Leg {
        &self.leg
    }

    /// Returns the losses of the leg.
    #[must_use]
    pub const fn losses(&self) -> &Losses {
        &self.losses
    }

    /// Returns the velocity of the foot on the ground, m/s; 0 unless it slides.
    #[must_use]
    pub const fn foot_vx_m_s(&self) -> f64 {
        self.foot_vx_m_s
    }

    /// Returns how far the foot has slid on the ground since the start, m. A massless foot leaves
    /// the ground at once in place of sliding.
    #[must_use]
    pub const fn slid_m(&self) -> f64 {
        self.slid_m
    }

    /// Returns the leg length that a sensor on the leg measures, m. In stance this is the distance
    /// from foot to mass, otherwise the rest length with the elongation of the last command.
    #[must_use]
    pub fn leg_length_m(&self) -> f64 {
        match self.phase {
            Phase::Stance { foot_x_m, foot_y_m } => {
                libm::hypot(self.body.x_m - foot_x_m, self.body.y_m - foot_y_m)
            }
            Phase::Flight | Phase::Fallen => self.unloaded_length_m,
        }
    }

    /// Advances the plant by `dt_s` and returns the events in that time. Does nothing if `dt_s` is
    /// not positive and finite, or after a fall.
    ///
    /// The ground is evaluated under the foot and, for a fall, under the body at the ends of the
    /// smooth segments of a tick. A narrow spike that the body passes in between is not noticed.
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
        let standing = Flight::new(&self.leg, medium);
        let foot_mass_kg = self.losses.foot_mass_kg;
        let flight = if foot_mass_kg > 0.0 {
            Flight::new(&self.leg.with_more_mass(foot_mass_kg), medium)
        } else {
            standing
        };
        let follows = command.elongation_m.is_finite() && command.elongation_rate_m_s.is_finite();
        let mut elongation = Elongation {
            rest_length_m: p.rest_length_m,
            max_m: p.max_elongation_m,
            start_m: if follows { command.elongation_m } else { 0.0 },
            rate_m_s: if follows { command.elongation_rate_m_s } else { 0.0 },
        };
        if let Some(limit_n) = self.losses.drive_force_n {
            elongation = self.within_drive_force(elongation, limit_n, dt_s);
        }
        let tick = Tick {
            flight,
            field: Field::new(&self.leg, &standing),
            elongation,
            angle_rad: command.leg_angle_rad,
            gravity_m_s2: medium.gravity_m_s2(),
            ground,
            end_s: dt_s,
        };
        self.unloaded_length_m = tick.elongation.ramp(dt_s).0.length_m;
        let mut t_s = 0.0;
        let mut segments = 0;
        // The leg length is known exactly only at touchdown.
        let mut known_length_m = None;
        // A foot that lifted off at once does not touch down again in the same tick.
        let mut may_land = true;
        while t_s < dt_s {
            segments += 1;
            if segments > MAX_SEGMENTS || !self.body.is_finite() {
                let body = self.body;
                self.fall(t_s, body, &mut events);
            }
            t_s = match self.phase {
                Phase::Fallen => dt_s,
                Phase::Flight => {
                    let t_s = self.fly(&tick, t_s, may_land, &mut events);
                    known_length_m = Some(tick.elongation.rest_length_m);
                    t_s
                }
                Phase::Stance { foot_x_m, foot_y_m } => {
                    let foot = [foot_x_m, foot_y_m];
                    let from_s = t_s;
                    let known = known_length_m.take();
                    let t_s = self.stand(&tick, t_s, foot, known, &mut events);
                    if known.is_some() && t_s == from_s {
                        may_land = false;
                    }
                    t_s
                }
            };
        }
        events
    }

    /// Continues a flight to the end of the tick, the turning point or touchdown, and returns the
    /// time of that.
    fn fly<G: Ground>(
        &mut self,
        tick: &Tick<'_, G>,
        from_s: f64,
        may_land: bool,
        events: &mut TickEvents,
    ) -> f64 {
        let start = self.body;
        let at = |t_s: f64| flown(&tick.flight, &start, t_s - from_s);
        let turn_s = tick.flight.time_to_turn_s(start.vy_m_s).map(|t_s| from_s + t_s);
        let turn_s = turn_s.filter(|&t_s| t_s <= tick.end_s);
        let end_s = turn_s.unwrap_or(tick.end_s);
        let end = at(end_s);
        let descends = start.vy_m_s < 0.0 || (start.vy_m_s == 0.0 && end.vy_m_s < 0.0);

        if descends && may_land && tick.angle_rad.is_finite() {
            let here = tick.foot_height_over_ground(&start, tick.angle_rad, &self.leg);
            if here >= 0.0 {
                self.clear_angle_rad = Some(tick.angle_rad);
                if tick.foot_height_over_ground(&end, tick.angle_rad, &self.leg) <= 0.0 {
                    let height =
                        |t_s| tick.foot_height_over_ground(&at(t_s), tick.angle_rad, &self.leg);
                    let t_s = falling_root(height, from_s, end_s);
                    self.land(t_s, at(t_s), tick.angle_rad, events);
                    return t_s;
                }
            } else if let Some(clear_rad) = self.clear_angle_rad {
                // The ground stops the swing from the old angle to the new one.
                let angle_rad = |part: f64| clear_rad + part * (tick.angle_rad - clear_rad);
                let height =
                    |part| tick.foot_height_over_ground(&start, angle_rad(part), &self.leg);
                let part = falling_root(height, 0.0, 1.0);
                self.land(from_s, start, angle_rad(part), events);
                return from_s;
            }
        } else {
            self.clear_angle_rad = None;
        }
        if tick.body_height_over_ground(&end) <= 0.0 {
            let t_s = falling_root(|t_s| tick.body_height_over_ground(&at(t_s)), from_s, end_s);
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

    fn land(&mut self, t_s: f64, body: Body, angle_rad: f64, events: &mut TickEvents) {
        let [foot_x_m, foot_y_m] = foot(&body, angle_rad, &self.leg);
        self.body = body;
        self.phase = Phase::Stance { foot_x_m, foot_y_m };
        self.foot_vx_m_s = self.losses.foot_after_touchdown_m_s(body.vx_m_s, body.vy_m_s);
        events.push(EventKind::Touchdown { foot_x_m, foot_y_m }, t_s, body);
    }

    fn fall(&mut self, t_s: f64, body: Body, events: &mut TickEvents) {
        events.push(EventKind::Fall, t_s, body);
        self.phase = Phase::Fallen;
        self.foot_vx_m_s = 0.0;
        self.foot_slips = false;
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
    /// Number of events that need no allocation.
    pub const INLINE: usize = 4;

    fn push(&mut self, kind: EventKind, t_s: f64, body: Body) {
        self.0.push(Event { kind, t_s, body });
    }
}

impl<G: Ground> Tick<'_, G> {
    fn body_height_over_ground(&self, body: &Body) -> f64 {
        body.y_m - self.ground.height_m(body.x_m)
    }

    fn foot_height_over_ground(&self, body: &Body, angle_rad: f64, leg: &Leg) -> f64 {
        let [x_m, y_m] = foot(body, angle_rad, leg);
        y_m - self.ground.height_m(x_m)
    }
}

/// Returns the place of the foot on the unloaded, unextended leg.
fn foot(body: &Body, angle_rad: f64, leg: &Leg) -> [f64; 2] {
    let length_m = leg.parameters().rest_length_m;
    let (sin, cos) = libm::sincos(angle_rad);
    [body.x_m - length_m * cos, body.y_m - length_m * sin]
}

/// Returns the body after `t_s` of flight.
fn flown(flight: &Flight, start: &Body, t_s: f64) -> Body {
    let (x_m, vx_m_s) = flight.horizontal(start.vx_m_s, t_s);
    let (y_m, vy_m_s) = flight.vertical(start.vy_m_s, t_s);
    Body { x_m: start.x_m + x_m, vx_m_s, y_m: start.y_m + y_m, vy_m_s }
}
