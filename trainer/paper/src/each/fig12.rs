//! Figure 12: the highest speed of the transferred agent in air, over other bodies.

use std::fmt::Write as _;

use leg_control::policy::{GainPoint, GainSchedule};
use leg_plant::Medium;
use rayon::prelude::*;

use crate::agents::{Learnt, Paper};
use crate::picture::{AUTHORS, Axis, COLORS, Mark, Panel, Sheet};
use crate::study::body::{MASS_KG, Plane, STIFFNESS_KN_M};
use crate::study::flown::{authors_actor, identity, other_leg};
use crate::study::learning::quartiles;
use crate::{Claim, Extent, Figure, FiguresError, Made, Verdict, Workshop};
use trainer::environment::LOWEST_APEX_M;
use trainer::evaluate::tracking::{START, highest_speed_of};
use trainer::policy::PackedActor;

/// What the paper reaches, and what its authors' agent does in an independent
/// simulator, m/s.
const PAPER_M_S: f64 = 6.0;
const AUTHORS_M_S: f64 = 5.98;
/// The ramp ends where the leg falls, which a last bit may put off by a step or two, m/s.
const NEAR_M_S: f64 = 0.3;
/// An average human runs at no less, m/s.
const RUNNING_M_S: f64 = 3.0;
/// Points of the lines.
const POINTS: usize = 25;

/// The gains of the published code: an integral term alone.
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
        extent.of(6.0, 1.0) // Beside the trainings of figure 3.
    }

    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError> {
        let transferred = shop.transferred()?;
        let ours = Speeds::of(shop, "speeds-ours", &transferred.shown().actor())?;
        let all = at_home(shop, &transferred.all)?;
        let theirs = authors_actor(shop.reference.as_ref(), "water_to_air")?;
        let theirs = theirs.map(|actor| Speeds::of(shop, "speeds-authors", &actor)).transpose()?;
        let mut measured = format!(
            "Seed {}, which of {} hops on from most starts in water and on land, by a ramp: integral gain 0.02, the speed asked for raised by \
             0.05 m/s every 10 hops until the leg falls. {:.2} m/s at home; over the plane at most \
             {:.2} m/s.",
            transferred.shown().seed,
            transferred.all.len(),
            ours.home,
            ours.highest(),
        );
        if let Some(theirs) = &theirs {
            let _ = write!(
                measured,
                " The authors' agent: {:.2} m/s at home, at most {:.2} m/s.",
                theirs.home,
                theirs.highest()
            );
        }
        let [low, median, high] = quartiles(&mut all.clone());
        let _ = write!(
            measured,
            " Over the seeds, at home: quartiles {low:.2}, {median:.2} and {high:.2} m/s, at most \
             {:.2} m/s.",
            all.iter().copied().fold(0.0, f64::max)
        );
        // What a leg that never elongates can come to: it keeps the energy of the ramp's start.
        let apart_m = START.y_m - LOWEST_APEX_M;
        let kept_m_s = (2.0 * Medium::AIR.gravity_m_s2() * apart_m).sqrt();
        let _ = write!(
            measured,
            " An agent that never elongates its leg keeps the energy of the start, {} m at rest, \
             which is {kept_m_s:.2} m/s at an apex of {LOWEST_APEX_M} m: to be faster it has to \
             elongate.",
            START.y_m
        );
        let each: Vec<Vec<Claim>> = all.iter().map(|v| vec![speed(*v)]).collect();
        let mut claims = Claim::over_seeds(&each, &[speed(ours.home)]);
        if let Some(theirs) = &theirs {
            claims.push(check(theirs.home));
        }
        let csv = table(&ours, theirs.as_ref());
        Ok(Made { svg: draw(&ours, theirs.as_ref())?, csv, measured, claims })
    }
}

/// The highest speed of every seed, with the leg that it was trained on, m/s.
fn at_home(shop: &Workshop, all: &[Learnt]) -> Result<Vec<f64>, FiguresError> {
    let inputs = (Paper::WaterToAir.config_toml(), all.len());
    shop.part("speeds-by-seed", &inputs, shop.extent.of(3.0, 0.2), || {
        let hopper = other_leg(80.0, 20_000.0, Medium::AIR);
        let gains = gains();
        let speed =
            |learnt: &Learnt| highest_speed_of(&learnt.actor().actor(), &gains, 0.0, &hopper);
        Ok(all.par_iter().map(speed).collect())
    })
}

