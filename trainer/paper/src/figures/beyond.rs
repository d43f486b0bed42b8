//! Beyond the paper: the shipped policy with other bodies, in other gravity and media, and
//! with the density measured or estimated.

use std::fmt::Write as _;

use leg_control::policy::{GainSchedule, Policy, SHIPPED};
use leg_plant::{Hopper, Leg, Medium};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::fig11_basin::Basin;
use super::fig12_top_speed::gains;
use crate::analysis::apex_run::{authors_actor, identity};
use crate::analysis::density_source::{self, SourceResult, density_axis};
use crate::{Claim, Extent, Figure, FigureContext, FiguresError, RenderedFigure, Verdict};
use leg_charts::color::{BLACK, BLUE, GREEN, SERIES};
use leg_charts::{Axis, Mark, Panel, Sheet};
use trainer::evaluate::DENSITIES;
use trainer::evaluate::survival::{draw_starts, survival};
use trainer::evaluate::tracking::{
    SET_POINTS, STEADY_GAIT_M_S, Tracking, highest_speeds, tracking_table,
};
use trainer::policy::PackedActor;

/// Highest speed on land in the paper, m/s.
const PAPER_M_S: f64 = 6.0;
/// Number of set-points that a prototype of the recipe tracked, of the 42 with a known
/// steady gait.
const PROTOTYPE_TRACKS: usize = 37;

pub(super) struct Beyond;

impl Figure for Beyond {
    fn id(&self) -> &'static str {
        "beyond"
    }

    fn title(&self) -> &'static str {
        "Beyond the paper: the shipped policy"
    }

    fn paper(&self) -> &'static str {
        "It leaves open how a controller performs between the two media, in other gravity, and if it \
         has to estimate the density. Below, the policy that is shipped with the controller, one \
         frozen actor with its own gains, is tested in these conditions beside the paper's agent."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        extent.of(40.0, 5.0) // Without the trainings of figure 3.
    }

    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError> {
        let policy = Policy::parse(SHIPPED).expect("the shipped policy is valid");
        let shipped = Agent {
            name: "shipped",
            actor: PackedActor::from(&policy),
            gains: policy.manifest().gains.clone(),
        };
        let origin = &policy.manifest().provenance;
        let provenance = format!(
            "CRC-32 {:08x}, preset `{}`, seed {}, {} steps, trainer {}",
            policy.crc32(),
            origin.preset,
            origin.seed,
            origin.steps,
            origin.trainer_version
        );
        ctx.note_policy("shipped", provenance);
        let transferred = Agent {
            name: "transferred",
            actor: ctx.transferred()?.shown().actor(),
            gains: gains(),
        };
        let theirs = authors_actor(ctx.reference.as_ref(), "water_to_air")?.map(|actor| Agent {
            name: "authors",
            actor,
            gains: gains(),
        });
        let agents: Vec<Agent> = [shipped, transferred].into_iter().chain(theirs).collect();
        let results = Results {
            basins: [
                Basin::of(ctx, "basin-shipped", [&agents[0].actor; 2])?,
                Basin::of(ctx, "basin-transferred", [&agents[1].actor; 2])?,
            ],
            media: agents.iter().map(|agent| agent.media(ctx)).collect::<Result<_, _>>()?,
            sources: density_source::both(ctx)?,
        };
        let measured = results.summary();
        Ok(RenderedFigure {
            svg: results.draw()?,
            csv: results.table(),
            measured,
            claims: results.claims(),
        })
    }
}

/// An agent that is tested.
struct Agent {
    name: &'static str,
    actor: PackedActor,
    gains: GainSchedule,
}

/// Worlds: names and gravities, m/s².
const WORLDS: [(&str, f64); 3] = [
    ("earth", Medium::AIR.gravity_m_s2()),
    ("mars", Medium::MARS.gravity_m_s2()),
    ("moon", Medium::MOON.gravity_m_s2()),
];

/// Density ratio, set-point, m/s, and mean and oscillation, m/s, or `None` after a fall.
type Tracked = (f64, f64, Option<(f64, f64)>);

/// Results of an agent by density.
#[derive(Serialize, Deserialize)]
struct DensityResults {
    name: String,
    /// Share of survived starts, by world and density.
    survive30: [Vec<f64>; 3],
    /// Highest speed, m/s, by density.
    speeds: Vec<f64>,
    tracking: Vec<Tracked>,
}

impl Agent {
    fn media(&self, ctx: &FigureContext) -> Result<DensityResults, FiguresError> {
        let count = ctx.extent.of(3_000, 300);
        let inputs = (identity(&self.actor), &self.gains, count);
        let name = format!("media-{}", self.name);
        ctx.cached(&name, &inputs, ctx.extent.of(6.0, 1.0), || Ok(self.run_policy(count)))
    }

