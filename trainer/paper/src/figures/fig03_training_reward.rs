//! Figure 3: training reward in water, in air, and in air after water.

use std::fmt::Write as _;

use crate::agents::{Episode, PaperAgent, cost_s};
use crate::analysis::learning_curves::{
    Cases, WINDOW, authors, mean_reward, quartiles, smooth, spread,
};
use crate::{Claim, Extent, Figure, FigureContext, FiguresError, RenderedFigure, Verdict};
use leg_charts::color::{BLACK, BLUE, GREEN, INK, ORANGE};
use leg_charts::{Axis, Mark, Panel, Point, Sheet};

/// Number of episodes compared at the beginning and at the end of a training.
const END: usize = 1_000;

pub(super) struct Fig03;

impl Figure for Fig03 {
    fn id(&self) -> &'static str {
        "fig03"
    }

    fn title(&self) -> &'static str {
        "Training reward in water, in air, and in air after water"
    }

    fn paper(&self) -> &'static str {
        "Learning to hop from scratch is easy in water and hard on land. An agent that is trained in \
         water first and then on land, with its actor and critic but an empty replay buffer, \
         reaches high rewards much faster than an agent trained on land only. Its rewards are also \
         higher, even if the episodes in water are counted."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        cost_s(PaperAgent::Air, extent) + cost_s(PaperAgent::WaterToAir, extent)
    }

    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError> {
        let cases = Cases::of(ctx)?;
        let reference = ctx.reference.as_ref();
        let theirs = [authors(reference, "air")?, authors(reference, "water_to_air")?];
        let claims = vec![faster(&cases), higher(&cases), counting_water(&cases)];
        let seeds = cases.air.len();
        let mut measured = format!(
            "{seeds} seeds of each preset. First {END} episodes on land, median over seeds of the \
             mean reward: {:.2} after water, {:.2} from scratch; last {END}: {:.2} and {:.2}.",
            median_of(&cases.after_water, first),
            median_of(&cases.air, first),
            median_of(&cases.after_water, last),
            median_of(&cases.air, last),
        );
        if let [Some(air), Some(transferred)] = &theirs {
            let _ = write!(
                measured,
                " The authors' two runs: {:.2} and {:.2} in their first {END} episodes.",
                mean_reward(&transferred[..END.min(transferred.len())]),
                mean_reward(&air[..END.min(air.len())]),
            );
        }
        Ok(RenderedFigure {
            svg: draw(&cases, &theirs)?,
            csv: table(&cases, &theirs),
            measured,
            claims,
        })
    }
}

fn first(episodes: &[Episode]) -> &[Episode] {
    &episodes[..END.min(episodes.len())]
}

fn last(episodes: &[Episode]) -> &[Episode] {
    &episodes[episodes.len().saturating_sub(END)..]
}

fn median_of(seeds: &[Vec<Episode>], part: fn(&[Episode]) -> &[Episode]) -> f64 {
    let mut means: Vec<f64> = seeds.iter().map(|episodes| mean_reward(part(episodes))).collect();
    quartiles(&mut means)[1]
}

/// Returns the number of seeds whose transferred agent is ahead of the agent trained on
/// land only, and the number of seeds.
fn ahead(cases: &Cases, part: fn(&[Episode]) -> &[Episode]) -> (usize, usize) {
    let pairs = cases.after_water.iter().zip(&cases.air);
    let ahead = pairs.filter(|(a, b)| mean_reward(part(a)) > mean_reward(part(b))).count();
    (ahead, cases.air.len())
}

fn comparison(cases: &Cases, part: fn(&[Episode]) -> &[Episode], statement: &str) -> Claim {
    let (transferred, scratch) = (median_of(&cases.after_water, part), median_of(&cases.air, part));
    let (seeds, of) = ahead(cases, part);
    let measured =
        format!("median {transferred:.2} against {scratch:.2}; ahead in {seeds} of {of} seeds");
    // More seeds than not must show what the medians do.
    Claim::new(statement, measured, Verdict::of(transferred > scratch && 2 * seeds > of))
}

fn faster(cases: &Cases) -> Claim {
    comparison(
        cases,
        first,
        "After water, the agent learns faster on land (first 1,000 episodes on land)",
    )
}

fn higher(cases: &Cases) -> Claim {
    comparison(cases, last, "After water, the reward on land is higher (last 1,000 episodes)")
}

/// Compares both agents after the same number of episodes, those in water included.
fn counting_water(cases: &Cases) -> Claim {
    let statement = "The transferred agent is ahead even if its episodes in water are counted";
    let water = cases.water.iter().map(Vec::len).min().unwrap_or(0);
    let budget = cases.air.iter().map(Vec::len).min().unwrap_or(0);
    let until = budget.saturating_sub(water);
    let at = |episodes: &[Episode], end: usize| {
        mean_reward(&episodes[end.saturating_sub(END)..end.min(episodes.len())])
    };
    let pairs: Vec<(f64, f64)> = (cases.after_water.iter().zip(&cases.air))
        .map(|(transferred, scratch)| (at(transferred, until), at(scratch, budget)))
        .collect();
    let seeds = pairs.iter().filter(|(a, b)| a > b).count();
    let mut sides = [Vec::new(), Vec::new()];
    for (a, b) in &pairs {
        sides[0].push(*a);
        sides[1].push(*b);
    }
    let [transferred, scratch] = sides.map(|mut side| quartiles(&mut side)[1]);
    let measured = format!(
        "after {budget} episodes in all, {water} of them in water: median {transferred:.2} \
         against {scratch:.2}; ahead in {seeds} of {} seeds",
        pairs.len()
    );
    Claim::new(statement, measured, Verdict::of(transferred > scratch && 2 * seeds > pairs.len()))
}

