//! Figure 4: steps in each of the first 1,000 episodes.

use std::fmt::Write as _;

use crate::agents::Episode;
use crate::picture::{AUTHORS, Axis, COLORS, Mark, Panel, Sheet};
use crate::study::learning::{Cases, authors, full_share, quartiles};
use crate::{Claim, Extent, Figure, FiguresError, Made, Verdict, Workshop};

/// Episodes that are counted.
const EPISODES: usize = 1_000;
/// Steps of a full episode.
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
        "An episode has at most 5 steps; fewer mean a fall. Trained on land alone, most of the \
         first 1,000 episodes end at the first step. The agent that comes from water falls less \
         from the start, which matters where falling costs more than it does in water."
    }

    fn cost_s(&self, _extent: Extent) -> f64 {
        0.1 // It is drawn from the trainings of figure 3.
    }

    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError> {
        let cases = Cases::of(shop)?;
        let reference = shop.reference.as_ref();
        let theirs = [authors(reference, "air")?, authors(reference, "water_to_air")?];
        let named = [
            ("water", &cases.water, None),
            ("air alone", &cases.air, theirs[0].as_ref()),
            ("air after water", &cases.after_water, theirs[1].as_ref()),
        ];
        let rows = named.map(|(name, seeds, theirs)| {
            let shares: Vec<[f64; 5]> = seeds.iter().map(|episodes| shares(episodes)).collect();
            (name, median(&shares), theirs.map(|episodes| shares_of_first(episodes)))
        });
        let mut csv = String::from("case,steps,share_median,share_authors\n");
        for (name, ours, theirs) in &rows {
            for (i, share) in ours.iter().enumerate() {
                let theirs = theirs.map(|t| t[i].to_string()).unwrap_or_default();
                let _ = writeln!(csv, "{},{},{share},{theirs}", name.replace(' ', "_"), i + 1);
            }
        }
        let measured = format!(
            "Share of the first {EPISODES} episodes that were full, median over {} seeds: {:.2} in \
             water, {:.2} in air after water, {:.2} in air alone; that ended at their first step: \
             {:.2}, {:.2}, {:.2}.",
            cases.air.len(),
            rows[0].1[4],
            rows[2].1[4],
            rows[1].1[4],
            rows[0].1[0],
            rows[2].1[0],
            rows[1].1[0],
        );
        let claims = vec![fewer_falls(&cases), most_end_at_once(rows[1].1[0])];
        Ok(Made { svg: draw(&rows)?, csv, measured, claims })
    }
}

type Row<'a> = (&'a str, [f64; 5], Option<[f64; 5]>);

fn shares(episodes: &[Episode]) -> [f64; 5] {
    shares_of_first(&episodes[..EPISODES.min(episodes.len())])
}

/// Share of the first episodes with 1 to 5 steps.
fn shares_of_first(episodes: &[Episode]) -> [f64; 5] {
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
            "full episodes {transferred:.2} against {scratch:.2} (medians); more in {seeds} of {} seeds",
            pairs.len()
        ),
        Verdict::of(transferred > scratch && 2 * seeds > pairs.len()),
    )
}

fn most_end_at_once(share: f64) -> Claim {
    Claim::new(
        "On land alone, a massive number of episodes end at the first step",
        format!("{share:.2} of the first {EPISODES} episodes, median over seeds"),
        Verdict::of(share > 0.3),
    )
}

fn draw(rows: &[Row<'_>; 3]) -> Result<String, FiguresError> {
    let panels =
        rows.iter().zip([COLORS[2], COLORS[1], COLORS[0]]).map(|((name, ours, theirs), color)| {
            let bars = |shares: &[f64; 5], from: f64, to: f64| {
                let bar = |(i, share): (usize, &f64)| {
                    ((i + 1) as f64 + from, (i + 1) as f64 + to, *share)
                };
                shares.iter().enumerate().map(bar).collect()
            };
            let mut marks = vec![Mark::Bars {
                bars: bars(ours, -0.38, 0.0),
                color,
                label: Some("ours, median".into()),
            }];
            if let Some(theirs) = theirs {
                let label = Some("the authors'".to_owned());
                marks.push(Mark::Bars { bars: bars(theirs, 0.02, 0.38), color: AUTHORS, label });
            }
            Panel {
                title: (*name).to_owned(),
                x: Axis::new("steps in an episode", 0.5..5.5),
                y: Axis::new("share of episodes", 0.0..1.0),
                marks,
            }
        });
    let sheet = Sheet {
        title: "Figure 4. Steps in each of the first 1,000 episodes".into(),
        rows: vec![panels.collect()],
        ..Sheet::default()
    };
    Ok(sheet.draw()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(steps: [u32; 4]) -> Vec<Episode> {
        steps.iter().map(|&steps| Episode { reward: 1.0, steps }).collect()
    }

    #[test]
    fn shares_are_counted_by_steps() {
        assert_eq!(shares(&run([1, 1, 5, 3])), [0.5, 0.0, 0.25, 0.0, 0.25]);
    }

    #[test]
    fn fewer_falls_are_claimed_only_where_they_are() {
        let cases = |air, after_water| Cases {
            water: vec![run([5; 4])],
            air: vec![run(air)],
            after_water: vec![run(after_water)],
        };
        assert_eq!(fewer_falls(&cases([1, 1, 5, 5], [5, 5, 5, 1])).verdict, Verdict::Holds);
        assert_eq!(fewer_falls(&cases([5, 5, 5, 5], [5, 5, 5, 1])).verdict, Verdict::Fails);
    }
}
