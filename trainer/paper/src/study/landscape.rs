//! The reward of one step over all actions, from water to air: what figures 5
//! and 6 share. Each start's landscapes are reduced to a few numbers.

use std::ops::Range;

use leg_plant::{Action, Apex, Hopper, Leg, Medium, Tolerance};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{Extent, FiguresError, Workshop};
use trainer::config::Reward;
use trainer::environment::draw_start;
use trainer::preset::{ACTION_HIGH, ACTION_LOW, Preset};

/// A reward is high where the step comes this near to the wanted speed, m/s.
pub(crate) const NEAR_M_S: f64 = 0.5;
/// Seed of the starts.
const SEED: u64 = 5;
/// Spread of the starts, as in training.
const SPREAD: f64 = 3.0;
/// Seconds that a hop takes, roughly.
const HOP_S: f64 = 1.5e-6;

/// All touchdown angles, rad, or all elongation speeds, m/s.
pub(crate) fn bounds() -> [Range<f64>; 2] {
    [0, 1].map(|i| f64::from(ACTION_LOW[i])..f64::from(ACTION_HIGH[i]))
}

/// A grid over all actions, row by row from the lowest angle; a cell stands for
/// its middle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Plane {
    /// Rows: touchdown angles.
    pub(crate) angles: usize,
    /// Columns: elongation speeds.
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

/// What a step is rewarded for.
#[derive(Clone, Debug)]
pub(crate) struct Objective {
    /// The speed to reach, m/s: 0 is to stop.
    pub(crate) wanted_m_s: f64,
    reward: Reward,
}

impl Objective {
    /// The paper's reward, relative to a speed.
    pub(crate) fn speed(wanted_m_s: f64) -> Self {
        Self { wanted_m_s, reward: Preset::Air.config().reward }
    }

    /// Reward from which on it is high.
    pub(crate) fn high() -> f64 {
        (1.0 + 1.0 / NEAR_M_S).log10()
    }

    /// Rewards of all actions of a plane.
    pub(crate) fn rewards(&self, hops: &[Option<Apex>], plane: Plane, density: f64) -> Vec<f64> {
        let relative = |apex: Apex| Apex { vx_m_s: apex.vx_m_s - self.wanted_m_s, ..apex };
        let pairs = plane.actions().zip(hops);
        pairs.map(|(action, next)| self.reward.of(action, next.map(relative), density)).collect()
    }
}

/// Human-size leg in a medium between air, 0, and water, 1.
pub(crate) fn hopper(density_ratio: f64) -> Hopper {
    let medium = Medium::AIR.with_density_ratio(density_ratio).expect("a density ratio");
    Hopper::new(&Leg::human(), medium).with_tolerance(Tolerance::TRAINING)
}

/// Where every action of a plane leads; `None` is a fall.
pub(crate) fn hops(plane: Plane, start: Apex, density_ratio: f64) -> Vec<Option<Apex>> {
    let hopper = hopper(density_ratio);
    plane.actions().map(|action| hopper.hop(start, action).outcome.next()).collect()
}

/// The first so many of the seeded starts.
pub(crate) fn starts(count: usize) -> Vec<Apex> {
    let mut rng = Pcg64::seed_from_u64(SEED);
    (0..count).map(|_| draw_start(SPREAD, &mut rng)).collect()
}

/// A landscape in numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Look {
    /// Share of the actions with a high reward.
    pub(crate) high: f64,
    /// Connected pieces of the high region.
    pub(crate) pieces: f64,
    /// Share of the high region in its largest piece; NaN where there is none.
    pub(crate) largest: f64,
    /// Mean change of the reward per 0.1 rad of the angle.
    pub(crate) slope: f64,
    /// Share of the reward's variance that the angle alone explains; NaN where
    /// the reward is the same everywhere.
    pub(crate) by_angle: f64,
}

impl Look {
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

/// The landscapes of a start from water to air, in numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Transition {
    /// Density ratios, from water to air.
    pub(crate) densities: Vec<f64>,
    /// The landscape at each.
    pub(crate) looks: Vec<Look>,
    /// Mean absolute change of the reward from each density to the next.
    pub(crate) changes: Vec<f64>,
    /// Correlation of the rewards at each density and the next; NaN where one
    /// is the same everywhere.
    pub(crate) likeness: Vec<f64>,
}

impl Transition {
    fn of(objective: &Objective, hops: &[Vec<Option<Apex>>], plane: Plane, grid: &[f64]) -> Self {
        let media = hops.iter().zip(grid);
        let rewards: Vec<Vec<f64>> =
            media.map(|(hops, density)| objective.rewards(hops, plane, *density)).collect();
        Self {
            densities: grid.to_vec(),
            looks: rewards.iter().map(|rewards| Look::at(rewards, plane)).collect(),
            changes: rewards.windows(2).map(|w| mean_change(&w[0], &w[1])).collect(),
            likeness: rewards.windows(2).map(|w| correlation(&w[0], &w[1])).collect(),
        }
    }

    /// The sum of all changes: total variation along the density.
    pub(crate) fn variation(&self) -> f64 {
        self.changes.iter().sum()
    }

    /// The largest change between neighbouring densities.
    pub(crate) fn jump(&self) -> f64 {
        self.changes.iter().copied().fold(0.0, f64::max)
    }

