//! Figures 9 and 10: tracking a set-point of 1 m/s under several gains, in water and in air.

use std::fmt::Write as _;

use leg_control::actor::Actor;
use leg_control::policy::GainPoint;
use rayon::prelude::*;

use crate::agents::{CHOICE, TrainedAgent};
use crate::analysis::apex_run::{
    START, authors_actor, mean_and_amplitude, run_cascade, run_policy,
};
use crate::{Claim, Extent, Figure, FigureContext, FiguresError, RenderedFigure, Verdict};
use leg_charts::color::SERIES;
use leg_charts::{Axis, Mark, Panel, Sheet};
use trainer::evaluate::hopper;

/// The set-point, m/s.
const SET_POINT_M_S: f32 = 1.0;
/// Number of hops of a run, of those drawn, and of those evaluated: the last.
const HOPS: usize = 200;
const DRAWN: usize = 80;
const EVALUATED: usize = 20;
/// Gains that are tried.
const KP: [f32; 6] = [0.0, 0.1, 0.2, 0.4, 0.7, 1.0];
const KI: [f32; 4] = [0.02, 0.05, 0.1, 0.2];
const KD: [f32; 5] = [0.02, 0.05, 0.1, 0.2, 0.4];
/// Limit of the offset, m/s: so high that it is never reached.
const LIMIT_M_S: f32 = 10.0;
/// Errors and oscillations below this count as none, m/s.
const NONE_M_S: f64 = 0.01;
/// Largest oscillation that counts as slight, and largest error that counts as small, m/s.
const SLIGHT_M_S: f64 = 0.3;
const SMALL_M_S: f64 = 0.2;
/// Errors below this count as none on average, m/s.
const ON_AVERAGE_M_S: f64 = 0.1;
/// Constant offsets that show how fast an agent can move, in steps of 0.5 m/s.
const OFFSETS_M_S: std::ops::RangeInclusive<i32> = 0..=20;

/// Figure 9 or 10: tracking a set-point in a medium.
pub(super) struct SetPointFigure {
    id: &'static str,
    title: &'static str,
    paper: &'static str,
    medium: Medium,
    /// The stage of the transferred agent's training whose actor is used.
    stage: usize,
    authors: &'static str,
}

/// A medium, with claims of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Medium {
    Water,
    Air,
}

impl Medium {
    fn density_ratio(self) -> f32 {
        match self {
            Self::Water => 1.0,
            Self::Air => 0.0,
        }
    }
}

pub(super) const FIG09: SetPointFigure = SetPointFigure {
    id: "fig09",
    title: "Tracking 1 m/s in water under the cascade's gains",
    paper: "The agent observes its velocity minus the set-point and minus a proportional term. In \
            water it then behaves like a strongly damped spring, with small steady-state errors. A \
            derivative term reduces oscillations, an integral term the steady-state error.",
    medium: Medium::Water,
    stage: 0,
    authors: "water",
};

pub(super) const FIG10: SetPointFigure = SetPointFigure {
    id: "fig10",
    title: "Tracking 1 m/s in air under the cascade's gains",
    paper: "The transferred agent reaches the set-point on average, with slight oscillations around \
            it. A derivative term would reduce the oscillations, an integral term the steady-state \
            error. (The paper shows the proportional term; the published code uses an integral \
            term.)",
    medium: Medium::Air,
    stage: 1,
    authors: "water_to_air",
};

