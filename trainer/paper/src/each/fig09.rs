//! Figures 9 and 10: following 1 m/s under several gains, in water and in air.

use std::fmt::Write as _;

use leg_control::actor::Actor;
use leg_control::policy::GainPoint;
use rayon::prelude::*;

use crate::agents::Learnt;
use crate::picture::{Axis, COLORS, Mark, Panel, Sheet};
use crate::study::flown::{START, authors_actor, fly, follow, mean_and_swing};
use crate::{Claim, Extent, Figure, FiguresError, Made, Verdict, Workshop};
use trainer::evaluate::hopper;

/// The speed asked for, m/s.
const ASKED_M_S: f32 = 1.0;
/// Hops of a run, of those that are drawn, and of those that are judged: the last.
const HOPS: usize = 200;
const DRAWN: usize = 80;
const JUDGED: usize = 20;
/// Gains that are tried.
const KP: [f32; 6] = [0.0, 0.1, 0.2, 0.4, 0.7, 1.0];
const KI: [f32; 4] = [0.02, 0.05, 0.1, 0.2];
const KD: [f32; 5] = [0.02, 0.05, 0.1, 0.2, 0.4];
/// Bound of the offset, m/s: out of the way.
const LIMIT_M_S: f32 = 10.0;
/// Errors and oscillations below this are none, m/s.
const NONE_M_S: f64 = 0.01;
/// The most that is called a slight oscillation, and a small error, m/s.
const SLIGHT_M_S: f64 = 0.3;
const SMALL_M_S: f64 = 0.2;
/// Errors of the mean below this are none on average, m/s.
const ON_AVERAGE_M_S: f64 = 0.1;
/// Constant offsets that show how fast an agent goes at all, m/s.
const OFFSETS_M_S: std::ops::RangeInclusive<i32> = 0..=20;

/// Following a speed in a medium: figure 9 or 10.
pub(super) struct Following {
    id: &'static str,
    title: &'static str,
    paper: &'static str,
    medium: InMedium,
    /// The stage of the transferred agent's training after which it is taken.
    stage: usize,
    authors: &'static str,
}

/// Of the two media, each with a claim of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
enum InMedium {
    Water,
    Air,
}

impl InMedium {
    fn density_ratio(self) -> f32 {
        match self {
            Self::Water => 1.0,
            Self::Air => 0.0,
        }
    }
}

pub(super) const FIG09: Following = Following {
    id: "fig09",
    title: "Following 1 m/s in water, by the cascade's gains",
    paper: "Shown a velocity that is off by the speed asked for and by a proportional term, the \
            agent in water behaves like a heavily damped spring, with small steady-state errors. \
            A derivative term lessens oscillations, an integral term the steady-state error.",
    medium: InMedium::Water,
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
    medium: InMedium::Air,
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

    fn cost_s(&self, extent: Extent) -> f64 {
        extent.of(0.5, 0.1) // Beside the trainings of figure 3.
    }

    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError> {
        let transferred = shop.transferred()?;
        let terms =
            |learnt: &Learnt| Terms::of(&learnt.actor_after(self.stage).actor(), self.medium);
        let all: Vec<Vec<Claim>> =
            transferred.all.par_iter().map(|learnt| terms(learnt).claims("")).collect();
        let ours = terms(transferred.shown());
        let theirs = authors_actor(shop.reference.as_ref(), self.authors)?;
        let theirs = theirs.map(|actor| Terms::of(&actor.actor(), self.medium));
        let sets = [("ours", Some(&ours)), ("the authors'", theirs.as_ref())];
        let sets: Vec<(&str, &Terms)> =
            sets.into_iter().filter_map(|(whose, terms)| Some((whose, terms?))).collect();
        let measured = format!(
            "{} seeds; drawn is {}, which hops on from most starts in water and on land: from 1 m/s at 2 m, shown 1 m/s less than it has and the term's \
             share less; judged by the last {JUDGED} of {HOPS} hops. {}",
            all.len(),
            transferred.shown().seed,
            sets.iter().map(|(whose, terms)| terms.words(whose)).collect::<String>(),
        );
        let mut claims = Claim::over_seeds(&all, &ours.claims(""));
        if let Some(theirs) = &theirs {
            claims.extend(theirs.claims("The authors' agent: "));
        }
        Ok(Made { svg: self.draw(&sets)?, csv: table(&sets), measured, claims })
    }
}

