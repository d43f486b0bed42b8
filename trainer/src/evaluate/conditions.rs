//! Other legs and worlds: what the actor was not told that it would meet.

use super::DENSITIES;
use super::survival::{Survival, survival};
use leg_control::actor::Actor;
use leg_plant::{Apex, Hopper, Leg, LegParameters, Medium};
use serde::Serialize;
use serde::ser::{SerializeStruct, Serializer};
use std::fmt;

/// Stiffnesses of the paper's basins of attraction, N/m, at 80 kg.
const STIFFNESS_N_M: [f64; 6] = [5_000.0, 10_000.0, 15_000.0, 20_000.0, 30_000.0, 40_000.0];
/// And the dry masses, kg, at 20,000 N/m, but for the 80 kg that are among the above.
const MASS_KG: [f64; 4] = [40.0, 60.0, 100.0, 120.0];
const WORLDS: [Medium; 2] = [Medium::MOON, Medium::MARS];

/// How many conditions are evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Extent {
    /// On land: other springs and masses, moon and mars.
    #[default]
    Land,
    /// As well: moon and mars at every density.
    Full,
}

/// In what a condition differs from the paper's leg on earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// The spring's stiffness, N/m.
    Stiffness(f64),
    /// The dry mass, kg. Volume, areas and added mass stay.
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

/// One change, at one density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Condition {
    /// From the paper's leg on earth.
    pub change: Change,
    /// Density ratio.
    pub rho: f64,
}

impl Condition {
    /// On land.
    #[must_use]
    pub const fn on_land(change: Change) -> Self {
        Self { change, rho: 0.0 }
    }

    /// All of an extent: springs, masses, worlds; on land first.
    #[must_use]
    pub fn all(extent: Extent) -> Vec<Self> {
        let worlds = || WORLDS.map(|world| Change::Gravity(world.gravity_m_s2()));
        let land = || {
            let springs = STIFFNESS_N_M.map(Change::Stiffness).into_iter();
            let masses = MASS_KG.map(Change::Mass);
            springs.chain(masses).chain(worlds()).map(Self::on_land)
        };
        let wet = || {
            let densities = DENSITIES.into_iter().filter(|&rho| rho > 0.0);
            worlds()
                .into_iter()
                .flat_map(move |change| densities.clone().map(move |rho| Self { change, rho }))
        };
        match extent {
            Extent::Land => land().collect(),
            Extent::Full => land().chain(wet()).collect(),
        }
    }

    /// The leg, and what it is in.
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

    /// How the actor does in it.
    #[must_use]
    pub fn run(self, actor: &Actor<'_>, starts: &[Apex]) -> Elsewhere {
        let (leg, medium) = self.leg_and_medium();
        let survival = survival(actor, &Hopper::new(&leg, medium), self.rho, starts);
        Elsewhere { condition: self, survival }
    }
}

/// How an actor does in a condition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elsewhere {
    /// The condition.
    pub condition: Condition,
    /// What became of the starts, the same as at home.
    pub survival: Survival,
}

impl Serialize for Elsewhere {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let (leg, medium) = self.condition.leg_and_medium();
        let mut row = serializer.serialize_struct("Elsewhere", 9)?;
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
    fn a_change_changes_one_thing() {
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
    fn the_papers_spring_is_the_leg_at_home() {
        let (leg, medium) = Condition::on_land(Change::Stiffness(20_000.0)).leg_and_medium();
        let apex = Apex { vx_m_s: 0.3, y_m: 2.0 };
        let action = Action { touchdown_angle_rad: 1.6, elongation_speed_m_s: 0.1 };
        let hop = |hopper: &Hopper| hopper.hop(apex, action).outcome.next();
        assert_eq!(hop(&Hopper::new(&leg, medium)), hop(&hopper(0.0)));
    }
}
