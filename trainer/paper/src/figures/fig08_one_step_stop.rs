//! Figure 8: the actor against the best stop in one step.

use std::fmt::Write as _;

use leg_control::actor::Observation;
use leg_plant::{Action, Apex};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::agents::{PaperAgent, TrainedAgent, seeds};
use crate::analysis::landscape::{Plane, bounds, hopper};
use crate::analysis::learning_curves::quartiles;
use crate::analysis::one_step::{STOP_M_S, Step, TriedAction, distance};
use crate::{Claim, Extent, Figure, FigureContext, FiguresError, RenderedFigure, Verdict};
use leg_charts::{Axis, Mark, Panel, Sheet};
use trainer::policy::PackedActor;

/// The states: the velocities and heights of most starts in training.
const VX_M_S: std::ops::Range<f64> = -6.0..6.0;
const Y_M: std::ops::Range<f64> = 1.0..7.0;
/// Starts of the pattern searches, as shares of the plane; the first is its middle.
const FROM: [[f64; 2]; 3] = [[0.5, 0.5], [0.4, 0.5], [0.65, 0.5]];
/// Number of steps of an episode.
const STEPS: usize = 5;
/// The media in the order of the transferred agent's stages. Each stage is examined in the
/// medium that it was trained in.
const MEDIA: [Medium; 2] = [
    Medium { name: "water", density: 1.0, authors: "water" },
    Medium { name: "air", density: 0.0, authors: "water_to_air" },
];

/// A medium, and the authors' agent that was trained for it.
#[derive(Clone, Copy)]
struct Medium {
    name: &'static str,
    density: f64,
    authors: &'static str,
}

pub(super) struct Fig08;

impl Figure for Fig08 {
    fn id(&self) -> &'static str {
        "fig08"
    }

    fn title(&self) -> &'static str {
        "The actor against the best stop in one step"
    }

    fn paper(&self) -> &'static str {
        "The actor's actions differ from those that a pattern search finds to be the best for \
         stopping in one step. The reason is that the agent may take more than one step; with longer \
         training it should come closer to them."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        let seeds = seeds(extent).count() as f64;
        MEDIA.len() as f64 * cost_s(extent) * (1.0 + seeds / 25.0)
    }

    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError> {
        let transferred = ctx.transferred()?;
        let mut csv = String::from(
            "medium,who,vx_m_s,y_m,alpha_rad,rs_m_s,next_speed_m_s,distance,speed_after_5_m_s\n",
        );
        let (mut rows, mut claims) = (Vec::new(), Vec::new());
        let mut measured = String::new();
        for (stage, Medium { name: medium, density, authors }) in MEDIA.into_iter().enumerate() {
            let mut actors = vec![("ours", transferred.shown().actor_after(stage))];
            if let Some(reference) = &ctx.reference {
                actors.push(("the authors'", reference.actor(authors)?));
            }
            let best = best(ctx, medium, density)?;
            let seeds = stats_by_seed(ctx, stage, &transferred.all, &best)?;
            let solved = best.iter().filter(|best| best.least() < STOP_M_S).count();
            let _ = write!(
                measured,
                "In {medium}, from at least {:.3} of {} states one step can stop, that is, end at less \
                 than {STOP_M_S} m/s at an apex of 1 m or more. ",
                solved as f64 / best.len() as f64,
                best.len(),
            );
            let steps: Vec<(&str, Vec<PolicyStep>)> = (actors.iter())
                .map(|(who, actor)| (*who, policy_steps(actor, density, &best)))
                .collect();
            for (who, steps) in &steps {
                let stats = StepStats::of(&best, steps);
                let whose = if *who == "ours" { "our" } else { who };
                let _ = write!(
                    measured,
                    "From these states, {:.3} of the steps of {whose} agent stop, and {:.3} fall or end \
                     below 1 m; the median distance of its action from the nearest best one is {:.3} \
                     of the plane. ",
                    stats.stops, stats.falls, stats.distance,
                );
                let of = |stats: &StepStats| {
                    vec![differs(medium, whose, stats), more_steps(medium, whose, stats)]
                };
                claims.extend(match *who {
                    "ours" => {
                        let all: Vec<Vec<Claim>> = seeds.iter().map(of).collect();
                        Claim::over_seeds(&all, &of(&stats))
                    }
                    _ => of(&stats),
                });
            }
            claims.push(pattern_search(medium, &best));
            write_rows(&mut csv, medium, &best, &steps);
            rows.extend(draw(ctx.extent, medium, &best, &steps));
        }
        let title = "Figure 8. The actor against the best stop in one step";
        let note = "upper rows: the touchdown angle; lower: the reward of the step, white where it \
                    falls or ends below 1 m";
        let sheet = Sheet::new(title, note).rows(186, rows);
        Ok(RenderedFigure {
            svg: sheet.draw()?,
            csv,
            measured: measured.trim_end().to_owned(),
            claims,
        })
    }
}

