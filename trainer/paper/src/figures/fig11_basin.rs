//! Figure 11: the basin of attraction of the transferred agent with other bodies.

use std::fmt::Write as _;

use leg_control::actor::Actor;
use leg_plant::{Apex, Medium};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use crate::agents::CHOICE;
use crate::analysis::apex_run::{authors_actor, identity, leg_with, run_policy};
use crate::analysis::bodies::Plane;
use crate::analysis::learning_curves::quartiles;
use crate::{Claim, Extent, Figure, FigureContext, FiguresError, RenderedFigure, Verdict};
use leg_charts::color::{BLACK, BLUE, GREEN};
use leg_charts::{Axis, Mark, Panel, Sheet};
use trainer::evaluate::survival::{HOPS, draw_starts, survival};
use trainer::policy::PackedActor;

/// Bodies of the lines: stiffnesses, N/m, at 80 kg; masses, kg, at 20,000 N/m.
const STIFFNESS_N_M: [f64; 8] =
    [2_500.0, 5_000.0, 7_500.0, 10_000.0, 15_000.0, 20_000.0, 30_000.0, 40_000.0];
const MASS_KG: [f64; 7] = [40.0, 50.0, 60.0, 70.0, 80.0, 100.0, 120.0];
/// The body that was trained: mass, kg, and stiffness, N/m.
const TRAINED: [f64; 2] = [80.0, 20_000.0];
/// Stiffnesses whose basins are drawn start by start, N/m.
const DRAWN_N_M: [f64; 3] = [5_000.0, 10_000.0, 20_000.0];
/// Range of their starts: velocities up to this, m/s, and heights, m.
const SPEED_M_S: f64 = 9.0;
const HEIGHT_M: [f64; 2] = [1.0, 10.0];
/// Share of the starts on land that the authors' agent survives with the trained body, by an
/// independent simulator.
const AUTHORS_SHARE: f64 = 0.906;

pub(super) struct Fig11;

impl Figure for Fig11 {
    fn id(&self) -> &'static str {
        "fig11"
    }

    fn title(&self) -> &'static str {
        "Basin of attraction over mass and stiffness"
    }

    fn paper(&self) -> &'static str {
        "The share of random starts from which the transferred agent takes 30 steps on land. It \
         stays large if mass and stiffness are far from those of the training, and shrinks strongly \
         as the stiffness decreases."
    }

    fn cost_s(&self, extent: Extent) -> f64 {
        extent.of(20.0, 1.0) // Without the trainings of figure 3.
    }

    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError> {
        let transferred = ctx.transferred()?;
        let shown = transferred.shown();
        let ours = Basin::of(ctx, "basin-ours", [&shown.actor(), &shown.actor_after(0)])?;
        let theirs = authors_actor(ctx.reference.as_ref(), "water_to_air")?;
        let in_water = authors_actor(ctx.reference.as_ref(), "water")?;
        let theirs = theirs
            .zip(in_water)
            .map(|(air, water)| Basin::of(ctx, "basin-authors", [&air, &water]))
            .transpose()?;
        let share_of_trained = share_at(&ours.by_mass[0], 80.0);
        let mut measured = format!(
            "Seed {} of {}, {CHOICE}; {} random starts for each body as in training, every apex at or \
             above 1 m. With the trained body it survives {share_of_trained:.3} of them on land; \
             before its training on land, {:.3} in water. In water, a leg lighter than the 62.4 kg of \
             water that it displaces floats.",
            transferred.shown().seed,
            transferred.all.len(),
            starts_a_body(ctx.extent),
            share_at(&ours.by_mass[1], 80.0),
        );
        if let Some(theirs) = &theirs {
            let _ = write!(measured, " The authors' agent on land: {}.", theirs.list());
        }
        let mut shares = transferred.on_land.clone();
        let [low, median, high] = quartiles(&mut shares);
        let _ = write!(
            measured,
            " Over all seeds, the share of starts from which the trained body takes 60 hops on land has \
             the quartiles {low:.3}, {median:.3} and {high:.3}."
        );
        let mut claims = vec![drastic(&ours), softer(&ours)];
        if let Some(theirs) = &theirs {
            let share = share_at(&theirs.by_mass[0], 80.0);
            // Three standard errors of our starts and of the 5,000 compared with.
            let n = starts_a_body(ctx.extent) as f64;
            let variance = AUTHORS_SHARE * (1.0 - AUTHORS_SHARE) * (1.0 / n + 1.0 / 5_000.0);
            claims.push(Claim::new(
                format!(
                    "A check of our plant: in an independent simulator, the authors' agent \
                     survives {AUTHORS_SHARE} of the starts on land"
                ),
                format!("{share:.3}"),
                Verdict::of((share - AUTHORS_SHARE).abs() <= 3.0 * variance.sqrt()),
            ));
        }
        Ok(RenderedFigure {
            svg: draw(&ours, theirs.as_ref())?,
            csv: table(&ours, theirs.as_ref()),
            measured,
            claims,
        })
    }
}

