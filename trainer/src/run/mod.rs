//! A training run: a training with its log, checkpoints, progress and collapse detection.
//!
//! While it runs, these files are beside the policy `X.bin` to be written (beside `X`, the
//! log is `X.csv`, whatever dots are in `X`):
//!
//! | file | content |
//! |---|---|
//! | `X.csv.part` | the log so far; renamed to `X.csv` when the training is complete |
//! | `X.bin.checkpoint` | the latest [checkpoint](Checkpoint); removed when the policy is written |
//! | `X.bin.checkpoint.part` | a checkpoint that is being written |
//!
//! A process that is killed leaves these. A checkpoint holds the length of the log, so that
//! the log is cut to where the training resumes.

pub mod checkpoint;
pub mod collapse;
pub mod error;
pub mod log;
mod owner;
pub mod paths;
pub mod progress;
pub mod recent;
pub mod tensorboard;

use crate::config::Config;
use crate::train::{EpisodeRecord, Training};
use checkpoint::{Checkpoint, CheckpointWriter};
use collapse::CollapseDetector;
use error::RunError;
use leg_process::Stop;
use leg_simd::Isa;
use log::Log;
use progress::Progress;
use recent::RecentEpisodes;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tensorboard::EventWriter;

/// The files and options of a run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Path of the policy file.
    pub out: PathBuf,
    /// Path of the log, a CSV file.
    pub log: PathBuf,
    /// Folder for TensorBoard event files, which are in a folder of their own below it.
    pub tensorboard: Option<PathBuf>,
    /// Time between checkpoints; `None` for none.
    pub checkpoint_every: Option<Duration>,
    /// Whether to suppress progress output.
    pub quiet: bool,
    /// Whether to continue a training that has collapsed.
    pub allow_collapse: bool,
    /// Whether to discard the rows of an interrupted training that left no checkpoint.
    pub discard: bool,
}

/// A running training with its files.
pub struct Run {
    training: Training,
    log: Log,
    checkpoints: CheckpointWriter,
    events: Option<EventWriter>,
    /// Path of the log, as checkpoints state it.
    log_hint: PathBuf,
    recent: RecentEpisodes,
    detector: Option<CollapseDetector>,
    progress: Progress,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunEnd {
    /// All stages are complete.
    Done,
    /// A signal stopped the run.
    Stopped,
}

/// The files to close when the policy is written.
pub struct PendingFinish {
    log: Log,
    checkpoints: CheckpointWriter,
}

impl Run {
    /// Begins a training at its first step.
    ///
    /// # Errors
    /// [`RunError`] when a file cannot be written, or the log has rows of another training.
    pub fn begin(
        config: Config,
        seed: u64,
        isa: Isa,
        options: &RunOptions,
    ) -> Result<Self, RunError> {
        // Before the log, which would be left where the folder cannot be made.
        if let Some(folder) = &options.tensorboard {
            EventWriter::check(folder)?;
        }
        let log = Log::begin(&options.log, |part| discardable(part, options))?;
        let training = Training::new(config, seed, isa);
        let mut run = Self::new(training, RecentEpisodes::default(), log, options)?;
        // From here on the run can be resumed; a checkpoint of an older run must not remain.
        run.checkpoints.remove()?;
        run.checkpoint()?;
        Ok(run)
    }

    /// Resumes a training from a checkpoint. Its log is at the first of `logs`, at least one,
    /// that holds the checkpoint's rows; the log of the options is not used.
    ///
    /// # Errors
    /// [`RunError`] when the checkpoint does not fit its configuration or the log, or a file
    /// cannot be written.
    pub fn resume(
        checkpoint: Checkpoint,
        logs: &[PathBuf],
        isa: Isa,
        options: &RunOptions,
    ) -> Result<Self, RunError> {
        let path = checkpoint::path(&options.out);
        let config = checkpoint.config(&path)?;
        let log = Log::resume(logs, checkpoint.log)?;
        let training = Training::from_state(config, checkpoint.seed, isa, checkpoint.training)
            .map_err(|cause| RunError::State { path, cause })?;
        Self::new(training, checkpoint.recent, log, options)
    }