/// Returns the number of states across and up.
fn grid(extent: Extent) -> [usize; 2] {
    extent.of([31, 25], [13, 9])
}

/// The plane of the finer search.
const FINE: Plane = Plane { angles: 120, speeds: 21 };

fn cost_s(extent: Extent) -> f64 {
    let [across, up] = grid(extent);
    (across * up) as f64 * 0.01 / 2.0
}

/// The best steps from a state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct BestSteps {
    state: Apex,
    /// Found by the finer search.
    fine: Vec<TriedAction>,
    /// Found by the pattern search, from each of its starts.
    patterns: [TriedAction; FROM.len()],
}

impl BestSteps {
    fn of(density: f64, state: Apex) -> Self {
        let step = Step { hopper: hopper(density), start: state };
        let patterns = FROM.map(|from| step.pattern_search(from, 0.25));
        Self { state, fine: step.best(FINE), patterns }
    }

    /// Returns the best result of the pattern searches.
    fn pattern(&self) -> TriedAction {
        let least = |a: TriedAction, b: TriedAction| if b.speed_m_s < a.speed_m_s { b } else { a };
        self.patterns.into_iter().reduce(least).expect("several starts")
    }

    /// Returns the least speed after one step that any search found, m/s.
    fn least(&self) -> f64 {
        let speeds = self.fine.iter().chain(&self.patterns).map(|tried| tried.speed_m_s);
        speeds.fold(f64::INFINITY, f64::min)
    }

    /// Returns true if a result is the best of all, to within [`STOP_M_S`].
    fn is_best(&self, tried: TriedAction) -> bool {
        tried.speed_m_s <= self.least() + STOP_M_S
    }
}

/// Finds the best steps from every state, row by row from the lowest height.
fn best(ctx: &FigureContext, medium: &str, density: f64) -> Result<Vec<BestSteps>, FiguresError> {
    let [across, up] = grid(ctx.extent);
    let middle = |range: &std::ops::Range<f64>, i: usize, of: usize| {
        range.start + (i as f64 + 0.5) / of as f64 * (range.end - range.start)
    };
    let inputs = (across, up, FINE, FROM, [VX_M_S.end, Y_M.end, STOP_M_S, density]);
    ctx.cached(&format!("one-step-{medium}"), &inputs, cost_s(ctx.extent), || {
        let states = (0..across * up).into_par_iter().map(|i| Apex {
            vx_m_s: middle(&VX_M_S, i % across, across),
            y_m: middle(&Y_M, i / across, up),
        });
        Ok(states.map(|state| BestSteps::of(density, state)).collect())
    })
}

