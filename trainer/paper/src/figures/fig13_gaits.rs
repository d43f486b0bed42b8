//! Figure 13: the gaits of the universal controller in water and in air.

use std::fmt::Write as _;

use leg_control::actor::Actor;
use leg_control::policy::GainPoint;
use leg_plant::{Action, Apex, Body, EventKind, Flat, Leg, LegCommand, Medium, TickPlant};
use rayon::prelude::*;

use crate::agents::{PaperAgent, TrainedAgent, origin};
use crate::analysis::apex_run::{mean_and_amplitude, run_cascade};
use crate::{Claim, Extent, Figure, FigureContext, FiguresError, RenderedFigure, Verdict};
use leg_charts::color::{BLUE, GREEN, INK, ORANGE};
use leg_charts::{Axis, Mark, Panel, Sheet};
use trainer::evaluate::hopper;

/// The set-point, m/s.
const SET_POINT_M_S: f32 = 1.0;
const START: Apex = Apex { vx_m_s: 0.0, y_m: 2.0 };
/// Number of hops of a run, of the last hops that are evaluated, and of those drawn: the
/// first of the evaluated.
const HOPS: usize = 300;
const EVALUATED: usize = 20;
const DRAWN: usize = 3;
/// Time step of a path, s.
const STEP_S: f64 = 2e-3;
/// Gains that are tried in each medium; the paper does not give its own.
const KI: [f32; 5] = [0.02, 0.05, 0.1, 0.2, 0.4];
const FEED_FORWARD: [f32; 4] = [0.0, 0.5, 1.0, 1.5];
/// Angles that differ by less than this are equal, deg.
const SAME_DEG: f64 = 2.0;
/// A gait reaches the set-point if it is within this, m/s.
const NEAR_M_S: f64 = 0.1;
/// Deviation that a fall counts as when seeds are compared, m/s.
const FALLS_M_S: f64 = 1e3;
const MEDIA: [(&str, Medium); 2] = [("air", Medium::AIR), ("water", Medium::WATER)];

pub(super) struct Fig13;

impl Figure for Fig13 {
    fn id(&self) -> &'static str {
        "fig13"
    }

    fn title(&self) -> &'static str {
        "Gaits of the universal controller in water and in air"
    }

    fn paper(&self) -> &'static str {
        "One controller, trained in water and air alternately, with a set-point of 1 m/s. In air it \
         converges to the conservative model, with symmetric touchdown and lift-off angles. In water \
         it converges to a gait in which both angles are acute: the leg pushes from behind."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        // Episodes of universal trainings have twice as many steps.
        0.8 * seeds(extent).count() as f64
    }

    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError> {
        let by_seed = every_seed(ctx)?;
        let reach = [0, 1].map(|i| by_seed.iter().filter(|seed| seed.reaches_in(i)).count());
        let count = by_seed.len();
        let all: Vec<Vec<Claim>> = by_seed.iter().map(SeedGaits::claims).collect();
        let both = by_seed.iter().filter(|seed| seed.reaches_in(0) && seed.reaches_in(1)).count();
        let shown = by_seed.into_iter().next().expect("at least one seed");
        let claims = Claim::over_seeds(&all, &shown.claims());
        let SeedGaits { seed, gaits } = shown;
        let chosen = format!("drawn: seed {seed}, which comes nearest to the set-point");
        ctx.note_policy("universal", origin(PaperAgent::Universal, &seeds(ctx.extent), &chosen));
        let mut measured = format!(
            "{count} seeds; in each medium, the gains are used that come nearest to 1 m/s after {HOPS} \
             hops, from rest at 2 m. {} seeds come within {NEAR_M_S} m/s in air, {} in water, {both} \
             in both. Seed {seed} comes nearest and is drawn. Angles are between the direction of \
             travel and the line from foot to mass; above 90 deg the foot is ahead.",
            reach[0], reach[1],
        );
        for ((medium, _), gait) in MEDIA.iter().zip(&gaits) {
            let _ = match gait {
                Some(gait) => write!(measured, " In {medium}: {}.", gait.summary()),
                None => write!(measured, " In {medium} it falls with all gains that were tried."),
            };
        }
        Ok(RenderedFigure { svg: draw(&gaits)?, csv: table(&gaits), measured, claims })
    }
}

fn seeds(extent: Extent) -> std::ops::Range<u64> {
    0..extent.of(60, 2)
}

/// A universal controller, and its gait in each of [`MEDIA`].
struct SeedGaits {
    seed: u64,
    gaits: [Option<Gait>; 2],
}

impl SeedGaits {
    fn of(agent: &TrainedAgent) -> Self {
        let frozen = agent.actor();
        let gaits = MEDIA.map(|(_, medium)| Gait::best(&frozen.actor(), medium));
        Self { seed: agent.seed, gaits }
    }

