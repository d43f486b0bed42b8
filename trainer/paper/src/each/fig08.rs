//! Figure 8: the actor against the best stop in one step.

use std::fmt::Write as _;

use leg_control::actor::Observation;
use leg_plant::{Action, Apex};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::agents::{Learnt, Paper, seeds};
use crate::picture::{Axis, Mark, Panel, Sheet};
use crate::study::landscape::{Plane, bounds, hopper};
use crate::study::learning::quartiles;
use crate::study::one_step::{STOP_M_S, Step, Tried, distance};
use crate::{Claim, Extent, Figure, FiguresError, Made, Verdict, Workshop};
use trainer::policy::PackedActor;

/// The states: velocities and heights that most starts of the training lie in.
const VX_M_S: std::ops::Range<f64> = -6.0..6.0;
const Y_M: std::ops::Range<f64> = 1.0..7.0;
/// Where the pattern searches start, in parts of the plane; the first is its middle.
const FROM: [[f64; 2]; 3] = [[0.5, 0.5], [0.4, 0.5], [0.65, 0.5]];
/// Steps of an episode.
const STEPS: usize = 5;
/// In the order of the transferred agent's stages: each is looked at where it
/// has been trained last.
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
        "The actions of the actor differ from those that a pattern search finds best for stopping \
         in one step. That is because the agent may take more than one step; with longer training \
         it should come closer to them."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        let seeds = seeds(extent).count() as f64;
        MEDIA.len() as f64 * cost_s(extent) * (1.0 + seeds / 25.0)
    }

    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError> {
        let transferred = shop.transferred()?;
        let mut csv = String::from(
            "medium,who,vx_m_s,y_m,alpha_rad,rs_m_s,next_speed_m_s,distance,speed_after_5_m_s\n",
        );
        let (mut rows, mut claims) = (Vec::new(), Vec::new());
        let mut measured = String::new();
        for (stage, Medium { name: medium, density, authors }) in MEDIA.into_iter().enumerate() {
            let mut actors = vec![("ours", transferred.shown().actor_after(stage))];
            if let Some(reference) = &shop.reference {
                actors.push(("the authors'", reference.actor(authors)?));
            }
            let best = best(shop, medium, density)?;
            let seeds = each_seed(shop, stage, &transferred.all, &best)?;
            let solved = best.iter().filter(|best| best.least() < STOP_M_S).count();
            let _ = write!(
                measured,
                "In {medium}, a step that stops within {STOP_M_S} m/s, at an apex of 1 m or more, \
                 exists from at least {:.3} of {} states. ",
                solved as f64 / best.len() as f64,
                best.len(),
            );
            let acted: Vec<(&str, Vec<Acted>)> =
                (actors.iter()).map(|(who, actor)| (*who, acted(actor, density, &best))).collect();
            for (who, acted) in &acted {
                let numbers = Numbers::of(&best, acted);
                let _ = write!(
                    measured,
                    "{who}: {:.3} of its steps there stop, {:.3} fall or end low; its action lies \
                     {:.3} of the plane's width from the best ones (median). ",
                    numbers.stops, numbers.falls, numbers.distance,
                );
                let of = |numbers: &Numbers| {
                    vec![differs(medium, who, numbers), more_steps(medium, who, numbers)]
                };
                claims.extend(match *who {
                    "ours" => {
                        let all: Vec<Vec<Claim>> = seeds.iter().map(of).collect();
                        Claim::over_seeds(&all, &of(&numbers))
                    }
                    _ => of(&numbers),
                });
            }
            claims.push(pattern_search(medium, &best));
            write_rows(&mut csv, medium, &best, &acted);
            rows.extend(draw(shop.extent, medium, &best, &acted));
        }
        let sheet = Sheet {
            title: "Figure 8. The actor against the best stop in one step".into(),
            note: "upper rows: the touchdown angle; lower: the reward of the step, white where it \
                   falls or ends below 1 m"
                .into(),
            rows,
            row_px: 260,
        };
        Ok(Made { svg: sheet.draw()?, csv, measured: measured.trim_end().to_owned(), claims })
    }
}

