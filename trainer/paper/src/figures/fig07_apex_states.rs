//! Figure 7: states and actions at the apexes in water, in air after water, and in air.

use std::fmt::Write as _;

use leg_control::actor::Actor;
use leg_plant::Apex;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::agents::{CHOICE, PaperAgent, TrainedAgent, origin, seeds};
use crate::analysis::apex_run::{ApexRun, START, authors_actor, run_policy};
use crate::analysis::learning_curves::quartiles;
use crate::{Claim, Extent, Figure, FigureContext, FiguresError, RenderedFigure, Verdict};
use leg_charts::color::{BLACK, SERIES};
use leg_charts::{Axis, Mark, Panel, Sheet};
use trainer::evaluate::hopper;
use trainer::evaluate::survival::draw_starts;
use trainer::policy::PackedActor;
use trainer::preset::{ACTION_HIGH, ACTION_LOW};

/// Number of hops that are drawn.
const DRAWN: usize = 30;
/// Largest velocity that is drawn, m/s, so that a diverging run does not flatten the others.
const DRAWN_M_S: f64 = 4.5;
/// Number of hops from each of the starts that the statistics are over.
const HOPS: usize = 60;
/// Number of hops after which a run has survived, as in the paper's figure 11.
const SURVIVED: usize = 30;
/// Velocity that counts as "near zero", m/s; the authors' own agents end at 0.2.
const NEAR_M_S: f64 = 0.25;
/// Number of hops that counts as "a few steps".
const FEW: f64 = 10.0;
/// Apex velocities that differ by less than this are equal, m/s.
const SAME_M_S: f64 = 1e-3;
/// Longest cycle that is detected, in hops.
const LONGEST_CYCLE: usize = 8;
/// Starts that are drawn beside [`START`].
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
        "In water the agent hops in place after a few steps, at almost zero velocity. The agent that \
         is trained on land only takes a few steps and falls. The transferred agent keeps hopping \
         in a bi-periodic cycle around zero, less exactly than in water. In water the agent \
         elongates the leg as fast as possible; the transferred agent on land, as slowly as \
         possible."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        extent.of(17.0, 1.3) // Without the trainings of figure 3.
    }

    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError> {
        let transferred = ctx.transferred()?;
        let alone = ctx.trainings(PaperAgent::Air)?;
        let pairs: Vec<(&TrainedAgent, &TrainedAgent)> =
            transferred.all.iter().zip(&alone).collect();
        let all = stats_by_seed(ctx, &pairs)?;
        let shown = transferred.shown();
        let air = alone.iter().find(|agent| agent.seed == shown.seed).expect("the same seeds");
        let chosen = format!("drawn: seed {}, as for the transferred agent", shown.seed);
        ctx.note_policy("air alone", origin(PaperAgent::Air, &seeds(ctx.extent), &chosen));
        let theirs = |agent| authors_actor(ctx.reference.as_ref(), agent);
        let cases = [
            Case::new("water", 1.0, shown.actor_after(0), theirs("water")?),
            Case::new("air after water", 0.0, shown.actor(), theirs("water_to_air")?),
            Case::new("air alone", 0.0, air.actor(), theirs("air")?),
        ];
        let count = ctx.extent.of(2_000, 400);
        let starts = draw_starts(count, &mut Pcg64::seed_from_u64(11));
        let ours =
            cases.each_ref().map(|case| ApexStats::of(&case.ours.actor(), case.rho, &starts));
        let measured = format!(
            "{} seeds; drawn is seed {}, {CHOICE}. The paper does not give its starts: the charts show \
             1 m/s at 2 m and three others; the values below are over {count} random starts as in \
             training, {HOPS} hops each. {}",
            pairs.len(),
            shown.seed,
            cases.iter().zip(&ours).fold(String::new(), |text, (case, stats)| {
                format!("{text}{}: {}. ", case.name, stats.summary())
            }) + &authors_summary(&cases, &starts),
        );
        let all: Vec<Vec<Claim>> = all.iter().map(claims).collect();
        let claims = Claim::over_seeds(&all, &claims(&ours));
        Ok(RenderedFigure { svg: draw(&cases)?, csv: table(&cases), measured, claims })
    }
}

/// Computes the statistics of every seed: in water, transferred to land, and trained on land
/// only.
fn stats_by_seed(
    ctx: &FigureContext,
    pairs: &[(&TrainedAgent, &TrainedAgent)],
) -> Result<Vec<[ApexStats; 3]>, FiguresError> {
    let count = ctx.extent.of(400, 100);
    let inputs =
        (PaperAgent::WaterToAir.config_toml(), PaperAgent::Air.config_toml(), pairs.len(), count);
    ctx.cached("apex-stats-by-seed", &inputs, ctx.extent.of(15.0, 1.0), || {
        let starts = draw_starts(count, &mut Pcg64::seed_from_u64(11));
        let stats = |(transferred, alone): &(&TrainedAgent, &TrainedAgent)| {
            [
                ApexStats::of(&transferred.actor_after(0).actor(), 1.0, &starts),
                ApexStats::of(&transferred.actor().actor(), 0.0, &starts),
                ApexStats::of(&alone.actor().actor(), 0.0, &starts),
            ]
        };
        Ok(pairs.iter().map(stats).collect())
    })
}

