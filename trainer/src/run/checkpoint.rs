//! Checkpoints: the complete state of a training in one file.
//!
//! ```text
//! "LEGCHKPT", version u32, length of the payload u64, payload (postcard), CRC-32 of all that
//! precedes it
//! ```
//!
//! Integers are little-endian. A checkpoint is written to a temporary file, synced and renamed,
//! so the file under its final name is always complete.

use super::error::{Purpose, RunError};
use super::log::LogPosition;
use super::paths::with_suffix;
use super::recent::RecentEpisodes;
use crate::config::Config;
use crate::train::{Training, TrainingState};
use crc::{CRC_32_ISO_HDLC, Crc, Table};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

static CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);
const MAGIC: [u8; 8] = *b"LEGCHKPT";
const VERSION: u32 = 1;
const TRAINER: &str = env!("CARGO_PKG_VERSION");

/// The complete state of a training between two episodes.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Version of the trainer; another version may compute other bits.
    trainer: String,
    /// Seed of the training.
    pub seed: u64,
    /// Complete configuration, TOML.
    config: String,
    /// Final path of the log as seen from the folder of the policy file, or absolute: a hint,
    /// see [`log_candidates`](super::paths::log_candidates).
    pub log_path: PathBuf,
    /// Length and checksum of the log at this checkpoint.
    pub log: LogPosition,
    /// Statistics of the latest episodes.
    pub recent: RecentEpisodes,
    /// State of the training.
    pub training: TrainingState,
}

impl Checkpoint {
    /// Collects the state of a training between two episodes.
    #[must_use]
    pub fn new(
        training: &Training,
        recent: RecentEpisodes,
        log: LogPosition,
        log_path: &Path,
    ) -> Self {
        Self {
            trainer: TRAINER.into(),
            seed: training.seed(),
            config: training.config().to_toml(),
            log_path: log_path.into(),
            log,
            recent,
            training: training.state(),
        }
    }

    /// Serialises the checkpoint.
    ///
    /// # Panics
    /// Never: every field can be serialised.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let payload = postcard::to_stdvec(self).expect("a form for every field");
        let mut bytes = Vec::with_capacity(payload.len() + 24);
        bytes.extend(MAGIC);
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend((payload.len() as u64).to_le_bytes());
        bytes.extend(payload);
        bytes.extend(CRC.checksum(&bytes).to_le_bytes());
        bytes
    }

    /// Parses a checkpoint.
    ///
    /// # Errors
    /// States what is wrong with the bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let short = || format!("not a complete checkpoint: it has {} bytes", bytes.len());
        let (magic, rest) = bytes.split_first_chunk::<8>().ok_or_else(short)?;
        if *magic != MAGIC {
            return Err("not the checkpoint of a training".into());
        }
        let (version, rest) = rest.split_first_chunk::<4>().ok_or_else(short)?;
        let version = u32::from_le_bytes(*version);
        if version != VERSION {
            return Err(format!("a checkpoint of version {version}; this trainer reads {VERSION}"));
        }
        let (length, rest) = rest.split_first_chunk::<8>().ok_or_else(short)?;
        let length = u64::from_le_bytes(*length).saturating_add(4);
        if rest.len() as u64 != length {
            let found = rest.len();
            return Err(format!(
                "not a complete checkpoint: {found} bytes follow, expected {length}"
            ));
        }
        let (body, stored) = bytes.split_last_chunk::<4>().ok_or_else(short)?;
        let (stored, found) = (u32::from_le_bytes(*stored), CRC.checksum(body));
        if stored != found {
            return Err(format!(
                "a corrupt checkpoint: its checksum is {found:08x}, expected {stored:08x}"
            ));
        }
        let payload = &rest[..rest.len() - 4];
        let checkpoint: Self =
            postcard::from_bytes(payload).map_err(|e| format!("a corrupt checkpoint ({e})"))?;
        if checkpoint.trainer != TRAINER {
            return Err(format!(
                "a checkpoint of trainer {}, but this is {TRAINER}, which may compute other results",
                checkpoint.trainer
            ));
        }
        Ok(checkpoint)
    }

    /// Reads the checkpoint beside the policy file `out`; `None` when there is none.
    ///
    /// # Errors
    /// [`RunError::Checkpoint`] when there is one that cannot be used.
    pub fn read(out: &Path) -> Result<Option<Self>, RunError> {
        let path = path(out);
        let wrong = |what| RunError::Checkpoint { path: path.clone(), what };
        match fs::read(&path) {
            Ok(bytes) => Self::from_bytes(&bytes).map(Some).map_err(wrong),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(wrong(format!("cannot be read ({e})"))),
        }
    }

    /// Returns the configuration. `path` is the checkpoint's, for messages.
    ///
    /// # Errors
    /// [`RunError::Checkpoint`] when it cannot be trained.
    pub fn config(&self, path: &Path) -> Result<Config, RunError> {
        let wrong = |what| RunError::Checkpoint { path: path.into(), what };
        let config: Config = toml::from_str(&self.config).map_err(|e| wrong(e.to_string()))?;
        config.check().map_err(|e| wrong(e.to_string()))?;
        Ok(config)
    }
}

/// Ending of the names of checkpoints.
pub const ENDING: &str = "checkpoint";

/// Returns the path of the checkpoint beside the policy file `out`.
#[must_use]
pub fn path(out: &Path) -> PathBuf {
    with_suffix(out, &format!(".{ENDING}"))
}

/// Writes checkpoints periodically.
pub struct CheckpointWriter {
    path: PathBuf,
    part: PathBuf,
    every: Option<Duration>,
    last: Instant,
}

impl CheckpointWriter {
    /// Writes beside the policy file `out`; `every` is the period, `None` disables checkpoints.
    #[must_use]
    pub fn new(out: &Path, every: Option<Duration>) -> Self {
        let path = path(out);
        Self { part: with_suffix(&path, ".part"), path, every, last: Instant::now() }
    }

    /// Whether checkpoints are enabled.
    #[must_use]
    pub fn is_enabled(&self) -> bool {
        self.every.is_some()
    }

    /// Whether the period has passed since the last checkpoint.
    #[must_use]
    pub fn is_due(&self) -> bool {
        self.every.is_some_and(|every| self.last.elapsed() >= every)
    }

    /// Replaces the last checkpoint.
    ///
    /// # Errors
    /// [`RunError::Unwritten`]; the last checkpoint is then unchanged.
    pub fn write(&mut self, checkpoint: &Checkpoint) -> Result<(), RunError> {
        let write = || {
            let mut file = File::create(&self.part)?;
            file.write_all(&checkpoint.to_bytes())?;
            file.sync_data()?;
            fs::rename(&self.part, &self.path)
        };
        write().map_err(|cause| {
            // Half a checkpoint is of no use, and may fill the disk.
            _ = fs::remove_file(&self.part);
            RunError::unwritten(&self.path, Purpose::Checkpoint)(cause)
        })?;
        self.last = Instant::now();
        Ok(())
    }

    /// Removes the checkpoint.
    ///
    /// # Errors
    /// [`RunError::Unwritten`] when it cannot be removed.
    pub fn remove(&self) -> Result<(), RunError> {
        for path in [&self.part, &self.path] {
            match fs::remove_file(path) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => {
                    return Err(RunError::unwritten(path, Purpose::Checkpoint)(e));
                }
                _ => {}
            }
        }
        Ok(())
    }
}
