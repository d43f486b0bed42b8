//! The shipped policy tick by tick, told the density or left to estimate it.

use std::fmt::Write as _;

use leg_control::config::Config;
use leg_control::policy::{Policy, SHIPPED};
use leg_control::wire_controller::WireController;
use leg_host::memory::Inline;
use leg_plant::EventKind;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sim_host::scenario::{DensitySense, Scenario, Settings, StartSettings};
use sim_host::session::Ending;
use sim_host::session::lock_step::{self, Options};

use super::flown::mean_and_swing;
use crate::picture::{Axis, COLORS, Mark, Panel};
use crate::{Claim, FiguresError, Verdict, Workshop};
use trainer::evaluate::DENSITIES;

/// The speed asked for, m/s: at every density a gait has it.
const ASKED_M_S: f64 = 0.5;
/// Simulated time of a run, s, and apexes that are judged: the last.
const RUN_S: f64 = 90.0;
const JUDGED: usize = 15;
/// An estimate that costs no more than this in speed does as well, m/s.
const AS_WELL_M_S: f64 = 0.02;
const SENSES: [(DensitySense, &str); 2] =
    [(DensitySense::Measured, "told"), (DensitySense::Estimated, "estimated")];

/// What comes of a density, told or estimated, over some starts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Sensed {
    told: bool,
    rho: f64,
    runs: usize,
    falls: usize,
    /// Mean over the runs that stand of the error of the mean velocity, and of
    /// half its range, m/s.
    error_m_s: f64,
    swing_m_s: f64,
}

/// Every density, told and estimated.
///
/// # Errors
/// [`FiguresError`].
pub(crate) fn both(shop: &Workshop) -> Result<Vec<Sensed>, FiguresError> {
    let starts: u64 = shop.extent.of(6, 2);
    let inputs = (SHIPPED, starts, RUN_S, ASKED_M_S);
    shop.part("sensed", &inputs, shop.extent.of(12.0, 4.0), || {
        let cases: Vec<(DensitySense, f64)> =
            SENSES.iter().flat_map(|(sense, _)| DENSITIES.map(|rho| (*sense, rho))).collect();
        let cases = cases.into_par_iter().with_max_len(1);
        Ok(cases.map(|(sense, rho)| over_starts(sense, rho, starts)).collect())
    })
}

fn over_starts(sense: DensitySense, rho: f64, starts: u64) -> Sensed {
    let runs: Vec<Option<(f64, f64)>> = (0..starts).map(|seed| play(sense, rho, seed)).collect();
    let standing: Vec<(f64, f64)> = runs.iter().copied().flatten().collect();
    let mean = |pick: fn(&(f64, f64)) -> f64| {
        standing.iter().map(pick).sum::<f64>() / standing.len() as f64
    };
    Sensed {
        told: sense == DensitySense::Measured,
        rho,
        runs: runs.len(),
        falls: runs.len() - standing.len(),
        error_m_s: mean(|run| run.0),
        swing_m_s: mean(|run| run.1),
    }
}

/// One run: error of the mean velocity and half its range, m/s; none after a fall.
fn play(sense: DensitySense, rho: f64, seed: u64) -> Option<(f64, f64)> {
    let settings = Settings {
        duration_s: Some(RUN_S),
        density_ratio: Some(rho),
        density: Some(sense),
        set_point_m_s: Some(ASKED_M_S),
        seed: Some(seed),
        start: StartSettings {
            vx_spread_m_s: Some(1.5),
            y_spread_m: Some(1.5),
            ..StartSettings::default()
        },
        ..Settings::default()
    };
    let scenario = Scenario::from_settings(&settings).expect("settings within their limits");
    let policy = Policy::parse(SHIPPED).expect("the shipped policy is whole");
    let config = Config::at_rate(scenario.rate_hz).expect("the usual rate");
    let mut controller = WireController::new(policy, config);
    let mut link = Inline::new(|sample| controller.tick(Some(sample)));
    let mut apexes = Vec::new();
    let outcome = lock_step::run(&scenario, &mut link, Options::default(), |tick| {
        let here = tick.events.iter().filter(|event| event.kind == EventKind::Apex);
        apexes.extend(here.map(|event| event.body.vx_m_s));
    })
    .expect("a link within the process does not break");
    if outcome.ending == Ending::Fall || apexes.len() < JUDGED {
        return None;
    }
    let (mean, swing) = mean_and_swing(&apexes[apexes.len() - JUDGED..]);
    Some(((mean - ASKED_M_S).abs(), swing))
}

