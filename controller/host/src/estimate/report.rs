//! What came of a log.

use std::fmt;
use std::path::{Path, PathBuf};

use leg_control::estimator::Estimate;
use leg_control::guard::Counts;
use leg_control::serial::node::SessionParams;
use leg_process::rounded;
use leg_recording::schema;
use serde::Serialize;

use super::run::Held;
use crate::law::Described;

/// Most apexes in the text table.
const MOST_ROWS: usize = 40;

/// The estimate when an apex had passed.
#[derive(Clone, Debug, Serialize)]
pub struct ApexRow {
    /// Time of the measurement, s.
    pub t_s: f64,
    /// Horizontal velocity, m/s, height, m, and density ratio.
    pub estimate: [f32; 3],
    /// Their standard deviations.
    pub deviation: [f64; 3],
    /// The true values, where they are known.
    pub truth: Option<[f64; 3]>,
    /// Mean square of the innovations in flight since the apex before, in standard deviations.
    pub nis: Option<f64>,
}

/// Errors at the apexes whose truth is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    /// Their number.
    pub apexes: usize,
    /// Root mean square of the error of horizontal velocity, m/s, height, m, and density ratio.
    pub rms: [f64; 3],
    /// Mean square of the errors in standard deviations.
    pub nees: [f64; 3],
}

/// What came of a log.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// The log.
    pub input: PathBuf,
    /// Ticks a second of the law.
    pub rate_hz: u32,
    /// Its gravity, m/s2.
    pub gravity_m_s2: f32,
    /// Its estimator, with the noise.
    pub estimator: String,
    /// Its policy.
    pub policy: String,
    /// Whether the log is a recording of a run in real time.
    pub is_real_time: bool,
    /// Rows of the log.
    pub rows: u64,
    /// Ticks that were played because rows were missing.
    pub empty_ticks: u64,
    /// Time from the first row to the last, s.
    pub duration_s: f64,
    /// Rows after which there was an estimate.
    pub estimated: u64,
    /// Times that an estimate was lost.
    pub lost: u32,
    /// Rows of which only a part of the readings was used.
    pub used_in_part: u32,
    /// Ticks whose sample was not used, by reason; without those of `empty_ticks`.
    pub rejected: Vec<(&'static str, u32)>,
    /// Times that the safe state was entered.
    pub safe_entered: u32,
    /// Each apex.
    pub apexes: Vec<ApexRow>,
    /// Errors at the apexes; none without truth.
    pub errors: Option<Errors>,
    /// Mean square of all innovations in flight, in standard deviations: 1 for a consistent
    /// filter.
    pub nis: Option<f64>,
    /// Estimates in the recording, and how many of these have other bits.
    pub recorded: u64,
    /// See `recorded`.
    pub different: u64,
    /// Tick of the first of these.
    pub first_different: Option<u64>,
    /// What is noteworthy about the file.
    pub warnings: Vec<String>,
    #[serde(skip)]
    last_apexes: u32,
    #[serde(skip)]
    of_hop: MeanSquare,
    #[serde(skip)]
    of_all: MeanSquare,
}

#[derive(Clone, Copy, Debug, Default)]
struct MeanSquare {
    sum: f64,
    count: u64,
}

impl MeanSquare {
    fn add(&mut self, x: f64) {
        self.sum += x * x;
        self.count += 1;
    }

    fn get(self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }
}

impl Report {
    /// Returns the report of a law that has not run yet.
    pub(super) fn new(path: &Path, params: &SessionParams, policy: String) -> Self {
        Self {
            input: path.to_owned(),
            rate_hz: params.rate_hz,
            gravity_m_s2: params.gravity_m_s2,
            estimator: Described(params.estimator).to_string(),
            policy,
            ..Self::default()
        }
    }

    /// Adds what is held after a tick.
    pub(super) fn add(
        &mut self,
        held: &Held,
        empty_before: u64,
        recorded: Option<&schema::Estimate>,
        seq: u64,
    ) {
        self.rows += 1;
        self.empty_ticks += empty_before;
        self.duration_s = self.duration_s.max(held.t_s);
        self.estimated += u64::from(held.estimate.is_some());
        if let Some(recorded) = recorded {
            self.recorded += 1;
            let ours = held.estimate.map(|e| schema::Estimate::at_tick(recorded.seq, &e));
            if !ours.is_some_and(|ours| ours.has_the_bits_of(recorded)) {
                self.different += 1;
                self.first_different.get_or_insert(seq);
            }
        }
        if let Some(estimate) = held.estimate.filter(|estimate| !estimate.in_stance) {
            self.of_hop.add(estimate.innovation.into());
            self.of_all.add(estimate.innovation.into());
        }
        if held.apexes > self.last_apexes
            && let Some(estimate) = held.estimate
        {
            let nis = std::mem::take(&mut self.of_hop).get();
            self.apexes.push(ApexRow::new(&estimate, held, nis));
        }
        self.last_apexes = held.apexes;
    }

