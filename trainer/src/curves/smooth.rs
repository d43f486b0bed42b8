//! Smoothing: from the episodes of several runs to one curve with its spread.
//!
//! The value of a run at a position is the mean over the episodes that ended in the window
//! before it. The window does not reach back across a change of stage, because the task changes
//! there; until it is half full, there is no value. The value of a group is the median over its
//! runs, with quartiles. It exists only where every run has a value, because past the end of
//! the shortest run the others are not the same group.

use super::log::Log;
use super::{By, Zero};
use crate::evaluate::survival::quantile;

/// Number of positions at which curves are computed.
const PLACES: usize = 600;

/// Runs that are drawn as one curve.
#[derive(Clone, Debug)]
pub struct Group {
    /// Name of the group.
    pub label: String,
    /// The runs, at least one.
    pub runs: Vec<Log>,
}

/// The parameters of the smoothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoothing {
    /// Horizontal axis.
    pub by: By,
    /// Position of zero.
    pub zero: Zero,
    /// Width of the window, in the unit of `by`.
    pub window: f64,
    /// Number of steps of a full episode; `None` takes that of the longest in the group.
    pub full_steps: Option<u64>,
}

/// Median and quartiles over the runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Lower quartile.
    pub low: f64,
    /// Median.
    pub median: f64,
    /// Upper quartile.
    pub high: f64,
}

/// The values of a group at one position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Position, in the unit of [`Smoothing::by`].
    pub x: f64,
    /// Sum of the rewards of an episode.
    pub reward: Spread,
    /// Share of the episodes with full length.
    pub full: Spread,
}

/// A group's curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Name of the group.
    pub label: String,
    /// Number of runs.
    pub runs: usize,
    /// Number of steps of a full episode.
    pub full_steps: u64,
    /// Parts of the curve without a gap.
    pub stretches: Vec<Vec<Point>>,
    /// Starts of the stages after the first: the median over the runs that have them.
    pub changes: Vec<f64>,
}

/// Returns the lowest and highest position of all runs.
#[must_use]
pub fn extent(groups: &[Group], by: By, zero: Zero) -> (f64, f64) {
    let runs = groups.iter().flat_map(|g| &g.runs);
    let ends = runs.map(|run| (first_start(run, by, zero), last_end(run, by, zero)));
    ends.fold((0.0, 0.0), |(low, high), (first, last)| (low.min(first), high.max(last)))
}

/// Returns a fiftieth of the range, rounded down to 1, 2 or 5 times a power of ten, and at
/// least 20: no episode of a preset has more steps, so a window always holds one.
#[must_use]
pub fn usual_window((low, high): (f64, f64)) -> f64 {
    let wanted = (high - low) / 50.0;
    let nice = (1..12).flat_map(|power| [1.0, 2.0, 5.0].map(|d| d * libm::pow(10.0, power.into())));
    nice.take_while(|&w| w <= wanted).last().unwrap_or(0.0).max(20.0)
}

/// Computes the curve of each group.
#[must_use]
pub fn curves(groups: &[Group], how: &Smoothing) -> Vec<Curve> {
    let (low, high) = extent(groups, how.by, how.zero);
    let step = (high - low) / PLACES as f64;
    let options: Vec<f64> = (0..=PLACES).map(|i| low + step * i as f64).collect();
    groups.iter().map(|group| curve(group, how, &options)).collect()
}

