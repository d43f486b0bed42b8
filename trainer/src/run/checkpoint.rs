//! Checkpoints: everything that a training is, in one file.
//!
//! ```text
//! "LEGCHKPT", version u32, length of the payload u64, payload (postcard), CRC-32 of all before
//! ```
//!
//! Little-endian. It is written beside its place, synced, and renamed into it: the
//! file under the name of a checkpoint is always a whole one.

use super::error::RunError;
use super::log::LogPosition;
use super::recent::RecentEpisodes;
use super::with_suffix;
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

/// Everything that a training under way is.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Version of the trainer: another may compute other bits.
    trainer: String,
    /// Of everything random.
    pub seed: u64,
    /// The whole configuration, TOML.
    config: String,
    /// The log to be.
    pub log_path: PathBuf,
    /// How far the log was.
    pub log: LogPosition,
    /// The latest episodes.
    pub recent: RecentEpisodes,
    /// The training itself.
    pub training: TrainingState,
}

impl Checkpoint {
    /// Of a training between two episodes, and what goes with it.
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

    /// As a file.
    ///
    /// # Panics
    /// Never: everything in it has a form.
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

    /// From a file's bytes.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let short = || format!("not a whole checkpoint: only {} bytes", bytes.len());
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
            return Err(format!("not a whole checkpoint: {found} bytes follow, expected {length}"));
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
                "a checkpoint by trainer {}, but this is {TRAINER}, which may compute other bits",
                checkpoint.trainer
            ));
        }
        Ok(checkpoint)
    }

    /// The checkpoint beside a policy to be; `None` when there is none.
    ///
    /// # Errors
    /// When there is one that cannot be used.
    pub fn read(out: &Path) -> Result<Option<Self>, RunError> {
        let path = path(out);
        let wrong = |what| RunError::Checkpoint { path: path.clone(), what };
        match fs::read(&path) {
            Ok(bytes) => Self::from_bytes(&bytes).map(Some).map_err(wrong),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(wrong(format!("cannot be read ({e})"))),
        }
    }

    /// What is trained. `path` is this checkpoint's, to be named in an error.
    ///
    /// # Errors
    /// When it cannot be trained.
    pub fn config(&self, path: &Path) -> Result<Config, RunError> {
        let wrong = |what| RunError::Checkpoint { path: path.into(), what };
        let config: Config = toml::from_str(&self.config).map_err(|e| wrong(e.to_string()))?;
        config.check().map_err(|e| wrong(e.to_string()))?;
        Ok(config)
    }
}

/// Where the checkpoint of a policy to be is.
#[must_use]
pub fn path(out: &Path) -> PathBuf {
    with_suffix(out, ".checkpoint")
}

/// Writes checkpoints now and then.
pub struct CheckpointWriter {
    path: PathBuf,
    part: PathBuf,
    every: Option<Duration>,
    last: Instant,
}

impl CheckpointWriter {
    /// Beside a policy to be; never without a time.
    #[must_use]
    pub fn new(out: &Path, every: Option<Duration>) -> Self {
        let path = path(out);
        Self { part: with_suffix(&path, ".part"), path, every, last: Instant::now() }
    }

    /// Whether it keeps any at all.
    #[must_use]
    pub fn keeps(&self) -> bool {
        self.every.is_some()
    }

    /// Whether it is time for one.
    #[must_use]
    pub fn is_due(&self) -> bool {
        self.every.is_some_and(|every| self.last.elapsed() >= every)
    }

    /// Puts a checkpoint in the place of the last.
    ///
    /// # Errors
    /// When it cannot be written; the last is then as it was.
    pub fn write(&mut self, checkpoint: &Checkpoint) -> Result<(), RunError> {
        let write = || {
            let mut file = File::create(&self.part)?;
            file.write_all(&checkpoint.to_bytes())?;
            file.sync_data()?;
            fs::rename(&self.part, &self.path)
        };
        write().map_err(RunError::unwritten(&self.path, "--out"))?;
        self.last = Instant::now();
        Ok(())
    }

    /// There is nothing to go on from any more.
    ///
    /// # Errors
    /// When it cannot be removed.
    pub fn remove(&self) -> Result<(), RunError> {
        for path in [&self.part, &self.path] {
            match fs::remove_file(path) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => {
                    return Err(RunError::unwritten(path, "--out")(e));
                }
                _ => {}
            }
        }
        Ok(())
    }
}
