//! Figure 5: the reward of stopping in one step, over all actions, from water to air.

use crate::analysis::landscape::{NEAR_M_S, Objective, Survey, Transition, cost_s, mean_over};
use crate::analysis::landscape_charts::draw_with_table;
use crate::{Claim, Extent, Figure, FigureContext, FiguresError, RenderedFigure, Verdict};

/// Landscapes with at least this correlation count as alike.
const ALIKE: f64 = 0.9;
/// A region counts as scattered if its largest piece has less than this share of it.
const CONNECTED: f64 = 0.75;
/// Changes of up to this many times the mean change count as smooth.
const SMOOTH: f64 = 3.0;

pub(super) struct Fig05;

impl Figure for Fig05 {
    fn id(&self) -> &'static str {
        "fig05"
    }

    fn title(&self) -> &'static str {
        "Reward landscape of stopping, from water to air"
    }

    fn paper(&self) -> &'static str {
        "In water, many actions have a high reward, and they lie together, which suits gradient \
         methods. In air they are few and scattered. In between, the landscape changes as smoothly \
         as the density, from every start; what the agent learned in water is therefore useful on \
         land. For one step, the reward hardly depends on the elongation speed."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        cost_s(extent)
    }

    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError> {
        let survey = Survey::of(ctx)?;
        let stop = &survey.stop;
        let (svg, csv) = draw_with_table(
            "Figure 5. Reward of stopping in one step",
            ctx.extent,
            &Objective::speed(0.0),
            ("stop", stop),
            ("1 m/s, figure 6", &survey.speed),
        )?;
        let claims = vec![dense(stop), together(stop), smooth(stop), by_angle(stop)];
        let measured = format!(
            "{} starts. A reward of {:.2}, that is a speed within {NEAR_M_S} m/s, counts as high: \
             {:.3} of all actions in water, {:.3} at half the density, {:.3} in air. The reward \
             changes by {:.3} per 0.1 rad in water and by {:.3} in air. From water to air its total \
             variation is {:.2}; its largest change is {:.3} per 0.05 of the density ratio.",
            stop.len(),
            Objective::high(),
            mean_over(stop, |t| t.water().high),
            mean_over(stop, |t| t.stats[t.stats.len() / 2].high),
            mean_over(stop, |t| t.air().high),
            mean_over(stop, |t| t.water().slope),
            mean_over(stop, |t| t.air().slope),
            mean_over(stop, Transition::variation),
            mean_over(stop, Transition::max_change),
        );
        Ok(RenderedFigure { svg, csv, measured, claims })
    }
}

fn dense(stop: &[Transition]) -> Claim {
    let (water, air) = (mean_over(stop, |t| t.water().high), mean_over(stop, |t| t.air().high));
    let starts = stop.iter().filter(|t| t.water().high > t.air().high).count();
    let verdict = match water / air {
        ratio if ratio >= 2.0 => Verdict::Holds,
        ratio if ratio > 1.0 => Verdict::InPart,
        _ => Verdict::Fails,
    };
    Claim::new(
        "High rewards are dense in water and sparse in air",
        format!(
            "{water:.3} of all actions in water, {air:.3} in air; more in water from {starts} of {} \
             starts",
            stop.len()
        ),
        verdict,
    )
}

fn together(stop: &[Transition]) -> Claim {
    let whole = [mean_over(stop, |t| t.water().largest), mean_over(stop, |t| t.air().largest)];
    let pieces = [mean_over(stop, |t| t.water().pieces), mean_over(stop, |t| t.air().pieces)];
    let verdict = match (whole[0] >= 0.9, whole[1] < CONNECTED) {
        (true, true) => Verdict::Holds,
        (false, false) => Verdict::Fails,
        _ => Verdict::InPart,
    };
    Claim::new(
        "High rewards form one region in water and scattered regions in air",
        format!(
            "in water the largest of {:.1} pieces holds {:.2} of them; in air the largest of {:.1} \
             holds {:.2}{}",
            pieces[0],
            whole[0],
            pieces[1],
            whole[1],
            if whole[1] < CONNECTED { "" } else { ", a thin band without islands" }
        ),
        verdict,
    )
}

fn smooth(stop: &[Transition]) -> Claim {
    let mean = mean_over(stop, |t| t.variation() / t.changes.len() as f64);
    let max_change = mean_over(stop, Transition::max_change);
    let min_correlation = mean_over(stop, Transition::min_correlation);
    let alike = stop.iter().filter(|t| t.min_correlation() >= ALIKE).count();
    let verdict = match (max_change <= SMOOTH * mean, min_correlation >= ALIKE) {
        (true, true) => Verdict::Holds,
        (false, false) => Verdict::Fails,
        _ => Verdict::InPart,
    };
    Claim::new(
        "From water to air the landscape changes smoothly, from every start",
        format!(
            "per 0.05 of the density ratio the reward changes by {mean:.3}, at most by {max_change:.3}; \
             the lowest correlation of neighbouring densities is {min_correlation:.3}, and at least {ALIKE} from \
             {alike} of {} starts",
            stop.len()
        ),
        verdict,
    )
}

fn by_angle(stop: &[Transition]) -> Claim {
    let shares = [mean_over(stop, |t| t.water().by_angle), mean_over(stop, |t| t.air().by_angle)];
    let verdict = match shares.iter().filter(|share| **share >= 0.9).count() {
        2 => Verdict::Holds,
        1 => Verdict::InPart,
        _ if shares.iter().all(|share| *share >= 0.5) => Verdict::InPart,
        _ => Verdict::Fails,
    };
    Claim::new(
        "In one step the reward hardly depends on the elongation speed",
        format!(
            "of its variance over all actions the angle alone explains {:.2} in water and {:.2} in \
             air",
            shares[0], shares[1]
        ),
        verdict,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::landscape::LandscapeStats;

    fn look(high: f64, pieces: f64, largest: f64, by_angle: f64) -> LandscapeStats {
        LandscapeStats { high, pieces, largest, slope: 0.1, by_angle }
    }

    fn transition(
        water: LandscapeStats,
        air: LandscapeStats,
        changes: [f64; 4],
        correlations: [f64; 4],
    ) -> Transition {
        let stats = vec![water, water, air, air, air];
        let densities = vec![1.0, 0.75, 0.5, 0.25, 0.0];
        Transition { densities, stats, changes: changes.into(), correlations: correlations.into() }
    }

    #[test]
    fn claims_hold_for_a_transition_as_the_paper_describes_it_and_fail_for_its_reverse() {
        let so = transition(
            look(0.4, 1.0, 1.0, 0.95),
            look(0.1, 3.0, 0.6, 0.95),
            [0.1, 0.1, 0.1, 0.12],
            [0.99; 4],
        );
        for claim in [dense, together, smooth, by_angle] {
            let claim = claim(std::slice::from_ref(&so));
            assert_eq!(claim.verdict, Verdict::Holds, "{claim:?}");
        }
        let reverse = transition(
            look(0.1, 3.0, 0.6, 0.2),
            look(0.4, 1.0, 1.0, 0.3),
            [0.01, 0.01, 0.01, 0.5],
            [0.99, 0.99, 0.99, 0.2],
        );
        for claim in [dense, together, smooth, by_angle] {
            assert_eq!(claim(std::slice::from_ref(&reverse)).verdict, Verdict::Fails);
        }
        assert!(smooth(&[reverse]).measured.contains("0 of 1 starts"));
    }
}