fn of(all: &[Sensed], told: bool) -> impl Iterator<Item = &Sensed> {
    all.iter().filter(move |sensed| sensed.told == told)
}

/// Falls, runs, and the largest mean error over the densities, m/s.
fn sum(all: &[Sensed], told: bool) -> (usize, usize, f64) {
    of(all, told).fold((0, 0, 0.0), |(falls, runs, worst), sensed| {
        (falls + sensed.falls, runs + sensed.runs, sensed.error_m_s.max(worst))
    })
}

pub(crate) fn words(all: &[Sensed]) -> String {
    let mut text = format!("Tick by tick at {ASKED_M_S} m/s, {RUN_S} s a run: ");
    for (told, name) in [(true, "told the density"), (false, "estimating it")] {
        let (falls, runs, error) = sum(all, told);
        let _ = write!(
            text,
            "{name}, {falls} of {runs} runs fall, mean error at most {error:.3} m/s at any \
             density{}",
            if told { "; " } else { "." }
        );
    }
    text
}

pub(crate) fn claim(all: &[Sensed]) -> Claim {
    let [(told_falls, _, told), (falls, runs, estimated)] = [sum(all, true), sum(all, false)];
    let extra = of(all, true)
        .zip(of(all, false))
        .map(|(told, estimated)| estimated.error_m_s - told.error_m_s)
        .fold(0.0, f64::max);
    Claim::new(
        "Ours: estimating the density it does as well as being told",
        format!(
            "{falls} against {told_falls} falls in {runs} runs; largest mean error {estimated:.3} \
             against {told:.3} m/s; at worst {extra:.3} m/s more at one density"
        ),
        match (falls <= told_falls, extra <= AS_WELL_M_S) {
            (true, true) => Verdict::Holds,
            (false, false) => Verdict::Fails,
            _ => Verdict::InPart,
        },
    )
}

/// What is drawn: title, axis, value.
type Kind = (&'static str, &'static str, fn(&Sensed) -> f64);

pub(crate) fn panels(all: &[Sensed]) -> Vec<Panel> {
    let kinds: [Kind; 2] = [
        ("error at 0.5 m/s, tick by tick", "error of the mean, m/s", |s| s.error_m_s),
        ("oscillation at 0.5 m/s, tick by tick", "oscillation, m/s", |s| s.swing_m_s),
    ];
    kinds
        .into_iter()
        .map(|(title, label, value)| {
            let lines = [(true, "told", COLORS[0]), (false, "estimated", COLORS[1])];
            let marks = lines.map(|(told, name, color)| {
                let points = of(all, told).map(|sensed| (sensed.rho, value(sensed))).collect();
                Mark::line(points, color, format!("density {name}"))
            });
            let y = Axis::around(label, all.iter().map(value).chain([0.0, 0.01]));
            Panel { title: title.into(), x: density(), y, marks: marks.into() }
        })
        .collect()
}

/// Rows of the table that it is part of.
pub(crate) fn rows(all: &[Sensed]) -> String {
    let mut csv = String::new();
    for sensed in all {
        let how = if sensed.told { "told" } else { "estimated" };
        let Sensed { rho, error_m_s, swing_m_s, .. } = sensed;
        let _ = writeln!(
            csv,
            "shipped,error_m_s_density_{how},earth,{rho},{ASKED_M_S},{error_m_s},{swing_m_s}"
        );
    }
    csv
}

/// The axis of densities.
pub(crate) fn density() -> Axis {
    Axis::new("density ratio", -0.02..1.02)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensed(told: bool, falls: usize, error_m_s: f64) -> Sensed {
        Sensed { told, rho: 0.3, runs: 4, falls, error_m_s, swing_m_s: 0.0 }
    }

    #[test]
    fn the_claim_follows_falls_and_errors() {
        let verdict =
            |falls, error| claim(&[sensed(true, 1, 0.01), sensed(false, falls, error)]).verdict;
        assert_eq!(verdict(1, 0.02), Verdict::Holds);
        assert_eq!(verdict(1, 0.2), Verdict::InPart);
        assert_eq!(verdict(2, 0.2), Verdict::Fails);
    }

    #[test]
    fn the_shipped_policy_follows_told_and_not() {
        for (sense, _) in SENSES {
            let (error, swing) = play(sense, 0.3, 1).unwrap();
            assert!(error < 0.05 && swing < 0.1, "{sense:?}: {error} {swing}");
        }
    }
}
