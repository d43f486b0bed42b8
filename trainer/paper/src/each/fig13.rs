//! Figure 13: the gaits of the universal controller in water and in air.

use std::fmt::Write as _;

use leg_control::actor::Actor;
use leg_control::policy::GainPoint;
use leg_plant::{Action, Apex, Body, EventKind, Flat, Leg, LegCommand, Medium, TickPlant};
use rayon::prelude::*;

use crate::agents::{Learnt, Paper, from};
use crate::picture::{Axis, COLORS, INK, Mark, Panel, Sheet};
use crate::study::flown::{follow, mean_and_swing};
use crate::{Claim, Extent, Figure, FiguresError, Made, Verdict, Workshop};
use trainer::evaluate::hopper;

/// The speed asked for, m/s.
const ASKED_M_S: f32 = 1.0;
const START: Apex = Apex { vx_m_s: 0.0, y_m: 2.0 };
/// Hops until the gait is looked at, and hops that then are: those drawn are the
/// first of them.
const HOPS: usize = 300;
const LOOKED_AT: usize = 20;
const DRAWN: usize = 3;
/// Step of a path, s.
const STEP_S: f64 = 2e-3;
/// Gains that are tried in each medium: the paper does not say its own.
const KI: [f32; 5] = [0.02, 0.05, 0.1, 0.2, 0.4];
const FEED_FORWARD: [f32; 4] = [0.0, 0.5, 1.0, 1.5];
/// Angles that differ by less are the same, deg.
const SAME_DEG: f64 = 2.0;
/// Gaits nearer to the speed asked for than this have it, m/s.
const NEAR_M_S: f64 = 0.1;
/// What a fall counts as, when seeds are compared, m/s.
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
        "One controller, trained in water and air in turn, asked for 1 m/s. In air it settles to \
         the conservative model, its touchdown and lift-off angles symmetric; in water to a gait \
         in which both angles are acute: the leg pushes from behind."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        // Universal trainings take twice the steps an episode.
        0.8 * seeds(extent).count() as f64
    }

    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError> {
        let tried = every_seed(shop)?;
        let goes = [0, 1].map(|i| tried.iter().filter(|seed| seed.goes_in(i)).count());
        let count = tried.len();
        let all: Vec<Vec<Claim>> = tried.iter().map(Seed::claims).collect();
        let both = tried.iter().filter(|seed| seed.goes_in(0) && seed.goes_in(1)).count();
        let shown = tried.into_iter().next().expect("at least one seed");
        let claims = Claim::over_seeds(&all, &shown.claims());
        let Seed { seed, gaits } = shown;
        let chosen = format!("the one that comes nearest to the speed asked for: {seed}");
        shop.used("universal", from(Paper::Universal, &seeds(shop.extent), &chosen));
        let mut measured = format!(
            "{count} seeds; in each medium the gains that come nearest to 1 m/s after {HOPS} hops, \
             from rest at 2 m. {} of the seeds come within {NEAR_M_S} m/s in air, {} in water, \
             {both} in both. Seed {seed} comes nearest and is drawn. Angles are of the line from \
             foot to mass, from the direction of travel; over 90 deg the foot is ahead.",
            goes[0], goes[1],
        );
        for ((medium, _), gait) in MEDIA.iter().zip(&gaits) {
            let _ = match gait {
                Some(gait) => write!(measured, " In {medium} {}.", gait.words()),
                None => write!(measured, " In {medium} it falls under all gains that were tried."),
            };
        }
        Ok(Made { svg: draw(&gaits)?, csv: table(&gaits), measured, claims })
    }
}

fn seeds(extent: Extent) -> std::ops::Range<u64> {
    0..extent.of(60, 2)
}

/// A universal controller, and its gait in each of [`MEDIA`].
struct Seed {
    seed: u64,
    gaits: [Option<Gait>; 2],
}

impl Seed {
    fn of(learnt: &Learnt) -> Self {
        let frozen = learnt.actor();
        let gaits = MEDIA.map(|(_, medium)| Gait::best(&frozen.actor(), medium));
        Self { seed: learnt.seed, gaits }
    }