fn curve(group: &Group, how: &Smoothing, options: &[f64]) -> Curve {
    let longest = || group.runs.iter().map(Log::longest).max().unwrap_or(0);
    let full_steps = how.full_steps.unwrap_or_else(longest);
    let runs: Vec<Smoothed> =
        group.runs.iter().map(|log| Smoothed::new(log, how, full_steps)).collect();
    let mut stretches = vec![Vec::new()];
    for &x in options {
        let values: Option<Vec<[f64; 2]>> = runs.iter().map(|run| run.at(x)).collect();
        let open = stretches.last_mut().expect("one at least");
        match values {
            Some(values) => {
                let [reward, full] = [0, 1].map(|i| spread(values.iter().map(|v| v[i]).collect()));
                open.push(Point { x, reward, full });
            }
            None if !open.is_empty() => stretches.push(Vec::new()),
            None => {}
        }
    }
    stretches.retain(|s| !s.is_empty());
    let most = runs.iter().map(|run| run.changes.len()).max().unwrap_or(0);
    let change = |i: usize| {
        spread(
            runs.iter().filter_map(|run| run.changes.get(i).map(|&at| run.ends[at - 1])).collect(),
        )
    };
    Curve {
        label: group.label.clone(),
        runs: runs.len(),
        full_steps,
        stretches,
        changes: (0..most).map(|i| change(i).median).collect(),
    }
}

/// Returns the spread of at least one number.
fn spread(mut values: Vec<f64>) -> Spread {
    values.sort_by(f64::total_cmp);
    let at = |share| quantile(&values, share).expect("a run at least");
    Spread { low: at(0.25), median: at(0.5), high: at(0.75) }
}

fn first_start(log: &Log, by: By, zero: Zero) -> f64 {
    let length = match by {
        By::Steps => log.episodes()[0].total_steps as f64,
        By::Episodes => 1.0,
    };
    log.ends(by, zero)[0] - length
}

fn last_end(log: &Log, by: By, zero: Zero) -> f64 {
    log.ends(by, zero)[log.episodes().len() - 1]
}

/// A run, with cumulative sums for its means.
struct Smoothed {
    window: f64,
    /// Positions of the start of the run and of the end of each episode.
    start: f64,
    ends: Vec<f64>,
    /// Indices of the first episodes of the later stages.
    changes: Vec<usize>,
    /// Sums of rewards and full episodes over the episodes before each.
    sums: Vec<[f64; 2]>,
}

impl Smoothed {
    fn new(log: &Log, how: &Smoothing, full_steps: u64) -> Self {
        let mut sums = vec![[0.0; 2]];
        let mut sum = [0.0; 2];
        for episode in log.episodes() {
            sum[0] += episode.reward;
            sum[1] += f64::from(u8::from(episode.steps >= full_steps));
            sums.push(sum);
        }
        Self {
            window: how.window,
            start: first_start(log, how.by, how.zero),
            ends: log.ends(how.by, how.zero),
            changes: log.changes(),
            sums,
        }
    }

