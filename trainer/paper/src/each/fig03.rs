//! Figure 3: the training reward in water, in air, and in air after water.

use std::fmt::Write as _;

use crate::agents::{Episode, Paper, cost_s};
use crate::picture::{AUTHORS, Axis, COLORS, INK, Mark, Panel, Sheet};
use crate::study::learning::{Cases, WINDOW, authors, mean_reward, quartiles, smooth, spread};
use crate::{Claim, Extent, Figure, FiguresError, Made, Verdict, Workshop};

/// Episodes at either end of a training that are compared.
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
        "Learning to hop from scratch is easy in water and hard on land. An agent that is taken \
         from water to land, with its actor and critic but an empty replay buffer, reaches high \
         rewards much faster than one trained on land alone, and higher ones, even when the \
         episodes in water are counted."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        cost_s(Paper::Air, extent) + cost_s(Paper::WaterToAir, extent)
    }

    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError> {
        let cases = Cases::of(shop)?;
        let reference = shop.reference.as_ref();
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
        Ok(Made { svg: draw(&cases, &theirs)?, csv: table(&cases, &theirs), measured, claims })
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

/// Seeds in which the transferred agent is ahead of the one trained on land alone.
fn ahead(cases: &Cases, part: fn(&[Episode]) -> &[Episode]) -> (usize, usize) {
    let pairs = cases.after_water.iter().zip(&cases.air);
    let ahead = pairs.filter(|(a, b)| mean_reward(part(a)) > mean_reward(part(b))).count();
    (ahead, cases.air.len())
}

fn comparison(cases: &Cases, part: fn(&[Episode]) -> &[Episode], says: &str) -> Claim {
    let (transferred, scratch) = (median_of(&cases.after_water, part), median_of(&cases.air, part));
    let (seeds, of) = ahead(cases, part);
    let measured =
        format!("median {transferred:.2} against {scratch:.2}; ahead in {seeds} of {of} seeds");
    // More seeds than not must show what the medians do.
    Claim::new(says, measured, Verdict::of(transferred > scratch && 2 * seeds > of))
}

fn faster(cases: &Cases) -> Claim {
    comparison(
        cases,
        first,
        "After water, land is learned faster: the first 1,000 episodes on land",
    )
}

fn higher(cases: &Cases) -> Claim {
    comparison(cases, last, "After water, the reward on land is higher: the last 1,000 episodes")
}

/// With the water episodes counted, the agent on land alone has had that many more.
fn counting_water(cases: &Cases) -> Claim {
    let says = "It is ahead also when the episodes in water are counted";
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
    Claim::new(says, measured, Verdict::of(transferred > scratch && 2 * seeds > pairs.len()))
}

fn draw(cases: &Cases, theirs: &[Option<Vec<Episode>>; 2]) -> Result<String, FiguresError> {
    let named = [
        ("air after water", &cases.after_water, COLORS[0], 0),
        ("air alone", &cases.air, COLORS[1], 0),
        ("water, before", &cases.water, COLORS[2], 0),
    ];
    let curves = named.map(|(name, seeds, color, _)| {
        let curves: Vec<_> = seeds.iter().map(|episodes| smooth(episodes)).collect();
        (name, spread(&curves), color)
    });
    let mut marks = Vec::new();
    for (_, curve, color) in &curves {
        let points = curve.iter().map(|(x, [low, _, high])| (*x, *low, *high)).collect();
        marks.push(Mark::Band { points, color: *color });
    }
    for (name, curve, color) in &curves {
        let points = curve.iter().map(|(x, [_, median, _])| (*x, *median)).collect();
        marks.push(Mark::line(points, *color, *name));
    }
    for ((episodes, name), color) in theirs
        .iter()
        .zip(["the authors', air alone", "the authors', air after water"])
        .zip([AUTHORS, INK])
    {
        if let Some(episodes) = episodes {
            let (points, label) = (smooth(episodes), Some(name.to_owned()));
            marks.push(Mark::Line { points, color, dashed: name.ends_with("alone"), label });
        }
    }
    let ends = marks.iter().flat_map(|mark| match mark {
        Mark::Line { points, .. } => points.clone(),
        Mark::Band { points, .. } => points.iter().map(|(x, _, high)| (*x, *high)).collect(),
        _ => Vec::new(),
    });
    let ends: Vec<(f64, f64)> = ends.collect();
    let longest = cases.air.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let top = ends.iter().filter(|(x, _)| *x <= longest).map(|(_, y)| *y);
    let panel = Panel {
        title: String::new(),
        x: Axis::new("episodes of the stage", 0.0..longest),
        y: Axis::around("reward of an episode (at most 5 steps)", top.chain([0.0])),
        marks,
    };
    let sheet = Sheet {
        title: "Figure 3. Training reward".into(),
        note: format!(
            "mean over {WINDOW} episodes; line: median of {} seeds, band: quartiles",
            cases.air.len()
        ),
        rows: vec![vec![panel]],
        row_px: 420,
    };
    Ok(sheet.draw()?)
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
    fn what_is_ahead_is_said_to_be_and_what_is_behind_is_not() {
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
    fn the_curves_are_the_seeds_quartiles() {
        let curves: Vec<_> = [1.0, 2.0, 3.0, 4.0, 5.0].map(|r| smooth(&run([r, r]))).into();
        let spread = spread(&curves);
        assert_eq!(spread.len(), 4_000 / WINDOW);
        assert_eq!(spread[0], (WINDOW as f64, [2.0, 3.0, 4.0]));
    }
}
