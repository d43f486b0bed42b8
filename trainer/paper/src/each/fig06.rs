//! Figure 6: the reward of going at 1 m/s after one step, from water to air.

use crate::study::landscape::{Objective, Survey, Transition, cost_s, over};
use crate::study::landscape_sheet::sheet;
use crate::{Claim, Extent, Figure, FiguresError, Made, Verdict, Workshop};

pub(super) struct Fig06;

impl Figure for Fig06 {
    fn id(&self) -> &'static str {
        "fig06"
    }

    fn title(&self) -> &'static str {
        "Reward landscape of going at 1 m/s, from water to air"
    }

    fn paper(&self) -> &'static str {
        "With the reward for going at 1 m/s instead of stopping, the landscape changes less \
         smoothly from water to air, though part of what is learned still carries over: stopping \
         is the objective that suits every medium."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        // Mostly found among the parts of figure 5.
        0.05 * cost_s(extent)
    }

    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError> {
        let survey = Survey::of(shop)?;
        let (svg, csv) = sheet(
            "Figure 6. Reward of going at 1 m/s after one step",
            shop.extent,
            &Objective::speed(1.0),
            ("1 m/s", &survey.speed),
            ("stop, figure 5", &survey.stop),
        )?;
        let high = [|t: &Transition| t.water().high, |t: &Transition| t.air().high];
        let [water, air] = high.map(|high| over(&survey.speed, high));
        let [stop_water, stop_air] = high.map(|high| over(&survey.stop, high));
        let measured = format!(
            "The same {} starts as in figure 5. High rewards: {water:.3} of the plane in water \
             ({stop_water:.3} for stopping), {air:.3} in air ({stop_air:.3}). Whether the \
             transition is less smooth is judged by three numbers that agree only if it is: total \
             variation, largest jump, and the correlation of neighbouring densities.",
            survey.speed.len(),
        );
        Ok(Made { svg, csv, measured, claims: vec![less_smooth(&survey)] })
    }
}

fn less_smooth(survey: &Survey) -> Claim {
    let pairs = || survey.speed.iter().zip(&survey.stop);
    let both =
        |number: fn(&Transition) -> f64| [over(&survey.speed, number), over(&survey.stop, number)];
    let variation = both(Transition::variation);
    let jump = both(Transition::jump);
    let alike = both(Transition::least_like);
    let rougher = [variation[0] > variation[1], jump[0] > jump[1], alike[0] < alike[1]];
    let starts = pairs().filter(|(speed, stop)| speed.variation() > stop.variation()).count();
    let less_alike = pairs().filter(|(speed, stop)| speed.least_like() < stop.least_like()).count();
    let verdict = match rougher.iter().filter(|rougher| **rougher).count() {
        3 => Verdict::Holds,
        0 => Verdict::Fails,
        _ => Verdict::InPart,
    };
    Claim::new(
        "For 1 m/s the transition from water to air is less smooth than for stopping",
        format!(
            "1 m/s against stopping: total variation {:.3} and {:.3} (more from {starts} of {of} \
             starts), largest jump {:.3} and {:.3}, least correlation of neighbours {:.3} and \
             {:.3} (less from {less_alike} of {of})",
            variation[0],
            variation[1],
            jump[0],
            jump[1],
            alike[0],
            alike[1],
            of = survey.stop.len(),
        ),
        verdict,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::landscape::Look;

    fn transition(changes: [f64; 2], likeness: [f64; 2]) -> Transition {
        let look = Look { high: 0.1, pieces: 1.0, largest: 1.0, slope: 0.1, by_angle: 1.0 };
        Transition {
            densities: vec![1.0, 0.5, 0.0],
            looks: vec![look; 3],
            changes: changes.into(),
            likeness: likeness.into(),
        }
    }

    #[test]
    fn less_smooth_is_what_varies_more_jumps_higher_and_is_less_alike() {
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
