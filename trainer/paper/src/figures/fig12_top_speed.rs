//! Figure 12: the highest speed of the transferred agent in air with other bodies.

use std::fmt::Write as _;

use leg_control::policy::{GainPoint, GainSchedule};
use leg_plant::Medium;
use rayon::prelude::*;

use crate::agents::{CHOICE, PaperAgent, TrainedAgent};
use crate::analysis::apex_run::{authors_actor, identity, leg_with};
use crate::analysis::bodies::{MASS_KG, Plane, STIFFNESS_KN_M};
use crate::analysis::learning_curves::quartiles;
use crate::{Claim, Extent, Figure, FigureContext, FiguresError, RenderedFigure, Verdict};
use leg_charts::color::{BLACK, BLUE};
use leg_charts::{Axis, Mark, Panel, Sheet};
use trainer::environment::LOWEST_APEX_M;
use trainer::evaluate::tracking::{START, highest_speed_of};
use trainer::policy::PackedActor;

/// Speed in the paper, and speed of the authors' agent in an independent simulator, m/s.
const PAPER_M_S: f64 = 6.0;
const AUTHORS_M_S: f64 = 5.98;
/// Speeds within this are equal, m/s: a rounding error may end the ramp a step earlier or
/// later.
const NEAR_M_S: f64 = 0.3;
/// Speed of a running human, at least, m/s.
const RUNNING_M_S: f64 = 3.0;
/// Number of points of a line.
const POINTS: usize = 25;

/// Returns the gains of the published code: an integral term only.
pub(super) fn gains() -> GainSchedule {
    let point = GainPoint { ki: 0.02, limit_m_s: 10.0, ..GainPoint::default() };
    [point].into_iter().collect()
}

pub(super) struct Fig12;

impl Figure for Fig12 {
    fn id(&self) -> &'static str {
        "fig12"
    }

    fn title(&self) -> &'static str {
        "Highest speed in air over mass and stiffness"
    }

    fn paper(&self) -> &'static str {
        "The highest speed that the transferred agent reaches on land before it falls, over mass \
         and stiffness: up to 6 m/s, comparable to the speed of a running human."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        extent.of(6.0, 1.0) // Without the trainings of figure 3.
    }

    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError> {
        let transferred = ctx.transferred()?;
        let ours = TopSpeeds::of(ctx, "speeds-ours", &transferred.shown().actor())?;
        let all = with_trained_body(ctx, &transferred.all)?;
        let theirs = authors_actor(ctx.reference.as_ref(), "water_to_air")?;
        let theirs =
            theirs.map(|actor| TopSpeeds::of(ctx, "speeds-authors", &actor)).transpose()?;
        let mut measured = format!(
            "Seed {} of {}, {CHOICE}. A ramp with an integral gain of 0.02 raises the set-point by \
             0.05 m/s every 10 hops until the leg falls. The highest speed is {:.2} m/s with the \
             trained body, and {:.2} m/s over all bodies.",
            transferred.shown().seed,
            transferred.all.len(),
            ours.trained_body,
            ours.highest(),
        );
        if let Some(theirs) = &theirs {
            let _ = write!(
                measured,
                " The authors' agent: {:.2} m/s with the trained body, {:.2} m/s over all bodies.",
                theirs.trained_body,
                theirs.highest()
            );
        }
        let [low, median, high] = quartiles(&mut all.clone());
        let _ = write!(
            measured,
            " Over all seeds, with the trained body: quartiles {low:.2}, {median:.2} and {high:.2} m/s, \
             highest {:.2} m/s.",
            all.iter().copied().fold(0.0, f64::max)
        );
        // The speed of a leg that never elongates: it keeps the energy of the ramp's start.
        let apart_m = START.y_m - LOWEST_APEX_M;
        let kept_m_s = (2.0 * Medium::AIR.gravity_m_s2() * apart_m).sqrt();
        let _ = write!(
            measured,
            " An agent that never elongates its leg keeps the energy of the start at rest at {} m, \
             which is {kept_m_s:.2} m/s at an apex of {LOWEST_APEX_M} m. It has to elongate the leg \
             to be faster.",
            START.y_m
        );
        let by_seed: Vec<Vec<Claim>> = all.iter().map(|v| vec![speed(*v)]).collect();
        let mut claims = Claim::over_seeds(&by_seed, &[speed(ours.trained_body)]);
        if let Some(theirs) = &theirs {
            claims.push(check(theirs.trained_body));
        }
        let csv = table(&ours, theirs.as_ref());
        Ok(RenderedFigure { svg: draw(&ours, theirs.as_ref())?, csv, measured, claims })
    }
}

/// Computes the highest speed of every seed with the trained body, m/s.
fn with_trained_body(ctx: &FigureContext, all: &[TrainedAgent]) -> Result<Vec<f64>, FiguresError> {
    let inputs = (PaperAgent::WaterToAir.config_toml(), all.len());
    ctx.cached("speeds-by-seed", &inputs, ctx.extent.of(3.0, 0.2), || {
        let hopper = leg_with(80.0, 20_000.0, Medium::AIR);
        let gains = gains();
        let speed =
            |agent: &TrainedAgent| highest_speed_of(&agent.actor().actor(), &gains, 0.0, &hopper);
        Ok(all.par_iter().map(speed).collect())
    })
}

fn speed(speed_m_s: f64) -> Claim {
    Claim::new(
        "The transferred agent reaches 6 m/s on land, as an average runner does",
        format!("{speed_m_s:.2} m/s"),
        if speed_m_s >= PAPER_M_S - NEAR_M_S {
            Verdict::Holds
        } else if speed_m_s >= RUNNING_M_S {
            Verdict::InPart
        } else {
            Verdict::Fails
        },
    )
}