    fn run_policy(&self, count: usize) -> DensityResults {
        let actor = self.actor.actor();
        let starts = draw_starts(count, &mut Pcg64::seed_from_u64(11));
        let share = |rho: f64, gravity_m_s2: f64| {
            let medium = Medium::new(rho, gravity_m_s2).expect("a medium of the list");
            survival(&actor, &Hopper::new(&Leg::human(), medium), rho, &starts).survive30
        };
        let row = |t: Tracking| (t.rho, t.set_point, t.mean_v.zip(t.oscillation));
        DensityResults {
            name: self.name.to_owned(),
            survive30: WORLDS
                .map(|(_, gravity)| DENSITIES.iter().map(|&rho| share(rho, gravity)).collect()),
            speeds: highest_speeds(&actor, &self.gains).into_iter().map(|(_, v)| v).collect(),
            tracking: tracking_table(&actor, &self.gains).into_iter().map(row).collect(),
        }
    }
}

impl DensityResults {
    /// Returns the number of set-points that are tracked, and of those with a known gait.
    fn tracked(&self) -> [usize; 2] {
        let possible: Vec<Tracking> = self
            .tracking
            .iter()
            .map(|&(rho, set_point, settled)| Tracking {
                rho,
                set_point,
                mean_v: settled.map(|s| s.0),
                oscillation: settled.map(|s| s.1),
                friction: None,
                fell: settled.is_none(),
            })
            .filter(Tracking::possible)
            .collect();
        [possible.iter().filter(|t| t.tracked()).count(), possible.len()]
    }

    fn least(&self, world: usize) -> f64 {
        self.survive30[world].iter().copied().fold(f64::INFINITY, f64::min)
    }
}

/// All results.
struct Results {
    /// Basins of the shipped policy, and of the transferred agent.
    basins: [Basin; 2],
    /// Results by density, the shipped policy first.
    media: Vec<DensityResults>,
    sources: Vec<SourceResult>,
}

impl Results {
    fn summary(&self) -> String {
        let mut text = String::new();
        for media in &self.media {
            let [tracked, of] = media.tracked();
            let _ = write!(
                text,
                "{}: survives at least {:.3} of the starts at every density on Earth, {:.3} on Mars, \
                 {:.3} on the Moon; tracks {tracked} of {of} set-points with a known gait; reaches \
                 {:.2} m/s in air and {:.2} m/s in water. ",
                media.name,
                media.least(0),
                media.least(1),
                media.least(2),
                media.speeds[0],
                media.speeds[DENSITIES.len() - 1],
            );
        }
        text + &density_source::summary(&self.sources)
    }

    /// Returns the shares of all bodies that survive at least nine in ten starts on land.
    fn wide(&self) -> [f64; 2] {
        self.basins.each_ref().map(|basin| {
            let plane = &basin.plane[0];
            plane.iter().filter(|share| **share >= 0.9).count() as f64 / plane.len() as f64
        })
    }

    fn claims(&self) -> Vec<Claim> {
        let shipped = &self.media[0];
        let [tracked, of] = shipped.tracked();
        let [wide, narrow] = self.wide();
        let graded = |value: f64, holds: f64, in_part: f64| {
            if value >= holds {
                Verdict::Holds
            } else if value >= in_part {
                Verdict::InPart
            } else {
                Verdict::Fails
            }
        };
        let [mars, moon] = [shipped.least(1), shipped.least(2)];
        vec![
            Claim::new(
                "Ours: one actor survives at every density between air and water",
                format!("at least {:.3} of the starts", shipped.least(0)),
                graded(shipped.least(0), 0.99, 0.9),
            ),
            Claim::new(
                "Ours: it also survives in the gravity of Moon and Mars, where it was never trained",
                format!(
                    "at least {mars:.3} of the starts on Mars and {moon:.3} on the Moon, at any density"
                ),
                graded(mars.min(moon), 0.99, 0.7),
            ),
            Claim::new(
                "Ours: it tracks the set-points with a known gait",
                format!("{tracked} of {of} within 2 %, with oscillations below 5 %"),
                graded(tracked as f64, PROTOTYPE_TRACKS as f64, of as f64 / 2.0),
            ),
            Claim::new(
                "Ours: it is faster on land than the paper's 6 m/s",
                format!("{:.2} m/s", shipped.speeds[0]),
                Verdict::of(shipped.speeds[0] > PAPER_M_S),
            ),
            Claim::new(
                "Ours: it survives with more bodies on land than the transferred agent",
                format!(
                    "it survives nine in ten starts with {wide:.2} of all bodies, against {narrow:.2}"
                ),
                Verdict::of(wide > narrow),
            ),
            density_source::claim(&self.sources),
        ]
    }

