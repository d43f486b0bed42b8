//! The shipped policy, tick by tick, with the density measured or estimated.

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

use super::apex_run::mean_and_amplitude;
use crate::{Claim, FigureContext, FiguresError, Verdict};
use leg_charts::color::{BLUE, ORANGE};
use leg_charts::{Axis, Mark, Panel};
use trainer::evaluate::DENSITIES;

/// The set-point, m/s, for which there is a gait at every density.
const SET_POINT_M_S: f64 = 0.5;
/// Simulated time of a run, s, and number of apexes that are evaluated: the last.
const RUN_S: f64 = 90.0;
const EVALUATED: usize = 15;
/// An estimate is as good as a measurement if it adds at most this error, m/s.
const TOLERANCE_M_S: f64 = 0.02;
const SENSES: [(DensitySense, &str); 2] =
    [(DensitySense::Measured, "measured"), (DensitySense::Estimated, "estimated")];

/// Results at one density, measured or estimated, over some starts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SourceResult {
    measured: bool,
    rho: f64,
    runs: usize,
    falls: usize,
    /// Means over the runs without a fall: error of the mean velocity, and half its range,
    /// m/s.
    error_m_s: f64,
    amplitude_m_s: f64,
}

/// Runs every density, measured and estimated.
///
/// # Errors
/// [`FiguresError::Write`] if the results cannot be cached.
pub(crate) fn both(ctx: &FigureContext) -> Result<Vec<SourceResult>, FiguresError> {
    let starts: u64 = ctx.extent.of(6, 2);
    let inputs = (SHIPPED, starts, RUN_S, SET_POINT_M_S);
    ctx.cached("density-source", &inputs, ctx.extent.of(12.0, 4.0), || {
        let cases: Vec<(DensitySense, f64)> =
            SENSES.iter().flat_map(|(sense, _)| DENSITIES.map(|rho| (*sense, rho))).collect();
        let cases = cases.into_par_iter().with_max_len(1);
        Ok(cases.map(|(sense, rho)| over_starts(sense, rho, starts)).collect())
    })
}

fn over_starts(sense: DensitySense, rho: f64, starts: u64) -> SourceResult {
    let runs: Vec<Option<(f64, f64)>> = (0..starts).map(|seed| play(sense, rho, seed)).collect();
    let survived: Vec<(f64, f64)> = runs.iter().copied().flatten().collect();
    let mean = |pick: fn(&(f64, f64)) -> f64| {
        survived.iter().map(pick).sum::<f64>() / survived.len() as f64
    };
    SourceResult {
        measured: sense == DensitySense::Measured,
        rho,
        runs: runs.len(),
        falls: runs.len() - survived.len(),
        error_m_s: mean(|run| run.0),
        amplitude_m_s: mean(|run| run.1),
    }
}

/// Plays one run and returns the error of the mean velocity and half its range, m/s, or
/// `None` after a fall.
fn play(sense: DensitySense, rho: f64, seed: u64) -> Option<(f64, f64)> {
    let settings = Settings {
        duration_s: Some(RUN_S),
        density_ratio: Some(rho),
        density: Some(sense),
        set_point_m_s: Some(SET_POINT_M_S),
        seed: Some(seed),
        start: StartSettings {
            vx_spread_m_s: Some(1.5),
            y_spread_m: Some(1.5),
            ..StartSettings::default()
        },
        ..Settings::default()
    };
    let scenario = Scenario::from_settings(&settings).expect("settings within their limits");
    let policy = Policy::parse(SHIPPED).expect("the shipped policy is valid");
    let config = Config::at_rate(scenario.rate_hz).expect("the usual rate");
    let mut controller = WireController::new(policy, config);
    let mut link = Inline::new(|sample| controller.tick(Some(sample)));
    let mut apexes = Vec::new();
    let outcome = lock_step::run(&scenario, &mut link, Options::default(), |tick| {
        let reached = tick.events.iter().filter(|event| event.kind == EventKind::Apex);
        apexes.extend(reached.map(|event| event.body.vx_m_s));
    })
    .expect("an in-process link does not break");
    if outcome.ending == Ending::Fall || apexes.len() < EVALUATED {
        return None;
    }
    let (mean, amplitude) = mean_and_amplitude(&apexes[apexes.len() - EVALUATED..]);
    Some(((mean - SET_POINT_M_S).abs(), amplitude))
}

fn of(all: &[SourceResult], measured: bool) -> impl Iterator<Item = &SourceResult> {
    all.iter().filter(move |result| result.measured == measured)
}

