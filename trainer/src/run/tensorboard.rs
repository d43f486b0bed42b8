//! TensorBoard event files: `TFRecord` frames of protobuf events.
//!
//! The step of an event is the environment step over all stages. Each process writes one file.
//! Where it resumes a training that was killed, it first cuts off the events of earlier files
//! that are later than its checkpoint: no reader finds a step twice. (A TensorBoard that has read
//! them drops them at the session start with which each file begins.) Therefore each training has
//! a folder of its own, named after its policy, and TensorBoard shows it as a run of that name.
//! The names of the files state which training they belong to.

mod event;
mod hparams;

use super::error::{Purpose, RunError};
use super::recent::RecentEpisodes;
use crate::evaluate::DENSITIES;
use crate::evaluate::selection::Evaluation;
use crate::train::{EpisodeRecord, Training};
use crc::{CRC_64_XZ, Crc};
use std::ffi::{OsStr, OsString};
use std::fs::{File, create_dir, create_dir_all, read, read_dir, remove_file};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

pub use event::{Event, SessionLog, Summary, Value, first_frame, masked};

/// Beginning of the names of event files; TensorBoard looks for `tfevents`.
const FILE_NAME: &str = "events.out.tfevents.";
const FILE_VERSION: &str = "brain.Event:2";
/// Time between two measurements of the speed.
const SPEED_EVERY: Duration = Duration::from_secs(1);
/// Time between two flushes of the file.
const FLUSH_EVERY: Duration = Duration::from_secs(5);

/// Writes the events of a training to a file.
pub struct EventWriter {
    file: BufWriter<File>,
    path: PathBuf,
    flushed: Instant,
    /// Time and number of updates of the latest speed measurement.
    speed: (Instant, u64),
    /// Environment step of the latest evaluation that was written.
    evaluated: u64,
}

impl EventWriter {
    /// Creates the folder of all trainings, if it is missing.
    ///
    /// # Errors
    /// [`RunError`] when that is not possible.
    pub fn check(folder: &Path) -> Result<(), RunError> {
        create_dir_all(folder).map_err(RunError::unwritten(folder, Purpose::Events))
    }

    /// Creates a new file in the training's own folder, below `folder`: the one of the name
    /// `title`, or `title-2` and so on where another training has that.
    ///
    /// # Errors
    /// [`RunError`] when the file cannot be written.
    pub fn begin(folder: &Path, title: &OsStr, training: &Training) -> Result<Self, RunError> {
        let now = since_1970();
        let identity = identity(training);
        // The alphabetical order of the names is the order of the files in time.
        let name = format!(
            "{FILE_NAME}{:010}.{:09}.{identity}.{}",
            now.as_secs(),
            now.subsec_nanos(),
            std::process::id()
        );
        let make = || {
            create_dir_all(folder)?;
            let own = own_folder(folder, title, &identity)?;
            let is_continued = keep_until(&own, training.total_steps())?;
            let path = own.join(name);
            File::create_new(&path).map(|file| (file, path, is_continued))
        };
        let (file, path, is_continued) =
            make().map_err(RunError::unwritten(folder, Purpose::Events))?;
        let mut board = Self {
            file: BufWriter::new(file),
            flushed: Instant::now(),
            speed: (Instant::now(), training.total_updates()),
            evaluated: 0,
            path,
        };
        let steps = training.total_steps();
        let version = Some(FILE_VERSION.into());
        board.write(Event { file_version: version, ..Event::default() })?;
        // The events at the checkpoint's own step stay.
        let first = if steps == 0 { 0 } else { steps.cast_signed() + 1 };
        let start = Some(SessionLog { status: 1 });
        board.write(Event { step: first, session_log: start, ..Event::default() })?;
        if !is_continued {
            let config = format!(
                "seed {}\n\n```toml\n{}```\n",
                training.seed(),
                training.config().to_commented_toml()
            );
            let text = Value::text("hyperparameters", &config);
            let start = hparams::session_start(training, since_1970().as_secs_f64());
            board.values(first.cast_unsigned(), vec![text, start])?;
        }
        board.flush()?;
        Ok(board)
    }

    /// Writes the events of an episode.
    ///
    /// # Errors
    /// [`RunError`] when the file cannot be written.
    pub fn record(
        &mut self,
        record: &EpisodeRecord,
        training: &Training,
        recent: &RecentEpisodes,
    ) -> Result<(), RunError> {
        let mut values = vec![
            Value::scalar("episode/reward", record.reward),
            Value::scalar("episode/steps", f64::from(record.steps)),
            Value::scalar("episode/q0", f64::from(record.q0)),
            Value::scalar("episode/full_share", recent.full()),
        ];
        if let Some(update) = training.latest_update() {
            let norm = |name, x: f32| Value::scalar(name, f64::from(x));
            values.push(norm("update/critic_gradient_norm", update.critic_gradient_norm));
            values.push(norm("update/actor_gradient_norm", update.actor_gradient_norm));
        }
        let (since, before) = self.speed;
        if since.elapsed() >= SPEED_EVERY {
            let updates = training.total_updates();
            let speed = (updates - before) as f64 / since.elapsed().as_secs_f64();
            values.push(Value::scalar("updates_per_s", speed));
            self.speed = (Instant::now(), updates);
        }
        if let Some(evaluation) = training.selector().and_then(|s| s.latest())
            && evaluation.score.steps != self.evaluated
        {
            self.evaluated = evaluation.score.steps;
            values.extend(evaluation_values(evaluation));
        }
        self.values(record.total_steps, values)?;
        if self.flushed.elapsed() >= FLUSH_EVERY { self.flush() } else { Ok(()) }
    }