    /// Completes the report with the counts of the law and what is noteworthy about the file.
    pub(super) fn finish(&mut self, counts: &Counts, warnings: Vec<String>) {
        let empty = u32::try_from(self.empty_ticks).unwrap_or(u32::MAX);
        let less = |(kind, count): (&'static str, u32)| {
            (kind, if kind == "missing" { count.saturating_sub(empty) } else { count })
        };
        let all = counts.by_kind().map(less);
        self.rejected = all.into_iter().filter(|(_, count)| *count > 0).collect();
        self.lost = counts.estimates_lost;
        self.used_in_part = counts.used_in_part;
        self.safe_entered = counts.safe_entered;
        self.nis = self.of_all.get();
        self.errors = Errors::of(&self.apexes);
        self.warnings = warnings;
        let path = self.input.display();
        if let refused @ 1.. = counts.set_points_refused {
            self.warnings.push(format!(
                "{path}: {refused} set-points are out of range; the last good one was held"
            ));
        }
        let rejected: u64 = self.rejected.iter().map(|(_, count)| u64::from(*count)).sum();
        if rejected >= self.rows {
            self.warnings.push(format!(
                "{path}: no row could be used; its readings are not those of the estimator, or \
                 not in the units of the columns"
            ));
        }
    }
}

impl ApexRow {
    fn new(estimate: &Estimate, held: &Held, nis: Option<f64>) -> Self {
        let e = estimate;
        let deviation = |variance: f32| f64::from(variance).sqrt();
        let truth = held.truth.map(|truth| truth.values).map(|[vx, y, _, rho]| [vx, y, rho]);
        Self {
            t_s: held.measured_s,
            estimate: [e.vx_m_s, e.y_m, e.density_ratio],
            deviation: [e.vx_variance, e.y_variance, e.density_variance].map(deviation),
            // Of a late sample the truth is that of another time.
            truth: truth
                .filter(|truth| truth.iter().all(|x| x.is_finite()) && held.measured_s == held.t_s),
            nis,
        }
    }
}

impl Errors {
    fn of(apexes: &[ApexRow]) -> Option<Self> {
        let mut squares = [MeanSquare::default(); 3];
        let mut normal = squares;
        for row in apexes {
            let Some(truth) = row.truth else { continue };
            for i in 0..3 {
                let error = f64::from(row.estimate[i]) - truth[i];
                squares[i].add(error);
                normal[i].add(error / row.deviation[i]);
            }
        }
        let apexes = squares[0].count as usize;
        (apexes > 0).then(|| Self {
            apexes,
            rms: squares.map(|mean| mean.get().unwrap_or_default().sqrt()),
            nees: normal.map(|mean| mean.get().unwrap_or_default()),
        })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { input, rows, duration_s, rate_hz, estimator, policy, .. } = self;
        writeln!(
            f,
            "{}: {rows} rows, {duration_s:.3} s at {rate_hz} Hz\nestimator {estimator}; policy \
             {policy}\n",
            input.display()
        )?;
        self.table(f)?;
        self.counts(f)?;
        if let Some(nis) = self.nis {
            writeln!(f, "innovations in flight, mean square (NIS): {nis:.2}, 1 if consistent")?;
        }
        if let Some(Errors { apexes, rms: [vx, y, rho], nees: [nees_vx, nees_y, nees_rho] }) =
            self.errors
        {
            writeln!(
                f,
                "errors at {apexes} apexes, rms: vx {vx:.4} m/s, y {y:.4} m, density {rho:.4}; in \
                 standard deviations, mean square (NEES): {nees_vx:.2}, {nees_y:.2}, {nees_rho:.2}"
            )?;
        }
        match (self.recorded, self.different, self.first_different) {
            (0, ..) => Ok(()),
            (all, 0, _) => writeln!(f, "{all} estimates in the recording: the same, bit for bit"),
            (all, different, first) => writeln!(
                f,
                "{all} estimates in the recording: {different} differ, the first at tick {}",
                first.unwrap_or_default()
            ),
        }
    }
}

impl Report {
    fn table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let head = ["vx, m/s", "y, m", "density"].map(|name| format!("  {name:>16}")).concat();
        let truth = match self.errors {
            Some(_) => ["true vx", "y", "density"].map(|name| format!("  {name:>8}")).concat(),
            None => String::new(),
        };
        writeln!(f, "{:>9}{head}  {:>5}{truth}", "time, s", "NIS")?;
        for row in self.apexes.iter().take(MOST_ROWS) {
            write!(f, "{:>9.3}", row.t_s)?;
            for (value, deviation) in row.estimate.into_iter().zip(row.deviation) {
                let text = format!("{:.3} \u{b1} {deviation:.3}", rounded(value.into(), 3));
                write!(f, "  {text:>16}")?;
            }
            write!(f, "  {:>5}", row.nis.map_or_else(String::new, |nis| format!("{nis:.2}")))?;
            match row.truth.map(|truth| truth.map(|x| rounded(x, 3))) {
                Some([vx, y, rho]) => writeln!(f, "  {vx:>8.3}  {y:>8.3}  {rho:>8.3}")?,
                None => writeln!(f)?,
            }
        }
        if let more @ 1.. = self.apexes.len().saturating_sub(MOST_ROWS) {
            writeln!(f, "and {more} more apexes; the JSON output has all")?;
        }
        Ok(())
    }

    fn counts(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rows, estimated, lost, used_in_part, empty_ticks, safe_entered, .. } = self;
        let apexes = self.apexes.len();
        writeln!(
            f,
            "\n{apexes} apexes; an estimate after {estimated} of {rows} rows, lost {lost} times"
        )?;
        let rejected: u32 = self.rejected.iter().map(|(_, count)| count).sum();
        write!(f, "{rejected} rows rejected")?;
        for (kind, count) in &self.rejected {
            write!(f, ", {count} {kind}")?;
        }
        writeln!(
            f,
            "; {used_in_part} used in part; {empty_ticks} ticks without a row; safe state entered {safe_entered} times"
        )
    }
}