    fn new(
        training: Training,
        recent: RecentEpisodes,
        log: Log,
        options: &RunOptions,
    ) -> Result<Self, RunError> {
        let title = paths::title(&options.out);
        let events = options
            .tensorboard
            .as_ref()
            .map(|folder| EventWriter::begin(folder, &title, &training));
        Ok(Self {
            events: events.transpose()?,
            log_hint: paths::hint(log.path(), &options.out),
            log,
            checkpoints: CheckpointWriter::new(&options.out, options.checkpoint_every),
            progress: Progress::new(&training, options.quiet),
            detector: (!options.allow_collapse).then(|| CollapseDetector::new(training.config())),
            training,
            recent,
        })
    }

    /// Returns the training.
    #[must_use]
    pub fn training(&self) -> &Training {
        &self.training
    }

    /// Trains until all stages are complete or a signal arrives. A training that diverges or
    /// collapses leaves its whole log and no checkpoint.
    ///
    /// # Errors
    /// [`RunError`] when it diverges or collapses, or a file cannot be written.
    pub fn learn(&mut self, stop: &Stop) -> Result<RunEnd, RunError> {
        let end = self.episodes(stop);
        self.progress.finish();
        if let Some(events) = &mut self.events {
            match &end {
                Ok(RunEnd::Done) => events.end(&self.training, true)?,
                Err(error) if error.ends_the_training() => events.end(&self.training, false)?,
                _ => events.flush()?,
            }
        }
        if let Err(error) = end {
            if error.ends_the_training() {
                self.log.finish()?;
                self.checkpoints.remove()?;
            }
            return Err(error);
        }
        self.checkpoint()?;
        end
    }

    fn episodes(&mut self, stop: &Stop) -> Result<RunEnd, RunError> {
        while !stop.is_raised() {
            let Some(record) = self.training.episode()? else { return Ok(RunEnd::Done) };
            self.record(&record)?;
            if let Some(detector) = &self.detector {
                detector.check(&mut self.training, &self.recent)?;
            }
            if self.checkpoints.is_due() {
                self.checkpoint()?;
            }
        }
        Ok(RunEnd::Stopped)
    }

    fn record(&mut self, record: &EpisodeRecord) -> Result<(), RunError> {
        let full = record.steps >= self.training.config().episode.max_steps;
        self.recent.push(record, full, self.training.share_of_stage());
        self.log.write(record)?;
        self.progress.report(&self.training, &self.recent);
        match &mut self.events {
            Some(events) => events.record(record, &self.training, &self.recent),
            None => Ok(()),
        }
    }

    fn checkpoint(&mut self) -> Result<(), RunError> {
        if !self.checkpoints.is_enabled() {
            return Ok(());
        }
        let log = self.log.position()?;
        if let Some(events) = &mut self.events {
            events.flush()?;
        }
        self.checkpoints.write(&Checkpoint::new(
            &self.training,
            self.recent.clone(),
            log,
            &self.log_hint,
        ))
    }

    /// Returns the training, and the files to close when its policy is written.
    #[must_use]
    pub fn close(self) -> (Training, PendingFinish) {
        (self.training, PendingFinish { log: self.log, checkpoints: self.checkpoints })
    }
}

impl PendingFinish {
    /// Renames the log and removes the checkpoint. Call this after the policy is written.
    ///
    /// # Errors
    /// [`RunError`] when a file cannot be renamed or removed.
    pub fn close(mut self) -> Result<(), RunError> {
        self.log.finish()?;
        self.checkpoints.remove()
    }
}

/// Checks that the rows in `part`, of an interrupted training, may be discarded.
fn discardable(part: &Path, options: &RunOptions) -> Result<(), RunError> {
    let checkpoint = owner::other_checkpoint(&options.log, &options.out);
    if checkpoint.is_none() && options.discard {
        return Ok(());
    }
    Err(RunError::OtherLog { path: part.into(), checkpoint })
}