    /// Writes the end of a complete or failed training, and flushes the file.
    ///
    /// # Errors
    /// [`RunError`] when the file cannot be written.
    pub fn end(&mut self, training: &Training, is_good: bool) -> Result<(), RunError> {
        let end = hparams::session_end(is_good, since_1970().as_secs_f64());
        // Later than the last checkpoint: whoever resumes from that cuts it off.
        self.values(training.total_steps() + 1, vec![end])?;
        self.flush()
    }

    /// Flushes the file.
    ///
    /// # Errors
    /// [`RunError`] when the file cannot be written.
    pub fn flush(&mut self) -> Result<(), RunError> {
        self.flushed = Instant::now();
        self.file.flush().map_err(RunError::unwritten(&self.path, Purpose::Events))
    }

    fn values(&mut self, step: u64, value: Vec<Value>) -> Result<(), RunError> {
        let summary = Some(Summary { value });
        self.write(Event { step: step.cast_signed(), summary, ..Event::default() })
    }

    fn write(&mut self, event: Event) -> Result<(), RunError> {
        let event = Event { wall_time: since_1970().as_secs_f64(), ..event };
        event::frame(&mut self.file, &prost::Message::encode_to_vec(&event))
            .map_err(RunError::unwritten(&self.path, Purpose::Events))
    }
}

/// Returns 16 hexadecimal digits for everything that a training's course depends on.
fn identity(training: &Training) -> String {
    let text = format!("{}\n{}", training.seed(), training.config().to_toml());
    format!("{:016x}", Crc::<u64>::new(&CRC_64_XZ).checksum(text.as_bytes()))
}

/// Returns the folder of a training below `folder`, and creates it where it does not exist.
fn own_folder(folder: &Path, title: &OsStr, identity: &str) -> io::Result<PathBuf> {
    for number in 1_u32.. {
        let mut name = OsString::from(title);
        if number > 1 {
            name.push(format!("-{number}"));
        }
        let path = folder.join(name);
        match create_dir(&path) {
            Ok(()) => return Ok(path),
            Err(error) if error.kind() != ErrorKind::AlreadyExists => return Err(error),
            Err(_) if holds_events_of(&path, identity) => return Ok(path),
            Err(_) => {}
        }
    }
    unreachable!("a folder does not have four billion others")
}

/// Whether a folder has event files, all of one training.
fn holds_events_of(folder: &Path, identity: &str) -> bool {
    let entries = read_dir(folder).into_iter().flatten().flatten();
    let names: Vec<_> = entries.map(|entry| entry.file_name()).collect();
    let mut events = names.iter().filter_map(|name| name.to_str()?.strip_prefix(FILE_NAME));
    let mut any = false;
    let all = events.all(|rest| {
        any = true;
        rest.split('.').nth(2) == Some(identity)
    });
    any && all
}

/// Cuts the event files of a folder off before the first event later than `steps`, of a training
/// that begins anew before their first, and where a killed process has left half an event. Removes
/// those of which nothing is left. Returns whether any event is left.
fn keep_until(folder: &Path, steps: u64) -> io::Result<bool> {
    let mut is_any_left = false;
    for entry in read_dir(folder)? {
        let path = entry?.path();
        let bytes = read(&path)?;
        let (mut kept, mut events) = (0, 0);
        while let Some((event, len)) = first_frame(&bytes[kept..]) {
            if steps == 0 || event.step > steps.cast_signed() {
                break;
            }
            events += usize::from(event.summary.is_some());
            kept += len;
        }
        if events == 0 {
            remove_file(&path)?;
        } else if kept < bytes.len() {
            File::options().write(true).open(&path)?.set_len(kept as u64)?;
        }
        is_any_left |= events > 0;
    }
    Ok(is_any_left)
}

fn since_1970() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default()
}

fn evaluation_values(evaluation: &Evaluation) -> Vec<Value> {
    let mut values = vec![Value::scalar("evaluation/cost", evaluation.score.cost)];
    for (rho, result) in DENSITIES.iter().zip(&evaluation.results) {
        values.push(Value::scalar(&format!("evaluation/survive30/{rho}"), result.survive30));
    }
    values
}
