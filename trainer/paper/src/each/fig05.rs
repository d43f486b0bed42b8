//! Figure 5: the reward of stopping in one step, over all actions, from water to air.

use crate::study::landscape::{NEAR_M_S, Objective, Survey, Transition, cost_s, over};
use crate::study::landscape_sheet::sheet;
use crate::{Claim, Extent, Figure, FiguresError, Made, Verdict, Workshop};

/// Landscapes this much correlated are the same but for a little.
const ALIKE: f64 = 0.9;
/// A region of which the largest piece is less than this is in pieces.
const IN_PIECES: f64 = 0.75;
/// A change that is so many times the usual one is a jump.
const JUMP: f64 = 3.0;

pub(super) struct Fig05;

impl Figure for Fig05 {
    fn id(&self) -> &'static str {
        "fig05"
    }

    fn title(&self) -> &'static str {
        "Reward landscape of stopping, from water to air"
    }

    fn paper(&self) -> &'static str {
        "In water the actions with a high reward are many and lie together, which suits gradients; \
         in air they are few and scattered. In between, the landscape changes as smoothly as the \
         density does, from every start, so what was learned in water leads on to land. For one \
         step, the reward hardly depends on the elongation speed."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        cost_s(extent)
    }

    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError> {
        let survey = Survey::of(shop)?;
        let stop = &survey.stop;
        let (svg, csv) = sheet(
            "Figure 5. Reward of stopping in one step",
            shop.extent,
            &Objective::speed(0.0),
            ("stop", stop),
            ("1 m/s, figure 6", &survey.speed),
        )?;
        let claims = vec![dense(stop), together(stop), smooth(stop), by_angle(stop)];
        let measured = format!(
            "{} seeded starts. High is a reward of {:.2}, a speed within {NEAR_M_S} m/s: {:.3} of \
             the plane in water, {:.3} at half the density, {:.3} in air. The reward changes by \
             {:.3} per 0.1 rad in water, by {:.3} in air. From water to air it varies by {:.2} in \
             all, by {:.3} at most in a step of 0.05 of the density ratio.",
            stop.len(),
            Objective::high(),
            over(stop, |t| t.water().high),
            over(stop, |t| t.looks[t.looks.len() / 2].high),
            over(stop, |t| t.air().high),
            over(stop, |t| t.water().slope),
            over(stop, |t| t.air().slope),
            over(stop, Transition::variation),
            over(stop, Transition::jump),
        );
        Ok(Made { svg, csv, measured, claims })
    }
}

fn dense(stop: &[Transition]) -> Claim {
    let (water, air) = (over(stop, |t| t.water().high), over(stop, |t| t.air().high));
    let starts = stop.iter().filter(|t| t.water().high > t.air().high).count();
    let verdict = match water / air {
        ratio if ratio >= 2.0 => Verdict::Holds,
        ratio if ratio > 1.0 => Verdict::InPart,
        _ => Verdict::Fails,
    };
    Claim::new(
        "High rewards are dense in water and sparse in air",
        format!(
            "{water:.3} of all actions in water, {air:.3} in air; more in water from {starts} of \
             {} starts",
            stop.len()
        ),
        verdict,
    )
}

fn together(stop: &[Transition]) -> Claim {
    let whole = [over(stop, |t| t.water().largest), over(stop, |t| t.air().largest)];
    let pieces = [over(stop, |t| t.water().pieces), over(stop, |t| t.air().pieces)];
    let verdict = match (whole[0] >= 0.9, whole[1] < IN_PIECES) {
        (true, true) => Verdict::Holds,
        (false, false) => Verdict::Fails,
        _ => Verdict::InPart,
    };
    Claim::new(
        "They are continuous in water and discrete in air",
        format!(
            "in water {:.2} of them lie in one piece, of {:.1} pieces; in air {:.2}, of {:.1}{}",
            whole[0],
            pieces[0],
            whole[1],
            pieces[1],
            if whole[1] < IN_PIECES { "" } else { ": a thin band, no islands" }
        ),
        verdict,
    )
}

fn smooth(stop: &[Transition]) -> Claim {
    let mean = over(stop, |t| t.variation() / t.changes.len() as f64);
    let jump = over(stop, Transition::jump);
    let least_like = over(stop, Transition::least_like);
    let alike = stop.iter().filter(|t| t.least_like() >= ALIKE).count();
    let verdict = match (jump <= JUMP * mean, least_like >= ALIKE) {
        (true, true) => Verdict::Holds,
        (false, false) => Verdict::Fails,
        _ => Verdict::InPart,
    };
    Claim::new(
        "From water to air the landscape changes smoothly, from every start",
        format!(
            "per 0.05 of the density ratio the reward changes by {mean:.3}, at most by {jump:.3}; \
             the least correlation of neighbours is {least_like:.3}, and at least {ALIKE} from \
             {alike} of {} starts",
            stop.len()
        ),
        verdict,
    )
}

fn by_angle(stop: &[Transition]) -> Claim {
    let shares = [over(stop, |t| t.water().by_angle), over(stop, |t| t.air().by_angle)];
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
    use crate::study::landscape::Look;

    fn look(high: f64, pieces: f64, largest: f64, by_angle: f64) -> Look {
        Look { high, pieces, largest, slope: 0.1, by_angle }
    }

    fn transition(water: Look, air: Look, changes: [f64; 4], likeness: [f64; 4]) -> Transition {
        let looks = vec![water, water, air, air, air];
        let densities = vec![1.0, 0.75, 0.5, 0.25, 0.0];
        Transition { densities, looks, changes: changes.into(), likeness: likeness.into() }
    }

    #[test]
    fn what_the_paper_says_holds_where_it_is_so_and_not_where_it_is_not() {
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