    fn claims(&self) -> Vec<Claim> {
        claims(self.gaits.each_ref().map(Option::as_ref))
    }

    fn goes_in(&self, medium: usize) -> bool {
        self.gaits[medium].as_ref().is_some_and(|gait| gait.misses_by() <= NEAR_M_S)
    }

    /// By how much it misses the speed asked for, m/s, over both media.
    fn misses_by(&self) -> f64 {
        self.gaits.iter().map(|gait| gait.as_ref().map_or(FALLS_M_S, Gait::misses_by)).sum()
    }
}

/// Every seed's, the one that comes nearest to the speed asked for first.
fn every_seed(shop: &Workshop) -> Result<Vec<Seed>, FiguresError> {
    let mut all = seeds(shop.extent)
        .collect::<Vec<_>>()
        .into_par_iter()
        .with_max_len(1)
        .map(|seed| shop.training(Paper::Universal, seed).map(|learnt| Seed::of(&learnt)))
        .collect::<Result<Vec<_>, _>>()?;
    all.sort_by(|a, b| a.misses_by().total_cmp(&b.misses_by()));
    Ok(all)
}

/// A gait after convergence.
#[derive(Clone, Debug)]
struct Gait {
    gains: GainPoint,
    mean_vx_m_s: f64,
    swing_m_s: f64,
    /// The hops looked at.
    hops: Vec<Stride>,
}

/// One hop in full.
#[derive(Clone, Debug)]
#[expect(clippy::struct_field_names, reason = "all are lengths, and say their unit")]
struct Stride {
    /// Where the mass was, from the apex on: x and y, m.
    path_m: Vec<[f64; 2]>,
    foot_x_m: f64,
    /// From foot to mass, at touchdown and at lift-off: x and y, m.
    touchdown_m: [f64; 2],
    liftoff_m: [f64; 2],
}

impl Stride {
    fn angles_deg(&self) -> [f64; 2] {
        [self.touchdown_m, self.liftoff_m].map(|[x, y]| libm::atan2(y, x).to_degrees())
    }
}

impl Gait {
    /// The gait nearest to the speed asked for, over the gains.
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
        gaits.min_by(|a, b| a.misses_by().total_cmp(&b.misses_by()))
    }

    fn of(actor: &Actor<'_>, medium: Medium, gains: GainPoint) -> Option<Self> {
        let hopper = hopper(medium.density_ratio());
        let flown = follow(actor, &hopper, gains, ASKED_M_S, START, HOPS);
        let (mean_vx_m_s, swing_m_s) = mean_and_swing(&flown.last_vx_m_s(LOOKED_AT)?);
        let mut x_m = 0.0;
        let from = HOPS - LOOKED_AT;
        let hops = flown.apexes[from..].iter().zip(&flown.actions[from..]).map(|(apex, action)| {
            let stride = stride(x_m, *apex, *action, medium)?;
            x_m = stride.path_m.last()?[0];
            Some(stride)
        });
        Some(Self { gains, mean_vx_m_s, swing_m_s, hops: hops.collect::<Option<_>>()? })
    }

    fn misses_by(&self) -> f64 {
        (self.mean_vx_m_s - f64::from(ASKED_M_S)).abs() + self.swing_m_s
    }

    /// Mean touchdown and lift-off angle, deg.
    fn angles_deg(&self) -> [f64; 2] {
        [0, 1].map(|i| {
            self.hops.iter().map(|hop| hop.angles_deg()[i]).sum::<f64>() / self.hops.len() as f64
        })
    }

    /// Mean over the hops of how far the two angles are from mirror images, deg.
    fn asymmetry_deg(&self) -> f64 {
        let each = |hop: &Stride| (hop.angles_deg().iter().sum::<f64>() - 180.0).abs();
        self.hops.iter().map(each).sum::<f64>() / self.hops.len() as f64
    }

    fn words(&self) -> String {
        let [touchdown, liftoff] = self.angles_deg();
        format!(
            "{:.3} ± {:.3} m/s (ki {}, feed-forward {}), touchdown at {touchdown:.1} deg, lift-off \
             at {liftoff:.1} deg, {:.1} deg from symmetric",
            self.mean_vx_m_s,
            self.swing_m_s,
            self.gains.ki,
            self.gains.feed_forward,
            self.asymmetry_deg()
        )
    }
}