fn starts_a_body(extent: Extent) -> usize {
    extent.of(3_000, 400)
}

/// Two media: on land, and in water.
const MEDIA: [(&str, Medium); 2] = [("air", Medium::AIR), ("water", Medium::WATER)];

/// Stiffness or mass of bodies, and the share of starts that each survives.
type Line = Vec<(f64, f64)>;

/// Shares of survived starts by body, and hops by start.
#[derive(serde::Serialize, serde::Deserialize)]
pub(super) struct Basin {
    /// On land and in water: stiffness, N/m, and share.
    by_stiffness: [Line; 2],
    /// On land and in water: mass, kg, and share.
    pub(super) by_mass: [Line; 2],
    /// Number of cells across and up the plane, and its values on land and in water.
    cells: usize,
    pub(super) plane: [Vec<f64>; 2],
    /// Number of cells across and up the starts, and the hops from each on land, for each
    /// stiffness that is drawn.
    start_cells: usize,
    hops: Vec<Vec<f64>>,
}

impl Basin {
    /// Computes the basin of an agent, given as one actor for land and one for water;
    /// `name` names the cached step.
    pub(super) fn of(
        ctx: &FigureContext,
        name: &str,
        agents: [&PackedActor; 2],
    ) -> Result<Self, FiguresError> {
        let extent = ctx.extent;
        let cost_s = extent.of(8.0, 0.4);
        let inputs = (agents.map(identity), extent);
        ctx.cached(name, &inputs, cost_s, || Ok(Self::compute(agents, extent)))
    }

    fn compute(agents: [&PackedActor; 2], extent: Extent) -> Self {
        let actors = agents.map(PackedActor::actor);
        let media = [(&actors[0], MEDIA[0].1), (&actors[1], MEDIA[1].1)];
        let draw = |count| draw_starts(count, &mut Pcg64::seed_from_u64(11));
        let starts = draw(starts_a_body(extent));
        let share = |[mass_kg, stiffness_n_m]: [f64; 2], (actor, medium): (&Actor<'_>, Medium)| {
            let hopper = leg_with(mass_kg, stiffness_n_m, medium);
            survival(actor, &hopper, medium.density_ratio(), &starts).survive30
        };
        let plane = Plane::of(extent);
        let few = draw(extent.of(300, 60));
        let start_cells = extent.of(60, 24);
        Self {
            by_stiffness: media
                .map(|medium| STIFFNESS_N_M.map(|k| (k, share([TRAINED[0], k], medium))).into()),
            by_mass: media
                .map(|medium| MASS_KG.map(|m| (m, share([m, TRAINED[1]], medium))).into()),
            cells: plane.cells,
            plane: media.map(|(actor, medium)| {
                let rho = medium.density_ratio();
                plane.map(medium, |hopper| survival(actor, hopper, rho, &few).survive30)
            }),
            start_cells,
            hops: DRAWN_N_M.map(|k| hops_by_start(&actors[0], k, start_cells)).into(),
        }
    }

    fn list(&self) -> String {
        let list = |rows: &[(f64, f64)], what: &str, per: f64| {
            let items = rows.iter().map(|(x, share)| format!("{what} {} {share:.2}", x / per));
            items.collect::<Vec<_>>().join(", ")
        };
        format!("{}; {}", list(&self.by_stiffness[0], "k", 1.0), list(&self.by_mass[0], "m", 1.0))
    }