fn check(speed_m_s: f64) -> Claim {
    Claim::new(
        format!(
            "A check of our plant: in an independent simulator, the authors' agent reaches \
             {AUTHORS_M_S} m/s"
        ),
        format!("{speed_m_s:.2} m/s; speeds within {NEAR_M_S} m/s count as equal"),
        Verdict::of((speed_m_s - AUTHORS_M_S).abs() <= NEAR_M_S),
    )
}

/// Highest speeds, m/s.
#[derive(serde::Serialize, serde::Deserialize)]
struct TopSpeeds {
    /// With the body that was trained.
    trained_body: f64,
    /// Speeds by stiffness, kN/m, at 80 kg, and by mass, kg, at 20 kN/m.
    lines: [Vec<(f64, f64)>; 2],
    cells: usize,
    plane: Vec<f64>,
}

impl TopSpeeds {
    fn of(ctx: &FigureContext, name: &str, agent: &PackedActor) -> Result<Self, FiguresError> {
        let extent = ctx.extent;
        let cost_s = extent.of(3.0, 0.5);
        ctx.cached(name, &(identity(agent), extent), cost_s, || Ok(Self::compute(agent, extent)))
    }

    fn compute(agent: &PackedActor, extent: Extent) -> Self {
        let (actor, gains) = (agent.actor(), gains());
        let speed = |mass_kg, stiffness_n_m| {
            let hopper = leg_with(mass_kg, stiffness_n_m, Medium::AIR);
            highest_speed_of(&actor, &gains, 0.0, &hopper)
        };
        let along = |range: &std::ops::Range<f64>| {
            let (low, step) = (range.start, (range.end - range.start) / (POINTS - 1) as f64);
            (0..POINTS).map(move |i| low + step * i as f64)
        };
        let plane = Plane::of(extent);
        Self {
            trained_body: speed(80.0, 20_000.0),
            lines: [
                along(&STIFFNESS_KN_M).map(|k| (k, speed(80.0, 1e3 * k))).collect(),
                along(&MASS_KG).map(|m| (m, speed(m, 20_000.0))).collect(),
            ],
            cells: plane.cells,
            plane: plane.map(Medium::AIR, |hopper| highest_speed_of(&actor, &gains, 0.0, hopper)),
        }
    }

    fn highest(&self) -> f64 {
        self.plane.iter().copied().fold(self.trained_body, f64::max)
    }
}

fn draw(ours: &TopSpeeds, theirs: Option<&TopSpeeds>) -> Result<String, FiguresError> {
    let sets = [("ours", Some(ours)), ("the authors'", theirs)];
    let sets: Vec<(&str, &TopSpeeds)> =
        sets.into_iter().filter_map(|(whose, speeds)| Some((whose, speeds?))).collect();
    let top = sets.iter().map(|(_, speeds)| speeds.highest()).fold(1.0, f64::max);
    let planes = sets.iter().map(|(whose, speeds)| {
        Plane { cells: speeds.cells }.panel(whose, speeds.plane.clone(), 0.0..top, "m/s")
    });
    let line = |index: usize, label: &str| {
        let mut marks = Vec::new();
        for (whose, speeds) in &sets {
            let line = |color| Mark::line(speeds.lines[index].clone(), color).label(*whose);
            marks.push(if *whose == "ours" { line(BLUE) } else { line(BLACK).dashed() });
        }
        let all = sets.iter().flat_map(|(_, speeds)| &speeds.lines[index]);
        let (x, y): (Vec<f64>, Vec<f64>) = all.copied().unzip();
        Panel {
            title: String::new(),
            x: Axis::around(label, x),
            y: Axis::around("highest speed, m/s", y.into_iter().chain([0.0])),
            marks,
        }
    };
    let title = "Figure 12. Highest speed in air over other bodies";
    let note = "the set-point rises until the leg falls";
    let lines = vec![line(0, "stiffness at 80 kg, kN/m"), line(1, "mass at 20 kN/m, kg")];
    Ok(Sheet::new(title, note).rows(226, vec![planes.collect(), lines]).draw()?)
}

fn table(ours: &TopSpeeds, theirs: Option<&TopSpeeds>) -> String {
    let mut csv = String::from("whose,mass_kg,stiffness_n_m,highest_speed_m_s\n");
    for (whose, speeds) in [("ours", Some(ours)), ("authors", theirs)] {
        let Some(speeds) = speeds else { continue };
        let _ = writeln!(csv, "{whose},80,20000,{}", speeds.trained_body);
        let springs = speeds.lines[0].iter().map(|(k, v)| ([80.0, 1e3 * k], *v));
        let masses = speeds.lines[1].iter().map(|(m, v)| ([*m, 20_000.0], *v));
        let plane = Plane { cells: speeds.cells }.bodies();
        let plane = plane.into_iter().zip(speeds.plane.iter().copied());
        for ([mass, stiffness], v) in springs.chain(masses).chain(plane) {
            let _ = writeln!(csv, "{whose},{mass},{stiffness},{v}");
        }
    }
    csv
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_claims_follow_the_speeds() {
        let verdicts = [6.1, 4.0, 0.7].map(|v| speed(v).verdict);
        assert_eq!(verdicts, [Verdict::Holds, Verdict::InPart, Verdict::Fails]);
        assert_eq!(check(5.98).verdict, Verdict::Holds);
        assert_eq!(check(5.3).verdict, Verdict::Fails);
    }
}
