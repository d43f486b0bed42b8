//! Figures 9 and 10: following 1 m/s under several gains, in water and in air.

use std::fmt::Write as _;

use controller::actor::Actor;
use controller::policy::GainPoint;

use crate::evaluate::hopper;
use crate::figures::picture::{Axis, COLORS, Mark, Panel, Sheet};
use crate::figures::study::flown::{START, authors_actor, follow, mean_and_swing};
use crate::figures::{Claim, Extent, Figure, FiguresError, Made, Verdict, Workshop};

/// The speed asked for, m/s.
const ASKED_M_S: f32 = 1.0;
/// Hops of a run, of those that are drawn, and of those that are judged: the last.
const HOPS: usize = 200;
const DRAWN: usize = 80;
const JUDGED: usize = 20;
/// Gains that are tried.
const KP: [f32; 6] = [0.0, 0.1, 0.2, 0.4, 0.7, 1.0];
const KI: [f32; 4] = [0.02, 0.05, 0.1, 0.2];
const KD: [f32; 4] = [0.1, 0.2, 0.4, 0.8];
/// Bound of the offset, m/s: out of the way.
const LIMIT_M_S: f32 = 10.0;
/// Errors and oscillations below this are none, m/s.
const NONE_M_S: f64 = 0.01;
/// The most that is called slight, m/s.
const SLIGHT_M_S: f64 = 0.3;

/// Following a speed in a medium: figure 9 or 10.
pub(super) struct Following {
    id: &'static str,
    title: &'static str,
    paper: &'static str,
    rho: f32,
    /// The stage of the transferred agent's training after which it is taken.
    stage: usize,
    authors: &'static str,
}

pub(super) const FIG09: Following = Following {
    id: "fig09",
    title: "Following 1 m/s in water, by the cascade's gains",
    paper: "Shown a velocity that is off by the speed asked for and by a proportional term, the \
            agent in water behaves like a heavily damped spring, with small steady-state errors. \
            A derivative term lessens oscillations, an integral term the steady-state error.",
    rho: 1.0,
    stage: 0,
    authors: "water",
};

pub(super) const FIG10: Following = Following {
    id: "fig10",
    title: "Following 1 m/s in air, by the cascade's gains",
    paper: "The transferred agent reaches the speed asked for on average, with slight oscillations \
            about it. A derivative term would lessen the oscillations, an integral term the \
            steady-state error. (The paper shows the proportional term; the published code \
            integrates.)",
    rho: 0.0,
    stage: 1,
    authors: "water_to_air",
};

impl Figure for Following {
    fn id(&self) -> &'static str {
        self.id
    }

    fn title(&self) -> &'static str {
        self.title
    }

    fn paper(&self) -> &'static str {
        self.paper
    }

    fn cost_s(&self, _extent: Extent) -> f64 {
        0.1 // Beside the trainings of figure 3.
    }

    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError> {
        let transferred = shop.transferred()?;
        let ours = transferred.actor_after(self.stage);
        let ours = Terms::of(&ours.actor(), self.rho);
        let theirs = authors_actor(shop.reference.as_ref(), self.authors)?;
        let theirs = theirs.map(|actor| Terms::of(&actor.actor(), self.rho));
        let sets = [("ours", Some(&ours)), ("the authors'", theirs.as_ref())];
        let sets: Vec<(&str, &Terms)> =
            sets.into_iter().filter_map(|(whose, terms)| Some((whose, terms?))).collect();
        let measured = format!(
            "The median seed, {}, from 1 m/s at 2 m, shown 1 m/s less than it has and the term's \
             share less; judged by the last {JUDGED} of {HOPS} hops. {}",
            transferred.seed,
            sets.iter().map(|(whose, terms)| terms.words(whose)).collect::<String>(),
        );
        let mut claims = ours.claims("");
        if let Some(theirs) = &theirs {
            claims.extend(theirs.claims("The authors' agent: "));
        }
        Ok(Made { svg: self.draw(&sets)?, csv: table(&sets), measured, claims })
    }
}

impl Following {
    fn draw(&self, sets: &[(&str, &Terms)]) -> Result<String, FiguresError> {
        let rows = sets.iter().map(|(whose, terms)| {
            let named = [("P alone", &terms.p), ("P with D", &terms.d), ("I alone", &terms.i)];
            named.map(|(name, runs)| panel(&format!("{whose}: {name}"), runs)).into()
        });
        let sheet = Sheet {
            title: format!(
                "Figure {}. {}",
                self.id.trim_start_matches("fig").trim_start_matches('0'),
                self.title
            ),
            note: "from 1 m/s at 2 m; a line ends where the leg falls".into(),
            rows: rows.collect(),
            ..Sheet::default()
        };
        Ok(sheet.draw()?)
    }
}