impl Following {
    fn draw(&self, sets: &[(&str, &Terms)]) -> Result<String, FiguresError> {
        let rows = sets.iter().map(|(whose, terms)| {
            let alone = [("P", &terms.p), ("I", &terms.i), ("D", &terms.d_alone)];
            let damped = terms.best_damped().map(|runs| ("P with D", runs));
            let named = alone.into_iter().chain(damped);
            named.map(|(name, runs)| panel(&format!("{whose}: {name}"), runs)).collect()
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
    medium: InMedium,
    p: Vec<Run>,
    /// Beside each proportional gain that oscillates, every derivative gain; the
    /// first of each is the proportional term alone.
    d: Vec<Vec<Run>>,
    d_alone: Vec<Run>,
    i: Vec<Run>,
    /// The highest mean velocity that any constant offset comes to, m/s.
    fastest_m_s: f64,
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

    /// Half the range of what has settled, m/s; infinite after a fall.
    fn swing(&self) -> f64 {
        self.settled.map_or(f64::INFINITY, |(_, swing)| swing)
    }

    /// By how much the mean misses, m/s; infinite after a fall.
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

    fn words(&self) -> String {
        match self.settled {
            Some((error, swing)) => format!("{} {error:+.3} ± {swing:.3}", self.name()),
            None => format!("{} falls after {} hops", self.name(), self.vx_m_s.len() - 1),
        }
    }
}

/// The run that oscillates least, and that which misses least; the first, if all fall.
fn calmest(runs: &[Run]) -> &Run {
    runs.iter().min_by(|a, b| a.swing().total_cmp(&b.swing())).expect("several gains")
}

fn nearest(runs: &[Run]) -> &Run {
    runs.iter().min_by(|a, b| a.error().total_cmp(&b.error())).expect("several gains")
}

impl Terms {
    fn of(actor: &Actor<'_>, medium: InMedium) -> Self {
        let density_ratio = medium.density_ratio();
        let base = GainPoint {
            density_ratio,
            feed_forward: 1.0,
            limit_m_s: LIMIT_M_S,
            ..GainPoint::default()
        };
        let p: Vec<Run> = KP.map(|kp| Run::of(actor, GainPoint { kp, ..base })).into();
        let unsteady = p.iter().filter(|run| run.settled.is_some() && run.swing() > NONE_M_S);
        let damped = |alone: &Run| {
            let with = KD.map(|kd| Run::of(actor, GainPoint { kd, ..alone.gains }));
            std::iter::once(alone.clone()).chain(with).collect()
        };
        let d = unsteady.map(damped).collect();
        let d_alone = KD.map(|kd| Run::of(actor, GainPoint { kd, ..base })).into();
        let i = KI.map(|ki| Run::of(actor, GainPoint { ki, ..base })).into();
        Self { medium, p, d, d_alone, i, fastest_m_s: fastest(actor, density_ratio) }
    }

    /// The derivative gains beside the proportional gain that they help most.
    fn best_damped(&self) -> Option<&Vec<Run>> {
        let ratio = |runs: &Vec<Run>| calmest(&runs[1..]).swing() / runs[0].swing();
        self.d.iter().min_by(|a, b| ratio(a).total_cmp(&ratio(b)))
    }

    fn words(&self, whose: &str) -> String {
        let list = |runs: &[Run]| runs.iter().map(Run::words).collect::<Vec<_>>().join("; ");
        let damped = self.best_damped().map_or_else(
            || "nothing oscillates that it could damp".to_owned(),
            |runs| list(&runs[1..]),
        );
        format!(
            "Steady-state error and oscillation, m/s, {whose}: P: {}. I: {}. D: {}. D beside P: \
             {damped}. With any constant offset it goes at {:.2} m/s at most. ",
            list(&self.p),
            list(&self.i),
            list(&self.d_alone),
            self.fastest_m_s
        )
    }

    fn claims(&self, whose: &str) -> Vec<Claim> {
        match self.medium {
            InMedium::Water => vec![self.like_a_damped_spring(whose), self.integrates(whose)],
            InMedium::Air => {
                vec![self.on_average(whose), self.damps(whose), self.integrates(whose)]
            }
        }
    }

    /// Error and oscillation of the proportional gains, in words.
    fn p_in_words(&self) -> String {
        let standing: Vec<(f64, f64)> = self.p.iter().filter_map(|run| run.settled).collect();
        if standing.is_empty() {
            return format!("it falls under each of the {} gains", self.p.len());
        }
        let span = |values: &mut dyn Iterator<Item = f64>| {
            let (low, high) =
                values.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
            format!("{low:.3} to {high:.3} m/s")
        };
        format!(
            "{} of {} gains without a fall: error {}, oscillation {}; with any constant offset it \
             goes at {:.2} m/s at most",
            standing.len(),
            self.p.len(),
            span(&mut standing.iter().map(|(error, _)| error.abs())),
            span(&mut standing.iter().map(|(_, swing)| *swing)),
            self.fastest_m_s
        )
    }

    fn like_a_damped_spring(&self, whose: &str) -> Claim {
        let mut standing = self.p.iter().filter(|run| run.settled.is_some()).peekable();
        let damped = standing.peek().is_some() && standing.all(|run| run.swing() <= NONE_M_S);
        Claim::new(
            format!(
                "{whose}In water it acts like a strongly damped spring, with small steady-state \
                 errors"
            ),
            self.p_in_words(),
            match (damped, nearest(&self.p).error() <= SMALL_M_S) {
                (true, true) => Verdict::Holds,
                (false, false) => Verdict::Fails,
                _ => Verdict::InPart,
            },
        )
    }

    fn on_average(&self, whose: &str) -> Claim {
        let there: Vec<&Run> = self.p.iter().filter(|r| r.error() <= ON_AVERAGE_M_S).collect();
        let slight = there.iter().any(|r| r.swing() > 1e-3 && r.swing() <= SLIGHT_M_S);
        Claim::new(
            format!(
                "{whose}In air, under a proportional term, it reaches the speed on average, with \
                 slight oscillations"
            ),
            self.p_in_words(),
            match (there.is_empty(), slight) {
                (false, true) => Verdict::Holds,
                (true, _) => Verdict::Fails,
                _ => Verdict::InPart,
            },
        )
    }

    fn damps(&self, whose: &str) -> Claim {
        let says = format!("{whose}A derivative term lessens the oscillations");
        let Some(best) = self.best_damped() else {
            return Claim::new(says, "no proportional gain oscillates and stands", Verdict::InPart);
        };
        let lessened = self.d.iter().filter(|d| calmest(&d[1..]).swing() < 0.9 * d[0].swing());
        let (count, of) = (lessened.count(), self.d.len());
        let (alone, with) = (&best[0], calmest(&best[1..]));
        let after = match with.settled {
            Some((_, swing)) => format!("{swing:.3} m/s with {}", with.name()),
            None => "a fall with every derivative gain".to_owned(),
        };
        Claim::new(
            says,
            format!(
                "beside {count} of {of} proportional gains that oscillate; best: {:.3} m/s with \
                 {}, {after}",
                alone.swing(),
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
            format!("{whose}An integral term lessens the steady-state error"),
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

/// The highest mean velocity that any constant offset comes to, m/s; 0 where all fall.
fn fastest(actor: &Actor<'_>, density_ratio: f32) -> f64 {
    let rho = f64::from(density_ratio);
    let mean = |half_m_s: i32| {
        let offset = half_m_s as f32 / 2.0;
        let flown = fly(actor, &hopper(rho), rho, START, HOPS, |_| offset);
        flown.last_vx_m_s(JUDGED).map_or(0.0, |v| mean_and_swing(&v).0)
    };
    OFFSETS_M_S.map(mean).fold(0.0, f64::max)
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
        let damped = terms.d.concat();
        let terms = [("p", &terms.p), ("i", &terms.i), ("d", &terms.d_alone), ("p_d", &damped)];
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

    /// Proportional gains, the best derivative one beside each that oscillates, and
    /// the best integral one.
    fn verdicts(
        medium: InMedium,
        p: &[(f64, f64)],
        d: (f64, f64),
        i: Option<(f64, f64)>,
    ) -> Vec<Verdict> {
        let p: Vec<Run> = p.iter().map(|settled| run(Some(*settled))).collect();
        let unsteady = p.iter().filter(|run| run.swing() > NONE_M_S);
        let d = unsteady.map(|alone| vec![alone.clone(), run(None), run(Some(d))]).collect();
        let i = vec![run(None), run(i)];
        let terms = Terms { medium, p, d, d_alone: vec![run(None)], i, fastest_m_s: 1.0 };
        terms.claims("").into_iter().map(|claim| claim.verdict).collect()
    }

    #[test]
    fn in_water_a_spring_is_judged_by_its_damping_and_its_error() {
        use Verdict::{Fails, Holds, InPart};
        let of = |p: &[(f64, f64)], i| verdicts(InMedium::Water, p, (0.0, 0.0), i);
        assert_eq!(of(&[(-0.3, 0.0), (0.1, 0.005)], Some((1e-4, 0.0))), [Holds, Holds]);
        assert_eq!(of(&[(-0.3, 0.0)], Some((0.25, 0.0))), [InPart, InPart]);
        assert_eq!(of(&[(-0.3, 0.2)], None), [Fails, Fails]);
    }

    #[test]
    fn in_air_each_term_is_judged_by_what_it_is_for() {
        use Verdict::{Fails, Holds, InPart};
        let of = |p: &[(f64, f64)], d, i| verdicts(InMedium::Air, p, d, i);
        let said = of(&[(-0.3, 0.0), (0.05, 0.1)], (0.2, 0.01), Some((1e-4, 0.0)));
        assert_eq!(said, [Holds; 3]);
        let otherwise = of(&[(0.2, 0.9)], (0.2, 0.95), Some((0.3, 0.0)));
        assert_eq!(otherwise, [Fails; 3]);
        let calm = of(&[(0.05, 0.0)], (0.3, 0.0), Some((0.04, 0.0)));
        assert_eq!(calm, [InPart; 3]);
    }

    #[test]
    fn any_constant_offset_comes_to_what_the_ramp_reaches() {
        let policy = leg_control::policy::Policy::parse(leg_control::policy::SHIPPED).unwrap();
        let water = fastest(policy.actor(), 1.0);
        assert!((1.0..2.0).contains(&water), "{water} m/s: the evaluation's ramp reaches 1.2");
    }
}