impl Figure for SetPointFigure {
    fn id(&self) -> &'static str {
        self.id
    }

    fn title(&self) -> &'static str {
        self.title
    }

    fn paper(&self) -> &'static str {
        self.paper
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        extent.of(0.5, 0.1) // Without the trainings of figure 3.
    }

    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError> {
        let transferred = ctx.transferred()?;
        let sweep = |agent: &TrainedAgent| {
            GainSweep::of(&agent.actor_after(self.stage).actor(), self.medium)
        };
        let all: Vec<Vec<Claim>> =
            transferred.all.par_iter().map(|agent| sweep(agent).claims("")).collect();
        let ours = sweep(transferred.shown());
        let theirs = authors_actor(ctx.reference.as_ref(), self.authors)?;
        let theirs = theirs.map(|actor| GainSweep::of(&actor.actor(), self.medium));
        let sets = [("ours", Some(&ours)), ("the authors'", theirs.as_ref())];
        let sets: Vec<(&str, &GainSweep)> =
            sets.into_iter().filter_map(|(whose, sweep)| Some((whose, sweep?))).collect();
        let measured = format!(
            "{} seeds; drawn is seed {}, {CHOICE}. Each run starts with 1 m/s at 2 m; the values are of \
             the last {EVALUATED} of {HOPS} hops. {}",
            all.len(),
            transferred.shown().seed,
            sets.iter().map(|(whose, sweep)| sweep.summary(whose)).collect::<String>(),
        );
        let mut claims = Claim::over_seeds(&all, &ours.claims(""));
        if let Some(theirs) = &theirs {
            claims.extend(theirs.claims("The authors' agent: "));
        }
        Ok(RenderedFigure { svg: self.draw(&sets)?, csv: table(&sets), measured, claims })
    }
}

impl SetPointFigure {
    fn draw(&self, sets: &[(&str, &GainSweep)]) -> Result<String, FiguresError> {
        let rows = sets.iter().map(|(whose, sweep)| {
            let alone = [("P", &sweep.p), ("I", &sweep.i), ("D", &sweep.d_alone)];
            let damped = sweep.best_damped().map(|runs| ("P with D", runs));
            let named = alone.into_iter().chain(damped);
            named.map(|(name, runs)| panel(&format!("{whose}: {name}"), runs)).collect()
        });
        let title = format!(
            "Figure {}. {}",
            self.id.trim_start_matches("fig").trim_start_matches('0'),
            self.title
        );
        let note = "from 1 m/s at 2 m; a line ends where the leg falls";
        Ok(Sheet::new(title, note).rows(226, rows.collect()).draw()?)
    }
}

/// Runs under every gain of each term of the cascade.
struct GainSweep {
    medium: Medium,
    p: Vec<Run>,
    /// For each proportional gain that oscillates: first the proportional term alone, then
    /// with every derivative gain.
    d: Vec<Vec<Run>>,
    d_alone: Vec<Run>,
    i: Vec<Run>,
    /// The highest mean velocity with any constant offset, m/s.
    fastest_m_s: f64,
}

/// A run under some gains.
#[derive(Clone, Debug)]
struct Run {
    gains: GainPoint,
    vx_m_s: Vec<f64>,
    /// Error of the mean and half the range, m/s; `None` after a fall.
    settled: Option<(f64, f64)>,
}

impl Run {
    fn of(actor: &Actor<'_>, gains: GainPoint) -> Self {
        let hopper = hopper(f64::from(gains.density_ratio));
        let run = run_cascade(actor, &hopper, gains, SET_POINT_M_S, START, HOPS);
        let settled = run.last_vx_m_s(EVALUATED).map(|v| {
            let (mean, amplitude) = mean_and_amplitude(&v);
            (mean - f64::from(SET_POINT_M_S), amplitude)
        });
        Self { gains, vx_m_s: run.apexes.iter().map(|apex| apex.vx_m_s).collect(), settled }
    }

    /// Returns half the range of the evaluated hops, m/s; infinite after a fall.
    fn amplitude(&self) -> f64 {
        self.settled.map_or(f64::INFINITY, |(_, amplitude)| amplitude)
    }

    /// Returns the absolute error of the mean, m/s; infinite after a fall.
    fn error(&self) -> f64 {
        self.settled.map_or(f64::INFINITY, |(error, _)| error.abs())
    }

    fn name(&self) -> String {
        let terms = [("kp", self.gains.kp), ("ki", self.gains.ki), ("kd", self.gains.kd)];
        let named: Vec<String> = terms
            .iter()
            .filter(|(_, gain)| *gain != 0.0)
            .map(|(name, gain)| format!("{name} {gain}"))
            .collect();
        if named.is_empty() { "no term".into() } else { named.join(", ") }
    }

