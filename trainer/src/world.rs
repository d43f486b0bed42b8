//! The world of an episode: the leg that hops, on what, and what the actor gets to see of it.
//!
//! Without a [`Randomisation`] this is the trainer's leg on level ground on earth, whose state the
//! actor observes exactly: the apex map of [`leg_plant`], to the last bit. Randomised are:
//!
//! * **Mass, stiffness, gravity**: factors. Volume, areas and added mass stay those of the leg.
//! * **Damping, mass of the foot, friction**: the losses of [`leg_plant::TickPlant`], which then
//!   computes the hop.
//! * **Ground**: the height of the ground under a hop, drawn for each hop. Apexes are measured from
//!   the height 0, so that the actor does not see it.
//! * **Delay**: the time from an event to the action that answers it. The angle that the actor
//!   chooses at an apex is taken up that much later; until then, or if the foot touches down
//!   before, the leg has the angle of the hop before. In stance the leg begins to elongate that
//!   much after touchdown. The first action of an episode is in force from its start.
//! * **Noise and bias**: added to what the actor observes. A density ratio below 0 is observed as
//!   0. Rewards, and the end of an episode, are those of the true state.
//!
//! Every quantity has a random stream of its own, which follows from the seed and the number of the
//! episode alone. So one quantity does not change the draws of another, trainings without
//! randomisation draw nothing, and a checkpoint has nothing to store.

mod hop;
#[cfg(test)]
mod tests;

use crate::config::{Distribution, Parameter, Randomisation};
use crate::environment::{leg, normal};
use hop::Body;
use leg_plant::{
    Action, Apex, EARTH_GRAVITY_M_S2, Hopper, Leg, LegParameters, Losses, Medium, Phase, TickPlant,
    Tolerance,
};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Keeps the streams of a training apart from its others, which begin with its seed.
const STREAMS: u64 = 0x7764_6f6d_6169_6e73;
/// Draws of the stream of an episode: more than there are parameters.
const SPACING: u128 = 64;

impl Distribution {
    /// Draws a value.
    #[must_use]
    pub fn draw(&self, rng: &mut impl Rng) -> f64 {
        match *self {
            Self::Uniform { low, high } => rng.random_range(low..=high),
            Self::LogUniform { low, high } => {
                let log = rng.random_range(libm::log(low)..=libm::log(high));
                // The logarithm's rounding may lead beyond the ends.
                libm::exp(log).clamp(low, high)
            }
            Self::Normal { mean, deviation, low, high } => {
                (mean + deviation * normal(rng)).clamp(low, high)
            }
        }
    }
}

/// A quantity that is drawn anew for each hop.
#[derive(Clone, Debug)]
struct PerHop {
    drawn: Option<(Distribution, Pcg64)>,
    now: f64,
}

impl PerHop {
    const NONE: Self = Self { drawn: None, now: 0.0 };

    fn draw(&mut self) {
        if let Some((distribution, rng)) = &mut self.drawn {
            self.now = distribution.draw(rng);
        }
    }
}

/// A point of the way of a hop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// Horizontal place of the mass.
    pub x_m: f64,
    /// Height of the mass.
    pub y_m: f64,
    /// Height of the ground.
    pub ground_m: f64,
    /// Place and height of the foot while it is on the ground.
    pub foot: Option<[f64; 2]>,
}

/// What an actor observes at an apex: vx in m/s, y in m, and the density ratio.
pub type Shown = [f64; 3];

/// The world of an episode.
#[derive(Clone, Debug)]
pub struct World {
    density_ratio: f64,
    hopper: Hopper,
    body: Body,
    ground_m: PerHop,
    /// Errors of velocity, height and density ratio.
    noise: [PerHop; 3],
    bias: Shown,
    in_force: Option<Action>,
    is_randomised: bool,
}

impl World {
    /// Creates the world without randomisation.
    ///
    /// # Panics
    /// If `density_ratio` is negative or not finite.
    #[must_use]
    pub fn exact(density_ratio: f64, tolerance: Tolerance) -> Self {
        let medium = Medium::AIR.with_density_ratio(density_ratio).expect("a density ratio");
        Self::of(Body { leg: leg(), losses: Losses::NONE, medium, delay_s: 0.0, tolerance })
    }

    /// Creates a world without errors of the observation, on level ground.
    fn of(body: Body) -> Self {
        Self {
            density_ratio: body.medium.density_ratio(),
            hopper: Hopper::new(&body.leg, body.medium).with_tolerance(body.tolerance),
            body,
            ground_m: PerHop::NONE,
            noise: [PerHop::NONE; 3],
            bias: [0.0; 3],
            in_force: None,
            is_randomised: false,
        }
    }

