//! Beyond the paper: the shipped policy in other bodies, worlds and media, and
//! with the density told or estimated.

use std::fmt::Write as _;

use leg_control::policy::{GainSchedule, Policy, SHIPPED};
use leg_plant::{Hopper, Leg, Medium};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::fig11::Basin;
use super::fig12::gains;
use crate::picture::{AUTHORS, Axis, COLORS, Mark, Panel, Sheet};
use crate::study::flown::{authors_actor, identity};
use crate::study::sensed::{self, Sensed, density};
use crate::{Claim, Extent, Figure, FiguresError, Made, Verdict, Workshop};
use trainer::evaluate::DENSITIES;
use trainer::evaluate::survival::{draw_starts, survival};
use trainer::evaluate::tracking::{
    SET_POINTS, STEADY_GAIT_M_S, Tracking, highest_speeds, tracking_table,
};
use trainer::policy::PackedActor;

/// What the paper reaches on land, m/s.
const PAPER_M_S: f64 = 6.0;
/// Set-points that a prototype of the recipe tracked, of the 42 that are possible.
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
        "It leaves open how a controller does between the two media, in other gravity, and when it \
         must find out the density by itself. Below, the policy that comes with the controller, \
         one frozen actor with its own gains, is put to these, beside the paper's agent."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        extent.of(40.0, 5.0) // Beside the trainings of figure 3.
    }

    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError> {
        let policy = Policy::parse(SHIPPED).expect("the shipped policy is whole");
        let shipped = Agent {
            name: "shipped",
            actor: PackedActor::from(&policy),
            gains: policy.manifest().gains.clone(),
        };
        let origin = &policy.manifest().provenance;
        let from = format!(
            "CRC-32 {:08x}, preset `{}`, seed {}, {} steps, trainer {}",
            policy.crc32(),
            origin.preset,
            origin.seed,
            origin.steps,
            origin.trainer_version
        );
        shop.used("shipped", from);
        let transferred = Agent {
            name: "transferred",
            actor: shop.transferred()?.shown().actor(),
            gains: gains(),
        };
        let theirs = authors_actor(shop.reference.as_ref(), "water_to_air")?.map(|actor| Agent {
            name: "authors",
            actor,
            gains: gains(),
        });
        let agents: Vec<Agent> = [shipped, transferred].into_iter().chain(theirs).collect();
        let found = Found {
            basins: [
                Basin::of(shop, "basin-shipped", [&agents[0].actor; 2])?,
                Basin::of(shop, "basin-transferred", [&agents[1].actor; 2])?,
            ],
            media: agents.iter().map(|agent| agent.media(shop)).collect::<Result<_, _>>()?,
            sensed: sensed::both(shop)?,
        };
        let measured = found.words();
        Ok(Made { svg: found.draw()?, csv: found.table(), measured, claims: found.claims() })
    }
}

/// Who is put to it.
struct Agent {
    name: &'static str,
    actor: PackedActor,
    gains: GainSchedule,
}

/// A world: its name and its gravity, m/s2.
const WORLDS: [(&str, f64); 3] = [
    ("earth", Medium::AIR.gravity_m_s2()),
    ("mars", Medium::MARS.gravity_m_s2()),
    ("moon", Medium::MOON.gravity_m_s2()),
];

/// Density, set-point, and mean and oscillation, m/s; none after a fall.
type Followed = (f64, f64, Option<(f64, f64)>);

/// What an agent does by density.
#[derive(Serialize, Deserialize)]
struct Media {
    name: String,
    /// Share of the starts that survive, by world and density.
    survive30: [Vec<f64>; 3],
    /// Highest speed, m/s, by density.
    speeds: Vec<f64>,
    tracking: Vec<Followed>,
}

impl Agent {
    fn media(&self, shop: &Workshop) -> Result<Media, FiguresError> {
        let count = shop.extent.of(3_000, 300);
        let inputs = (identity(&self.actor), &self.gains, count);
        let name = format!("media-{}", self.name);
        shop.part(&name, &inputs, shop.extent.of(6.0, 1.0), || Ok(self.fly(count)))
    }

    fn fly(&self, count: usize) -> Media {
        let actor = self.actor.actor();
        let starts = draw_starts(count, &mut Pcg64::seed_from_u64(11));
        let share = |rho: f64, gravity_m_s2: f64| {
            let medium = Medium::new(rho, gravity_m_s2).expect("a medium of the list");
            survival(&actor, &Hopper::new(&Leg::human(), medium), rho, &starts).survive30
        };
        let row = |t: Tracking| (t.rho, t.set_point, t.mean_v.zip(t.oscillation));
        Media {
            name: self.name.to_owned(),
            survive30: WORLDS
                .map(|(_, gravity)| DENSITIES.iter().map(|&rho| share(rho, gravity)).collect()),
            speeds: highest_speeds(&actor, &self.gains).into_iter().map(|(_, v)| v).collect(),
            tracking: tracking_table(&actor, &self.gains).into_iter().map(row).collect(),
        }
    }
}