    fn summary(&self) -> String {
        match self.settled {
            Some((error, amplitude)) => format!("{} {error:+.3} ± {amplitude:.3}", self.name()),
            None => format!("{} falls after {} hops", self.name(), self.vx_m_s.len() - 1),
        }
    }
}

/// Returns the run that oscillates least; the first if all fall.
fn calmest(runs: &[Run]) -> &Run {
    runs.iter().min_by(|a, b| a.amplitude().total_cmp(&b.amplitude())).expect("several gains")
}

/// Returns the run with the least error; the first if all fall.
fn nearest(runs: &[Run]) -> &Run {
    runs.iter().min_by(|a, b| a.error().total_cmp(&b.error())).expect("several gains")
}

impl GainSweep {
    fn of(actor: &Actor<'_>, medium: Medium) -> Self {
        let density_ratio = medium.density_ratio();
        let base = GainPoint {
            density_ratio,
            feed_forward: 1.0,
            limit_m_s: LIMIT_M_S,
            ..GainPoint::default()
        };
        let p: Vec<Run> = KP.map(|kp| Run::of(actor, GainPoint { kp, ..base })).into();
        let unsteady = p.iter().filter(|run| run.settled.is_some() && run.amplitude() > NONE_M_S);
        let damped = |alone: &Run| {
            let with = KD.map(|kd| Run::of(actor, GainPoint { kd, ..alone.gains }));
            std::iter::once(alone.clone()).chain(with).collect()
        };
        let d = unsteady.map(damped).collect();
        let d_alone = KD.map(|kd| Run::of(actor, GainPoint { kd, ..base })).into();
        let i = KI.map(|ki| Run::of(actor, GainPoint { ki, ..base })).into();
        Self { medium, p, d, d_alone, i, fastest_m_s: fastest(actor, density_ratio) }
    }

    /// Returns the runs of the proportional gain that derivative gains help most.
    fn best_damped(&self) -> Option<&Vec<Run>> {
        let ratio = |runs: &Vec<Run>| calmest(&runs[1..]).amplitude() / runs[0].amplitude();
        self.d.iter().min_by(|a, b| ratio(a).total_cmp(&ratio(b)))
    }

    fn summary(&self, whose: &str) -> String {
        let list = |runs: &[Run]| runs.iter().map(Run::summary).collect::<Vec<_>>().join("; ");
        let damped = self.best_damped().map_or_else(
            || "no run oscillates that it could damp".to_owned(),
            |runs| list(&runs[1..]),
        );
        format!(
            "Steady-state error and oscillation, m/s, {whose}: P: {}. I: {}. D: {}. P with D: \
             {damped}. The highest mean velocity with any constant offset is {:.2} m/s. ",
            list(&self.p),
            list(&self.i),
            list(&self.d_alone),
            self.fastest_m_s
        )
    }

    fn claims(&self, whose: &str) -> Vec<Claim> {
        match self.medium {
            Medium::Water => vec![self.like_a_damped_spring(whose), self.integrates(whose)],
            Medium::Air => {
                vec![self.on_average(whose), self.damps(whose), self.integrates(whose)]
            }
        }
    }

    /// Describes error and oscillation of the proportional gains.
    fn p_summary(&self) -> String {
        let standing: Vec<(f64, f64)> = self.p.iter().filter_map(|run| run.settled).collect();
        if standing.is_empty() {
            return format!("it falls with each of the {} gains", self.p.len());
        }
        let span = |values: &mut dyn Iterator<Item = f64>| {
            let (low, high) =
                values.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
            format!("{low:.3} to {high:.3} m/s")
        };
        format!(
            "{} of {} gains without a fall: error {}, oscillation {}; the highest mean velocity with \
             any constant offset is {:.2} m/s",
            standing.len(),
            self.p.len(),
            span(&mut standing.iter().map(|(error, _)| error.abs())),
            span(&mut standing.iter().map(|(_, amplitude)| *amplitude)),
            self.fastest_m_s
        )
    }