    /// Draws the world of an episode of a training or of an evaluation with this seed.
    ///
    /// # Panics
    /// If `density_ratio` is negative or not finite, or `randomisation` does not pass
    /// [`Randomisation::check`].
    #[must_use]
    pub fn draw(
        randomisation: &Randomisation,
        seed: u64,
        episode: u64,
        density_ratio: f64,
        tolerance: Tolerance,
    ) -> Self {
        let mut root = Pcg64::seed_from_u64(seed ^ STREAMS);
        root.advance(u128::from(episode) * SPACING);
        let chosen = root.random::<f64>() < randomisation.share;
        if !chosen {
            return Self::exact(density_ratio, tolerance);
        }
        let streams = Parameter::ALL.map(|_| Pcg64::seed_from_u64(root.random()));
        let stream = |parameter: Parameter| streams[parameter as usize].clone();
        let once = |parameter: Parameter, otherwise: f64| {
            let distribution = randomisation.get(parameter);
            distribution.map_or(otherwise, |d| d.draw(&mut stream(parameter)))
        };
        let per_hop = |parameter: Parameter| {
            let drawn = randomisation.get(parameter).map(|d| (d, stream(parameter)));
            let mut quantity = PerHop { drawn, ..PerHop::NONE };
            quantity.draw();
            quantity
        };
        let human = leg();
        let p = human.parameters();
        let leg = Leg::new(LegParameters {
            mass_kg: once(Parameter::Mass, 1.0) * p.mass_kg,
            stiffness_n_m: once(Parameter::Stiffness, 1.0) * p.stiffness_n_m,
            ..*p
        });
        let leg = leg.expect("checked factors");
        let gravity_m_s2 = once(Parameter::Gravity, 1.0) * EARTH_GRAVITY_M_S2;
        let medium = Medium::new(density_ratio, gravity_m_s2).expect("a density ratio");
        let losses = losses(
            once(Parameter::Damping, 0.0),
            once(Parameter::FootMass, 0.0),
            randomisation.get(Parameter::Friction).map(|_| once(Parameter::Friction, 0.0)),
        );
        let delay_s = once(Parameter::Delay, 0.0);
        let [noise, bias] = [
            [Parameter::NoiseVx, Parameter::NoiseY, Parameter::NoiseDensity],
            [Parameter::BiasVx, Parameter::BiasY, Parameter::BiasDensity],
        ];
        Self {
            ground_m: per_hop(Parameter::Ground),
            noise: noise.map(per_hop),
            bias: bias.map(|parameter| once(parameter, 0.0)),
            is_randomised: randomisation.parameters().next().is_some(),
            ..Self::of(Body { leg, losses, medium, delay_s, tolerance })
        }
    }

    /// Returns what an actor observes at an apex.
    #[must_use]
    pub fn show(&self, apex: Apex) -> Shown {
        let [vx, y, density] = [apex.vx_m_s, apex.y_m, self.density_ratio];
        let shown = |i: usize, x: f64| {
            let error = self.noise[i].now + self.bias[i];
            // The sum of -0 and 0 would have other bits.
            if error == 0.0 { x } else { x + error }
        };
        // A density ratio cannot be negative, nor does an estimator say so.
        [shown(0, vx), shown(1, y), shown(2, density).max(0.0)]
    }

    /// Takes a hop from an apex; returns the next one, or `None` after a fall.
    pub fn hop(&mut self, start: Apex, action: Action) -> Option<Apex> {
        let ground_m = self.ground_m.now;
        let above = Apex { y_m: start.y_m - ground_m, ..start };
        let before = self.in_force.replace(action).unwrap_or(action);
        let next = if self.body.needs_ticks() {
            self.body.hop(above, action, before.touchdown_angle_rad)
        } else {
            self.hopper.hop(above, action).outcome.next()
        };
        self.ground_m.draw();
        self.noise.iter_mut().for_each(PerHop::draw);
        next.map(|apex| Apex { y_m: apex.y_m + ground_m, ..apex })
    }

    /// Returns the way of the hop that [`Self::hop`] would take, in points of at most 20 ms; places
    /// count from its start.
    #[must_use]
    pub fn path(&self, start: Apex, action: Action) -> Vec<PathPoint> {
        let ground_m = self.ground_m.now;
        let above = Apex { y_m: start.y_m - ground_m, ..start };
        let before = self.in_force.unwrap_or(action);
        let mut path = vec![PathPoint { x_m: 0.0, y_m: start.y_m, ground_m, foot: None }];
        let mut add = |plant: &TickPlant| {
            let body = plant.body();
            let foot = match plant.phase() {
                Phase::Stance { foot_x_m, foot_y_m } => Some([foot_x_m, foot_y_m + ground_m]),
                Phase::Flight | Phase::Fallen => None,
            };
            path.push(PathPoint { x_m: body.x_m, y_m: body.y_m + ground_m, ground_m, foot });
        };
        let _ = self.body.hop_observed(above, action, before.touchdown_angle_rad, &mut add);
        path
    }

    /// Returns whether anything was drawn for this world.
    #[must_use]
    pub const fn is_randomised(&self) -> bool {
        self.is_randomised
    }

    /// Returns the density ratio.
    #[must_use]
    pub const fn density_ratio(&self) -> f64 {
        self.density_ratio
    }
}

/// Returns the losses of these quantities, which are in their ranges. A foot that is too light for
/// the plant has no mass.
fn losses(damping_n_s_m: f64, foot_mass_kg: f64, friction: Option<f64>) -> Losses {
    let foot_mass_kg = if foot_mass_kg < Losses::MIN_FOOT_MASS_KG { 0.0 } else { foot_mass_kg };
    let losses = Losses::NONE.with_damping(damping_n_s_m);
    let losses = losses.and_then(|losses| losses.with_foot_mass(foot_mass_kg));
    let losses = losses.and_then(|losses| match friction {
        Some(friction) => losses.with_friction(friction),
        None => Ok(losses),
    });
    losses.expect("checked ranges")
}
