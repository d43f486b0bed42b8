//! The reward of one step over all actions, from water to air, for figures 5 and 6. The
//! landscapes of each start are reduced to a few statistics.

use std::ops::Range;

use leg_plant::{Action, Apex, Hopper, Leg, Medium, Tolerance};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{Extent, FigureContext, FiguresError};
use trainer::config::Reward;
use trainer::environment::draw_start;
use trainer::preset::{ACTION_HIGH, ACTION_LOW, Preset};

/// A reward is high if the step ends within this of the wanted speed, m/s.
pub(crate) const NEAR_M_S: f64 = 0.5;
/// Seed of the starts.
const SEED: u64 = 5;
/// Standard deviation of the starts, as in training.
const SPREAD: f64 = 3.0;
/// Approximate time that a hop takes to compute, s.
const HOP_S: f64 = 1.5e-6;

/// Returns the ranges of the touchdown angle, rad, and of the elongation speed, m/s.
pub(crate) fn bounds() -> [Range<f64>; 2] {
    [0, 1].map(|i| f64::from(ACTION_LOW[i])..f64::from(ACTION_HIGH[i]))
}

/// A grid over all actions, row by row from the lowest angle. A cell stands for its
/// middle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Plane {
    /// Number of touchdown angles: rows.
    pub(crate) angles: usize,
    /// Number of elongation speeds: columns.
    pub(crate) speeds: usize,
}

impl Plane {
    pub(crate) fn actions(self) -> impl Iterator<Item = Action> {
        let [alpha, rs] = bounds();
        let middle = |range: &Range<f64>, i: usize, of: usize| {
            range.start + (i as f64 + 0.5) / of as f64 * (range.end - range.start)
        };
        (0..self.angles * self.speeds).map(move |cell| Action {
            touchdown_angle_rad: middle(&alpha, cell / self.speeds, self.angles),
            elongation_speed_m_s: middle(&rs, cell % self.speeds, self.speeds),
        })
    }
}

/// A reward for reaching a speed in one step.
#[derive(Clone, Debug)]
pub(crate) struct Objective {
    /// The speed to reach, m/s; 0 is to stop.
    pub(crate) wanted_m_s: f64,
    reward: Reward,
}

impl Objective {
    /// Returns the paper's reward, relative to a speed, m/s.
    pub(crate) fn speed(wanted_m_s: f64) -> Self {
        Self { wanted_m_s, reward: Preset::Air.config().reward }
    }

    /// Returns the least reward that counts as high.
    pub(crate) fn high() -> f64 {
        (1.0 + 1.0 / NEAR_M_S).log10()
    }

    /// Returns the rewards of all actions of a plane.
    pub(crate) fn rewards(&self, hops: &[Option<Apex>], plane: Plane, density: f64) -> Vec<f64> {
        let relative = |apex: Apex| Apex { vx_m_s: apex.vx_m_s - self.wanted_m_s, ..apex };
        let pairs = plane.actions().zip(hops);
        pairs.map(|(action, next)| self.reward.of(action, next.map(relative), density)).collect()
    }
}

/// Returns a human-size leg in a medium between air, 0, and water, 1.
pub(crate) fn hopper(density_ratio: f64) -> Hopper {
    let medium = Medium::AIR.with_density_ratio(density_ratio).expect("a density ratio");
    Hopper::new(&Leg::human(), medium).with_tolerance(Tolerance::TRAINING)
}

/// Returns the next apex for every action of a plane; `None` is a fall.
pub(crate) fn hops(plane: Plane, start: Apex, density_ratio: f64) -> Vec<Option<Apex>> {
    let hopper = hopper(density_ratio);
    plane.actions().map(|action| hopper.hop(start, action).outcome.next()).collect()
}

/// Draws the first `count` starts.
pub(crate) fn starts(count: usize) -> Vec<Apex> {
    let mut rng = Pcg64::seed_from_u64(SEED);
    (0..count).map(|_| draw_start(SPREAD, &mut rng)).collect()
}

/// Statistics of a landscape.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct LandscapeStats {
    /// Share of the actions with a high reward.
    pub(crate) high: f64,
    /// Number of connected pieces of the region with a high reward.
    pub(crate) pieces: f64,
    /// Share of that region in its largest piece; NaN if there is none.
    pub(crate) largest: f64,
    /// Mean absolute change of the reward per 0.1 rad of the angle.
    pub(crate) slope: f64,
    /// Share of the reward's variance that the angle alone explains; NaN if the reward is
    /// the same everywhere.
    pub(crate) by_angle: f64,
}

