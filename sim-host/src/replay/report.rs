//! The result of a replay.

use std::fmt;
use std::path::{Path, PathBuf};

use leg_control::wire::Command;
use serde::Serialize;

use super::compare::{Difference, difference};
use super::controller::Continuity;
use super::faulted;
use super::source::Answer;
use crate::record::contents::Contents;
use crate::record::read::ReadError;
use crate::record::schema::Config;

/// Most apexes in the text table.
const MAX_TABLE_APEXES: usize = 12;

/// The decisions of both controllers at an apex of the recording.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ApexComparison {
    /// Tick of the sample at which the recorded controller decided.
    pub tick: u64,
    /// Time of that tick, s.
    pub t_s: f64,
    /// Set-point, m/s.
    pub set_point_m_s: f32,
    /// Recorded velocity at the apex, m/s.
    pub apex_vx_m_s: f32,
    /// Density ratio that the actor received: recorded, replayed.
    pub density_ratio: [f32; 2],
    /// Leg angle, rad: recorded, replayed.
    pub leg_angle_rad: [f32; 2],
    /// Fastest elongation until the next apex, m/s: recorded, replayed.
    pub elongation_rate_m_s: [f32; 2],
    /// Offset of the velocity cascade, m/s: recorded, replayed.
    pub velocity_offset_m_s: [f32; 2],
}

/// Result of a replay.
#[derive(Clone, Debug, Serialize)]
pub struct ReplayReport {
    /// The recording.
    pub recording: PathBuf,
    /// `lock-step` or `real-time`.
    pub time_mode: String,
    /// The policy replayed; the first one if it was swapped.
    pub policy: String,
    /// Whether another policy than the recorded one was replayed.
    pub is_other: bool,
    /// Ticks in the recording.
    pub ticks: u64,
    /// Commands compared.
    pub compared: u64,
    /// Estimates of the controller compared, where the recording has them; with the recorded
    /// policy, and once all commands are equal.
    pub estimates_compared: u64,
    /// Whether all compared commands and estimates were equal bit for bit.
    pub equal: bool,
    /// Commands that differ. With the recorded policy the replay ends at the first.
    pub different: u64,
    /// Samples without a command in the recording; none in lock-step.
    pub unanswered: u64,
    /// The first difference.
    pub first_difference: Option<Difference>,
    /// The first difference of an estimate; the replay ends there.
    pub first_estimate_difference: Option<Difference>,
    /// Ticks at which the recorded controller had restarted without any state.
    pub restart_ticks: Vec<u64>,
    /// Why the rest of the recording was not compared.
    pub not_compared: Option<String>,
    /// Ticks that were not compared for that reason.
    pub not_compared_ticks: u64,
    /// Decisions at each apex, for another policy.
    pub apexes: Vec<ApexComparison>,
    /// Warnings about the recording.
    pub warnings: Vec<String>,
    /// Whether the recording is whole: neither cut off nor damaged.
    #[serde(skip)]
    pub is_complete: bool,
    #[serde(skip)]
    last_apexes: u32,
}

impl ReplayReport {
    pub(super) fn new(
        path: &Path,
        contents: &Contents,
        policy: &str,
        is_other: bool,
        injects_faults: bool,
    ) -> Result<Self, ReadError> {
        let config = contents.config()?;
        Ok(Self {
            recording: path.to_owned(),
            time_mode: config.time_mode.clone(),
            policy: policy.to_owned(),
            is_other,
            ticks: contents.ticks,
            compared: 0,
            estimates_compared: 0,
            equal: true,
            different: 0,
            unanswered: 0,
            first_difference: None,
            first_estimate_difference: None,
            restart_ticks: Vec::new(),
            not_compared: None,
            not_compared_ticks: 0,
            apexes: Vec::new(),
            warnings: contents
                .warning()
                .into_iter()
                .chain(fault_warning(config).filter(|_| !injects_faults))
                .collect(),
            is_complete: contents.is_complete(),
            last_apexes: 0,
        })
    }

    pub(super) fn add_same(&mut self, answer: &Answer, continuity: Continuity) {
        self.count(answer);
        if continuity == Continuity::Restarted {
            self.restart_ticks.push(answer.command.header.seq);
        }
    }

    pub(super) fn add_different(&mut self, answer: &Answer, difference: Difference) {
        self.count(answer);
        self.equal = false;
        self.different += 1;
        self.first_difference.get_or_insert(difference);
    }