/// A column of panels: an agent in a medium.
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

    /// Computes the runs that are drawn: whose agent, the start, the run.
    fn runs(&self) -> Vec<(&'static str, Apex, ApexRun)> {
        let run = |whose, frozen: &PackedActor, start| {
            let run =
                run_policy(&frozen.actor(), &hopper(self.rho), self.rho, start, DRAWN, |_| 0.0);
            (whose, start, run)
        };
        let mut runs = vec![run("ours", &self.ours, START)];
        runs.extend(OTHERS.map(|start| run("ours", &self.ours, start)));
        runs.extend(self.theirs.as_ref().map(|theirs| run("authors", theirs, START)));
        runs
    }
}

/// Statistics of an agent over many starts.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct ApexStats {
    /// Shares of the starts from which it takes 5 hops, and [`SURVIVED`].
    takes: [f64; 2],
    /// Median over survivors of the mean |v| of the last hops, m/s.
    abs_v_m_s: f64,
    /// Median over survivors of the number of hops after which |v| stays near zero;
    /// infinite if it does not.
    hops_to_stop: f64,
    /// Shares of the survivors in a cycle of each length, from 1.
    cycles: [f64; LONGEST_CYCLE],
    /// Mean elongation speed, m/s, and shares of the hops at the lowest and the highest.
    elongation: [f64; 3],
}

impl ApexStats {
    fn of(actor: &Actor<'_>, rho: f64, starts: &[Apex]) -> Self {
        let hopper = hopper(rho);
        let runs: Vec<ApexRun> = starts
            .par_iter()
            .map(|&start| run_policy(actor, &hopper, rho, start, HOPS, |_| 0.0))
            .collect();
        Self::from_runs(&runs)
    }