impl LandscapeStats {
    pub(crate) fn at(rewards: &[f64], plane: Plane) -> Self {
        let high: Vec<bool> = rewards.iter().map(|r| *r >= Objective::high()).collect();
        let count = high.iter().filter(|h| **h).count();
        let pieces = pieces(&high, plane.speeds);
        let [alpha, _] = bounds();
        let per_rad = plane.angles as f64 / (alpha.end - alpha.start);
        let rows: Vec<f64> = rewards.chunks(plane.speeds).map(mean).collect();
        Self {
            high: count as f64 / rewards.len() as f64,
            pieces: pieces.len() as f64,
            largest: pieces.iter().max().map_or(f64::NAN, |n| *n as f64 / count as f64),
            slope: 0.1 * per_rad * mean_change(&rewards[plane.speeds..], rewards),
            by_angle: variance(&rows) / variance(rewards),
        }
    }
}

/// Statistics of the landscapes of one start, from water to air.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Transition {
    /// Density ratios, from water to air.
    pub(crate) densities: Vec<f64>,
    /// Statistics at each density.
    pub(crate) stats: Vec<LandscapeStats>,
    /// Mean absolute change of the reward from each density to the next.
    pub(crate) changes: Vec<f64>,
    /// Correlation of the rewards at each density and the next; NaN if one of them is the
    /// same everywhere.
    pub(crate) correlations: Vec<f64>,
}

impl Transition {
    fn of(objective: &Objective, hops: &[Vec<Option<Apex>>], plane: Plane, grid: &[f64]) -> Self {
        let media = hops.iter().zip(grid);
        let rewards: Vec<Vec<f64>> =
            media.map(|(hops, density)| objective.rewards(hops, plane, *density)).collect();
        Self {
            densities: grid.to_vec(),
            stats: rewards.iter().map(|rewards| LandscapeStats::at(rewards, plane)).collect(),
            changes: rewards.windows(2).map(|w| mean_change(&w[0], &w[1])).collect(),
            correlations: rewards.windows(2).map(|w| correlation(&w[0], &w[1])).collect(),
        }
    }

    /// Returns the sum of all changes: the total variation along the density.
    pub(crate) fn variation(&self) -> f64 {
        self.changes.iter().sum()
    }

    /// Returns the largest change between neighbouring densities.
    pub(crate) fn max_change(&self) -> f64 {
        self.changes.iter().copied().fold(0.0, f64::max)
    }

    /// Returns the lowest correlation between neighbouring densities.
    pub(crate) fn min_correlation(&self) -> f64 {
        self.correlations.iter().copied().fold(f64::NAN, f64::min)
    }

    pub(crate) fn water(&self) -> &LandscapeStats {
        &self.stats[0]
    }

    pub(crate) fn air(&self) -> &LandscapeStats {
        &self.stats[self.stats.len() - 1]
    }
}

/// The transitions of both objectives, one for each start.
pub(crate) struct Survey {
    /// For stopping.
    pub(crate) stop: Vec<Transition>,
    /// For 1 m/s.
    pub(crate) speed: Vec<Transition>,
}

fn plane(extent: Extent) -> Plane {
    extent.of(Plane { angles: 120, speeds: 40 }, Plane { angles: 80, speeds: 20 })
}

fn start_count(extent: Extent) -> usize {
    extent.of(64, 16)
}

/// Number of densities, 0.05 apart: the same in both extents, so that changes compare.
const DENSITIES: usize = 21;

/// Returns the approximate time that a survey takes on two cores, s.
pub(crate) fn cost_s(extent: Extent) -> f64 {
    start_count(extent) as f64 * one_cost_s(extent) / 2.0
}

fn one_cost_s(extent: Extent) -> f64 {
    let Plane { angles, speeds } = plane(extent);
    (angles * speeds * DENSITIES) as f64 * HOP_S
}

impl Survey {
    /// Computes the transitions from all starts; each is a cached step.
    pub(crate) fn of(ctx: &FigureContext) -> Result<Self, FiguresError> {
        let plane = plane(ctx.extent);
        let last = (DENSITIES - 1) as f64;
        let grid: Vec<f64> = (0..DENSITIES).map(|i| 1.0 - i as f64 / last).collect();
        let both: Vec<[Transition; 2]> = starts(start_count(ctx.extent))
            .into_par_iter()
            .enumerate()
            .map(|(i, start)| {
                let inputs = (plane, &grid, start, NEAR_M_S);
                ctx.cached(&format!("landscape-{i}"), &inputs, one_cost_s(ctx.extent) / 2.0, || {
                    let hops: Vec<_> = grid.iter().map(|rho| hops(plane, start, *rho)).collect();
                    let of =
                        |wanted| Transition::of(&Objective::speed(wanted), &hops, plane, &grid);
                    Ok([of(0.0), of(1.0)])
                })
            })
            .collect::<Result<_, _>>()?;
        let (stop, speed) = both.into_iter().map(|[stop, speed]| (stop, speed)).unzip();
        Ok(Self { stop, speed })
    }
}