/// What came of the cascade's terms.
struct Terms {
    p: Vec<Run>,
    /// Beside the proportional gain that oscillates most without a fall; the
    /// first is that alone.
    d: Vec<Run>,
    i: Vec<Run>,
}

/// A run under some gains.
#[derive(Clone, Debug)]
struct Run {
    gains: GainPoint,
    vx_m_s: Vec<f64>,
    /// Error of the mean, and half the range, m/s; none after a fall.
    settled: Option<(f64, f64)>,
}

impl Run {
    fn of(actor: &Actor<'_>, gains: GainPoint) -> Self {
        let hopper = hopper(f64::from(gains.density_ratio));
        let flown = follow(actor, &hopper, gains, ASKED_M_S, START, HOPS);
        let settled = flown.last_vx_m_s(JUDGED).map(|v| {
            let (mean, swing) = mean_and_swing(&v);
            (mean - f64::from(ASKED_M_S), swing)
        });
        Self { gains, vx_m_s: flown.apexes.iter().map(|apex| apex.vx_m_s).collect(), settled }
    }

    fn swing(&self) -> Option<f64> {
        self.settled.map(|(_, swing)| swing)
    }

    fn error(&self) -> Option<f64> {
        self.settled.map(|(error, _)| error.abs())
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

    fn words(&self) -> String {
        match self.settled {
            Some((error, swing)) => format!("{} {error:+.3} +- {swing:.3}", self.name()),
            None => format!("{} falls after {} hops", self.name(), self.vx_m_s.len() - 1),
        }
    }
}

impl Terms {
    fn of(actor: &Actor<'_>, density_ratio: f32) -> Self {
        let base = GainPoint {
            density_ratio,
            feed_forward: 1.0,
            limit_m_s: LIMIT_M_S,
            ..GainPoint::default()
        };
        let p: Vec<Run> = KP.map(|kp| Run::of(actor, GainPoint { kp, ..base })).into();
        let unsteady = unsteadiest(&p);
        let damped = KD.map(|kd| Run::of(actor, GainPoint { kd, ..unsteady.gains }));
        let d = std::iter::once(unsteady.clone()).chain(damped).collect();
        let i = KI.map(|ki| Run::of(actor, GainPoint { ki, ..base })).into();
        Self { p, d, i }
    }

    fn words(&self, whose: &str) -> String {
        let list = |runs: &[Run]| runs.iter().map(Run::words).collect::<Vec<_>>().join("; ");
        format!(
            "Steady-state error and oscillation, m/s, {whose}: P: {}. D: {}. I: {}. ",
            list(&self.p),
            list(&self.d[1..]),
            list(&self.i)
        )
    }

    fn claims(&self, whose: &str) -> Vec<Claim> {
        vec![self.p_alone(whose), self.damps(whose), self.integrates(whose)]
    }

    fn p_alone(&self, whose: &str) -> Claim {
        let standing: Vec<(f64, f64)> = self.p.iter().filter_map(|run| run.settled).collect();
        let errors: Vec<f64> = standing.iter().map(|(error, _)| error.abs()).collect();
        let errs = !errors.is_empty() && errors.iter().all(|error| *error > NONE_M_S);
        let slight = |swing: f64| swing > 1e-3 && swing <= SLIGHT_M_S;
        let swings = standing.iter().any(|(_, swing)| slight(*swing));
        let (least, most) = extremes(&errors);
        let (calmest, wildest) = extremes(&standing.iter().map(|s| s.1).collect::<Vec<_>>());
        Claim::new(
            format!(
                "{whose}A proportional term alone leaves a steady-state error and slight \
                 oscillations"
            ),
            format!(
                "{} of {} gains without a fall: error {least:.3} to {most:.3} m/s, oscillation \
                 {calmest:.3} to {wildest:.3} m/s",
                standing.len(),
                self.p.len()
            ),
            match (errs, swings) {
                (true, true) => Verdict::Holds,
                (false, false) => Verdict::Fails,
                _ => Verdict::InPart,
            },
        )
    }

    fn damps(&self, whose: &str) -> Claim {
        let alone = &self.d[0];
        let best = self.d[1..]
            .iter()
            .filter(|run| run.settled.is_some())
            .min_by(|a, b| a.swing().partial_cmp(&b.swing()).expect("finite"));
        let says = format!("{whose}A derivative term lessens the oscillations");
        let (Some(before), Some(best)) = (alone.swing(), best) else {
            return Claim::new(says, "no run without a fall", Verdict::Fails);
        };
        let after = best.swing().unwrap_or(f64::INFINITY);
        let measured =
            format!("{before:.3} m/s with {}, {after:.3} m/s with {}", alone.name(), best.name());
        if before <= 1e-3 {
            return Claim::new(
                says,
                format!("{measured}: there was none to lessen"),
                Verdict::InPart,
            );
        }
        Claim::new(says, measured, Verdict::of(after < 0.9 * before))
    }