    fn like_a_damped_spring(&self, whose: &str) -> Claim {
        let mut standing = self.p.iter().filter(|run| run.settled.is_some()).peekable();
        let damped = standing.peek().is_some() && standing.all(|run| run.amplitude() <= NONE_M_S);
        Claim::new(
            format!(
                "{whose}In water it behaves like a strongly damped spring, with small \
                 steady-state errors"
            ),
            self.p_summary(),
            match (damped, nearest(&self.p).error() <= SMALL_M_S) {
                (true, true) => Verdict::Holds,
                (false, false) => Verdict::Fails,
                _ => Verdict::InPart,
            },
        )
    }

    fn on_average(&self, whose: &str) -> Claim {
        let there: Vec<&Run> = self.p.iter().filter(|r| r.error() <= ON_AVERAGE_M_S).collect();
        let slight = there.iter().any(|r| r.amplitude() > 1e-3 && r.amplitude() <= SLIGHT_M_S);
        Claim::new(
            format!(
                "{whose}In air, with a proportional term, it reaches the set-point on average, \
                 with slight oscillations"
            ),
            self.p_summary(),
            match (there.is_empty(), slight) {
                (false, true) => Verdict::Holds,
                (true, _) => Verdict::Fails,
                _ => Verdict::InPart,
            },
        )
    }

    fn damps(&self, whose: &str) -> Claim {
        let statement = format!("{whose}A derivative term reduces the oscillations");
        let Some(best) = self.best_damped() else {
            return Claim::new(
                statement,
                "no proportional gain oscillates without a fall",
                Verdict::InPart,
            );
        };
        let lessened =
            self.d.iter().filter(|d| calmest(&d[1..]).amplitude() < 0.9 * d[0].amplitude());
        let (count, of) = (lessened.count(), self.d.len());
        let (alone, with) = (&best[0], calmest(&best[1..]));
        let after = match with.settled {
            Some((_, amplitude)) => format!("{amplitude:.3} m/s with {}", with.name()),
            None => "a fall with every derivative gain".to_owned(),
        };
        Claim::new(
            statement,
            format!(
                "with {count} of {of} proportional gains that oscillate; in the best case from \
                 {:.3} m/s with {} to {after}",
                alone.amplitude(),
                alone.name()
            ),
            match count {
                0 => Verdict::Fails,
                count if count == of => Verdict::Holds,
                _ => Verdict::InPart,
            },
        )
    }

    fn integrates(&self, whose: &str) -> Claim {
        let (p, i) = (nearest(&self.p), nearest(&self.i));
        let measured = |run: &Run| match run.settled {
            Some((error, _)) => format!("{:.4} m/s with {}", error.abs(), run.name()),
            None => "a fall with every gain".to_owned(),
        };
        Claim::new(
            format!("{whose}An integral term reduces the steady-state error"),
            format!("least error, P: {}; I: {}", measured(p), measured(i)),
            if i.error() <= NONE_M_S || i.error() <= p.error() / 2.0 && i.settled.is_some() {
                Verdict::Holds
            } else if i.error() < p.error() {
                Verdict::InPart
            } else {
                Verdict::Fails
            },
        )
    }
}

/// Returns the highest mean velocity with any constant offset, m/s; 0 if all runs fall.
fn fastest(actor: &Actor<'_>, density_ratio: f32) -> f64 {
    let rho = f64::from(density_ratio);
    let mean = |half_m_s: i32| {
        let offset = half_m_s as f32 / 2.0;
        let run = run_policy(actor, &hopper(rho), rho, START, HOPS, |_| offset);
        run.last_vx_m_s(EVALUATED).map_or(0.0, |v| mean_and_amplitude(&v).0)
    };
    OFFSETS_M_S.map(mean).fold(0.0, f64::max)
}

fn panel(title: &str, runs: &[Run]) -> Panel {
    let drawn = |run: &Run| -> Vec<(f64, f64)> {
        run.vx_m_s.iter().take(DRAWN + 1).enumerate().map(|(i, v)| (i as f64, *v)).collect()
    };
    // A run that diverges before it falls must not flatten the others.
    let shown = runs.iter().flat_map(drawn).map(|(_, v)| v.clamp(-2.0, 4.0));
    let y = Axis::around("apex velocity, m/s", shown.chain([0.0, 1.5]));
    let mut marks = vec![Mark::guide(vec![(0.0, 1.0), (DRAWN as f64, 1.0)])];
    for (run, color) in runs.iter().zip(SERIES) {
        let points = drawn(run).into_iter().map(|(x, v)| (x, v.clamp(y.range.start, y.range.end)));
        marks.push(Mark::line(points.collect(), color).label(run.name()));
    }
    Panel { title: title.to_owned(), x: Axis::new("apex", 0.0..DRAWN as f64), y, marks }
}

