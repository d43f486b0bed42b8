//! Figure 7: states and actions at the apexes in water, in air, and in air after water.

use std::fmt::Write as _;

use leg_control::actor::Actor;
use leg_plant::Apex;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::agents::{Learnt, Paper, from, seeds};
use crate::picture::{AUTHORS, Axis, COLORS, Mark, Panel, Sheet};
use crate::study::flown::{Flown, START, authors_actor, fly};
use crate::study::learning::quartiles;
use crate::{Claim, Extent, Figure, FiguresError, Made, Verdict, Workshop};
use trainer::evaluate::hopper;
use trainer::evaluate::survival::draw_starts;
use trainer::policy::PackedActor;
use trainer::preset::{ACTION_HIGH, ACTION_LOW};

/// Hops that are drawn.
const DRAWN: usize = 30;
/// Velocities that are drawn, m/s: a run that flees must not flatten the others.
const DRAWN_M_S: f64 = 4.5;
/// Hops that are flown from each of many starts, to see what they settle to.
const HOPS: usize = 60;
/// A run has survived after this many, as in the paper's figure 11.
const SURVIVED: usize = 30;
/// What "near zero" is taken for, m/s: the authors' own agents end at 0.2.
const NEAR_M_S: f64 = 0.25;
/// What "a few steps" is taken for.
const FEW: f64 = 10.0;
/// Apex velocities that differ by less are the same, m/s.
const SAME_M_S: f64 = 1e-3;
/// Longest cycle that is looked for.
const LONGEST_CYCLE: usize = 8;
/// Starts beside [`START`] that are drawn.
const OTHERS: [Apex; 3] = [
    Apex { vx_m_s: -2.0, y_m: 1.5 },
    Apex { vx_m_s: 0.3, y_m: 3.0 },
    Apex { vx_m_s: 3.0, y_m: 4.0 },
];

pub(super) struct Fig07;

impl Figure for Fig07 {
    fn id(&self) -> &'static str {
        "fig07"
    }

    fn title(&self) -> &'static str {
        "States and actions at the apexes"
    }

    fn paper(&self) -> &'static str {
        "In water the agent comes to hop in place within a few steps, its velocity almost zero. \
         The agent trained on land alone takes a few steps and falls. The transferred agent hops \
         on, in a bi-periodic cycle about zero, less exactly than in water. In water the agent \
         elongates the leg as fast as it can, the transferred one on land as slowly as it can."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        extent.of(17.0, 1.3) // Beside the trainings of figure 3.
    }

    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError> {
        let transferred = shop.transferred()?;
        let alone = shop.trainings(Paper::Air)?;
        let pairs: Vec<(&Learnt, &Learnt)> = transferred.all.iter().zip(&alone).collect();
        let all = each_seed(shop, &pairs)?;
        let shown = transferred.shown();
        let air = alone.iter().find(|learnt| learnt.seed == shown.seed).expect("the same seeds");
        let chosen = format!("drawn: {}, the transferred agent's", shown.seed);
        shop.used("air alone", from(Paper::Air, &seeds(shop.extent), &chosen));
        let theirs = |agent| authors_actor(shop.reference.as_ref(), agent);
        let cases = [
            Case::new("water", 1.0, shown.actor_after(0), theirs("water")?),
            Case::new("air after water", 0.0, shown.actor(), theirs("water_to_air")?),
            Case::new("air alone", 0.0, air.actor(), theirs("air")?),
        ];
        let count = shop.extent.of(2_000, 400);
        let starts = draw_starts(count, &mut Pcg64::seed_from_u64(11));
        let ours = cases.each_ref().map(|case| Habits::of(&case.ours.actor(), case.rho, &starts));
        let measured = format!(
            "{} seeds; drawn is {}, which hops on from most starts in water and on land. The paper does not say where it starts: drawn from 1 m/s at 2 m \
             and from three other starts; the figures are over {count} starts drawn as in training, \
             {HOPS} hops each. {}",
            pairs.len(),
            shown.seed,
            cases.iter().zip(&ours).fold(String::new(), |text, (case, habits)| {
                format!("{text}{}: {}. ", case.name, habits.words())
            }) + &authors_words(&cases, &starts),
        );
        let all: Vec<Vec<Claim>> = all.iter().map(claims).collect();
        let claims = Claim::over_seeds(&all, &claims(&ours));
        Ok(Made { svg: draw(&cases)?, csv: table(&cases), measured, claims })
    }
}

