//! A training that can be trusted: driven to its end with a log, checkpoints,
//! progress, and a watch over whether it still learns.
//!
//! What is there while it runs, beside the policy `X.bin` to be:
//!
//! | file | |
//! |---|---|
//! | `X.csv.part` | the log so far; `X.csv` when the training is over |
//! | `X.bin.checkpoint` | the latest [checkpoint](Checkpoint); gone when the policy is written |
//! | `X.bin.checkpoint.part` | a checkpoint being written |
//!
//! A process that is killed leaves these. A checkpoint knows how long the log was,
//! so that the log is cut to where the training goes on.

pub mod checkpoint;
pub mod collapse;
pub mod error;
pub mod log;
pub mod progress;
pub mod recent;
pub mod tensorboard;

use crate::config::Config;
use crate::simd::Isa;
use crate::train::{EpisodeRecord, Training};
use checkpoint::{Checkpoint, CheckpointWriter};
use collapse::Watch;
use error::RunError;
use leg_process::Stop;
use log::Log;
use progress::Progress;
use recent::RecentEpisodes;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tensorboard::EventWriter;

/// Where a run writes and what it says.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// The policy to be.
    pub out: PathBuf,
    /// The log to be.
    pub log: PathBuf,
    /// Folder of TensorBoard event files.
    pub tensorboard: Option<PathBuf>,
    /// Time between checkpoints; `None` for none.
    pub checkpoint_every: Option<Duration>,
    /// Nothing is said of the progress.
    pub quiet: bool,
    /// A collapsed training goes on.
    pub allow_collapse: bool,
}

/// A training with all that goes with it.
pub struct Run {
    training: Training,
    log: Log,
    checkpoints: CheckpointWriter,
    board: Option<EventWriter>,
    recent: RecentEpisodes,
    watch: Option<Watch>,
    progress: Progress,
}

/// How driving a training ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunEnd {
    /// It is over.
    Done,
    /// A signal asked to stop.
    Stopped,
}

/// What is left to do when the policy is written.
pub struct PendingFinish {
    log: Log,
    checkpoints: CheckpointWriter,
}

impl Run {
    /// From the first step.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn begin(
        config: Config,
        seed: u64,
        isa: Isa,
        options: &RunOptions,
    ) -> Result<Self, RunError> {
        let log = Log::begin(&options.log)?;
        let training = Training::new(config, seed, isa);
        let mut run = Self::new(training, RecentEpisodes::default(), log, options)?;
        // From here on it can be resumed, and an old checkpoint is no more.
        run.checkpoints.remove()?;
        run.checkpoint()?;
        Ok(run)
    }

    /// From a checkpoint.
    ///
    /// # Errors
    /// When the checkpoint does not fit its configuration or the log, or a file
    /// cannot be written.
    pub fn resume(
        checkpoint: Checkpoint,
        isa: Isa,
        options: &RunOptions,
    ) -> Result<Self, RunError> {
        let path = checkpoint::path(&options.out);
        let config = checkpoint.config(&path)?;
        let log = Log::resume(&options.log, checkpoint.log)?;
        let training = Training::from_state(config, checkpoint.seed, isa, checkpoint.training)
            .map_err(|cause| RunError::StateError { path, cause })?;
        Self::new(training, checkpoint.recent, log, options)
    }

    fn new(
        training: Training,
        recent: RecentEpisodes,
        log: Log,
        options: &RunOptions,
    ) -> Result<Self, RunError> {
        let board =
            options.tensorboard.as_ref().map(|folder| EventWriter::begin(folder, &training));
        Ok(Self {
            board: board.transpose()?,
            log,
            checkpoints: CheckpointWriter::new(&options.out, options.checkpoint_every),
            progress: Progress::new(&training, options.quiet),
            watch: (!options.allow_collapse).then(|| Watch::new(training.config())),
            training,
            recent,
        })
    }

    /// What is trained.
    #[must_use]
    pub fn training(&self) -> &Training {
        &self.training
    }

    /// To the end, or until a signal. A training that diverges or collapses leaves
    /// its whole log and no checkpoint.
    ///
    /// # Errors
    /// When it diverges or collapses, or a file cannot be written.
    pub fn learn(&mut self, stop: &Stop) -> Result<RunEnd, RunError> {
        let learnt = self.episodes(stop);
        self.progress.end();
        if let Some(board) = &mut self.board {
            board.flush()?;
        }
        if let Err(error) = learnt {
            if error.ends_the_training() {
                self.log.finish()?;
                self.checkpoints.remove()?;
            }
            return Err(error);
        }
        self.checkpoint()?;
        learnt
    }

    fn episodes(&mut self, stop: &Stop) -> Result<RunEnd, RunError> {
        while !stop.is_raised() {
            let Some(record) = self.training.episode()? else { return Ok(RunEnd::Done) };
            self.tell(&record)?;
            if let Some(watch) = &self.watch {
                watch.look(&mut self.training, &self.recent)?;
            }
            if self.checkpoints.is_due() {
                self.checkpoint()?;
            }
        }
        Ok(RunEnd::Stopped)
    }

    fn tell(&mut self, record: &EpisodeRecord) -> Result<(), RunError> {
        let full = record.steps >= self.training.config().episode.max_steps;
        self.recent.push(record, full, self.training.share_of_stage());
        self.log.write(record)?;
        self.progress.tell(&self.training, &self.recent);
        match &mut self.board {
            Some(board) => board.tell(record, &self.training, &self.recent),
            None => Ok(()),
        }
    }

    fn checkpoint(&mut self) -> Result<(), RunError> {
        if !self.checkpoints.keeps() {
            return Ok(());
        }
        let log = self.log.mark()?;
        if let Some(board) = &mut self.board {
            board.flush()?;
        }
        self.checkpoints.write(&Checkpoint::new(
            &self.training,
            self.recent.clone(),
            log,
            self.log.path(),
        ))
    }

    /// The training, and what is left to do when its policy is written.
    #[must_use]
    pub fn close(self) -> (Training, PendingFinish) {
        (self.training, PendingFinish { log: self.log, checkpoints: self.checkpoints })
    }
}

impl PendingFinish {
    /// The policy is written: the log gets its name, the checkpoint goes.
    ///
    /// # Errors
    /// When that cannot be done.
    pub fn close(mut self) -> Result<(), RunError> {
        self.log.finish()?;
        self.checkpoints.remove()
    }
}

/// A path with more at its end.
fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(suffix);
    name.into()
}