    fn draw(&self) -> Result<String, FiguresError> {
        let title = "Beyond the paper. The shipped policy";
        let note = "one frozen actor with its own gains, beside the paper's agents";
        let rows = vec![
            self.basins[0].planes("shipped"),
            self.basins[1].planes("transferred"),
            WORLDS.iter().enumerate().map(|(i, (world, _))| self.survival(i, world)).collect(),
            vec![self.speeds(), self.tracking()],
            density_source::panels(&self.sources),
        ];
        Ok(Sheet::new(title, note).rows(226, rows).draw()?)
    }

    fn lines(&self, values: impl Fn(&DensityResults) -> Vec<f64>) -> Vec<Mark> {
        let colors = [GREEN, BLUE, BLACK];
        let lines = self.media.iter().zip(colors).map(|(media, color)| {
            let points = DENSITIES.into_iter().zip(values(media)).collect();
            let label = match media.name.as_str() {
                "authors" => "the authors', transferred",
                other => other,
            };
            Mark::line(points, color).label(label)
        });
        lines.collect()
    }

    fn survival(&self, world: usize, name: &str) -> Panel {
        Panel {
            title: format!("survival on {name}"),
            x: density_axis(),
            y: Axis::new("share of survived starts", -0.02..1.02),
            marks: self.lines(|media| media.survive30[world].clone()),
        }
    }

    fn speeds(&self) -> Panel {
        let mut marks = self.lines(|media| media.speeds.clone());
        marks.push(Mark::guide(STEADY_GAIT_M_S.to_vec()));
        let all = self.media.iter().flat_map(|media| media.speeds.clone());
        let limit = STEADY_GAIT_M_S.iter().map(|(_, v)| *v);
        let y = Axis::around("highest speed, m/s", all.chain(limit).chain([0.0]));
        Panel { title: "highest speed; dashed: known gaits".into(), x: density_axis(), y, marks }
    }

    fn tracking(&self) -> Panel {
        let shipped = &self.media[0];
        let mut marks = Vec::new();
        for (set_point, color) in SET_POINTS.into_iter().zip(SERIES) {
            let of = shipped.tracking.iter().filter(|(_, asked, _)| *asked == set_point);
            let mean = |settled: &Option<(f64, f64)>| settled.map_or(f64::NAN, |(mean, _)| mean);
            let points: Vec<(f64, f64)> =
                of.map(|(rho, _, settled)| (*rho, mean(settled))).collect();
            marks.push(Mark::guide(vec![(0.0, set_point), (1.0, set_point)]));
            marks.push(Mark::dots(points.clone(), color));
            marks.push(Mark::line(points, color));
        }
        let y = Axis::new("mean velocity, m/s", -2.3..2.3);
        Panel {
            title: "shipped: mean velocity; dashed: set-points".into(),
            x: density_axis(),
            y,
            marks,
        }
    }

    fn table(&self) -> String {
        let mut csv =
            String::from("who,what,world,density_ratio,set_point_m_s,value,oscillation\n");
        for media in &self.media {
            for ((world, _), shares) in WORLDS.iter().zip(&media.survive30) {
                for (rho, share) in DENSITIES.iter().zip(shares) {
                    let _ = writeln!(csv, "{},survive30,{world},{rho},,{share},", media.name);
                }
            }
            for (rho, speed) in DENSITIES.iter().zip(&media.speeds) {
                let _ = writeln!(csv, "{},highest_speed_m_s,earth,{rho},,{speed},", media.name);
            }
            for (rho, set_point, settled) in &media.tracking {
                let [mean, amplitude] = [settled.map(|s| s.0), settled.map(|s| s.1)]
                    .map(|value| value.map(|v| v.to_string()).unwrap_or_default());
                let _ = writeln!(
                    csv,
                    "{},mean_vx_m_s,earth,{rho},{set_point},{mean},{amplitude}",
                    media.name
                );
            }
        }
        csv + &density_source::rows(&self.sources)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_tracked_set_points_among_those_with_a_known_gait() {
        let at = |rho, asked, mean| (rho, asked, Some((mean, 0.0)));
        let media = DensityResults {
            name: "shipped".into(),
            survive30: [vec![1.0, 0.9], vec![0.8], vec![0.7]],
            speeds: vec![1.0],
            tracking: vec![
                at(0.0, 1.0, 1.01),
                at(0.0, 2.0, 1.5),
                // No gait of this speed is known.
                at(1.0, 2.0, 2.0),
                (0.0, -1.0, None),
            ],
        };
        assert_eq!(media.tracked(), [1, 3]);
        assert_eq!(media.least(0), 0.9);
    }
}