/// Returns falls, runs, and the largest mean error over the densities, m/s.
fn sum(all: &[SourceResult], measured: bool) -> (usize, usize, f64) {
    of(all, measured).fold((0, 0, 0.0), |(falls, runs, worst), result| {
        (falls + result.falls, runs + result.runs, result.error_m_s.max(worst))
    })
}

pub(crate) fn summary(all: &[SourceResult]) -> String {
    let mut text = format!("Tick by tick at {SET_POINT_M_S} m/s, {RUN_S} s for each run: ");
    for (measured, name) in
        [(true, "with the density measured"), (false, "with the density estimated")]
    {
        let (falls, runs, error) = sum(all, measured);
        let _ = write!(
            text,
            "{name}, {falls} of {runs} runs fall, and the mean error is at most {error:.3} m/s at any \
             density{}",
            if measured { "; " } else { "." }
        );
    }
    text
}

pub(crate) fn claim(all: &[SourceResult]) -> Claim {
    let [(measured_falls, _, measured), (falls, runs, estimated)] =
        [sum(all, true), sum(all, false)];
    let extra = of(all, true)
        .zip(of(all, false))
        .map(|(measured, estimated)| estimated.error_m_s - measured.error_m_s)
        .fold(0.0, f64::max);
    Claim::new(
        "Ours: it performs as well with an estimated density as with a measured one",
        format!(
            "{falls} against {measured_falls} falls in {runs} runs; largest mean error \
             {estimated:.3} against {measured:.3} m/s; at most {extra:.3} m/s more at one density"
        ),
        match (falls <= measured_falls, extra <= TOLERANCE_M_S) {
            (true, true) => Verdict::Holds,
            (false, false) => Verdict::Fails,
            _ => Verdict::InPart,
        },
    )
}

/// A quantity that is drawn: title, axis, value.
type Kind = (&'static str, &'static str, fn(&SourceResult) -> f64);

pub(crate) fn panels(all: &[SourceResult]) -> Vec<Panel> {
    let kinds: [Kind; 2] = [
        ("error at 0.5 m/s, tick by tick", "error of the mean, m/s", |s| s.error_m_s),
        ("oscillation at 0.5 m/s, tick by tick", "oscillation, m/s", |s| s.amplitude_m_s),
    ];
    kinds
        .into_iter()
        .map(|(title, label, value)| {
            let lines = [(true, "measured", BLUE), (false, "estimated", ORANGE)];
            let marks = lines.map(|(measured, name, color)| {
                let points = of(all, measured).map(|result| (result.rho, value(result))).collect();
                Mark::line(points, color).label(format!("density {name}"))
            });
            let y = Axis::around(label, all.iter().map(value).chain([0.0, 0.01]));
            Panel { title: title.into(), x: density_axis(), y, marks: marks.into() }
        })
        .collect()
}

/// Returns the rows of the figure's table.
pub(crate) fn rows(all: &[SourceResult]) -> String {
    let mut csv = String::new();
    for result in all {
        // Scripts read these names.
        let how = if result.measured { "measured" } else { "estimated" };
        let SourceResult { rho, error_m_s, amplitude_m_s, .. } = result;
        let _ = writeln!(
            csv,
            "shipped,error_m_s_density_{how},earth,{rho},{SET_POINT_M_S},{error_m_s},{amplitude_m_s}"
        );
    }
    csv
}

/// Returns the axis of densities.
pub(crate) fn density_axis() -> Axis {
    Axis::new("density ratio", -0.02..1.02)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn result(measured: bool, falls: usize, error_m_s: f64) -> SourceResult {
        SourceResult { measured, rho: 0.3, runs: 4, falls, error_m_s, amplitude_m_s: 0.0 }
    }

    #[test]
    fn the_claim_follows_falls_and_errors() {
        let verdict =
            |falls, error| claim(&[result(true, 1, 0.01), result(false, falls, error)]).verdict;
        assert_eq!(verdict(1, 0.02), Verdict::Holds);
        assert_eq!(verdict(1, 0.2), Verdict::InPart);
        assert_eq!(verdict(2, 0.2), Verdict::Fails);
    }

    #[test]
    fn the_shipped_policy_tracks_with_either_source() {
        for (sense, _) in SENSES {
            let (error, amplitude) = play(sense, 0.3, 1).unwrap();
            assert!(error < 0.05 && amplitude < 0.1, "{sense:?}: {error} {amplitude}");
        }
    }
}