/// Computes the statistics of every seed.
fn stats_by_seed(
    ctx: &FigureContext,
    stage: usize,
    all: &[TrainedAgent],
    best: &[BestSteps],
) -> Result<Vec<StepStats>, FiguresError> {
    let Medium { name, density, .. } = MEDIA[stage];
    let inputs =
        (PaperAgent::WaterToAir.config_toml(), all.len(), grid(ctx.extent), FINE, STOP_M_S);
    let cost_s = all.len() as f64 * cost_s(ctx.extent) / 25.0;
    ctx.cached(&format!("one-step-by-seed-{name}"), &inputs, cost_s, || {
        let stats = |agent: &TrainedAgent| {
            StepStats::of(best, &policy_steps(&agent.actor_after(stage), density, best))
        };
        Ok(all.iter().map(stats).collect())
    })
}

/// An actor's step from a state.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PolicyStep {
    tried: TriedAction,
    /// Distance of its action from the nearest best one, as a share of the plane.
    distance: f64,
    /// Speed after a whole episode, m/s; infinite after a fall.
    after_m_s: f64,
}

fn policy_steps(actor: &PackedActor, density: f64, best: &[BestSteps]) -> Vec<PolicyStep> {
    let actor = actor.actor();
    let hopper = hopper(density);
    let act = |state: Apex| {
        let action = actor.act(Observation {
            apex_vx_m_s: state.vx_m_s as f32,
            apex_y_m: state.y_m as f32,
            density_ratio: density as f32,
        });
        let (alpha, rs) = (action.touchdown_angle_rad, action.elongation_speed_m_s);
        Action { touchdown_angle_rad: f64::from(alpha), elongation_speed_m_s: f64::from(rs) }
    };
    let each = best.par_iter().map(|best| {
        let step = Step { hopper, start: best.state };
        let Action { touchdown_angle_rad, elongation_speed_m_s } = act(best.state);
        let mut set = best.fine.clone();
        if best.least() < STOP_M_S {
            set.extend(step.stops_at(elongation_speed_m_s));
        }
        if set.is_empty() {
            set.extend(Some(best.pattern()).filter(|pattern| pattern.speed_m_s.is_finite()));
        }
        let mut state = Some(best.state);
        for _ in 0..STEPS {
            state = state.and_then(|state| hopper.hop(state, act(state)).outcome.next());
            state = state.filter(|state| state.y_m >= trainer::environment::LOWEST_APEX_M);
        }
        PolicyStep {
            tried: step.tried(touchdown_angle_rad, elongation_speed_m_s),
            distance: distance(touchdown_angle_rad, elongation_speed_m_s, &set),
            after_m_s: state.map_or(f64::INFINITY, |state| state.vx_m_s.abs()),
        }
    });
    each.collect()
}

/// Statistics of an actor's steps, over the states from which one step can stop.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct StepStats {
    /// Share of its steps that stop.
    stops: f64,
    /// Share of its steps that fall or end below 1 m.
    falls: f64,
    /// Median distance from the best actions, as a share of the plane.
    distance: f64,
    /// Share that survives a whole episode.
    survives: f64,
    /// Median speed of those after the first step and after the last, m/s.
    after_m_s: [f64; 2],
}

impl StepStats {
    fn of(best: &[BestSteps], steps: &[PolicyStep]) -> Self {
        let there = |(best, _): &(&BestSteps, &PolicyStep)| best.least() < STOP_M_S;
        let steps: Vec<&PolicyStep> =
            best.iter().zip(steps).filter(there).map(|(_, steps)| steps).collect();
        let share = |is: fn(&PolicyStep) -> bool| {
            steps.iter().filter(|a| is(a)).count() as f64 / steps.len() as f64
        };
        let survives = |a: &&&PolicyStep| a.after_m_s.is_finite();
        let median = |steps: &[&PolicyStep], number: fn(&PolicyStep) -> f64| {
            let mut finite: Vec<f64> =
                steps.iter().map(|a| number(a)).filter(|x| x.is_finite()).collect();
            quartiles(&mut finite)[1]
        };
        let surviving: Vec<&PolicyStep> = steps.iter().filter(survives).copied().collect();
        Self {
            stops: share(|a| a.tried.speed_m_s < STOP_M_S),
            falls: share(|a| a.tried.speed_m_s.is_infinite()),
            distance: median(&steps, |a| a.distance),
            survives: share(|a| a.after_m_s.is_finite()),
            after_m_s: [
                median(&surviving, |a| a.tried.speed_m_s),
                median(&surviving, |a| a.after_m_s),
            ],
        }
    }
}