fn speed(home_m_s: f64) -> Claim {
    Claim::new(
        "The transferred agent reaches 6 m/s on land, as an average runner does",
        format!("{home_m_s:.2} m/s"),
        if home_m_s >= PAPER_M_S - NEAR_M_S {
            Verdict::Holds
        } else if home_m_s >= RUNNING_M_S {
            Verdict::InPart
        } else {
            Verdict::Fails
        },
    )
}

fn check(home_m_s: f64) -> Claim {
    Claim::new(
        format!(
            "A check of our plant: the authors' agent reaches {AUTHORS_M_S} m/s in an independent \
             simulator"
        ),
        format!("{home_m_s:.2} m/s; the ramp's end is taken as the same within {NEAR_M_S} m/s"),
        Verdict::of((home_m_s - AUTHORS_M_S).abs() <= NEAR_M_S),
    )
}

/// Highest speeds, m/s.
#[derive(serde::Serialize, serde::Deserialize)]
struct Speeds {
    home: f64,
    /// By stiffness, kN/m, at 80 kg, and by mass, kg, at 20 kN/m.
    lines: [Vec<(f64, f64)>; 2],
    cells: usize,
    plane: Vec<f64>,
}

impl Speeds {
    fn of(shop: &Workshop, name: &str, agent: &PackedActor) -> Result<Self, FiguresError> {
        let extent = shop.extent;
        let cost_s = extent.of(3.0, 0.5);
        shop.part(name, &(identity(agent), extent), cost_s, || Ok(Self::compute(agent, extent)))
    }

    fn compute(agent: &PackedActor, extent: Extent) -> Self {
        let (actor, gains) = (agent.actor(), gains());
        let speed = |mass_kg, stiffness_n_m| {
            let hopper = other_leg(mass_kg, stiffness_n_m, Medium::AIR);
            highest_speed_of(&actor, &gains, 0.0, &hopper)
        };
        let along = |range: &std::ops::Range<f64>| {
            let (low, step) = (range.start, (range.end - range.start) / (POINTS - 1) as f64);
            (0..POINTS).map(move |i| low + step * i as f64)
        };
        let plane = Plane::of(extent);
        Self {
            home: speed(80.0, 20_000.0),
            lines: [
                along(&STIFFNESS_KN_M).map(|k| (k, speed(80.0, 1e3 * k))).collect(),
                along(&MASS_KG).map(|m| (m, speed(m, 20_000.0))).collect(),
            ],
            cells: plane.cells,
            plane: plane.map(Medium::AIR, |hopper| highest_speed_of(&actor, &gains, 0.0, hopper)),
        }
    }

    fn highest(&self) -> f64 {
        self.plane.iter().copied().fold(self.home, f64::max)
    }
}

fn draw(ours: &Speeds, theirs: Option<&Speeds>) -> Result<String, FiguresError> {
    let sets = [("ours", Some(ours)), ("the authors'", theirs)];
    let sets: Vec<(&str, &Speeds)> =
        sets.into_iter().filter_map(|(whose, speeds)| Some((whose, speeds?))).collect();
    let top = sets.iter().map(|(_, speeds)| speeds.highest()).fold(1.0, f64::max);
    let planes = sets.iter().map(|(whose, speeds)| {
        Plane { cells: speeds.cells }.panel(whose, speeds.plane.clone(), 0.0..top, "m/s")
    });
    let line = |index: usize, label: &str| {
        let mut marks = Vec::new();
        for (whose, speeds) in &sets {
            let (points, label) = (speeds.lines[index].clone(), Some((*whose).to_owned()));
            let dashed = *whose != "ours";
            let color = if dashed { AUTHORS } else { COLORS[0] };
            marks.push(Mark::Line { points, color, dashed, label });
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
    let sheet = Sheet {
        title: "Figure 12. Highest speed in air over other bodies".into(),
        note: "a ramp of the speed asked for, until the leg falls".into(),
        rows: vec![
            planes.collect(),
            vec![line(0, "stiffness at 80 kg, kN/m"), line(1, "mass at 20 kN/m, kg")],
        ],
        ..Sheet::default()
    };
    Ok(sheet.draw()?)
}

fn table(ours: &Speeds, theirs: Option<&Speeds>) -> String {
    let mut csv = String::from("whose,mass_kg,stiffness_n_m,highest_speed_m_s\n");
    for (whose, speeds) in [("ours", Some(ours)), ("authors", theirs)] {
        let Some(speeds) = speeds else { continue };
        let _ = writeln!(csv, "{whose},80,20000,{}", speeds.home);
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