    /// Adds the command of another policy for the same samples.
    pub(super) fn add_other(&mut self, answer: &Answer, replayed: &Command) {
        let recorded = &answer.command;
        match difference(recorded, replayed) {
            Some(difference) => self.add_different(answer, difference),
            None => self.count(answer),
        }
        if recorded.apexes != self.last_apexes {
            self.last_apexes = recorded.apexes;
            self.apexes.push(ApexComparison {
                tick: recorded.header.seq,
                t_s: 1e-9 * answer.sample.header.t_ns as f64,
                set_point_m_s: answer.sample.set_point_m_s,
                apex_vx_m_s: recorded.apex_vx_m_s,
                density_ratio: [recorded.density_ratio, replayed.density_ratio],
                leg_angle_rad: [recorded.leg_angle_rad, replayed.leg_angle_rad],
                elongation_rate_m_s: [0.0; 2],
                velocity_offset_m_s: [recorded.velocity_offset_m_s, replayed.velocity_offset_m_s],
            });
        }
        if let Some(row) = self.apexes.last_mut() {
            for (fastest, command) in row.elongation_rate_m_s.iter_mut().zip([recorded, replayed]) {
                *fastest = fastest.max(command.elongation_rate_m_s);
            }
        }
    }

    pub(super) fn stop(&mut self, why: String) {
        self.not_compared = Some(why);
    }

    pub(super) fn finish(&mut self) {
        if self.not_compared.is_some() {
            self.not_compared_ticks = self.ticks.saturating_sub(self.compared + self.unanswered);
        }
    }

    /// Returns whether all commands of the recording were compared, and they and the estimates
    /// are equal bit for bit.
    #[must_use]
    pub fn is_the_same(&self) -> bool {
        self.equal && self.not_compared.is_none()
    }

    fn count(&mut self, answer: &Answer) {
        self.compared += 1;
        self.unanswered += answer.unanswered.len() as u64;
    }
}

/// Returns a warning if faults were injected on the link of the run.
fn fault_warning(config: &Config) -> Option<String> {
    faulted::link_faults(config).map(|_| {
        "faults were injected on the link of the run, so the controller may have received other \
         samples than the recorded ones, and the leg other commands than it sent"
            .to_owned()
    })
}

impl fmt::Display for ReplayReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { policy, compared, different, .. } = self;
        writeln!(
            f,
            "{}: {}, {} ticks; policy {policy}",
            self.recording.display(),
            self.time_mode,
            self.ticks
        )?;
        if self.unanswered > 0 {
            writeln!(f, "{} samples without a command in the recording", self.unanswered)?;
        }
        for tick in &self.restart_ticks {
            writeln!(f, "at tick {tick} the recorded controller restarted without any state")?;
        }
        match (&self.first_difference, &self.not_compared) {
            (None, None) => writeln!(f, "{compared} commands compared: the same, bit for bit")?,
            (None, Some(_)) => writeln!(f, "{compared} commands are the same, bit for bit")?,
            (Some(first), _) => {
                let Difference { tick, field, recorded, replayed } = first;
                if self.is_other {
                    writeln!(f, "{compared} commands compared, {different} differ")?;
                } else {
                    writeln!(
                        f,
                        "{} commands are the same, bit for bit, the next differs",
                        compared.saturating_sub(1)
                    )?;
                }
                writeln!(
                    f,
                    "first at tick {tick}, in {field}: recorded {} (bits {}), replayed {} (bits {})",
                    recorded.value, recorded.bits, replayed.value, replayed.bits
                )?;
            }
        }
        match &self.first_estimate_difference {
            None if self.estimates_compared == 0 => (),
            None => {
                let all = self.estimates_compared;
                writeln!(f, "{all} estimates compared: the same, bit for bit")?;
            }
            Some(Difference { tick, field, recorded, replayed }) => writeln!(
                f,
                "{} estimates are the same, bit for bit, the next differs\n\
                 at tick {tick}, in {field}: recorded {} (bits {}), replayed {} (bits {})",
                self.estimates_compared.saturating_sub(1),
                recorded.value,
                recorded.bits,
                replayed.value,
                replayed.bits
            )?,
        }
        if let Some(why) = &self.not_compared {
            let (rest, all) = (self.not_compared_ticks, self.ticks);
            writeln!(f, "{rest} of {all} ticks are not compared: {why}")?;
        }
        if self.is_other { self.table(f) } else { Ok(()) }
    }
}

impl ReplayReport {
    fn table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nAt each apex, recorded and by {}:", self.policy)?;
        writeln!(
            f,
            "{:>9} {:>7} {:>9}  {:>15}  {:>17}  {:>15}  {:>17}",
            "time, s", "set-pt", "apex vx", "density", "leg angle, rad", "push, m/s", "offset, m/s"
        )?;
        for row in self.apexes.iter().take(MAX_TABLE_APEXES) {
            let pair = |[a, b]: [f32; 2], digits: usize| format!("{a:.digits$} {b:.digits$}");
            writeln!(
                f,
                "{:>9.3} {:>7.2} {:>9.3}  {:>15}  {:>17}  {:>15}  {:>17}",
                row.t_s,
                row.set_point_m_s,
                row.apex_vx_m_s,
                pair(row.density_ratio, 3),
                pair(row.leg_angle_rad, 4),
                pair(row.elongation_rate_m_s, 3),
                pair(row.velocity_offset_m_s, 4),
            )?;
        }
        match self.apexes.len().saturating_sub(MAX_TABLE_APEXES) {
            0 => Ok(()),
            more => writeln!(f, "and {more} more apexes; the JSON output has all"),
        }
    }
}