/// States across and up.
fn grid(extent: Extent) -> [usize; 2] {
    extent.of([31, 25], [13, 9])
}

/// The plane that the finer search looks over.
const FINE: Plane = Plane { angles: 120, speeds: 21 };

fn cost_s(extent: Extent) -> f64 {
    let [across, up] = grid(extent);
    (across * up) as f64 * 0.01 / 2.0
}

/// What is best in a state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Best {
    state: Apex,
    /// By the finer search.
    fine: Vec<Tried>,
    /// By the pattern search, from each of its starts.
    patterns: [Tried; FROM.len()],
}

impl Best {
    fn of(density: f64, state: Apex) -> Self {
        let step = Step { hopper: hopper(density), start: state };
        let patterns = FROM.map(|from| step.pattern_search(from, 0.25));
        Self { state, fine: step.best(FINE), patterns }
    }

    /// The best of the pattern searches.
    fn pattern(&self) -> Tried {
        let least = |a: Tried, b: Tried| if b.speed_m_s < a.speed_m_s { b } else { a };
        self.patterns.into_iter().reduce(least).expect("several starts")
    }

    /// The least speed that one step can leave, by whatever search found it, m/s.
    fn least(&self) -> f64 {
        let speeds = self.fine.iter().chain(&self.patterns).map(|tried| tried.speed_m_s);
        speeds.fold(f64::INFINITY, f64::min)
    }

    /// Whether a search result is as good as any, to within a stop's speed.
    fn is_best(&self, tried: Tried) -> bool {
        tried.speed_m_s <= self.least() + STOP_M_S
    }
}

/// The best of every state, row by row from the lowest height.
fn best(shop: &Workshop, medium: &str, density: f64) -> Result<Vec<Best>, FiguresError> {
    let [across, up] = grid(shop.extent);
    let middle = |range: &std::ops::Range<f64>, i: usize, of: usize| {
        range.start + (i as f64 + 0.5) / of as f64 * (range.end - range.start)
    };
    let inputs = (across, up, FINE, FROM, [VX_M_S.end, Y_M.end, STOP_M_S, density]);
    shop.part(&format!("one-step-{medium}"), &inputs, cost_s(shop.extent), || {
        let states = (0..across * up).into_par_iter().map(|i| Apex {
            vx_m_s: middle(&VX_M_S, i % across, across),
            y_m: middle(&Y_M, i / across, up),
        });
        Ok(states.map(|state| Best::of(density, state)).collect())
    })
}

/// The numbers of every seed.
fn each_seed(
    shop: &Workshop,
    stage: usize,
    all: &[Learnt],
    best: &[Best],
) -> Result<Vec<Numbers>, FiguresError> {
    let Medium { name, density, .. } = MEDIA[stage];
    let inputs = (Paper::WaterToAir.config_toml(), all.len(), grid(shop.extent), FINE, STOP_M_S);
    let cost_s = all.len() as f64 * cost_s(shop.extent) / 25.0;
    shop.part(&format!("one-step-by-seed-{name}"), &inputs, cost_s, || {
        let numbers =
            |learnt: &Learnt| Numbers::of(best, &acted(&learnt.actor_after(stage), density, best));
        Ok(all.iter().map(numbers).collect())
    })
}

/// What an actor does in a state.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Acted {
    tried: Tried,
    /// From the nearest best action, in parts of the plane.
    distance: f64,
    /// After a whole episode; infinite after a fall, m/s.
    after_m_s: f64,
}

fn acted(actor: &PackedActor, density: f64, best: &[Best]) -> Vec<Acted> {
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
        Acted {
            tried: step.tried(touchdown_angle_rad, elongation_speed_m_s),
            distance: distance(touchdown_angle_rad, elongation_speed_m_s, &set),
            after_m_s: state.map_or(f64::INFINITY, |state| state.vx_m_s.abs()),
        }
    });
    each.collect()
}

