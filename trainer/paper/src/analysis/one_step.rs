//! The actions that stop in one step, by the paper's pattern search and by a finer
//! search.

use leg_plant::{Action, Apex, Hopper};
use serde::{Deserialize, Serialize};

use super::landscape::{Plane, bounds};
use trainer::environment::LOWEST_APEX_M;

/// A step that ends at less than this speed is a stop, m/s.
pub(crate) const STOP_M_S: f64 = 0.01;
/// Step at which the pattern search ends, as a share of the plane.
const FINEST: f64 = 1e-6;
/// Number of bisections of a bracket: to 1e-8 rad.
const BISECTIONS: usize = 20;
/// Number of angles tried at one elongation speed.
const ANGLES: usize = 200;

/// An action, and the speed at the next apex. The speed is infinite if the step ends in a
/// fall or in an apex below 1 m, from which no other step follows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct TriedAction {
    /// Touchdown angle, rad.
    pub(crate) touchdown_angle_rad: f64,
    /// Elongation speed, m/s.
    pub(crate) elongation_speed_m_s: f64,
    /// Speed at the next apex, m/s.
    pub(crate) speed_m_s: f64,
}

/// One step from an apex.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step {
    /// The leg in its medium.
    pub(crate) hopper: Hopper,
    /// The apex before the step.
    pub(crate) start: Apex,
}

impl Step {
    /// Returns the velocity at the next apex, m/s, or `None` if no other step follows.
    pub(crate) fn velocity(
        &self,
        touchdown_angle_rad: f64,
        elongation_speed_m_s: f64,
    ) -> Option<f64> {
        let next = self
            .hopper
            .hop(self.start, Action { touchdown_angle_rad, elongation_speed_m_s })
            .outcome
            .next()?;
        (next.y_m >= LOWEST_APEX_M).then_some(next.vx_m_s)
    }

    pub(crate) fn tried(&self, touchdown_angle_rad: f64, elongation_speed_m_s: f64) -> TriedAction {
        let speed_m_s = self
            .velocity(touchdown_angle_rad, elongation_speed_m_s)
            .map_or(f64::INFINITY, f64::abs);
        TriedAction { touchdown_angle_rad, elongation_speed_m_s, speed_m_s }
    }

    /// Runs a pattern search from a place in the plane, 0 to 1 on both axes. Its step
    /// doubles after each success and halves after each failure.
    pub(crate) fn pattern_search(&self, from: [f64; 2], mut mesh: f64) -> TriedAction {
        let [alpha, rs] = bounds();
        let at = |[a, s]: [f64; 2]| {
            let along = |part: f64, low: f64, high: f64| low + part * (high - low);
            self.tried(along(a, alpha.start, alpha.end), along(s, rs.start, rs.end))
        };
        let (mut place, mut best) = (from, at(from));
        while mesh > FINEST {
            let polls = [[mesh, 0.0], [-mesh, 0.0], [0.0, mesh], [0.0, -mesh]];
            let better = polls.iter().find_map(|step| {
                let there = [0, 1].map(|i| (place[i] + step[i]).clamp(0.0, 1.0));
                let tried = at(there);
                (tried.speed_m_s < best.speed_m_s).then_some((there, tried))
            });
            if let Some((there, tried)) = better {
                (place, best) = (there, tried);
                mesh = (2.0 * mesh).min(0.5);
            } else {
                mesh /= 2.0;
            }
        }
        best
    }

    /// Finds the angles that stop at one elongation speed, by bisection wherever the
    /// velocity changes its sign between neighbouring angles.
    pub(crate) fn stops_at(&self, elongation_speed_m_s: f64) -> Vec<TriedAction> {
        let [range, _] = bounds();
        let angle = |i: usize| range.start + i as f64 / ANGLES as f64 * (range.end - range.start);
        let tried: Vec<Option<f64>> =
            (0..=ANGLES).map(|i| self.velocity(angle(i), elongation_speed_m_s)).collect();
        let brackets = tried.windows(2).enumerate().filter_map(|(i, pair)| match pair {
            [Some(a), Some(b)] if (*a < 0.0) != (*b < 0.0) => Some((i, *a)),
            _ => None,
        });
        let roots = brackets.map(|(i, at_low)| {
            let (mut low, mut high) = (angle(i), angle(i + 1));
            for _ in 0..BISECTIONS {
                let middle = f64::midpoint(low, high);
                let same = self
                    .velocity(middle, elongation_speed_m_s)
                    .is_some_and(|v| (v < 0.0) == (at_low < 0.0));
                if same { low = middle } else { high = middle }
            }
            let [a, b] = [low, high]
                .map(|touchdown_angle_rad| self.tried(touchdown_angle_rad, elongation_speed_m_s));
            if b.speed_m_s < a.speed_m_s { b } else { a }
        });
        // A velocity that jumps over 0 has no stop.
        roots.filter(|tried| tried.speed_m_s < STOP_M_S).collect()
    }