    /// Returns panels of the planes, on land and in water.
    pub(super) fn planes(&self, whose: &str) -> Vec<Panel> {
        let plane = Plane { cells: self.cells };
        let panel = |((medium, _), values): ((&str, Medium), &Vec<f64>)| {
            plane.panel(&format!("{whose}, {medium}"), values.clone(), 0.0..1.0, "share")
        };
        MEDIA.into_iter().zip(&self.plane).map(panel).collect()
    }
}

/// Counts the hops on land with a stiffness, start by start.
fn hops_by_start(actor: &Actor<'_>, stiffness_n_m: f64, cells: usize) -> Vec<f64> {
    let hopper = leg_with(TRAINED[0], stiffness_n_m, Medium::AIR);
    let place =
        |i: usize, [low, high]: [f64; 2]| low + (high - low) * (i as f64 + 0.5) / cells as f64;
    (0..cells * cells)
        .into_par_iter()
        .map(|i| {
            let vx_m_s = place(i % cells, [-SPEED_M_S, SPEED_M_S]);
            let start = Apex { vx_m_s, y_m: place(i / cells, HEIGHT_M) };
            run_policy(actor, &hopper, 0.0, start, HOPS as usize, |_| 0.0).hops() as f64
        })
        .collect()
}

/// Returns the share at a body of a line; NaN if it is not there.
fn share_at(rows: &[(f64, f64)], body: f64) -> f64 {
    rows.iter().find(|(x, _)| *x == body).map_or(f64::NAN, |(_, share)| *share)
}

fn drastic(basin: &Basin) -> Claim {
    let [springs, masses] = [&basin.by_stiffness[0], &basin.by_mass[0]];
    let shares = [(springs, 10_000.0), (springs, 40_000.0), (masses, 40.0), (masses, 120.0)]
        .map(|(line, body)| share_at(line, body));
    let large = shares.iter().filter(|share| **share >= 0.3).count();
    Claim::new(
        "Even with drastic changes of the body, the agent is stable from a large set of starts",
        format!(
            "{:.2} at half and {:.2} at twice the stiffness, {:.2} at half and {:.2} at one and a \
             half times the mass",
            shares[0], shares[1], shares[2], shares[3]
        ),
        match large {
            4 => Verdict::Holds,
            0 => Verdict::Fails,
            _ => Verdict::InPart,
        },
    )
}

fn softer(basin: &Basin) -> Claim {
    let springs = &basin.by_stiffness[0];
    let [soft, half, full] = [5_000.0, 10_000.0, 20_000.0].map(|k| share_at(springs, k));
    Claim::new(
        "The basin shrinks strongly as the stiffness decreases",
        format!("{full:.2} at 20,000 N/m, {half:.2} at 10,000, {soft:.2} at 5,000"),
        Verdict::of(soft <= 0.5 * full && half < full),
    )
}