/// The habits of every seed: in water, transferred, and on land alone.
fn each_seed(
    shop: &Workshop,
    pairs: &[(&Learnt, &Learnt)],
) -> Result<Vec<[Habits; 3]>, FiguresError> {
    let count = shop.extent.of(400, 100);
    let inputs = (Paper::WaterToAir.config_toml(), Paper::Air.config_toml(), pairs.len(), count);
    shop.part("habits-by-seed", &inputs, shop.extent.of(15.0, 1.0), || {
        let starts = draw_starts(count, &mut Pcg64::seed_from_u64(11));
        let habits = |(transferred, alone): &(&Learnt, &Learnt)| {
            [
                Habits::of(&transferred.actor_after(0).actor(), 1.0, &starts),
                Habits::of(&transferred.actor().actor(), 0.0, &starts),
                Habits::of(&alone.actor().actor(), 0.0, &starts),
            ]
        };
        Ok(pairs.iter().map(habits).collect())
    })
}

/// A column: an agent in a medium.
struct Case {
    name: &'static str,
    rho: f64,
    ours: PackedActor,
    theirs: Option<PackedActor>,
}

impl Case {
    fn new(name: &'static str, rho: f64, ours: PackedActor, theirs: Option<PackedActor>) -> Self {
        Self { name, rho, ours, theirs }
    }

    /// What is drawn: whose, from where, the run.
    fn runs(&self) -> Vec<(&'static str, Apex, Flown)> {
        let run = |whose, frozen: &PackedActor, start| {
            let flown = fly(&frozen.actor(), &hopper(self.rho), self.rho, start, DRAWN, |_| 0.0);
            (whose, start, flown)
        };
        let mut runs = vec![run("ours", &self.ours, START)];
        runs.extend(OTHERS.map(|start| run("ours", &self.ours, start)));
        runs.extend(self.theirs.as_ref().map(|theirs| run("authors", theirs, START)));
        runs
    }
}

/// What an agent does over many starts.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Habits {
    /// Share that takes 5 hops, and [`SURVIVED`].
    takes: [f64; 2],
    /// Median over survivors of the mean |v| over the last hops, m/s.
    abs_v_m_s: f64,
    /// Median over survivors of the hops after which |v| stays near zero;
    /// infinite where it does not.
    hops_to_stop: f64,
    /// Share of the survivors in a cycle of each length from 1.
    cycles: [f64; LONGEST_CYCLE],
    /// Mean elongation speed, m/s, and shares of the hops at its lowest and highest.
    elongation: [f64; 3],
}

impl Habits {
    fn of(actor: &Actor<'_>, rho: f64, starts: &[Apex]) -> Self {
        let hopper = hopper(rho);
        let runs: Vec<Flown> = starts
            .par_iter()
            .map(|&start| fly(actor, &hopper, rho, start, HOPS, |_| 0.0))
            .collect();
        Self::from_runs(&runs)
    }

    fn from_runs(runs: &[Flown]) -> Self {
        let share = |count: usize, of: usize| count as f64 / of.max(1) as f64;
        let takes = [5, SURVIVED]
            .map(|hops| share(runs.iter().filter(|run| run.hops() >= hops).count(), runs.len()));
        let standing: Vec<&Flown> = runs.iter().filter(|run| !run.fell).collect();
        let median = |values: Vec<f64>| quartiles(&mut { values })[1];
        let last = |run: &Flown| {
            let v = run.last_vx_m_s(2 * LONGEST_CYCLE).unwrap_or_default();
            v.iter().map(|v| v.abs()).sum::<f64>() / v.len().max(1) as f64
        };
        let periods: Vec<Option<usize>> = standing.iter().map(|run| period(run)).collect();
        let rs: Vec<f64> =
            runs.iter().flat_map(|run| &run.actions).map(|a| a.elongation_speed_m_s).collect();
        let [low, high] = [ACTION_LOW[1], ACTION_HIGH[1]].map(f64::from);
        let at = |bound: f64| share(rs.iter().filter(|rs| **rs == bound).count(), rs.len());
        Self {
            takes,
            abs_v_m_s: median(standing.iter().map(|run| last(run)).collect()),
            hops_to_stop: median(standing.iter().map(|run| hops_to_stop(run)).collect()),
            cycles: std::array::from_fn(|i| {
                share(periods.iter().filter(|p| **p == Some(i + 1)).count(), periods.len())
            }),
            elongation: [rs.iter().sum::<f64>() / rs.len().max(1) as f64, at(low), at(high)],
        }
    }

    fn words(&self) -> String {
        let [five, survived] = self.takes;
        let settles = match self.abs_v_m_s {
            v if v.is_finite() => format!("|v| settles at {v:.3} m/s"),
            _ => format!("none takes {HOPS}"),
        };
        format!("{survived:.3} of the starts take {SURVIVED} hops, {five:.3} take 5; {settles}")
    }
}

/// Hops after which the velocity stays near zero.
fn hops_to_stop(run: &Flown) -> f64 {
    match run.apexes.iter().rposition(|apex| apex.vx_m_s.abs() > NEAR_M_S) {
        None => 0.0,
        Some(last) if last + 1 < run.apexes.len() => (last + 1) as f64,
        Some(_) => f64::INFINITY,
    }
}