    fn claims(&self) -> Vec<Claim> {
        claims(self.gaits.each_ref().map(Option::as_ref))
    }

    fn reaches_in(&self, medium: usize) -> bool {
        self.gaits[medium].as_ref().is_some_and(|gait| gait.deviation_m_s() <= NEAR_M_S)
    }

    /// Returns the sum of the deviations in both media, m/s.
    fn deviation_m_s(&self) -> f64 {
        self.gaits.iter().map(|gait| gait.as_ref().map_or(FALLS_M_S, Gait::deviation_m_s)).sum()
    }
}

/// Computes the gaits of every seed, the one nearest to the set-point first.
fn every_seed(ctx: &FigureContext) -> Result<Vec<SeedGaits>, FiguresError> {
    let mut all = seeds(ctx.extent)
        .collect::<Vec<_>>()
        .into_par_iter()
        .with_max_len(1)
        .map(|seed| ctx.training(PaperAgent::Universal, seed).map(|agent| SeedGaits::of(&agent)))
        .collect::<Result<Vec<_>, _>>()?;
    all.sort_by(|a, b| a.deviation_m_s().total_cmp(&b.deviation_m_s()));
    Ok(all)
}

/// A gait after convergence.
#[derive(Clone, Debug)]
struct Gait {
    gains: GainPoint,
    mean_vx_m_s: f64,
    amplitude_m_s: f64,
    /// The evaluated hops.
    hops: Vec<Stride>,
}

/// One hop: path, foot, and leg at touchdown and lift-off.
#[derive(Clone, Debug)]
#[expect(clippy::struct_field_names, reason = "all fields are lengths with their unit")]
struct Stride {
    /// Positions of the mass from the apex on: x and y, m.
    path_m: Vec<[f64; 2]>,
    foot_x_m: f64,
    /// Vector from foot to mass at touchdown: x and y, m.
    touchdown_m: [f64; 2],
    /// The same at lift-off.
    liftoff_m: [f64; 2],
}

impl Stride {
    /// Returns touchdown and lift-off angle, deg.
    fn angles_deg(&self) -> [f64; 2] {
        [self.touchdown_m, self.liftoff_m].map(|[x, y]| libm::atan2(y, x).to_degrees())
    }
}

impl Gait {
    /// Finds the gains whose gait is nearest to the set-point; `None` if all fall.
    fn best(actor: &Actor<'_>, medium: Medium) -> Option<Self> {
        let all = KI.into_iter().flat_map(|ki| FEED_FORWARD.map(|feed_forward| (ki, feed_forward)));
        let gaits = all.filter_map(|(ki, feed_forward)| {
            let density_ratio = medium.density_ratio() as f32;
            let gains = GainPoint {
                density_ratio,
                ki,
                feed_forward,
                limit_m_s: 10.0,
                ..GainPoint::default()
            };
            Self::of(actor, medium, gains)
        });
        gaits.min_by(|a, b| a.deviation_m_s().total_cmp(&b.deviation_m_s()))
    }

    fn of(actor: &Actor<'_>, medium: Medium, gains: GainPoint) -> Option<Self> {
        let hopper = hopper(medium.density_ratio());
        let run = run_cascade(actor, &hopper, gains, SET_POINT_M_S, START, HOPS);
        let (mean_vx_m_s, amplitude_m_s) = mean_and_amplitude(&run.last_vx_m_s(EVALUATED)?);
        let mut x_m = 0.0;
        let from = HOPS - EVALUATED;
        let hops = run.apexes[from..].iter().zip(&run.actions[from..]).map(|(apex, action)| {
            let stride = stride(x_m, *apex, *action, medium)?;
            x_m = stride.path_m.last()?[0];
            Some(stride)
        });
        Some(Self { gains, mean_vx_m_s, amplitude_m_s, hops: hops.collect::<Option<_>>()? })
    }

    /// Returns how far it is from a steady 1 m/s: error of the mean plus amplitude.
    fn deviation_m_s(&self) -> f64 {
        (self.mean_vx_m_s - f64::from(SET_POINT_M_S)).abs() + self.amplitude_m_s
    }

    /// Returns mean touchdown and mean lift-off angle, deg.
    fn angles_deg(&self) -> [f64; 2] {
        [0, 1].map(|i| {
            self.hops.iter().map(|hop| hop.angles_deg()[i]).sum::<f64>() / self.hops.len() as f64
        })
    }

    /// Returns the mean difference of the two angles from symmetric ones, deg.
    fn asymmetry_deg(&self) -> f64 {
        let deviation_deg = |hop: &Stride| (hop.angles_deg().iter().sum::<f64>() - 180.0).abs();
        self.hops.iter().map(deviation_deg).sum::<f64>() / self.hops.len() as f64
    }