/// Returns the mean over starts of the finite values.
pub(crate) fn mean_over(starts: &[Transition], number: impl Fn(&Transition) -> f64) -> f64 {
    let finite: Vec<f64> = starts.iter().map(number).filter(|x| x.is_finite()).collect();
    mean(&finite)
}

pub(crate) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / values.len() as f64
}

/// Returns the mean absolute difference of pairs, up to the end of the shorter slice.
fn mean_change(a: &[f64], b: &[f64]) -> f64 {
    let changes = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    changes.sum::<f64>() / a.len().min(b.len()) as f64
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (mean_a, mean_b) = (mean(a), mean(b));
    let products = a.iter().zip(b).map(|(a, b)| (a - mean_a) * (b - mean_b));
    products.sum::<f64>() / a.len() as f64 / (variance(a) * variance(b)).sqrt()
}

/// Returns the sizes of the connected pieces of a region. Cells touch at sides and
/// corners.
fn pieces(region: &[bool], columns: usize) -> Vec<usize> {
    let mut open = region.to_vec();
    let rows = region.len() / columns;
    let mut sizes = Vec::new();
    for first in 0..open.len() {
        if !open[first] {
            continue;
        }
        open[first] = false;
        let (mut size, mut todo) = (0, vec![first]);
        while let Some(cell) = todo.pop() {
            size += 1;
            let (row, column) = (cell / columns, cell % columns);
            for row in row.saturating_sub(1)..(row + 2).min(rows) {
                for column in column.saturating_sub(1)..(column + 2).min(columns) {
                    let next = row * columns + column;
                    if std::mem::take(&mut open[next]) {
                        todo.push(next);
                    }
                }
            }
        }
        sizes.push(size);
    }
    sizes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_connect_over_sides_and_corners_but_not_around_an_edge() {
        let region = |rows: [&str; 3]| -> Vec<bool> {
            rows.iter().flat_map(|row| row.chars().map(|c| c == '#')).collect()
        };
        assert_eq!(pieces(&region(["##..", "..#.", "...."]), 4), [3]);
        assert_eq!(pieces(&region(["...#", "#...", "#..."]), 4), [1, 2]);
        assert!(pieces(&region(["....", "....", "...."]), 4).is_empty());
    }

    #[test]
    fn attributes_the_variance_to_the_angle_if_only_the_angle_matters() {
        let plane = Plane { angles: 4, speeds: 3 };
        let by_angle: Vec<f64> = (0..12).map(|cell| f64::from(cell / 3)).collect();
        let look = LandscapeStats::at(&by_angle, plane);
        assert!((look.by_angle - 1.0).abs() < 1e-12);
        assert_eq!((look.high, look.pieces, look.largest), (0.75, 1.0, 1.0));
        let [alpha, _] = bounds();
        assert!((look.slope - 0.4 / (alpha.end - alpha.start)).abs() < 1e-12);
        let by_speed: Vec<f64> = (0..12).map(|cell| f64::from(cell % 3)).collect();
        assert!(LandscapeStats::at(&by_speed, plane).by_angle < 1e-12);
    }

    #[test]
    fn rewards_as_the_paper_does_and_gives_a_fall_nothing() {
        let plane = Plane { angles: 1, speeds: 2 };
        let hops = [Some(Apex { vx_m_s: 1.5, y_m: 2.0 }), None];
        let rewards = Objective::speed(1.0).rewards(&hops, plane, 0.0);
        assert_eq!(rewards, [3_f64.log10(), 0.0]);
        assert_eq!(rewards[0], Objective::high());
    }

    #[test]
    fn more_actions_stop_in_water_than_in_air() {
        let plane = Plane { angles: 30, speeds: 8 };
        let start = Apex { vx_m_s: 1.0, y_m: 2.0 };
        let of = |grid: &[f64]| {
            let hops: Vec<_> = grid.iter().map(|rho| hops(plane, start, *rho)).collect();
            Transition::of(&Objective::speed(0.0), &hops, plane, grid)
        };
        let transition = of(&[1.0, 0.5, 0.0]);
        assert!(transition.water().high > 2.0 * transition.air().high, "{transition:?}");
        assert_eq!(of(&[0.5, 0.5]).variation(), 0.0);
        assert!((of(&[0.5, 0.5]).min_correlation() - 1.0).abs() < 1e-12);
        assert!(transition.max_change() < transition.variation());
    }
}