/// The length of the cycle that a run ends in, if it ends in one.
fn period(run: &Flown) -> Option<usize> {
    let v = run.last_vx_m_s(2 * LONGEST_CYCLE)?;
    let same = |p: &usize| v.iter().zip(&v[*p..]).all(|(a, b)| (a - b).abs() < SAME_M_S);
    (1..=LONGEST_CYCLE).find(same)
}

fn authors_words(cases: &[Case; 3], starts: &[Apex]) -> String {
    let words = cases.iter().filter_map(|case| {
        let theirs = case.theirs.as_ref()?;
        let habits = Habits::of(&theirs.actor(), case.rho, starts);
        Some(format!("The authors' agent, {}: {}. ", case.name, habits.words()))
    });
    words.collect()
}

fn claims([water, transferred, air]: &[Habits; 3]) -> Vec<Claim> {
    let graded = |all: bool, some: bool| match (all, some) {
        (true, _) => Verdict::Holds,
        (false, true) => Verdict::InPart,
        (false, false) => Verdict::Fails,
    };
    let stops = water.hops_to_stop <= FEW && water.abs_v_m_s <= NEAR_M_S;
    let near = transferred.abs_v_m_s <= NEAR_M_S;
    let stable = transferred.takes[1] >= 0.8;
    let even = transferred.cycles[1];
    let [slow, fast] = [transferred.elongation, water.elongation];
    vec![
        Claim::new(
            "In water the agent hops in place after a few steps, its velocity almost zero",
            if water.abs_v_m_s.is_finite() {
                format!(
                    "{:.3} of the starts take {SURVIVED} hops; |v| stays below {NEAR_M_S} m/s from \
                     hop {:.0} on (median) and settles at {:.3} m/s",
                    water.takes[1], water.hops_to_stop, water.abs_v_m_s
                )
            } else {
                water.words()
            },
            graded(stops && water.takes[1] >= 0.95, stops || water.takes[1] >= 0.95),
        ),
        Claim::new(
            "Trained on land alone, it takes a few steps, but is not stable",
            format!(
                "{:.3} of the starts take 5 hops, {:.3} take {SURVIVED}",
                air.takes[0], air.takes[1]
            ),
            Verdict::of(air.takes[1] < 0.5),
        ),
        Claim::new(
            "The transferred agent is stable on land, in a bi-periodic cycle near zero",
            format!(
                "{:.3} of the starts take {SURVIVED} hops; |v| settles at {:.3} m/s; of what still \
                 hops after {HOPS}, {even:.2} in a cycle of two, {:.2} of one, {:.2} of three to \
                 {LONGEST_CYCLE}",
                transferred.takes[1],
                transferred.abs_v_m_s,
                transferred.cycles[0],
                transferred.cycles[2..].iter().sum::<f64>(),
            ),
            graded(stable && near && even >= 0.5, stable),
        ),
        Claim::new(
            "It comes less near zero than the agent in water",
            format!("{:.3} m/s against {:.3} m/s", transferred.abs_v_m_s, water.abs_v_m_s),
            Verdict::of(transferred.abs_v_m_s > water.abs_v_m_s),
        ),
        Claim::new(
            "In water the agent uses the highest elongation speed",
            format!("mean {:.2} m/s of 2; {:.2} of the hops at 2", fast[0], fast[2]),
            graded(fast[0] >= 1.9, fast[0] >= 1.5),
        ),
        Claim::new(
            "The transferred agent uses the lowest elongation speed on land",
            format!("mean {:.2} m/s; {:.2} of the hops at 0", slow[0], slow[1]),
            graded(slow[0] <= 0.1, slow[0] <= 0.5),
        ),
    ]
}