    fn integrates(&self, whose: &str) -> Claim {
        let says = format!("{whose}An integral term lessens the steady-state error");
        let best = |runs: &[Run]| {
            let standing = runs.iter().filter(|run| run.settled.is_some());
            standing.min_by(|a, b| a.error().partial_cmp(&b.error()).expect("finite")).cloned()
        };
        match (best(&self.p), best(&self.i)) {
            (Some(p), Some(i)) => {
                let [before, after] = [&p, &i].map(|run| run.error().unwrap_or(f64::INFINITY));
                let measured = format!(
                    "least error {before:.4} m/s with {}, {after:.4} m/s with {}",
                    p.name(),
                    i.name()
                );
                let verdict = if after <= NONE_M_S || after <= before / 2.0 {
                    Verdict::Holds
                } else if after < before {
                    Verdict::InPart
                } else {
                    Verdict::Fails
                };
                Claim::new(says, measured, verdict)
            }
            (None, Some(i)) => Claim::new(
                says,
                format!(
                    "P alone falls; {:.4} m/s with {}",
                    i.error().unwrap_or(f64::INFINITY),
                    i.name()
                ),
                Verdict::of(i.error().is_some_and(|error| error <= NONE_M_S)),
            ),
            _ => Claim::new(says, "with an integral term alone the leg falls", Verdict::Fails),
        }
    }
}

/// The run that oscillates most without a fall; the first, if all fall.
fn unsteadiest(runs: &[Run]) -> &Run {
    let standing = runs.iter().filter(|run| run.settled.is_some());
    standing.max_by(|a, b| a.swing().partial_cmp(&b.swing()).expect("finite")).unwrap_or(&runs[0])
}

fn extremes(values: &[f64]) -> (f64, f64) {
    (
        values.iter().copied().fold(f64::NAN, f64::min),
        values.iter().copied().fold(f64::NAN, f64::max),
    )
}

fn panel(title: &str, runs: &[Run]) -> Panel {
    let drawn = |run: &Run| -> Vec<(f64, f64)> {
        run.vx_m_s.iter().take(DRAWN + 1).enumerate().map(|(i, v)| (i as f64, *v)).collect()
    };
    // A run that flees before it falls must not flatten the others.
    let shown = runs.iter().flat_map(drawn).map(|(_, v)| v.clamp(-2.0, 4.0));
    let y = Axis::around("apex velocity, m/s", shown.chain([0.0, 1.5]));
    let mut marks = vec![Mark::guide(vec![(0.0, 1.0), (DRAWN as f64, 1.0)])];
    for (run, color) in runs.iter().zip(COLORS) {
        let points = drawn(run).into_iter().map(|(x, v)| (x, v.clamp(y.range.start, y.range.end)));
        marks.push(Mark::line(points.collect(), color, run.name()));
    }
    Panel { title: title.to_owned(), x: Axis::new("apex", 0.0..DRAWN as f64), y, marks }
}

fn table(sets: &[(&str, &Terms)]) -> String {
    let mut csv = String::from("whose,term,kp,ki,kd,apex,vx_m_s\n");
    for (whose, terms) in sets {
        let whose = whose.trim_start_matches("the ").trim_end_matches('\'');
        for (term, runs) in [("p", &terms.p), ("d", &terms.d), ("i", &terms.i)] {
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

    fn verdicts(p: &[(f64, f64)], d: (f64, f64), i: (f64, f64)) -> Vec<Verdict> {
        let p: Vec<Run> = p.iter().map(|settled| run(Some(*settled))).collect();
        let d = vec![unsteadiest(&p).clone(), run(None), run(Some(d))];
        let terms = Terms { p, d, i: vec![run(None), run(Some(i))] };
        terms.claims("").into_iter().map(|claim| claim.verdict).collect()
    }

    #[test]
    fn each_term_is_judged_by_what_it_is_for() {
        let as_said = verdicts(&[(-0.3, 0.0), (0.2, 0.1)], (0.2, 0.01), (1e-4, 0.0));
        assert_eq!(as_said, [Verdict::Holds; 3]);
        let otherwise = verdicts(&[(0.005, 0.9)], (0.2, 0.95), (0.2, 0.0));
        assert_eq!(otherwise, [Verdict::Fails; 3]);
        let calm = verdicts(&[(0.3, 0.0)], (0.3, 0.0), (0.0, 0.0));
        assert_eq!(calm, [Verdict::InPart, Verdict::InPart, Verdict::Holds]);
    }
}