/// A hop of the apex map, step by step; none where the plants do not agree that
/// there is a whole one.
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
    let says = "One controller goes at 1 m/s in air and in water";
    let speed = |gait: Option<&Gait>| match gait {
        Some(gait) => format!("{:.3} ± {:.3} m/s", gait.mean_vx_m_s, gait.swing_m_s),
        None => "it falls".to_owned(),
    };
    let goes = [air, water].iter().flatten().filter(|gait| gait.misses_by() <= NEAR_M_S).count();
    let both = Claim::new(
        says,
        format!("in air {}, in water {}", speed(air), speed(water)),
        [Verdict::Fails, Verdict::InPart, Verdict::Holds][goes],
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
        "In water they are not: both are acute",
        water.map_or_else(|| "it falls".to_owned(), angles),
        match water {
            Some(gait) if gait.angles_deg().iter().all(|angle| *angle < 90.0) => Verdict::Holds,
            Some(gait) if gait.asymmetry_deg() > SAME_DEG => Verdict::InPart,
            _ => Verdict::Fails,
        },
    );
    vec![both, symmetric, acute]
}

fn draw(gaits: &[Option<Gait>; 2]) -> Result<String, FiguresError> {
    let panels = MEDIA.iter().zip(gaits).map(|((medium, _), gait)| {
        let hops = gait.as_ref().map_or(&[][..], |gait| &gait.hops[..DRAWN]);
        let points: Vec<[f64; 2]> = hops.iter().flat_map(|hop| hop.path_m.clone()).collect();
        let path = points.iter().map(|[x, y]| (*x, *y)).collect();
        let mut marks = vec![Mark::line(path, COLORS[0], "path of the mass")];
        for (i, hop) in hops.iter().enumerate() {
            let leg = |[x, y]: [f64; 2]| vec![(hop.foot_x_m, 0.0), (hop.foot_x_m + x, y)];
            let labels = ["leg at touchdown", "leg at lift-off"]
                .map(|label| (i == 0).then(|| label.to_owned()));
            let [touchdown, liftoff] = labels;
            let line = |points, color, label| Mark::Line { points, color, dashed: false, label };
            marks.push(line(leg(hop.touchdown_m), COLORS[1], touchdown));
            marks.push(line(leg(hop.liftoff_m), COLORS[2], liftoff));
        }
        // A metre each way also where there is nothing to draw.
        let x = Axis::around("way, m", points.iter().map(|p| p[0]).chain([0.0, 1.0]));
        let y = Axis::around("height, m", points.iter().map(|p| p[1]).chain([0.0, 1.0]));
        marks.push(Mark::Line {
            points: vec![(x.range.start, 0.0), (x.range.end, 0.0)],
            color: INK,
            dashed: false,
            label: None,
        });
        let title = match gait {
            Some(_) => (*medium).to_owned(),
            None => format!("{medium}: it falls"),
        };
        Panel { title, x, y, marks }
    });
    let sheet = Sheet {
        title: "Figure 13. Gaits of the universal controller at 1 m/s".into(),
        note: "the first hops after convergence; apex to apex".into(),
        rows: vec![panels.collect()],
        row_px: 340,
    };
    Ok(sheet.draw()?)
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

    /// A gait with these angles, deg.
    fn gait([touchdown, liftoff]: [f64; 2], mean_vx_m_s: f64) -> Gait {
        let at = |deg: f64| [libm::cos(deg.to_radians()), libm::sin(deg.to_radians())];
        let hop = Stride {
            path_m: vec![[0.0, 2.0], [1.0, 2.0]],
            foot_x_m: 0.5,
            touchdown_m: at(touchdown),
            liftoff_m: at(liftoff),
        };
        Gait { gains: GainPoint::default(), mean_vx_m_s, swing_m_s: 0.0, hops: vec![hop; DRAWN] }
    }

    #[test]
    fn claims_are_judged_by_the_angles() {
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
    fn a_stride_ends_where_the_apex_map_does() {
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