    fn from_runs(runs: &[ApexRun]) -> Self {
        let share = |count: usize, of: usize| count as f64 / of.max(1) as f64;
        let takes = [5, SURVIVED]
            .map(|hops| share(runs.iter().filter(|run| run.hops() >= hops).count(), runs.len()));
        let standing: Vec<&ApexRun> = runs.iter().filter(|run| !run.fell).collect();
        let median = |values: Vec<f64>| quartiles(&mut { values })[1];
        let last = |run: &ApexRun| {
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

    fn summary(&self) -> String {
        let [five, survived] = self.takes;
        let settles = match self.abs_v_m_s {
            v if v.is_finite() => format!("|v| settles at {v:.3} m/s"),
            _ => format!("none takes {HOPS} hops"),
        };
        format!(
            "from {survived:.3} of the starts it takes {SURVIVED} hops, from {five:.3} it takes 5; {settles}"
        )
    }
}

/// Returns the number of hops after which the velocity stays near zero; infinite if it does
/// not.
fn hops_to_stop(run: &ApexRun) -> f64 {
    match run.apexes.iter().rposition(|apex| apex.vx_m_s.abs() > NEAR_M_S) {
        None => 0.0,
        Some(last) if last + 1 < run.apexes.len() => (last + 1) as f64,
        Some(_) => f64::INFINITY,
    }
}

/// Returns the length of the cycle that a run ends in, if it ends in one.
fn period(run: &ApexRun) -> Option<usize> {
    let v = run.last_vx_m_s(2 * LONGEST_CYCLE)?;
    let same = |p: &usize| v.iter().zip(&v[*p..]).all(|(a, b)| (a - b).abs() < SAME_M_S);
    (1..=LONGEST_CYCLE).find(same)
}

fn authors_summary(cases: &[Case; 3], starts: &[Apex]) -> String {
    let summaries = cases.iter().filter_map(|case| {
        let theirs = case.theirs.as_ref()?;
        let stats = ApexStats::of(&theirs.actor(), case.rho, starts);
        Some(format!("The authors' agent, {}: {}. ", case.name, stats.summary()))
    });
    summaries.collect()
}

fn claims([water, transferred, air]: &[ApexStats; 3]) -> Vec<Claim> {
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
            "In water the agent hops in place after a few steps, at almost zero velocity",
            if water.abs_v_m_s.is_finite() {
                format!(
                    "from {:.3} of the starts it takes {SURVIVED} hops; |v| stays below {NEAR_M_S} m/s from \
                     hop {:.0} on (median) and settles at {:.3} m/s",
                    water.takes[1], water.hops_to_stop, water.abs_v_m_s
                )
            } else {
                water.summary()
            },
            graded(stops && water.takes[1] >= 0.95, stops || water.takes[1] >= 0.95),
        ),
        Claim::new(
            "The agent trained on land only takes a few steps, but is not stable",
            format!(
                "from {:.3} of the starts it takes 5 hops, from {:.3} it takes {SURVIVED}",
                air.takes[0], air.takes[1]
            ),
            Verdict::of(air.takes[1] < 0.5),
        ),
        Claim::new(
            "The transferred agent is stable on land, in a bi-periodic cycle near zero",
            format!(
                "from {:.3} of the starts it takes {SURVIVED} hops; |v| settles at {:.3} m/s; of the \
                 runs that survive {HOPS} hops, {even:.2} end in a cycle of two hops, {:.2} of one, \
                 {:.2} of three to {LONGEST_CYCLE}",
                transferred.takes[1],
                transferred.abs_v_m_s,
                transferred.cycles[0],
                transferred.cycles[2..].iter().sum::<f64>(),
            ),
            graded(stable && near && even >= 0.5, stable),
        ),
        Claim::new(
            "Its velocity is farther from zero than that of the agent in water",
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

/// A quantity that is drawn: its name, and its values over a run.
type Quantity = (&'static str, fn(&ApexRun) -> Vec<f64>);

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
        let is_last = row + 1 == QUANTITIES.len();
        let all = drawn.iter().flat_map(|(_, runs)| runs).flat_map(|(_, _, run)| values(run));
        let y = match row {
            2 => Axis::new(name, f64::from(ACTION_LOW[0]).to_degrees()..155.0),
            3 => Axis::new(name, -0.1..2.1),
            0 => Axis::new(name, -DRAWN_M_S..DRAWN_M_S),
            _ => Axis::around(name, all),
        };
        let panel = |(title, runs): &(&str, Vec<(&str, Apex, ApexRun)>)| Panel {
            title: if row == 0 { (*title).to_owned() } else { String::new() },
            x: Axis::new(if is_last { "apex" } else { "" }, 0.0..DRAWN as f64),
            y: y.clone(),
            marks: runs.iter().enumerate().map(|(i, run)| line(i, run, *values, row)).collect(),
        };
        drawn.iter().map(panel).collect()
    });
    let title = "Figure 7. States and actions at the apexes";
    let note = "from 1 m/s at 2 m and three other starts; a line ends where the leg falls";
    Ok(Sheet::new(title, note).shared_legend().rows(130, rows.collect()).draw()?)
}

fn line(
    index: usize,
    (whose, start, run): &(&str, Apex, ApexRun),
    values: fn(&ApexRun) -> Vec<f64>,
    row: usize,
) -> Mark {
    let within = |v: f64| if row == 0 && v.abs() > DRAWN_M_S { f64::NAN } else { v };
    let points = values(run).into_iter().enumerate().map(|(i, v)| (i as f64, within(v))).collect();
    let theirs = *whose == "authors";
    if theirs {
        return Mark::line(points, BLACK).dashed().label("the authors' agent, from the first");
    }
    let label = format!("from {} m/s, {} m", start.vx_m_s, start.y_m);
    Mark::line(points, SERIES[index]).label(label)
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

    /// Returns a run that repeats these velocities, after a fast first apex.
    fn run(cycle: &[f64], elongation_speed_m_s: f64, fell: bool) -> ApexRun {
        let v = std::iter::once(3.0).chain(cycle.iter().copied().cycle().take(HOPS));
        let apexes: Vec<Apex> = v.map(|vx_m_s| Apex { vx_m_s, y_m: 2.0 }).collect();
        let apexes = if fell { apexes[..4].to_vec() } else { apexes };
        let actions = vec![Action { touchdown_angle_rad: 1.5, elongation_speed_m_s }; apexes.len()];
        ApexRun { apexes, actions, fell }
    }

    #[test]
    fn detects_the_length_of_a_cycle() {
        assert_eq!(period(&run(&[0.1], 0.0, false)), Some(1));
        assert_eq!(period(&run(&[0.1, -0.1], 0.0, false)), Some(2));
        assert_eq!(period(&run(&[0.1, -0.1, 0.2], 0.0, false)), Some(3));
        assert_eq!(period(&run(&[0.1], 0.0, true)), None);
        assert_eq!(hops_to_stop(&run(&[0.1], 0.0, false)), 1.0);
        assert_eq!(hops_to_stop(&run(&[0.5], 0.0, false)), f64::INFINITY);
    }

    #[test]
    fn claims_hold_for_agents_as_the_paper_describes_them_and_fail_for_others() {
        let of = |run: ApexRun| ApexStats::from_runs(&[run]);
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