    /// Returns the mean reward and the share of full episodes in the window that ends at `x`.
    fn at(&self, x: f64) -> Option<[f64; 2]> {
        if self.ends.last().is_none_or(|&end| x > end) {
            return None;
        }
        let ended_by = |x: f64| self.ends.partition_point(|&end| end <= x);
        let last = ended_by(x);
        let stage = self.changes.iter().rev().find(|&&first| first < last).copied().unwrap_or(0);
        let stage_start = if stage == 0 { self.start } else { self.ends[stage - 1] };
        if x - stage_start < self.window / 2.0 {
            return None;
        }
        let first = ended_by(x - self.window).max(stage);
        let count = last.checked_sub(first).filter(|&n| n > 0)? as f64;
        Some([0, 1].map(|i| (self.sums[last][i] - self.sums[first][i]) / count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write;
    use std::path::Path;

    /// A run of episodes (stage, reward, steps).
    fn run(episodes: &[(u64, f64, u64)]) -> Log {
        let mut text = "stage,total_steps,reward,steps\n".to_owned();
        let mut total = 0;
        for &(stage, reward, steps) in episodes {
            total += steps;
            writeln!(text, "{stage},{total},{reward},{steps}").unwrap();
        }
        Log::parse(Path::new("run.csv"), text.as_bytes()).unwrap()
    }

    fn how(by: By, window: f64) -> Smoothing {
        Smoothing { by, zero: Zero::Start, window, full_steps: None }
    }

    #[test]
    fn a_value_is_the_mean_over_the_episodes_of_its_window() {
        let log = run(&[(1, 1.0, 5), (1, 3.0, 5), (1, 5.0, 2), (1, 7.0, 5)]);
        let by_episodes = Smoothed::new(&log, &how(By::Episodes, 2.0), 5);
        assert_eq!(by_episodes.at(0.9), None, "the window is not half full");
        assert_eq!(by_episodes.at(1.0), Some([1.0, 1.0]));
        assert_eq!(by_episodes.at(3.0), Some([4.0, 0.5]));
        assert_eq!(by_episodes.at(4.0), Some([6.0, 0.5]));
        assert_eq!(by_episodes.at(4.1), None, "past the end");
        let by_steps = Smoothed::new(&log, &how(By::Steps, 10.0), 5);
        assert_eq!(by_steps.at(12.0), Some([3.0, 2.0 / 3.0]));
        assert_eq!(by_steps.at(17.0), Some([5.0, 2.0 / 3.0]));
    }

    #[test]
    fn a_window_ends_at_the_start_of_its_stage() {
        let log = run(&[(1, 1.0, 5), (1, 1.0, 5), (2, 4.0, 5), (2, 6.0, 5), (2, 8.0, 5)]);
        let smoothed = Smoothed::new(&log, &how(By::Episodes, 2.0), 5);
        assert_eq!(smoothed.at(2.0), Some([1.0, 1.0]));
        assert_eq!(smoothed.at(3.0), Some([4.0, 1.0]));
        assert_eq!(smoothed.at(4.0), Some([5.0, 1.0]));
        assert_eq!(smoothed.at(5.0), Some([7.0, 1.0]));
    }

    #[test]
    fn a_group_has_median_and_quartiles_where_all_runs_have_values() {
        let constant = |reward: f64, episodes| run(&vec![(1, reward, 5); episodes]);
        let runs = vec![constant(1.0, 100), constant(2.0, 50), constant(4.0, 100)];
        let group = Group { label: "g".into(), runs };
        let curves = curves(&[group], &how(By::Episodes, 10.0));
        let [stretch] = &curves[0].stretches[..] else { panic!("one stretch: {curves:?}") };
        for point in stretch {
            assert_eq!(point.reward, Spread { low: 1.5, median: 2.0, high: 3.0 });
            assert_eq!(point.full, Spread { low: 1.0, median: 1.0, high: 1.0 });
        }
        let ends = [stretch[0].x, stretch[stretch.len() - 1].x];
        assert!((5.0..5.2).contains(&ends[0]) && (49.8..=50.0).contains(&ends[1]), "{ends:?}");
        assert_eq!((curves[0].runs, curves[0].full_steps), (3, 5));
    }

    #[test]
    fn runs_aligned_by_their_last_stage_change_at_zero() {
        let long = run(&[[(1, 1.0, 5); 40].as_slice(), &[(2, 2.0, 5); 60]].concat());
        let short = run(&[(1, 1.5, 5); 60]);
        let group = |label: &str, run: &Log| Group { label: label.into(), runs: vec![run.clone()] };
        let groups = [group("long", &long), group("short", &short)];
        let how = Smoothing { zero: Zero::LastStage, ..how(By::Episodes, 4.0) };
        assert_eq!(extent(&groups, how.by, how.zero), (-40.0, 60.0));
        let curves = curves(&groups, &how);
        assert_eq!((&curves[0].changes[..], &curves[1].changes[..]), (&[0.0][..], &[][..]));
        // The gap at the change is where the window is not half full.
        let [before, after] = &curves[0].stretches[..] else { panic!("two stretches") };
        assert!(before.iter().all(|p| p.x < 2.0 && p.reward.median == 1.0));
        assert!(after.iter().all(|p| p.x >= 2.0 && p.reward.median == 2.0));
    }

    #[test]
    fn the_default_window_is_round_and_at_least_an_episode() {
        let windows = [10.0, 1_200.0, 5_000.0, 37_000.0, 300_000.0].map(|n| usual_window((0.0, n)));
        assert_eq!(windows, [20.0, 20.0, 100.0, 500.0, 5_000.0]);
    }
}
