//! The spring-legged hopper (SLIP/USLIP) in any medium: a point mass on a massless telescopic
//! leg, that swims, touches down, and pushes off.
//!
//! The model is that of "Learning to stop: a unifying principle for legged locomotion in
//! varying environments", in the form that its published data obeys (doi
//! 10.5281/zenodo.4607469; the equation as printed there has slips of sign). Nothing in here
//! knows of policies, processes or wall clocks.
//!
//! Two ways to drive it, over the same equations:
//!
//! * [`Hopper::hop`], the apex map: from one apex and an action to the next apex or a fall.
//! * [`TickPlant::step`], tick by tick, under a leg command, over any [`Ground`].
//!
//! ```
//! use leg_plant::{Action, Apex, Hopper, Leg, Medium};
//!
//! let hopper = Hopper::new(&Leg::human(), Medium::AIR);
//! let start = Apex { vx_m_s: 0.5, y_m: 2.0 };
//! let hop = hopper.hop(start, Action { touchdown_angle_rad: 1.6, elongation_speed_m_s: 0.0 });
//! assert!(hop.outcome.next().is_some());
//! ```
//!
//! # How it is computed
//!
//! Flight is solved in closed form, without a loss of digits as the drag or the net weight
//! goes to 0. Stance is expanded into Taylor series of 14 coefficients; each reaches as far as
//! its last terms allow ([`Tolerance`]), and is cut where the right-hand side has a corner: a
//! velocity changes its sign under quadratic drag, the actuator starts or stops. Lift-off and
//! apex are roots of functions evaluated on the series. Transcendental functions come from
//! the `libm` crate, not from the system, so that every machine gives the same bits.
//!
//! # How exact, how fast
//!
//! Over the 1,200 golden cases (`cargo test -p leg-plant --test apex_map -- --nocapture`) no
//! outcome differs, and no state or time by more than 8e-9 of `max(1, |value|)`. In 1,185 rows
//! every column agrees. The other 15 are falls in which the foot does not hold: whether the
//! golden integrator sees the lift-off at touchdown, and how many stances it counts, hangs on
//! the last bit of the leg length. 12 of them have a lift-off, which agrees; the stances are
//! not compared. Nearly all of the difference is the golden integrator's own error: between
//! [`Tolerance::GOLDEN`] and a tolerance of 1e-14 the most is 4e-10. Under the ideal command
//! [`TickPlant`] gives the apex map's states within 2e-11, whatever the length of the tick
//! (`cargo test -p leg-plant --test tick -- --nocapture`).
//!
//! A hop takes 2.3 us at [`Tolerance::GOLDEN`] and 1.3 us at [`Tolerance::TRAINING`]: the mean
//! over the golden cases by `cargo bench -p leg-plant --bench apex_map`, on one core of an AMD
//! EPYC at 2.6 GHz (rustc 1.95, baseline x86-64); a tick takes 0.09 us in air and 0.13 in
//! water. Six tenths of a hop's time go into the coefficients of the series.
//! They are limited by arithmetic, some 10,000 instructions a hop, most of them loads, products
//! and sums in two lanes: SSE2 has neither fused products nor wider registers. The rest goes
//! into finding the events and into flight. Other orders, from 12 to 20 coefficients, came out
//! within a quarter; a regularised time, `dt = l ds`, reached a fifth less far per series.

mod apex;
mod elongation;
mod flight;
mod ground;
mod leg;
mod medium;
mod pair;
mod roots;
mod stance;
mod taylor;
mod tick;

pub use apex::{
    Action, Apex, Hop, Hopper, LONGEST_SWIM_S, MOST_STANCES, NextApex, Outcome, Tolerance,
    Touchdown,
};
pub use ground::{Flat, Ground};
pub use leg::{EARTH_GRAVITY_M_S2, Leg, LegParameters, ParameterError, REFERENCE_DENSITY_KG_M3};
pub use medium::Medium;
pub use tick::{Body, Event, EventKind, LegCommand, Phase, TickEvents, TickPlant};