    fn summary(&self) -> String {
        let [touchdown, liftoff] = self.angles_deg();
        format!(
            "{:.3} ± {:.3} m/s (ki {}, feed-forward {}), touchdown at {touchdown:.1} deg, lift-off \
             at {liftoff:.1} deg, {:.1} deg from symmetric",
            self.mean_vx_m_s,
            self.amplitude_m_s,
            self.gains.ki,
            self.gains.feed_forward,
            self.asymmetry_deg()
        )
    }
}

/// Plays a hop of the apex map step by step; `None` if either plant finds no whole hop.
fn stride(x_m: f64, apex: Apex, action: Action, medium: Medium) -> Option<Stride> {
    let touchdown = hopper(medium.density_ratio()).hop(apex, action).touchdown?;
    let start = Body { x_m, vx_m_s: apex.vx_m_s, y_m: apex.y_m, vy_m_s: 0.0 };
    let mut plant = TickPlant::new(Leg::human(), start);
    let mut path_m = vec![[x_m, apex.y_m]];
    let (mut foot, mut touchdown_m, mut liftoff_m) = (None, None, None);
    for tick in 0.. {
        let from_s = f64::from(tick) * STEP_S;
        if from_s > 60.0 {
            break;
        }
        let command = LegCommand {
            leg_angle_rad: action.touchdown_angle_rad,
            elongation_m: action.elongation_speed_m_s * (from_s - touchdown.t_s),
            elongation_rate_m_s: action.elongation_speed_m_s,
        };
        for event in &*plant.step(STEP_S, command, medium, &Flat) {
            let body = event.body;
            match event.kind {
                EventKind::Touchdown { foot_x_m, .. } => {
                    foot = foot.or(Some(foot_x_m));
                    touchdown_m = touchdown_m.or(Some([body.x_m - foot_x_m, body.y_m]));
                }
                EventKind::LiftOff => liftoff_m = liftoff_m.or(Some([body.x_m - foot?, body.y_m])),
                EventKind::Apex => {
                    path_m.push([body.x_m, body.y_m]);
                    return Some(Stride {
                        path_m,
                        foot_x_m: foot?,
                        touchdown_m: touchdown_m?,
                        liftoff_m: liftoff_m?,
                    });
                }
                EventKind::Fall => return None,
            }
        }
        let body = plant.body();
        path_m.push([body.x_m, body.y_m]);
    }
    None
}

fn claims([air, water]: [Option<&Gait>; 2]) -> Vec<Claim> {
    let statement = "One controller reaches 1 m/s in air and in water";
    let speed = |gait: Option<&Gait>| match gait {
        Some(gait) => format!("{:.3} ± {:.3} m/s", gait.mean_vx_m_s, gait.amplitude_m_s),
        None => "it falls".to_owned(),
    };
    let reach =
        [air, water].iter().flatten().filter(|gait| gait.deviation_m_s() <= NEAR_M_S).count();
    let both = Claim::new(
        statement,
        format!("in air {}, in water {}", speed(air), speed(water)),
        [Verdict::Fails, Verdict::InPart, Verdict::Holds][reach],
    );
    let angles = |gait: &Gait| {
        let [touchdown, liftoff] = gait.angles_deg();
        format!(
            "touchdown {touchdown:.1} deg, lift-off {liftoff:.1} deg, {:.1} deg from symmetric",
            gait.asymmetry_deg()
        )
    };
    let symmetric = Claim::new(
        "In air the touchdown and lift-off angles are symmetric",
        air.map_or_else(|| "it falls".to_owned(), angles),
        Verdict::of(air.is_some_and(|gait| gait.asymmetry_deg() <= SAME_DEG)),
    );
    let acute = Claim::new(
        "In water both angles are acute",
        water.map_or_else(|| "it falls".to_owned(), angles),
        match water {
            Some(gait) if gait.angles_deg().iter().all(|angle| *angle < 90.0) => Verdict::Holds,
            Some(gait) if gait.asymmetry_deg() > SAME_DEG => Verdict::InPart,
            _ => Verdict::Fails,
        },
    );
    vec![both, symmetric, acute]
}

/// Width of a chart over its height, at least.
const WIDE: f64 = 2.4;

fn draw(gaits: &[Option<Gait>; 2]) -> Result<String, FiguresError> {
    let title = "Figure 13. Gaits of the universal controller at 1 m/s";
    let note = "the first hops after convergence, from apex to apex, to scale";
    let sheet = Sheet::new(title, note).shared_legend();
    let media = MEDIA.iter().zip(gaits);
    let sheet = media.fold(sheet, |sheet, ((medium, _), gait)| match gait {
        Some(gait) => sheet.row_to_scale(path_of(medium, &gait.hops[..DRAWN])),
        None => sheet.row(60, vec![path_of(&format!("{medium}: it falls"), &[])]),
    });
    Ok(sheet.draw()?)
}