/// An actor beside the best, over the states from which one step can stop.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Numbers {
    /// Share of its steps that stop.
    stops: f64,
    /// Share of its steps that fall or end low.
    falls: f64,
    /// Median distance from the best actions, in parts of the plane.
    distance: f64,
    /// Share that stands a whole episode.
    stands: f64,
    /// Of those, the median speed after the first step and after the last, m/s.
    after_m_s: [f64; 2],
}

impl Numbers {
    fn of(best: &[Best], acted: &[Acted]) -> Self {
        let there = |(best, _): &(&Best, &Acted)| best.least() < STOP_M_S;
        let acted: Vec<&Acted> =
            best.iter().zip(acted).filter(there).map(|(_, acted)| acted).collect();
        let share = |is: fn(&Acted) -> bool| {
            acted.iter().filter(|a| is(a)).count() as f64 / acted.len() as f64
        };
        let stands = |a: &&&Acted| a.after_m_s.is_finite();
        let median = |acted: &[&Acted], number: fn(&Acted) -> f64| {
            let mut finite: Vec<f64> =
                acted.iter().map(|a| number(a)).filter(|x| x.is_finite()).collect();
            quartiles(&mut finite)[1]
        };
        let standing: Vec<&Acted> = acted.iter().filter(stands).copied().collect();
        Self {
            stops: share(|a| a.tried.speed_m_s < STOP_M_S),
            falls: share(|a| a.tried.speed_m_s.is_infinite()),
            distance: median(&acted, |a| a.distance),
            stands: share(|a| a.after_m_s.is_finite()),
            after_m_s: [
                median(&standing, |a| a.tried.speed_m_s),
                median(&standing, |a| a.after_m_s),
            ],
        }
    }
}

fn differs(medium: &str, who: &str, numbers: &Numbers) -> Claim {
    let verdict = match numbers.stops {
        stops if stops < 0.5 => Verdict::Holds,
        stops if stops < 0.9 => Verdict::InPart,
        _ => Verdict::Fails,
    };
    Claim::new(
        format!("The actor's solutions differ from the best one-step stops ({medium}, {who})"),
        format!(
            "{:.3} of its steps stop within {STOP_M_S} m/s where one can; {:.3} of the plane's width \
             lie between its action and the nearest best (median)",
            numbers.stops, numbers.distance
        ),
        verdict,
    )
}

fn more_steps(medium: &str, who: &str, numbers: &Numbers) -> Claim {
    let [after_one, after_all] = numbers.after_m_s;
    Claim::new(
        format!("It takes more than one step to stop ({medium}, {who})"),
        format!(
            "{:.3} stand {STEPS} steps; of these, median speed {after_one:.3} m/s after one, \
             {after_all:.3} after {STEPS}",
            numbers.stands
        ),
        Verdict::of(after_all < after_one),
    )
}