fn table(sets: &[(&str, &GainSweep)]) -> String {
    let mut csv = String::from("whose,term,kp,ki,kd,apex,vx_m_s\n");
    for (whose, sweep) in sets {
        let whose = whose.trim_start_matches("the ").trim_end_matches('\'');
        let damped = sweep.d.concat();
        let terms = [("p", &sweep.p), ("i", &sweep.i), ("d", &sweep.d_alone), ("p_d", &damped)];
        for (term, runs) in terms {
            for Run { gains, vx_m_s, .. } in runs {
                for (i, v) in vx_m_s.iter().enumerate() {
                    let GainPoint { kp, ki, kd, .. } = gains;
                    let _ = writeln!(csv, "{whose},{term},{kp},{ki},{kd},{i},{v}");
                }
            }
        }
    }
    csv
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(settled: Option<(f64, f64)>) -> Run {
        Run { gains: GainPoint::default(), vx_m_s: vec![1.0; 3], settled }
    }

    /// Returns the verdicts for error and oscillation of the proportional gains, of the best
    /// derivative gain with each that oscillates, and of the best integral gain.
    fn verdicts(
        medium: Medium,
        p: &[(f64, f64)],
        d: (f64, f64),
        i: Option<(f64, f64)>,
    ) -> Vec<Verdict> {
        let p: Vec<Run> = p.iter().map(|settled| run(Some(*settled))).collect();
        let unsteady = p.iter().filter(|run| run.amplitude() > NONE_M_S);
        let d = unsteady.map(|alone| vec![alone.clone(), run(None), run(Some(d))]).collect();
        let i = vec![run(None), run(i)];
        let sweep = GainSweep { medium, p, d, d_alone: vec![run(None)], i, fastest_m_s: 1.0 };
        sweep.claims("").into_iter().map(|claim| claim.verdict).collect()
    }

    #[test]
    fn in_water_verdicts_follow_damping_and_error() {
        use Verdict::{Fails, Holds, InPart};
        let of = |p: &[(f64, f64)], i| verdicts(Medium::Water, p, (0.0, 0.0), i);
        assert_eq!(of(&[(-0.3, 0.0), (0.1, 0.005)], Some((1e-4, 0.0))), [Holds, Holds]);
        assert_eq!(of(&[(-0.3, 0.0)], Some((0.25, 0.0))), [InPart, InPart]);
        assert_eq!(of(&[(-0.3, 0.2)], None), [Fails, Fails]);
    }

    #[test]
    fn in_air_the_verdict_on_each_term_follows_its_purpose() {
        use Verdict::{Fails, Holds, InPart};
        let of = |p: &[(f64, f64)], d, i| verdicts(Medium::Air, p, d, i);
        let as_described = of(&[(-0.3, 0.0), (0.05, 0.1)], (0.2, 0.01), Some((1e-4, 0.0)));
        assert_eq!(as_described, [Holds; 3]);
        let otherwise = of(&[(0.2, 0.9)], (0.2, 0.95), Some((0.3, 0.0)));
        assert_eq!(otherwise, [Fails; 3]);
        let calm = of(&[(0.05, 0.0)], (0.3, 0.0), Some((0.04, 0.0)));
        assert_eq!(calm, [InPart; 3]);
    }

    #[test]
    fn the_fastest_constant_offset_agrees_with_the_evaluations_ramp() {
        let policy = leg_control::policy::Policy::parse(leg_control::policy::SHIPPED).unwrap();
        let water = fastest(policy.actor(), 1.0);
        assert!((1.0..2.0).contains(&water), "{water} m/s: the evaluation's ramp reaches 1.2");
    }
}