    /// Finds the best actions: all stops on a grid of elongation speeds, or, if none
    /// stops, the action with the least speed, by pattern search from the best cells of
    /// the grid. Returns nothing if every action falls.
    pub(crate) fn best(&self, grid: Plane) -> Vec<TriedAction> {
        let [_, rs] = bounds();
        let last = (grid.speeds - 1) as f64;
        let speed = |i: usize| rs.start + i as f64 / last * (rs.end - rs.start);
        let stops: Vec<TriedAction> =
            (0..grid.speeds).flat_map(|i| self.stops_at(speed(i))).collect();
        if !stops.is_empty() {
            return stops;
        }
        let [alpha, rs] = bounds();
        let mut cells: Vec<TriedAction> = grid
            .actions()
            .map(|action| self.tried(action.touchdown_angle_rad, action.elongation_speed_m_s))
            .collect();
        cells.sort_by(|a, b| a.speed_m_s.total_cmp(&b.speed_m_s));
        let refined = cells.iter().take(8).filter(|cell| cell.speed_m_s.is_finite()).map(|cell| {
            let from = [
                (cell.touchdown_angle_rad - alpha.start) / (alpha.end - alpha.start),
                (cell.elongation_speed_m_s - rs.start) / (rs.end - rs.start),
            ];
            self.pattern_search(from, 1.0 / grid.angles as f64)
        });
        refined.min_by(|a, b| a.speed_m_s.total_cmp(&b.speed_m_s)).into_iter().collect()
    }
}

/// Returns the distance of an action from the nearest of a set, as a share of the plane:
/// 1 is from end to end of an axis. NaN if the set is empty.
pub(crate) fn distance(
    touchdown_angle_rad: f64,
    elongation_speed_m_s: f64,
    set: &[TriedAction],
) -> f64 {
    let [alpha, rs] = bounds();
    let distances = set.iter().map(|best| {
        let across = (touchdown_angle_rad - best.touchdown_angle_rad) / (alpha.end - alpha.start);
        across.hypot((elongation_speed_m_s - best.elongation_speed_m_s) / (rs.end - rs.start))
    });
    distances.fold(f64::NAN, f64::min)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::analysis::landscape::hopper;

    fn step(density: f64, vx_m_s: f64, y_m: f64) -> Step {
        Step { hopper: hopper(density), start: Apex { vx_m_s, y_m } }
    }

    const GRID: Plane = Plane { angles: 40, speeds: 5 };

    #[test]
    fn both_searches_find_that_the_upright_leg_stops_from_rest() {
        for density in [0.0, 1.0] {
            let step = step(density, 0.0, 1.5);
            let stops = step.best(GRID);
            assert!(stops.iter().all(|stop| stop.speed_m_s < STOP_M_S));
            let upright =
                stops.iter().any(|stop| (stop.touchdown_angle_rad - FRAC_PI_2).abs() < 1e-5);
            assert!(upright, "{stops:?}");
            let found = step.pattern_search([0.45, 0.5], 0.25);
            assert!(found.speed_m_s < STOP_M_S, "{found:?}");
        }
    }

    #[test]
    fn a_stop_that_was_found_stops_and_its_neighbours_do_not() {
        let step = step(0.0, 1.0, 2.0);
        let stops = step.stops_at(0.0);
        assert!(!stops.is_empty());
        for stop in &stops {
            let again = step.tried(stop.touchdown_angle_rad, stop.elongation_speed_m_s);
            assert_eq!(again, *stop);
            assert!(step.tried(stop.touchdown_angle_rad + 0.05, 0.0).speed_m_s > STOP_M_S);
        }
        // The foot comes down ahead of the mass to brake it.
        assert!(stops.iter().any(|stop| stop.touchdown_angle_rad > FRAC_PI_2));
    }

    #[test]
    fn finds_no_best_action_if_every_action_falls() {
        // In air, at 1 km/s from 1 m: the leg catches nothing that goes up again.
        let hopeless = step(0.0, 1e3, 1.0);
        assert!(hopeless.best(GRID).is_empty());
        assert!(distance(1.0, 1.0, &[]).is_nan());
    }

    #[test]
    fn measures_distances_as_shares_of_the_plane() {
        let [alpha, rs] = bounds();
        let corner = TriedAction {
            touchdown_angle_rad: alpha.start,
            elongation_speed_m_s: rs.start,
            speed_m_s: 0.0,
        };
        assert!((distance(alpha.end, rs.start, &[corner]) - 1.0).abs() < 1e-12);
        let other = TriedAction { elongation_speed_m_s: rs.end, ..corner };
        assert!((distance(alpha.start, 0.75 * rs.end, &[corner, other]) - 0.25).abs() < 1e-12);
    }
}