impl Media {
    /// Set-points tracked, of those possible.
    fn tracked(&self) -> [usize; 2] {
        let possible: Vec<Tracking> = self
            .tracking
            .iter()
            .map(|&(rho, set_point, settled)| Tracking {
                rho,
                set_point,
                mean_v: settled.map(|s| s.0),
                oscillation: settled.map(|s| s.1),
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

/// All that was found.
struct Found {
    /// Of the shipped policy, and of the transferred agent.
    basins: [Basin; 2],
    /// The shipped policy first.
    media: Vec<Media>,
    sensed: Vec<Sensed>,
}

impl Found {
    fn words(&self) -> String {
        let mut text = String::new();
        for media in &self.media {
            let [tracked, of] = media.tracked();
            let _ = write!(
                text,
                "{}: survives from at least {:.3} of the starts at every density on earth, {:.3} \
                 on mars, {:.3} on the moon; tracks {tracked} of {of} possible set-points; up to \
                 {:.2} m/s in air and {:.2} m/s in water. ",
                media.name,
                media.least(0),
                media.least(1),
                media.least(2),
                media.speeds[0],
                media.speeds[DENSITIES.len() - 1],
            );
        }
        text + &sensed::words(&self.sensed)
    }

    /// Shares of the plane of bodies, on land, from which nine in ten starts survive.
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
                "Ours: one actor hops on at every density between air and water",
                format!("from at least {:.3} of the starts", shipped.least(0)),
                graded(shipped.least(0), 0.99, 0.9),
            ),
            Claim::new(
                "Ours: in gravity that it never met, moon and mars, it hops on as well",
                format!(
                    "from at least {mars:.3} of the starts on mars and {moon:.3} on the moon, at any density"
                ),
                graded(mars.min(moon), 0.99, 0.7),
            ),
            Claim::new(
                "Ours: it follows the set-points that are possible",
                format!("{tracked} of {of} within 2 %, oscillating less than 5 %"),
                graded(tracked as f64, PROTOTYPE_TRACKS as f64, of as f64 / 2.0),
            ),
            Claim::new(
                "Ours: it is faster on land than the paper's 6 m/s",
                format!("{:.2} m/s", shipped.speeds[0]),
                Verdict::of(shipped.speeds[0] > PAPER_M_S),
            ),
            Claim::new(
                "Ours: it puts up with more bodies on land than the transferred agent",
                format!(
                    "nine in ten starts survive over {wide:.2} of the plane against {narrow:.2}"
                ),
                Verdict::of(wide > narrow),
            ),
            sensed::claim(&self.sensed),
        ]
    }

    fn draw(&self) -> Result<String, FiguresError> {
        let sheet = Sheet {
            title: "Beyond the paper. The shipped policy".into(),
            note: "one frozen actor with its own gains; beside it the paper's agents".into(),
            rows: vec![
                self.basins[0].planes("shipped"),
                self.basins[1].planes("transferred"),
                WORLDS.iter().enumerate().map(|(i, (world, _))| self.survival(i, world)).collect(),
                vec![self.speeds(), self.followed()],
                sensed::panels(&self.sensed),
            ],
            ..Sheet::default()
        };
        Ok(sheet.draw()?)
    }

    fn lines(&self, values: impl Fn(&Media) -> Vec<f64>) -> Vec<Mark> {
        let colors = [COLORS[2], COLORS[0], AUTHORS];
        let lines = self.media.iter().zip(colors).map(|(media, color)| {
            let points = DENSITIES.into_iter().zip(values(media)).collect();
            let label = match media.name.as_str() {
                "authors" => "the authors', transferred",
                other => other,
            };
            Mark::line(points, color, label)
        });
        lines.collect()
    }

    fn survival(&self, world: usize, name: &str) -> Panel {
        Panel {
            title: format!("survival on {name}"),
            x: density(),
            y: Axis::new("share that survives", -0.02..1.02),
            marks: self.lines(|media| media.survive30[world].clone()),
        }
    }

    fn speeds(&self) -> Panel {
        let mut marks = self.lines(|media| media.speeds.clone());
        marks.push(Mark::guide(STEADY_GAIT_M_S.to_vec()));
        let all = self.media.iter().flat_map(|media| media.speeds.clone());
        let limit = STEADY_GAIT_M_S.iter().map(|(_, v)| *v);
        let y = Axis::around("highest speed, m/s", all.chain(limit).chain([0.0]));
        Panel { title: "highest speed; dashed: gaits known".into(), x: density(), y, marks }
    }

    fn followed(&self) -> Panel {
        let shipped = &self.media[0];
        let mut marks = Vec::new();
        for (set_point, color) in SET_POINTS.into_iter().zip(COLORS) {
            let of = shipped.tracking.iter().filter(|(_, asked, _)| *asked == set_point);
            let mean = |settled: &Option<(f64, f64)>| settled.map_or(f64::NAN, |(mean, _)| mean);
            let points: Vec<(f64, f64)> =
                of.map(|(rho, _, settled)| (*rho, mean(settled))).collect();
            marks.push(Mark::guide(vec![(0.0, set_point), (1.0, set_point)]));
            marks.push(Mark::Dots { points: points.clone(), color, radius_px: 3, label: None });
            marks.push(Mark::Line { points, color, dashed: false, label: None });
        }
        let y = Axis::new("mean velocity, m/s", -2.3..2.3);
        Panel { title: "shipped: velocity by set-point (dashed)".into(), x: density(), y, marks }
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
                let [mean, swing] = [settled.map(|s| s.0), settled.map(|s| s.1)]
                    .map(|value| value.map(|v| v.to_string()).unwrap_or_default());
                let _ = writeln!(
                    csv,
                    "{},mean_vx_m_s,earth,{rho},{set_point},{mean},{swing}",
                    media.name
                );
            }
        }
        csv + &sensed::rows(&self.sensed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracked_is_counted_among_the_possible() {
        let at = |rho, asked, mean| (rho, asked, Some((mean, 0.0)));
        let media = Media {
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
