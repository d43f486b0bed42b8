//! What a replay came to.

use std::fmt;
use std::path::{Path, PathBuf};

use leg_control::wire::Command;
use serde::Serialize;

use super::compare::{Difference, difference};
use super::recorded;
use super::source::{Answer, Source, Summary};
use crate::record::read::ReadError;
use crate::scenario::Settings;

/// Rows of the table at the beginning of the text.
const ROWS: usize = 12;

/// What both controllers decided at an apex of the recording.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ApexRow {
    /// Tick of the sample at which the recorded one decided.
    pub tick: u64,
    /// Its time, s.
    pub t_s: f64,
    /// The velocity asked for, m/s.
    pub set_point_m_s: f32,
    /// Recorded: the velocity at the apex, m/s.
    pub apex_vx_m_s: f32,
    /// Density ratio that the actor was given: recorded, replayed.
    pub density_ratio: [f32; 2],
    /// Leg angle, rad: recorded, replayed.
    pub leg_angle_rad: [f32; 2],
    /// Fastest elongation until the next apex, m/s: recorded, replayed.
    pub elongation_rate_m_s: [f32; 2],
    /// The cascade's offset, m/s: recorded, replayed.
    pub velocity_offset_m_s: [f32; 2],
}

/// What a replay came to.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The recording.
    pub recording: PathBuf,
    /// `lock-step` or `real-time`.
    pub pace: String,
    /// The policy that answered; the first, when it was swapped.
    pub policy: String,
    /// Whether another policy than the recorded one was to answer.
    pub is_other: bool,
    /// Ticks in the recording.
    pub ticks: u64,
    /// Commands that were compared.
    pub compared: u64,
    /// Whether all those were the same, to the last bit.
    pub equal: bool,
    /// Commands that differ. For the recorded policy the replay ends with the first.
    pub different: u64,
    /// Samples for which the recording has no command; in lock-step none.
    pub unanswered: u64,
    /// Where.
    pub first_difference: Option<Difference>,
    /// Ticks at which the recorded controller knew nothing of the ticks before,
    /// as a process that is started again.
    pub began_anew: Vec<u64>,
    /// Why the rest of the recording was not compared.
    pub not_compared: Option<String>,
    /// For another policy: apex by apex.
    pub apexes: Vec<ApexRow>,
    /// What is wrong with the file.
    pub warnings: Vec<String>,
    #[serde(skip)]
    apexes_told: u32,
}

impl Report {
    pub(super) fn new(path: &Path, summary: &Summary, policy: &str, is_other: bool) -> Self {
        Self {
            recording: path.to_owned(),
            pace: summary.config.pace.clone(),
            policy: policy.to_owned(),
            is_other,
            ticks: summary.ticks,
            compared: 0,
            equal: true,
            different: 0,
            unanswered: 0,
            first_difference: None,
            began_anew: Vec::new(),
            not_compared: None,
            apexes: Vec::new(),
            warnings: faults(summary).into_iter().collect(),
            apexes_told: 0,
        }
    }

    pub(super) fn same(&mut self, answer: &Answer, begun_anew: bool) {
        self.count(answer);
        if begun_anew {
            self.began_anew.push(answer.command.seq);
        }
    }

    pub(super) fn different(&mut self, answer: &Answer, difference: Difference) {
        self.count(answer);
        self.equal = false;
        self.different += 1;
        self.first_difference.get_or_insert(difference);
    }

    /// What another policy says to the same samples.
    pub(super) fn other(&mut self, answer: &Answer, replayed: &Command) {
        let recorded = recorded(answer);
        match difference(&recorded, replayed) {
            Some(difference) => self.different(answer, difference),
            None => self.count(answer),
        }
        if recorded.apexes != self.apexes_told {
            self.apexes_told = recorded.apexes;
            self.apexes.push(ApexRow {
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
            for (fastest, command) in row.elongation_rate_m_s.iter_mut().zip([&recorded, replayed])
            {
                *fastest = fastest.max(command.elongation_rate_m_s);
            }
        }
    }

    pub(super) fn stop(&mut self, why: String) {
        self.not_compared = Some(why);
    }

    pub(super) fn finish(&mut self, source: &mut Source) -> Result<(), ReadError> {
        self.warnings.extend(source.warning()?);
        if let Some(why) = &self.not_compared {
            let rest = self.ticks.saturating_sub(self.compared + self.unanswered);
            self.warnings.push(format!("{why}; {rest} of {} ticks are not compared", self.ticks));
        }
        Ok(())
    }

    fn count(&mut self, answer: &Answer) {
        self.compared += 1;
        self.unanswered += answer.unanswered.len() as u64;
    }
}

/// What is to be known of a run with faults on purpose.
fn faults(summary: &Summary) -> Option<String> {
    let settings = Settings::from_toml(&summary.config.scenario_toml).ok()?;
    (!settings.faults.is_empty()).then(|| {
        "the run had faults on purpose; where they are on the link, the controller may have seen \
         other samples than the recorded ones"
            .to_owned()
    })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { policy, compared, different, .. } = self;
        writeln!(
            f,
            "{}: {}, {} ticks; policy {policy}",
            self.recording.display(),
            self.pace,
            self.ticks
        )?;
        if self.unanswered > 0 {
            writeln!(f, "{} samples without a command in the recording", self.unanswered)?;
        }
        for tick in &self.began_anew {
            writeln!(f, "at tick {tick} the recorded controller began anew, knowing nothing")?;
        }
        match &self.first_difference {
            None => writeln!(f, "{compared} commands compared: the same, bit for bit")?,
            Some(first) => {
                let Difference { tick, field, recorded, replayed } = first;
                if self.is_other {
                    writeln!(f, "{compared} commands compared, {different} differ")?;
                } else {
                    writeln!(
                        f,
                        "{} commands are the same, bit for bit, the next differs",
                        compared - 1
                    )?;
                }
                writeln!(
                    f,
                    "first at tick {tick}, in {field}: recorded {} (bits {}), replayed {} (bits {})",
                    recorded.value, recorded.bits, replayed.value, replayed.bits
                )?;
            }
        }
        if self.is_other { self.table(f) } else { Ok(()) }
    }
}

impl Report {
    fn table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nAt each apex, recorded and by {}:", self.policy)?;
        writeln!(
            f,
            "{:>9} {:>7} {:>9}  {:>15}  {:>17}  {:>15}  {:>17}",
            "time, s", "asked", "apex vx", "density", "leg angle, rad", "push, m/s", "offset, m/s"
        )?;
        for row in self.apexes.iter().take(ROWS) {
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
        match self.apexes.len().saturating_sub(ROWS) {
            0 => Ok(()),
            more => writeln!(f, "and {more} more apexes (--json has them all)"),
        }
    }
}