fn pattern_search(medium: &str, best: &[Best]) -> Claim {
    let standing: Vec<&Best> = best.iter().filter(|best| best.least().is_finite()).collect();
    let share = |found: &dyn Fn(&Best) -> Tried| {
        let found = standing.iter().filter(|best| best.is_best(found(best))).count();
        found as f64 / standing.len() as f64
    };
    let (one, several) = (share(&|best| best.patterns[0]), share(&Best::pattern));
    let verdict = match several {
        share if share >= 0.95 => Verdict::Holds,
        share if share >= 0.5 => Verdict::InPart,
        _ => Verdict::Fails,
    };
    Claim::new(
        format!("Pattern search finds the best one-step stop ({medium})"),
        format!(
            "within {STOP_M_S} m/s of the finer search from {several:.3} of the states with {} \
             starts of the search, from {one:.3} with one in the middle of the plane",
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
    best: &[Best],
    acted: &[(&str, Vec<Acted>)],
) -> [Vec<Panel>; 2] {
    let panel = |title: String, label: &str, values: Vec<f64>, scale: std::ops::Range<f64>| Panel {
        title,
        x: Axis::new("apex velocity, m/s", VX_M_S),
        y: Axis::new("apex height, m", Y_M),
        marks: vec![Mark::Cells {
            x: VX_M_S,
            y: Y_M,
            columns: grid(extent)[0],
            values,
            scale,
            label: label.into(),
        }],
    };
    let [alpha, _] = bounds();
    let columns = |name: &str| format!("{medium}: {name}");
    let angle = |tried: Tried| {
        if tried.speed_m_s.is_finite() { tried.touchdown_angle_rad } else { f64::NAN }
    };
    let angles = |title: String, values| panel(title, "alpha, rad", values, alpha.clone());
    let rewards = |title: String, values| panel(title, "reward", values, 0.0..2.5);
    let mut upper = vec![angles(
        columns("pattern search"),
        best.iter().map(|best| angle(best.pattern())).collect(),
    )];
    let mut lower =
        vec![rewards(columns("best step"), best.iter().map(|best| reward(best.least())).collect())];
    for (who, acted) in acted {
        let all = acted.iter().map(|a| a.tried);
        upper.push(angles(
            columns(who),
            all.clone().map(|tried| tried.touchdown_angle_rad).collect(),
        ));
        lower.push(rewards(columns(who), all.map(|tried| reward(tried.speed_m_s)).collect()));
    }
    [upper, lower]
}

fn write_rows(csv: &mut String, medium: &str, best: &[Best], acted: &[(&str, Vec<Acted>)]) {
    for (i, best) in best.iter().enumerate() {
        let Apex { vx_m_s, y_m } = best.state;
        let mut row = |who: &str, tried: Tried, rest: &str| {
            let Tried { touchdown_angle_rad, elongation_speed_m_s, speed_m_s } = tried;
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
        for (who, acted) in acted {
            let Acted { tried, distance, after_m_s } = acted[i];
            row(who, tried, &format!("{distance},{after_m_s}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tried(touchdown_angle_rad: f64, speed_m_s: f64) -> Tried {
        Tried { touchdown_angle_rad, elongation_speed_m_s: 0.0, speed_m_s }
    }

    fn best(fine: f64, patterns: [f64; 3]) -> Best {
        let state = Apex { vx_m_s: 1.0, y_m: 2.0 };
        Best { state, fine: vec![tried(1.6, fine)], patterns: patterns.map(|v| tried(1.6, v)) }
    }

    fn acted(speed_m_s: f64, after_m_s: f64) -> Acted {
        Acted { tried: tried(1.5, speed_m_s), distance: 0.1, after_m_s }
    }

    #[test]
    fn an_actor_that_stops_at_once_does_not_differ_and_one_that_takes_its_time_does() {
        let states = vec![best(0.0, [0.0; 3]); 4];
        let at_once = Numbers::of(&states, &[acted(0.001, 0.002); 4]);
        assert_eq!(differs("air", "it", &at_once).verdict, Verdict::Fails);
        assert_eq!(more_steps("air", "it", &at_once).verdict, Verdict::Fails);
        let slow = Numbers::of(&states, &[acted(1.0, 0.2); 4]);
        assert_eq!(differs("air", "it", &slow).verdict, Verdict::Holds);
        assert_eq!(more_steps("air", "it", &slow).verdict, Verdict::Holds);
        assert_eq!(slow.distance, 0.1);
    }

    #[test]
    fn states_from_which_nothing_stops_are_not_held_against_the_actor() {
        let states = [best(0.0, [0.0; 3]), best(2.0, [2.0; 3])];
        let numbers = Numbers::of(&states, &[acted(0.0, 0.0), acted(f64::INFINITY, 5.0)]);
        assert_eq!((numbers.stops, numbers.falls), (1.0, 0.0));
    }

    #[test]
    fn pattern_search_is_credited_with_what_it_finds() {
        let found = vec![best(0.0, [3.0, 0.0, f64::INFINITY]); 3];
        let claim = pattern_search("air", &found);
        assert_eq!(claim.verdict, Verdict::Holds);
        assert!(claim.measured.contains("from 0.000 with one"), "{claim:?}");
        let missed = vec![best(0.0, [3.0; 3]); 3];
        assert_eq!(pattern_search("air", &missed).verdict, Verdict::Fails);
    }
}
