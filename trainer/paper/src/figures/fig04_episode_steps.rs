//! Figure 4: number of steps in each of the first 1,000 episodes.

use std::fmt::Write as _;

use crate::agents::Episode;
use crate::analysis::learning_curves::{Cases, authors, full_share, quartiles};
use crate::{Claim, Extent, Figure, FigureContext, FiguresError, RenderedFigure, Verdict};
use leg_charts::color::{BLACK, BLUE, GREEN, ORANGE};
use leg_charts::{Axis, Mark, Panel, Sheet};

/// Number of episodes that are counted.
const EPISODES: usize = 1_000;
/// Number of steps of a full episode.
const FULL: u32 = 5;

pub(super) struct Fig04;

impl Figure for Fig04 {
    fn id(&self) -> &'static str {
        "fig04"
    }

    fn title(&self) -> &'static str {
        "Steps per episode in the first 1,000 episodes"
    }

    fn paper(&self) -> &'static str {
        "An episode has at most 5 steps; fewer steps mean a fall. If the agent is trained on land \
         only, most of the first 1,000 episodes end at the first step. The agent that was trained \
         in water before falls less from the start, which matters because a fall on land costs \
         more than a fall in water."
    }

    fn cost_s(&self, _extent: Extent) -> f64 {
        0.1 // The trainings are those of figure 3.
    }

    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError> {
        let cases = Cases::of(ctx)?;
        let reference = ctx.reference.as_ref();
        let theirs = [authors(reference, "air")?, authors(reference, "water_to_air")?];
        let named = [
            ("water", &cases.water, None),
            ("air alone", &cases.air, theirs[0].as_ref()),
            ("air after water", &cases.after_water, theirs[1].as_ref()),
        ];
        let rows = named.map(|(name, seeds, theirs)| {
            let ours: Vec<[f64; 5]> = seeds.iter().map(|episodes| shares(episodes)).collect();
            (name, median(&ours), theirs.map(|episodes| shares(episodes)))
        });
        let mut csv = String::from("case,steps,share_median,share_authors\n");
        for (name, ours, theirs) in &rows {
            for (i, share) in ours.iter().enumerate() {
                let theirs = theirs.map(|t| t[i].to_string()).unwrap_or_default();
                let _ = writeln!(csv, "{},{},{share},{theirs}", name.replace(' ', "_"), i + 1);
            }
        }
        let measured = format!(
            "Share of full episodes among the first {EPISODES}, median over {} seeds: {:.2} in water, \
             {:.2} in air after water, {:.2} in air only. Share of episodes that ended at the first \
             step: {:.2}, {:.2}, {:.2}.",
            cases.air.len(),
            rows[0].1[4],
            rows[2].1[4],
            rows[1].1[4],
            rows[0].1[0],
            rows[2].1[0],
            rows[1].1[0],
        );
        let claims = vec![fewer_falls(&cases), most_end_at_once(rows[1].1[0])];
        Ok(RenderedFigure { svg: draw(&rows)?, csv, measured, claims })
    }
}

type Row<'a> = (&'a str, [f64; 5], Option<[f64; 5]>);

/// Returns the shares of the first episodes with 1 to 5 steps.
fn shares(episodes: &[Episode]) -> [f64; 5] {
    let first = &episodes[..EPISODES.min(episodes.len())];
    let count = |steps: usize| first.iter().filter(|e| e.steps as usize == steps).count();
    std::array::from_fn(|i| count(i + 1) as f64 / first.len().max(1) as f64)
}

fn median(seeds: &[[f64; 5]]) -> [f64; 5] {
    std::array::from_fn(|i| {
        quartiles(&mut seeds.iter().map(|shares| shares[i]).collect::<Vec<_>>())[1]
    })
}

fn fewer_falls(cases: &Cases) -> Claim {
    let first =
        |episodes: &Vec<Episode>| full_share(&episodes[..EPISODES.min(episodes.len())], FULL);
    let pairs: Vec<(f64, f64)> = cases
        .after_water
        .iter()
        .zip(&cases.air)
        .map(|(transferred, scratch)| (first(transferred), first(scratch)))
        .collect();
    let seeds = pairs.iter().filter(|(a, b)| a > b).count();
    let [transferred, scratch] = [0, 1].map(|side| {
        let share = |pair: &(f64, f64)| if side == 0 { pair.0 } else { pair.1 };
        quartiles(&mut pairs.iter().map(share).collect::<Vec<_>>())[1]
    });
    Claim::new(
        "The transferred agent falls less in its first 1,000 episodes on land",
        format!(
            "share of full episodes {transferred:.2} against {scratch:.2} (medians); higher in {seeds} of \
             {} seeds",
            pairs.len()
        ),
        Verdict::of(transferred > scratch && 2 * seeds > pairs.len()),
    )
}

fn most_end_at_once(share: f64) -> Claim {
    Claim::new(
        "Trained on land only, a large share of episodes ends at the first step",
        format!("{share:.2} of the first {EPISODES} episodes, median over seeds"),
        Verdict::of(share > 0.3),
    )
}

fn draw(rows: &[Row<'_>; 3]) -> Result<String, FiguresError> {
    let panels = rows.iter().zip([GREEN, ORANGE, BLUE]).map(|((name, ours, theirs), color)| {
        let bars = |shares: &[f64; 5], from: f64, to: f64| {
            let bar =
                |(i, share): (usize, &f64)| ((i + 1) as f64 + from, (i + 1) as f64 + to, *share);
            shares.iter().enumerate().map(bar).collect()
        };
        let x = Axis::new("steps in an episode", 0.5..5.5);
        let y = Axis::new("share of episodes", 0.0..1.0);
        let panel = Panel::new(*name, x, y).with(
            Mark::bars(bars(ours, -0.38, 0.0), color.with_opacity(0.75)).label("ours, median"),
        );
        let Some(theirs) = theirs else { return panel };
        let theirs = Mark::bars(bars(theirs, 0.02, 0.38), BLACK.with_opacity(0.75));
        panel.with(theirs.label("the authors'"))
    });
    let title = "Figure 4. Steps in each of the first 1,000 episodes";
    Ok(Sheet::new(title, "").row(230, panels.collect()).draw()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(steps: [u32; 4]) -> Vec<Episode> {
        steps.iter().map(|&steps| Episode { reward: 1.0, steps }).collect()
    }

    #[test]
    fn counts_episodes_by_their_steps() {
        assert_eq!(shares(&run([1, 1, 5, 3])), [0.5, 0.0, 0.25, 0.0, 0.25]);
    }

    #[test]
    fn the_claim_of_fewer_falls_holds_only_if_there_are_fewer() {
        let cases = |air, after_water| Cases {
            water: vec![run([5; 4])],
            air: vec![run(air)],
            after_water: vec![run(after_water)],
        };
        assert_eq!(fewer_falls(&cases([1, 1, 5, 5], [5, 5, 5, 1])).verdict, Verdict::Holds);
        assert_eq!(fewer_falls(&cases([5, 5, 5, 5], [5, 5, 5, 1])).verdict, Verdict::Fails);
    }
}