fn draw(ours: &Basin, theirs: Option<&Basin>) -> Result<String, FiguresError> {
    let lines = |pick: fn(&Basin) -> &[Line; 2], label: &str, per: f64| {
        let scaled = |rows: &[(f64, f64)]| -> Vec<(f64, f64)> {
            rows.iter().map(|(x, share)| (x / per, *share)).collect()
        };
        let [air, water] = pick(ours);
        let mut marks = vec![
            Mark::line(scaled(air), BLUE).label("ours, air"),
            Mark::line(scaled(water), GREEN).label("ours in water, before its training on land"),
        ];
        if let Some(theirs) = theirs {
            let points = scaled(&pick(theirs)[0]);
            marks.push(Mark::line(points, BLACK).dashed().label("the authors' agent, air"));
        }
        let x = Axis::around(label, scaled(air).iter().map(|(x, _)| *x));
        Panel {
            title: String::new(),
            x,
            y: Axis::new("share of survived starts", -0.02..1.02),
            marks,
        }
    };
    let start_panels = DRAWN_N_M.iter().zip(&ours.hops).map(|(k, hops)| Panel {
        title: format!("ours, air, {} kN/m", k / 1e3),
        x: Axis::new("velocity at the start, m/s", -SPEED_M_S..SPEED_M_S),
        y: Axis::new("height at the start, m", HEIGHT_M[0]..HEIGHT_M[1]),
        marks: vec![Mark::cells(
            (-SPEED_M_S..SPEED_M_S, HEIGHT_M[0]..HEIGHT_M[1]),
            ours.start_cells,
            hops.clone(),
            0.0..f64::from(HOPS),
            "hops",
        )],
    });
    let mut rows = vec![
        vec![
            lines(|b| &b.by_stiffness, "stiffness at 80 kg, kN/m", 1e3),
            lines(|b| &b.by_mass, "mass at 20 kN/m, kg", 1.0),
        ],
        ours.planes("ours"),
        start_panels.collect(),
    ];
    if let Some(theirs) = theirs {
        rows.insert(2, theirs.planes("the authors'"));
    }
    let title = "Figure 11. Basin of attraction over other bodies";
    let note = "share of random starts from which the agent takes 30 hops; in water, with the agent \
                before its training on land; last row, hops by start";
    Ok(Sheet::new(title, note).rows(226, rows).draw()?)
}

fn table(ours: &Basin, theirs: Option<&Basin>) -> String {
    let mut csv = String::from("whose,medium,mass_kg,stiffness_n_m,survive30\n");
    let sets = [("ours", Some(ours)), ("authors", theirs)];
    for (whose, basin) in sets.into_iter().filter_map(|(whose, b)| Some((whose, b?))) {
        for (i, (medium, _)) in MEDIA.iter().enumerate() {
            let springs = basin.by_stiffness[i].iter().map(|(k, share)| ([TRAINED[0], *k], *share));
            let masses = basin.by_mass[i].iter().map(|(m, share)| ([*m, TRAINED[1]], *share));
            let plane = Plane { cells: basin.cells }.bodies();
            let plane = plane.into_iter().zip(basin.plane[i].iter().copied());
            for ([mass, stiffness], share) in springs.chain(masses).chain(plane) {
                let _ = writeln!(csv, "{whose},{medium},{mass},{stiffness},{share}");
            }
        }
    }
    csv
}

#[cfg(test)]
mod tests {
    use super::*;
    use trainer::evaluate::hopper;

    fn basin(by_stiffness: [f64; 8], by_mass: f64) -> Basin {
        let springs: Vec<_> = STIFFNESS_N_M.into_iter().zip(by_stiffness).collect();
        let masses: Vec<_> = MASS_KG.into_iter().map(|m| (m, by_mass)).collect();
        Basin {
            by_stiffness: [springs.clone(), springs],
            by_mass: [masses.clone(), masses],
            cells: 1,
            plane: [vec![0.5], vec![0.0]],
            start_cells: 1,
            hops: vec![vec![3.0]; 3],
        }
    }

    #[test]
    fn the_claims_follow_the_shares() {
        let as_described = basin([0.0, 0.04, 0.2, 0.4, 0.8, 0.9, 1.0, 1.0], 0.9);
        assert_eq!(drastic(&as_described).verdict, Verdict::Holds);
        assert_eq!(softer(&as_described).verdict, Verdict::Holds);
        let even = basin([0.2; 8], 0.9);
        assert_eq!(drastic(&even).verdict, Verdict::InPart);
        assert_eq!(softer(&even).verdict, Verdict::Fails);
        let rows = 2 * (STIFFNESS_N_M.len() + MASS_KG.len() + 1) + 1;
        assert_eq!(table(&even, None).lines().count(), rows);
    }

    #[test]
    fn the_trained_body_is_the_papers_leg() {
        let start = Apex { vx_m_s: 0.4, y_m: 2.0 };
        let action = leg_plant::Action { touchdown_angle_rad: 1.6, elongation_speed_m_s: 0.3 };
        for (_, medium) in MEDIA {
            let leg = leg_with(TRAINED[0], TRAINED[1], medium).hop(start, action);
            assert_eq!(leg, hopper(medium.density_ratio()).hop(start, action));
        }
    }
}