/// A quantity of a run that is drawn: its name, and its values.
type Quantity = (&'static str, fn(&Flown) -> Vec<f64>);

const QUANTITIES: [Quantity; 4] = [
    ("velocity, m/s", |run| run.apexes.iter().map(|a| a.vx_m_s).collect()),
    ("height, m", |run| run.apexes.iter().map(|a| a.y_m).collect()),
    ("touchdown angle, deg", |run| {
        run.actions.iter().map(|a| a.touchdown_angle_rad.to_degrees()).collect()
    }),
    ("elongation speed, m/s", |run| run.actions.iter().map(|a| a.elongation_speed_m_s).collect()),
];

fn draw(cases: &[Case; 3]) -> Result<String, FiguresError> {
    let drawn = cases.each_ref().map(|case| (case.name, case.runs()));
    let rows = QUANTITIES.iter().enumerate().map(|(row, (name, values))| {
        let all = drawn.iter().flat_map(|(_, runs)| runs).flat_map(|(_, _, run)| values(run));
        let y = match row {
            2 => Axis::new(name, f64::from(ACTION_LOW[0]).to_degrees()..155.0),
            3 => Axis::new(name, -0.1..2.1),
            0 => Axis::new(name, -DRAWN_M_S..DRAWN_M_S),
            _ => Axis::around(name, all),
        };
        let panel = |(title, runs): &(&str, Vec<(&str, Apex, Flown)>)| Panel {
            title: if row == 0 { (*title).to_owned() } else { String::new() },
            x: Axis::new("apex", 0.0..DRAWN as f64),
            y: y.clone(),
            marks: runs.iter().enumerate().map(|(i, run)| line(i, run, *values, row)).collect(),
        };
        drawn.iter().map(panel).collect()
    });
    let sheet = Sheet {
        title: "Figure 7. States and actions at the apexes".into(),
        note: "from 1 m/s at 2 m and three other starts; a line ends where the leg falls".into(),
        rows: rows.collect(),
        row_px: 190,
    };
    Ok(sheet.draw()?)
}

fn line(
    index: usize,
    (whose, start, run): &(&str, Apex, Flown),
    values: fn(&Flown) -> Vec<f64>,
    row: usize,
) -> Mark {
    let within = |v: f64| if row == 0 && v.abs() > DRAWN_M_S { f64::NAN } else { v };
    let points = values(run).into_iter().enumerate().map(|(i, v)| (i as f64, within(v))).collect();
    let theirs = *whose == "authors";
    let label = match (row, theirs) {
        (0, true) => Some("the authors' agent, from the first".to_owned()),
        (0, false) => Some(format!("from {} m/s, {} m", start.vx_m_s, start.y_m)),
        _ => None,
    };
    let color = if theirs { AUTHORS } else { COLORS[index] };
    Mark::Line { points, color, dashed: theirs, label }
}

fn table(cases: &[Case; 3]) -> String {
    let mut csv = String::from(
        "case,whose,start_vx_m_s,start_y_m,apex,vx_m_s,y_m,touchdown_angle_rad,elongation_speed_m_s\n",
    );
    for case in cases {
        for (whose, start, run) in case.runs() {
            for (i, apex) in run.apexes.iter().enumerate() {
                let action = run.actions.get(i);
                let [alpha, rs] =
                    [action.map(|a| a.touchdown_angle_rad), action.map(|a| a.elongation_speed_m_s)]
                        .map(|value| value.map(|v| v.to_string()).unwrap_or_default());
                let _ = writeln!(
                    csv,
                    "{},{whose},{},{},{i},{},{},{alpha},{rs}",
                    case.name.replace(' ', "_"),
                    start.vx_m_s,
                    start.y_m,
                    apex.vx_m_s,
                    apex.y_m,
                );
            }
        }
    }
    csv
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_plant::Action;

    /// A run with these velocities over and over, after one that is fast.
    fn run(cycle: &[f64], elongation_speed_m_s: f64, fell: bool) -> Flown {
        let v = std::iter::once(3.0).chain(cycle.iter().copied().cycle().take(HOPS));
        let apexes: Vec<Apex> = v.map(|vx_m_s| Apex { vx_m_s, y_m: 2.0 }).collect();
        let apexes = if fell { apexes[..4].to_vec() } else { apexes };
        let actions = vec![Action { touchdown_angle_rad: 1.5, elongation_speed_m_s }; apexes.len()];
        Flown { apexes, actions, fell }
    }

    #[test]
    fn cycles_are_told_apart() {
        assert_eq!(period(&run(&[0.1], 0.0, false)), Some(1));
        assert_eq!(period(&run(&[0.1, -0.1], 0.0, false)), Some(2));
        assert_eq!(period(&run(&[0.1, -0.1, 0.2], 0.0, false)), Some(3));
        assert_eq!(period(&run(&[0.1], 0.0, true)), None);
        assert_eq!(hops_to_stop(&run(&[0.1], 0.0, false)), 1.0);
        assert_eq!(hops_to_stop(&run(&[0.5], 0.0, false)), f64::INFINITY);
    }

    #[test]
    fn claims_hold_only_for_what_does_so() {
        let of = |run: Flown| Habits::from_runs(&[run]);
        let as_said = claims(&[
            of(run(&[0.01], 2.0, false)),
            of(run(&[0.1, -0.1], 0.0, false)),
            of(run(&[0.1], 1.0, true)),
        ]);
        for claim in &as_said {
            assert_eq!(claim.verdict, Verdict::Holds, "{claim:?}");
        }
        let otherwise = claims(&[
            of(run(&[2.0], 0.0, true)),
            of(run(&[2.0], 2.0, true)),
            of(run(&[0.1], 1.0, false)),
        ]);
        for claim in &otherwise {
            assert_eq!(claim.verdict, Verdict::Fails, "{claim:?}");
        }
    }
}