fn differs(medium: &str, whose: &str, stats: &StepStats) -> Claim {
    let verdict = match stats.stops {
        stops if stops < 0.5 => Verdict::Holds,
        stops if stops < 0.9 => Verdict::InPart,
        _ => Verdict::Fails,
    };
    Claim::new(
        format!(
            "The actor's actions differ from the best one-step stops ({medium}, {whose} agent)"
        ),
        format!(
            "{:.3} of its steps stop where one step can; the median distance of its action from the \
             nearest best one is {:.3} of the plane",
            stats.stops, stats.distance
        ),
        verdict,
    )
}

fn more_steps(medium: &str, whose: &str, stats: &StepStats) -> Claim {
    let [after_one, after_all] = stats.after_m_s;
    Claim::new(
        format!("The agent takes more than one step to stop ({medium}, {whose} agent)"),
        format!(
            "from {:.3} of the states it survives {STEPS} steps; their median speed is \
             {after_one:.3} m/s after one step and {after_all:.3} m/s after {STEPS}",
            stats.survives
        ),
        Verdict::of(after_all < after_one),
    )
}

fn pattern_search(medium: &str, best: &[BestSteps]) -> Claim {
    let surviving: Vec<&BestSteps> = best.iter().filter(|best| best.least().is_finite()).collect();
    let share = |found: &dyn Fn(&BestSteps) -> TriedAction| {
        let found = surviving.iter().filter(|best| best.is_best(found(best))).count();
        found as f64 / surviving.len() as f64
    };
    let (one, several) = (share(&|best| best.patterns[0]), share(&BestSteps::pattern));
    let verdict = match several {
        share if share >= 0.95 => Verdict::Holds,
        share if share >= 0.5 => Verdict::InPart,
        _ => Verdict::Fails,
    };
    Claim::new(
        format!("Pattern search finds the best one-step stop ({medium})"),
        format!(
            "with {} starts of the search, it comes within {STOP_M_S} m/s of the finer search from \
             {several:.3} of the states; with one start in the middle of the plane, from {one:.3}",
            FROM.len()
        ),
        verdict,
    )
}

fn reward(speed_m_s: f64) -> f64 {
    if speed_m_s.is_finite() { (1.0 + 1.0 / speed_m_s).log10().min(2.5) } else { f64::NAN }
}

fn draw(
    extent: Extent,
    medium: &str,
    best: &[BestSteps],
    steps: &[(&str, Vec<PolicyStep>)],
) -> [Vec<Panel>; 2] {
    let panel = |title: String, label: &str, values: Vec<f64>, scale: std::ops::Range<f64>| Panel {
        title,
        x: Axis::new("apex velocity, m/s", VX_M_S),
        y: Axis::new("apex height, m", Y_M),
        marks: vec![Mark::cells((VX_M_S, Y_M), grid(extent)[0], values, scale, label)],
    };
    let [alpha, _] = bounds();
    let columns = |name: &str| format!("{medium}: {name}");
    let angle = |tried: TriedAction| {
        if tried.speed_m_s.is_finite() { tried.touchdown_angle_rad } else { f64::NAN }
    };
    let angles = |title: String, values| panel(title, "angle, rad", values, alpha.clone());
    let rewards = |title: String, values| panel(title, "reward", values, 0.0..2.5);
    let mut upper = vec![angles(
        columns("pattern search"),
        best.iter().map(|best| angle(best.pattern())).collect(),
    )];
    let mut lower =
        vec![rewards(columns("best step"), best.iter().map(|best| reward(best.least())).collect())];
    for (who, steps) in steps {
        let all = steps.iter().map(|a| a.tried);
        upper.push(angles(
            columns(who),
            all.clone().map(|tried| tried.touchdown_angle_rad).collect(),
        ));
        lower.push(rewards(columns(who), all.map(|tried| reward(tried.speed_m_s)).collect()));
    }
    [upper, lower]
}