fn draw(cases: &Cases, theirs: &[Option<Vec<Episode>>; 2]) -> Result<String, FiguresError> {
    let named = [
        ("air after water", &cases.after_water, BLUE),
        ("air alone", &cases.air, ORANGE),
        ("water, before", &cases.water, GREEN),
    ];
    let curves = named.map(|(name, seeds, color)| {
        let curves: Vec<_> = seeds.iter().map(|episodes| smooth(episodes)).collect();
        (name, spread(&curves), color)
    });
    let mut marks = Vec::new();
    for (_, curve, color) in &curves {
        let points = curve.iter().map(|(x, [low, _, high])| (*x, *low, *high)).collect();
        marks.push(Mark::band(points, *color));
    }
    for (name, curve, color) in &curves {
        let points = curve.iter().map(|(x, [_, median, _])| (*x, *median)).collect();
        marks.push(Mark::line(points, *color).label(*name));
    }
    for ((episodes, name), color) in theirs
        .iter()
        .zip(["the authors', air alone", "the authors', air after water"])
        .zip([BLACK, INK])
    {
        if let Some(episodes) = episodes {
            let line = Mark::line(smooth(episodes), color).label(name);
            marks.push(if name.ends_with("alone") { line.dashed() } else { line });
        }
    }
    let points: Vec<Point> = marks.iter().flat_map(Mark::points).collect();
    let longest = cases.air.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let top = points.iter().filter(|(x, _)| *x <= longest).map(|(_, y)| *y);
    let panel = Panel {
        title: String::new(),
        x: Axis::new("episodes of the stage", 0.0..longest),
        y: Axis::around("reward of an episode (at most 5 steps)", top.chain([0.0])),
        marks,
    };
    let note = format!(
        "mean over {WINDOW} episodes; line: median of {} seeds, band: quartiles",
        cases.air.len()
    );
    Ok(Sheet::new("Figure 3. Training reward", note).row(360, vec![panel]).draw()?)
}

fn table(cases: &Cases, theirs: &[Option<Vec<Episode>>; 2]) -> String {
    let mut csv = String::from("case,episode,lower_quartile,median,upper_quartile\n");
    for (name, seeds) in
        [("water", &cases.water), ("air", &cases.air), ("air_after_water", &cases.after_water)]
    {
        let curves: Vec<_> = seeds.iter().map(|episodes| smooth(episodes)).collect();
        for (episode, [low, median, high]) in spread(&curves) {
            let _ = writeln!(csv, "{name},{episode},{low},{median},{high}");
        }
    }
    for (name, episodes) in ["authors_air", "authors_air_after_water"].iter().zip(theirs) {
        for (episode, reward) in episodes.iter().flat_map(|episodes| smooth(episodes)) {
            let _ = writeln!(csv, "{name},{episode},,{reward},");
        }
    }
    csv
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(rewards: [f64; 2]) -> Vec<Episode> {
        let half = |reward| std::iter::repeat_n(Episode { reward, steps: 5 }, 2_000);
        half(rewards[0]).chain(half(rewards[1])).collect()
    }

    fn cases(after_water: [f64; 2], air: [f64; 2]) -> Cases {
        Cases {
            water: vec![run([1.0, 4.0])[..1_000].to_vec(); 3],
            air: vec![run(air); 3],
            after_water: vec![run(after_water); 3],
        }
    }

    #[test]
    fn claims_hold_for_the_agent_that_is_ahead_only() {
        let ahead = cases([2.0, 3.0], [0.5, 2.0]);
        for claim in [faster(&ahead), higher(&ahead), counting_water(&ahead)] {
            assert_eq!(claim.verdict, Verdict::Holds, "{claim:?}");
        }
        let behind = cases([2.0, 2.0], [0.5, 2.5]);
        assert_eq!(faster(&behind).verdict, Verdict::Holds);
        assert_eq!(higher(&behind).verdict, Verdict::Fails);
        assert_eq!(counting_water(&behind).verdict, Verdict::Fails);
        assert!(faster(&behind).measured.contains("2.00 against 0.50; ahead in 3 of 3"));
    }

    #[test]
    fn curves_are_the_quartiles_over_seeds() {
        let curves: Vec<_> = [1.0, 2.0, 3.0, 4.0, 5.0].map(|r| smooth(&run([r, r]))).into();
        let spread = spread(&curves);
        assert_eq!(spread.len(), 4_000 / WINDOW);
        assert_eq!(spread[0], (WINDOW as f64, [2.0, 3.0, 4.0]));
    }
}