fn path_of(title: &str, hops: &[Stride]) -> Panel {
    let points: Vec<(f64, f64)> =
        hops.iter().flat_map(|hop| &hop.path_m).map(|[x, y]| (*x, *y)).collect();
    let y = Axis::around("height, m", points.iter().map(|p| p.1).chain([0.0, 1.0]));
    let width_m = WIDE * (y.range.end - y.range.start);
    let x = Axis::around("distance, m", points.iter().map(|p| p.0).chain([0.0, width_m]));
    let ground = vec![(x.range.start, 0.0), (x.range.end, 0.0)];
    let leg = |hop: &Stride, [x, y]: [f64; 2]| [(hop.foot_x_m, 0.0), (hop.foot_x_m + x, y)];
    let touchdowns = hops.iter().map(|hop| leg(hop, hop.touchdown_m)).collect();
    let liftoffs = hops.iter().map(|hop| leg(hop, hop.liftoff_m)).collect();
    Panel::new(title, x, y)
        .with(Mark::line(ground, INK))
        .with(Mark::line(points, BLUE).label("path of the mass"))
        .with(Mark::segments(touchdowns, ORANGE).label("leg at touchdown"))
        .with(Mark::segments(liftoffs, GREEN).label("leg at lift-off"))
}

fn table(gaits: &[Option<Gait>; 2]) -> String {
    let mut csv =
        String::from("medium,hop,x_m,y_m,foot_x_m,touchdown_angle_deg,liftoff_angle_deg\n");
    for ((medium, _), gait) in MEDIA.iter().zip(gaits) {
        let hops = gait.as_ref().map_or(&[][..], |gait| &gait.hops[..DRAWN]);
        for (i, hop) in hops.iter().enumerate() {
            let [touchdown, liftoff] = hop.angles_deg();
            for [x, y] in &hop.path_m {
                let _ =
                    writeln!(csv, "{medium},{i},{x},{y},{},{touchdown},{liftoff}", hop.foot_x_m);
            }
        }
    }
    csv
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a gait with these angles, deg.
    fn gait([touchdown, liftoff]: [f64; 2], mean_vx_m_s: f64) -> Gait {
        let at = |deg: f64| [libm::cos(deg.to_radians()), libm::sin(deg.to_radians())];
        let hop = Stride {
            path_m: vec![[0.0, 2.0], [1.0, 2.0]],
            foot_x_m: 0.5,
            touchdown_m: at(touchdown),
            liftoff_m: at(liftoff),
        };
        Gait {
            gains: GainPoint::default(),
            mean_vx_m_s,
            amplitude_m_s: 0.0,
            hops: vec![hop; DRAWN],
        }
    }

    #[test]
    fn the_verdicts_follow_the_angles() {
        let verdicts = |air: Option<&Gait>, water: Option<&Gait>| -> Vec<Verdict> {
            claims([air, water]).into_iter().map(|claim| claim.verdict).collect()
        };
        let (even, behind) = (gait([97.0, 83.5], 1.0), gait([88.0, 60.0], 1.05));
        assert_eq!(verdicts(Some(&even), Some(&behind)), [Verdict::Holds; 3]);
        let ahead = gait([97.0, 60.0], 2.0);
        let swapped = verdicts(Some(&behind), Some(&ahead));
        assert_eq!(swapped, [Verdict::InPart, Verdict::Fails, Verdict::InPart]);
        assert_eq!(verdicts(None, None), [Verdict::Fails; 3]);
    }

    #[test]
    fn a_stride_ends_at_the_apex_of_the_apex_map() {
        let (apex, action) = (
            Apex { vx_m_s: 1.0, y_m: 2.0 },
            Action { touchdown_angle_rad: 1.65, elongation_speed_m_s: 0.2 },
        );
        for (_, medium) in MEDIA {
            let stride = stride(3.0, apex, action, medium).unwrap();
            let hop = hopper(medium.density_ratio()).hop(apex, action);
            let leg_plant::Outcome::Apex(next) = hop.outcome else { panic!("{hop:?}") };
            let last = stride.path_m.last().unwrap();
            assert!((last[0] - 3.0 - next.x_m).abs() < 1e-6 && (last[1] - next.y_m).abs() < 1e-6);
            assert!((stride.foot_x_m - 3.0 - hop.touchdown.unwrap().foot_x_m).abs() < 1e-6);
            assert!((stride.angles_deg()[0] - 1.65_f64.to_degrees()).abs() < 1e-6);
        }
    }
}