fn write_rows(
    csv: &mut String,
    medium: &str,
    best: &[BestSteps],
    steps: &[(&str, Vec<PolicyStep>)],
) {
    for (i, best) in best.iter().enumerate() {
        let Apex { vx_m_s, y_m } = best.state;
        let mut row = |who: &str, tried: TriedAction, rest: &str| {
            let TriedAction { touchdown_angle_rad, elongation_speed_m_s, speed_m_s } = tried;
            let who = who.replace('\'', "").replace(' ', "_");
            let _ = writeln!(
                csv,
                "{medium},{who},{vx_m_s},{y_m},{touchdown_angle_rad},{elongation_speed_m_s},\
                 {speed_m_s},{rest}"
            );
        };
        row("pattern search", best.pattern(), ",");
        let fine = best.fine.iter().copied().min_by(|a, b| a.speed_m_s.total_cmp(&b.speed_m_s));
        if let Some(fine) = fine {
            row("finer search", fine, ",");
        }
        for (who, steps) in steps {
            let PolicyStep { tried, distance, after_m_s } = steps[i];
            row(who, tried, &format!("{distance},{after_m_s}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tried(touchdown_angle_rad: f64, speed_m_s: f64) -> TriedAction {
        TriedAction { touchdown_angle_rad, elongation_speed_m_s: 0.0, speed_m_s }
    }

    fn best(fine: f64, patterns: [f64; 3]) -> BestSteps {
        let state = Apex { vx_m_s: 1.0, y_m: 2.0 };
        BestSteps { state, fine: vec![tried(1.6, fine)], patterns: patterns.map(|v| tried(1.6, v)) }
    }

    fn steps(speed_m_s: f64, after_m_s: f64) -> PolicyStep {
        PolicyStep { tried: tried(1.5, speed_m_s), distance: 0.1, after_m_s }
    }

    #[test]
    fn claims_fail_for_an_actor_that_stops_in_one_step_and_hold_for_a_slower_one() {
        let states = vec![best(0.0, [0.0; 3]); 4];
        let at_once = StepStats::of(&states, &[steps(0.001, 0.002); 4]);
        assert_eq!(differs("air", "it", &at_once).verdict, Verdict::Fails);
        assert_eq!(more_steps("air", "it", &at_once).verdict, Verdict::Fails);
        let slow = StepStats::of(&states, &[steps(1.0, 0.2); 4]);
        assert_eq!(differs("air", "it", &slow).verdict, Verdict::Holds);
        assert_eq!(more_steps("air", "it", &slow).verdict, Verdict::Holds);
        assert_eq!(slow.distance, 0.1);
    }

    #[test]
    fn leaves_out_states_from_which_no_step_stops() {
        let states = [best(0.0, [0.0; 3]), best(2.0, [2.0; 3])];
        let stats = StepStats::of(&states, &[steps(0.0, 0.0), steps(f64::INFINITY, 5.0)]);
        assert_eq!((stats.stops, stats.falls), (1.0, 0.0));
    }

    #[test]
    fn the_pattern_search_claim_follows_the_share_that_it_finds() {
        let found = vec![best(0.0, [3.0, 0.0, f64::INFINITY]); 3];
        let claim = pattern_search("air", &found);
        assert_eq!(claim.verdict, Verdict::Holds);
        assert!(claim.measured.contains("of the plane, from 0.000"), "{claim:?}");
        let missed = vec![best(0.0, [3.0; 3]); 3];
        assert_eq!(pattern_search("air", &missed).verdict, Verdict::Fails);
    }
}
