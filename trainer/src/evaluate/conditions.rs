//! Conditions that an actor was not trained for: other legs and other gravity.

use super::DENSITIES;
use super::survival::{Survival, survival};
use leg_control::actor::Actor;
use leg_plant::{Apex, Hopper, Leg, LegParameters, Medium};
use serde::Serialize;
use serde::ser::{SerializeStruct, Serializer};
use std::fmt;

/// Stiffnesses of the paper's basins of attraction at 80 kg, N/m.
const STIFFNESS_N_M: [f64; 6] = [5_000.0, 10_000.0, 15_000.0, 20_000.0, 30_000.0, 40_000.0];
/// Dry masses of the paper's basins of attraction at 20,000 N/m, kg. The 80 kg of the
/// paper's leg are among the stiffnesses.
const MASS_KG: [f64; 4] = [40.0, 60.0, 100.0, 120.0];
const PLANETS: [Medium; 2] = [Medium::MOON, Medium::MARS];

/// The set of conditions that an evaluation covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Extent {
    /// Other springs and masses, moon and mars, all on land.
    #[default]
    Land,
    /// In addition moon and mars at every density ratio.
    Full,
}

/// The difference of a condition from the paper's leg on earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// Stiffness of the spring, N/m.
    Stiffness(f64),
    /// Dry mass, kg. Volume, areas and added mass stay the same.
    Mass(f64),
    /// Gravity, m/s2.
    Gravity(f64),
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stiffness(k) => write!(f, "k {k} N/m"),
            Self::Mass(m) => write!(f, "m {m} kg"),
            Self::Gravity(g) if *g == Medium::MOON.gravity_m_s2() => write!(f, "moon"),
            Self::Gravity(g) if *g == Medium::MARS.gravity_m_s2() => write!(f, "mars"),
            Self::Gravity(g) => write!(f, "g {g} m/s2"),
        }
    }
}

/// A change at one density ratio.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Condition {
    /// Difference from the paper's leg on earth.
    pub change: Change,
    /// Density ratio.
    pub rho: f64,
}

impl Condition {
    /// Returns the condition with a change on land.
    #[must_use]
    pub const fn on_land(change: Change) -> Self {
        Self { change, rho: 0.0 }
    }

    /// Returns the conditions of an extent: springs, masses, gravity; land first.
    #[must_use]
    pub fn all(extent: Extent) -> Vec<Self> {
        let planets = || PLANETS.map(|planet| Change::Gravity(planet.gravity_m_s2()));
        let land = || {
            let springs = STIFFNESS_N_M.map(Change::Stiffness).into_iter();
            let masses = MASS_KG.map(Change::Mass);
            springs.chain(masses).chain(planets()).map(Self::on_land)
        };
        let wet = || {
            let densities = DENSITIES.into_iter().filter(|&rho| rho > 0.0);
            planets()
                .into_iter()
                .flat_map(move |change| densities.clone().map(move |rho| Self { change, rho }))
        };
        match extent {
            Extent::Land => land().collect(),
            Extent::Full => land().chain(wet()).collect(),
        }
    }

    /// Returns the leg and the medium.
    ///
    /// # Panics
    /// If the change or the density is not physical.
    #[must_use]
    pub fn leg_and_medium(&self) -> (Leg, Medium) {
        let mut leg: LegParameters = Leg::human().into();
        let mut medium = Medium::AIR;
        match self.change {
            Change::Stiffness(k) => leg.stiffness_n_m = k,
            Change::Mass(m) => leg.mass_kg = m,
            Change::Gravity(g) => medium = Medium::new(0.0, g).expect("a gravity"),
        }
        let medium = medium.with_density_ratio(self.rho).expect("a density ratio");
        (Leg::new(leg).expect("a leg"), medium)
    }

    /// Runs every start in this condition.
    #[must_use]
    pub fn run(self, actor: &Actor<'_>, starts: &[Apex]) -> ConditionResult {
        let (leg, medium) = self.leg_and_medium();
        let survival = survival(actor, &Hopper::new(&leg, medium), self.rho, starts);
        ConditionResult { condition: self, survival }
    }
}

/// The survival of an actor in a condition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConditionResult {
    /// The condition.
    pub condition: Condition,
    /// Outcome of the same starts as with the paper's leg on earth.
    pub survival: Survival,
}

impl Serialize for ConditionResult {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let (leg, medium) = self.condition.leg_and_medium();
        let mut row = serializer.serialize_struct("ConditionResult", 9)?;
        row.serialize_field("name", &self.condition.change.to_string())?;
        row.serialize_field("stiffness_n_m", &leg.parameters().stiffness_n_m)?;
        row.serialize_field("mass_kg", &leg.parameters().mass_kg)?;
        row.serialize_field("gravity_m_s2", &medium.gravity_m_s2())?;
        row.serialize_field("rho", &self.condition.rho)?;
        row.serialize_field("survive30", &self.survival.survive30)?;
        row.serialize_field("abs_v_median", &self.survival.abs_v_median)?;
        row.serialize_field("abs_v_p95", &self.survival.abs_v_p95)?;
        row.serialize_field("reward5", &self.survival.reward5)?;
        row.end()
    }
}

#[cfg(test)]
mod tests {
    use super::{Change, Condition, Extent};
    use crate::evaluate::hopper;
    use leg_plant::{Action, Apex, Hopper, Leg};

    #[test]
    fn a_condition_changes_exactly_one_parameter() {
        for condition in Condition::all(Extent::Full) {
            let (leg, medium) = condition.leg_and_medium();
            let (p, human) = (leg.parameters(), Leg::human());
            let h = human.parameters();
            let changed = [
                p.stiffness_n_m != h.stiffness_n_m,
                p.mass_kg != h.mass_kg,
                medium.gravity_m_s2() != 9.81,
            ];
            let expected = usize::from(condition.change != Change::Stiffness(20_000.0));
            assert_eq!(changed.iter().filter(|&&x| x).count(), expected, "{condition:?}");
            assert_eq!((p.volume_m3, p.added_mass_kg), (h.volume_m3, h.added_mass_kg));
            assert_eq!(medium.density_ratio(), condition.rho);
        }
        let count = |extent| Condition::all(extent).len();
        assert_eq!([Extent::Land, Extent::Full].map(count), [12, 26]);
    }

    #[test]
    fn the_papers_stiffness_gives_the_leg_of_the_trainings() {
        let (leg, medium) = Condition::on_land(Change::Stiffness(20_000.0)).leg_and_medium();
        let apex = Apex { vx_m_s: 0.3, y_m: 2.0 };
        let action = Action { touchdown_angle_rad: 1.6, elongation_speed_m_s: 0.1 };
        let hop = |hopper: &Hopper| hopper.hop(apex, action).outcome.next();
        assert_eq!(hop(&Hopper::new(&leg, medium)), hop(&hopper(0.0)));
    }
}
