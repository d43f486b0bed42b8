//! Figure 6: the reward of moving at 1 m/s after one step, from water to air.

use crate::analysis::landscape::{Objective, Survey, Transition, cost_s, mean_over};
use crate::analysis::landscape_charts::draw_with_table;
use crate::{Claim, Extent, Figure, FigureContext, FiguresError, RenderedFigure, Verdict};

pub(super) struct Fig06;

impl Figure for Fig06 {
    fn id(&self) -> &'static str {
        "fig06"
    }

    fn title(&self) -> &'static str {
        "Reward landscape of moving at 1 m/s, from water to air"
    }

    fn paper(&self) -> &'static str {
        "If the reward is for moving at 1 m/s instead of stopping, the landscape changes less \
         smoothly from water to air, although part of what is learned still carries over. Stopping \
         is the objective that suits every medium."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        // Most steps are those of figure 5.
        0.05 * cost_s(extent)
    }

    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError> {
        let survey = Survey::of(ctx)?;
        let (svg, csv) = draw_with_table(
            "Figure 6. Reward of moving at 1 m/s after one step",
            ctx.extent,
            &Objective::speed(1.0),
            ("1 m/s", &survey.speed),
            ("stop, figure 5", &survey.stop),
        )?;
        let high = [|t: &Transition| t.water().high, |t: &Transition| t.air().high];
        let [water, air] = high.map(|high| mean_over(&survey.speed, high));
        let [stop_water, stop_air] = high.map(|high| mean_over(&survey.stop, high));
        let measured = format!(
            "The same {} starts as in figure 5. High rewards: {water:.3} of all actions in water \
             ({stop_water:.3} for stopping), {air:.3} in air ({stop_air:.3}). Three measures decide \
             whether the transition is less smooth: total variation, largest change, and lowest \
             correlation of neighbouring densities. The claim holds if all three agree.",
            survey.speed.len(),
        );
        Ok(RenderedFigure { svg, csv, measured, claims: vec![less_smooth(&survey)] })
    }
}

fn less_smooth(survey: &Survey) -> Claim {
    let pairs = || survey.speed.iter().zip(&survey.stop);
    let both = |number: fn(&Transition) -> f64| {
        [mean_over(&survey.speed, number), mean_over(&survey.stop, number)]
    };
    let variation = both(Transition::variation);
    let max_change = both(Transition::max_change);
    let correlation = both(Transition::min_correlation);
    let rougher = [
        variation[0] > variation[1],
        max_change[0] > max_change[1],
        correlation[0] < correlation[1],
    ];
    let starts = pairs().filter(|(speed, stop)| speed.variation() > stop.variation()).count();
    let less_correlated =
        pairs().filter(|(speed, stop)| speed.min_correlation() < stop.min_correlation()).count();
    let verdict = match rougher.iter().filter(|rougher| **rougher).count() {
        3 => Verdict::Holds,
        0 => Verdict::Fails,
        _ => Verdict::InPart,
    };
    Claim::new(
        "For 1 m/s the transition from water to air is less smooth than for stopping",
        format!(
            "1 m/s against stopping: total variation {:.3} and {:.3} (more from {starts} of {of} \
             starts), largest change {:.3} and {:.3}, lowest correlation of neighbouring densities \
             {:.3} and {:.3} (lower from {less_correlated} of {of})",
            variation[0],
            variation[1],
            max_change[0],
            max_change[1],
            correlation[0],
            correlation[1],
            of = survey.stop.len(),
        ),
        verdict,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::landscape::LandscapeStats;

    fn transition(changes: [f64; 2], correlations: [f64; 2]) -> Transition {
        let look =
            LandscapeStats { high: 0.1, pieces: 1.0, largest: 1.0, slope: 0.1, by_angle: 1.0 };
        Transition {
            densities: vec![1.0, 0.5, 0.0],
            stats: vec![look; 3],
            changes: changes.into(),
            correlations: correlations.into(),
        }
    }

    #[test]
    fn the_claim_holds_only_if_all_three_measures_agree() {
        let (even, rough) =
            (transition([0.1, 0.1], [0.9, 0.9]), transition([0.1, 0.3], [0.9, 0.5]));
        let of = |speed: &Transition, stop: &Transition| {
            less_smooth(&Survey { stop: vec![stop.clone()], speed: vec![speed.clone()] }).verdict
        };
        assert_eq!(of(&rough, &even), Verdict::Holds);
        assert_eq!(of(&even, &rough), Verdict::Fails);
        let once = transition([0.0, 0.15], [0.9, 0.9]);
        assert_eq!(of(&once, &even), Verdict::InPart);
    }
}
