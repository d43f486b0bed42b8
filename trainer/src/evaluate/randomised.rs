//! Survival in randomised worlds: each quantity alone, and all of them together.
//!
//! The world of a start follows from its number and the seed, so two policies meet the same, and
//! a quantity has the same values alone as among the others. All starts are randomised, whatever
//! the share of a training is.

use super::report::keyed;
use super::survival::{Rollout, Survival, draw_starts, rollout, summary};
use super::{DENSITIES, act_on};
use crate::config::{Parameter, Randomisation};
use crate::world::World;
use leg_control::actor::Actor;
use leg_plant::{Apex, Tolerance};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::fmt;

/// What a row of the evaluation randomises.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// Nothing.
    Nothing,
    /// One quantity.
    One(Parameter),
    /// All of the table's.
    Everything,
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Nothing => "nothing",
            Self::One(parameter) => parameter.key(),
            Self::Everything => "all together",
        })
    }
}

/// The survival of an actor with one subject randomised, at each density ratio.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// What is randomised.
    pub subject: Subject,
    /// Survival by density ratio, lowest first.
    pub survival: Vec<(f64, Survival)>,
}

/// Runs every start in its world; returns the outcomes in the order of the starts.
#[must_use]
pub fn rollouts(
    actor: &Actor<'_>,
    randomisation: &Randomisation,
    density_ratio: f64,
    starts: &[Apex],
    seed: u64,
) -> Vec<Rollout> {
    let everywhere = Randomisation { share: 1.0, ..randomisation.clone() };
    let run = |(number, &start): (usize, &Apex)| {
        // The losses cost the survivors more than the last digits of the integrator.
        let tolerance = Tolerance::TRAINING;
        let mut world = World::draw(&everywhere, seed, number as u64, density_ratio, tolerance);
        rollout(start, |apex| {
            let action = act_on(actor, world.show(apex), 0.0);
            world.hop(apex, action)
        })
    };
    starts.par_iter().enumerate().with_min_len(16).map(run).collect()
}

/// Evaluates an actor from the same `starts` starts at each density ratio, as
/// [`super::report::Report`] draws them: without randomisation, with each quantity alone and with
/// all of them.
#[must_use]
pub fn table(
    actor: &Actor<'_>,
    randomisation: &Randomisation,
    starts: usize,
    seed: u64,
) -> Vec<Row> {
    let drawn = draw_starts(starts, &mut Pcg64::seed_from_u64(seed));
    let row = |subject: Subject| {
        let of = match subject {
            Subject::Nothing => Randomisation::default(),
            Subject::One(parameter) => randomisation.only(parameter),
            Subject::Everything => randomisation.clone(),
        };
        let at = |rho: f64| (rho, summary(&rollouts(actor, &of, rho, &drawn, seed)));
        Row { subject, survival: DENSITIES.map(at).to_vec() }
    };
    let mut subjects = vec![Subject::Nothing];
    subjects.extend(randomisation.parameters().map(Subject::One));
    subjects.push(Subject::Everything);
    subjects.into_iter().map(row).collect()
}

impl Row {
    /// Returns the row as JSON: what is randomised, and each figure by density ratio.
    pub(super) fn to_json(&self) -> Value {
        json!({
            "randomised": self.subject.to_string(),
            "survive30": keyed(&self.survival, |s| s.survive30),
            "abs_v_median": keyed(&self.survival, |s| s.abs_v_median),
            "abs_v_p95": keyed(&self.survival, |s| s.abs_v_p95),
            "reward5": keyed(&self.survival, |s| s.reward5),
        })
    }
}

/// The shares of starts that survive, a line for each row.
pub(super) struct Table<'a>(pub(super) &'a [Row]);

impl fmt::Display for Table<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let first = self.0.first().map_or(&[][..], |row| &row.survival);
        let starts = first.first().map_or(0, |(_, s)| s.starts);
        writeln!(f, "Survive30 in randomised worlds, from {starts} starts at each density:")?;
        write!(f, "{:<19}", "rho")?;
        for (rho, _) in first {
            write!(f, "  {rho:>6}")?;
        }
        for row in self.0 {
            write!(f, "\n{:<19}", row.subject.to_string())?;
            for (_, survival) in &row.survival {
                write!(f, "  {:>6.4}", survival.survive30)?;
            }
        }
        writeln!(f)
    }
}