    /// The lowest correlation between neighbouring densities.
    pub(crate) fn least_like(&self) -> f64 {
        self.likeness.iter().copied().fold(f64::NAN, f64::min)
    }

    pub(crate) fn water(&self) -> &Look {
        &self.looks[0]
    }

    pub(crate) fn air(&self) -> &Look {
        &self.looks[self.looks.len() - 1]
    }
}

/// Both objectives from every start.
pub(crate) struct Survey {
    /// To stop.
    pub(crate) stop: Vec<Transition>,
    /// To go at 1 m/s.
    pub(crate) speed: Vec<Transition>,
}

fn plane(extent: Extent) -> Plane {
    extent.of(Plane { angles: 120, speeds: 40 }, Plane { angles: 80, speeds: 20 })
}

fn start_count(extent: Extent) -> usize {
    extent.of(64, 16)
}

/// Density steps of 0.05: the same in both extents, or their changes could not be compared.
const DENSITIES: usize = 21;

/// Seconds that a survey takes on two cores.
pub(crate) fn cost_s(extent: Extent) -> f64 {
    start_count(extent) as f64 * one_cost_s(extent) / 2.0
}

fn one_cost_s(extent: Extent) -> f64 {
    let Plane { angles, speeds } = plane(extent);
    (angles * speeds * DENSITIES) as f64 * HOP_S
}

impl Survey {
    /// From all starts; each is a part.
    pub(crate) fn of(shop: &Workshop) -> Result<Self, FiguresError> {
        let plane = plane(shop.extent);
        let last = (DENSITIES - 1) as f64;
        let grid: Vec<f64> = (0..DENSITIES).map(|i| 1.0 - i as f64 / last).collect();
        let both: Vec<[Transition; 2]> = starts(start_count(shop.extent))
            .into_par_iter()
            .enumerate()
            .map(|(i, start)| {
                let inputs = (plane, &grid, start, NEAR_M_S);
                shop.part(&format!("landscape-{i}"), &inputs, one_cost_s(shop.extent) / 2.0, || {
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

/// Mean over starts of what is finite.
pub(crate) fn over(starts: &[Transition], number: impl Fn(&Transition) -> f64) -> f64 {
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

/// Over the pairs that there are.
fn mean_change(a: &[f64], b: &[f64]) -> f64 {
    let changes = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    changes.sum::<f64>() / a.len().min(b.len()) as f64
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (mean_a, mean_b) = (mean(a), mean(b));
    let products = a.iter().zip(b).map(|(a, b)| (a - mean_a) * (b - mean_b));
    products.sum::<f64>() / a.len() as f64 / (variance(a) * variance(b)).sqrt()
}

/// Sizes of the connected pieces of a region; cells touch at sides and corners.
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
    fn pieces_are_counted_over_sides_and_corners_but_not_around_an_edge() {
        let region = |rows: [&str; 3]| -> Vec<bool> {
            rows.iter().flat_map(|row| row.chars().map(|c| c == '#')).collect()
        };
        assert_eq!(pieces(&region(["##..", "..#.", "...."]), 4), [3]);
        assert_eq!(pieces(&region(["...#", "#...", "#..."]), 4), [1, 2]);
        assert!(pieces(&region(["....", "....", "...."]), 4).is_empty());
    }

    #[test]
    fn a_landscape_of_the_angle_alone_is_said_to_be_one() {
        let plane = Plane { angles: 4, speeds: 3 };
        let by_angle: Vec<f64> = (0..12).map(|cell| f64::from(cell / 3)).collect();
        let look = Look::at(&by_angle, plane);
        assert!((look.by_angle - 1.0).abs() < 1e-12);
        assert_eq!((look.high, look.pieces, look.largest), (0.75, 1.0, 1.0));
        let [alpha, _] = bounds();
        assert!((look.slope - 0.4 / (alpha.end - alpha.start)).abs() < 1e-12);
        let by_speed: Vec<f64> = (0..12).map(|cell| f64::from(cell % 3)).collect();
        assert!(Look::at(&by_speed, plane).by_angle < 1e-12);
    }

    #[test]
    fn the_reward_is_the_papers_and_falls_have_none() {
        let plane = Plane { angles: 1, speeds: 2 };
        let hops = [Some(Apex { vx_m_s: 1.5, y_m: 2.0 }), None];
        let rewards = Objective::speed(1.0).rewards(&hops, plane, 0.0);
        assert_eq!(rewards, [3_f64.log10(), 0.0]);
        assert_eq!(rewards[0], Objective::high());
    }

    #[test]
    fn in_water_a_leg_stops_from_more_of_the_plane_than_in_air() {
        let plane = Plane { angles: 30, speeds: 8 };
        let start = Apex { vx_m_s: 1.0, y_m: 2.0 };
        let of = |grid: &[f64]| {
            let hops: Vec<_> = grid.iter().map(|rho| hops(plane, start, *rho)).collect();
            Transition::of(&Objective::speed(0.0), &hops, plane, grid)
        };
        let transition = of(&[1.0, 0.5, 0.0]);
        assert!(transition.water().high > 2.0 * transition.air().high, "{transition:?}");
        assert_eq!(of(&[0.5, 0.5]).variation(), 0.0);
        assert!((of(&[0.5, 0.5]).least_like() - 1.0).abs() < 1e-12);
        assert!(transition.jump() < transition.variation());
    }
}
