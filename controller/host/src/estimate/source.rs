//! The ticks of a log or of a recording, one by one.

use std::path::Path;

use leg_control::wire::Sample;
use leg_recording::contents::{Contents, Messages};
use leg_recording::read::ReadError;
use leg_recording::schema::{self, AnyMessage, Phase};

use super::Truth;
use super::assemble::{Assembler, Tick};
use super::log::{Log, LogError};

/// Where the ticks come from.
pub(super) enum Source {
    /// Rows of a log.
    Log {
        /// The rows.
        log: Log,
        /// Makes ticks of them.
        assembler: Assembler,
    },
    /// A recording.
    Recording(Box<RecordedTicks>),
}

impl Source {
    /// Returns the next tick, none after the last.
    pub(super) fn next_tick(&mut self) -> Result<Option<Tick>, LogError> {
        match self {
            Self::Log { log, assembler } => Ok(log.next_row()?.map(|row| assembler.tick(&row))),
            Self::Recording(ticks) => Ok(ticks.next_tick()?),
        }
    }

    /// Returns what is noteworthy about the file, for the user. It is complete only after the
    /// last tick.
    pub(super) fn warnings(&self) -> Vec<String> {
        match self {
            Self::Log { log, .. } => log.warnings(),
            Self::Recording(ticks) => ticks.warning.iter().cloned().collect(),
        }
    }
}

/// The ticks of a recording.
pub(super) struct RecordedTicks {
    messages: Messages,
    warning: Option<String>,
    /// The tick whose messages are being read.
    pending: Option<Tick>,
    /// Run id and number of the last sample, and ticks of the runs before.
    last: Option<(u32, u64)>,
    earlier_ticks: u64,
    tick_ns: u64,
}

impl RecordedTicks {
    /// Opens a recording, of which a tick takes `tick_ns`.
    pub(super) fn open(contents: &Contents, tick_ns: u64) -> Result<Self, ReadError> {
        Ok(Self {
            messages: contents.messages()?,
            warning: contents.warning(),
            pending: None,
            last: None,
            earlier_ticks: 0,
            tick_ns,
        })
    }

    fn next_tick(&mut self) -> Result<Option<Tick>, ReadError> {
        while let Some(message) = self.messages.next_message()? {
            match message {
                AnyMessage::Sample(sample) => {
                    let next = self.begin((&sample).into());
                    if let Some(tick) = self.pending.replace(next) {
                        return Ok(Some(tick));
                    }
                }
                AnyMessage::State(state) => {
                    if let Some(tick) = &mut self.pending {
                        tick.truth = Some((&state).into());
                    }
                }
                AnyMessage::Estimate(estimate) => {
                    if let Some(tick) = &mut self.pending {
                        tick.recorded = Some(estimate);
                    }
                }
                _ => (),
            }
        }
        Ok(self.pending.take())
    }

    fn begin(&mut self, sample: Sample) -> Tick {
        let (run_id, seq) = (sample.header.run_id, sample.header.seq);
        let mut empty_before = 0;
        match self.last.replace((run_id, seq)) {
            Some((last_run, last)) if last_run != run_id => {
                self.earlier_ticks += last.saturating_add(1);
            }
            Some((_, last)) => empty_before = seq.saturating_sub(last.saturating_add(1)),
            None => (),
        }
        // A second without a sample is enough for the safe state.
        let most = 1_100_000_000 / self.tick_ns.max(1);
        Tick {
            empty_before: empty_before.min(most),
            sample: Some(sample),
            t_ns: self.earlier_ticks.saturating_add(seq).saturating_mul(self.tick_ns),
            run_begins_ns: self.earlier_ticks.saturating_mul(self.tick_ns),
            ..Tick::default()
        }
    }
}

impl From<&schema::State> for Truth {
    fn from(state: &schema::State) -> Self {
        Self {
            values: [state.vx_m_s, state.y_m, state.vy_m_s, state.density_ratio],
            in_flight: Some(state.phase() == Phase::Flight),
        }
    }
}

/// Reads the contents of a recording.
pub(super) fn contents(path: &Path) -> Result<Contents, LogError> {
    Ok(Contents::of(path)?)
}
