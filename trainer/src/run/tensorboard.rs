//! TensorBoard event files: `TFRecord` frames of protobuf events.
//!
//! The step of an event is the environment step over all stages. Each process writes one file,
//! which begins with a session start at its first step. From that step on TensorBoard drops the
//! events of earlier files in the same folder, so a training that was killed and resumed shows
//! no step twice. Therefore each training has a folder of its own, named after its policy, and
//! TensorBoard shows it as a run of that name. The names of the files state which training
//! they belong to.
//!
//! A frame is the length (u64), its masked CRC-32C, the event, and its masked CRC-32C,
//! little-endian. The fields are those of `tensorflow/core/util/event.proto` and
//! `framework/summary.proto` that are used here.

use super::error::{Purpose, RunError};
use super::recent::RecentEpisodes;
use crate::evaluate::DENSITIES;
use crate::evaluate::selection::Evaluation;
use crate::train::{EpisodeRecord, Training};
use crc::{CRC_32_ISCSI, CRC_64_XZ, Crc, Table};
use prost::Message;
use std::ffi::{OsStr, OsString};
use std::fs::{File, create_dir, create_dir_all, read_dir};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

static CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISCSI);
/// Beginning of the names of event files; TensorBoard looks for `tfevents`.
const FILE_NAME: &str = "events.out.tfevents.";
const FILE_VERSION: &str = "brain.Event:2";
/// Time between two measurements of the speed.
const SPEED_EVERY: Duration = Duration::from_secs(1);
/// Time between two flushes of the file.
const FLUSH_EVERY: Duration = Duration::from_secs(5);

/// An event.
#[derive(Clone, PartialEq, Message)]
pub struct Event {
    /// Seconds since 1970.
    #[prost(double, tag = "1")]
    pub wall_time: f64,
    /// Environment step.
    #[prost(int64, tag = "2")]
    pub step: i64,
    /// Version of the file format, in the first event of a file.
    #[prost(string, optional, tag = "3")]
    pub file_version: Option<String>,
    /// Scalars and texts of this step.
    #[prost(message, optional, tag = "5")]
    pub summary: Option<Summary>,
    /// State of the session.
    #[prost(message, optional, tag = "7")]
    pub session_log: Option<SessionLog>,
}

/// The scalars and texts of one step.
#[derive(Clone, PartialEq, Message)]
pub struct Summary {
    /// Values, each with its tag.
    #[prost(message, repeated, tag = "1")]
    pub value: Vec<Value>,
}

/// A scalar or a text.
#[derive(Clone, PartialEq, Message)]
pub struct Value {
    /// Name of the value.
    #[prost(string, tag = "1")]
    pub tag: String,
    /// The scalar.
    #[prost(float, optional, tag = "2")]
    pub simple_value: Option<f32>,
    /// The text.
    #[prost(message, optional, tag = "8")]
    pub tensor: Option<Tensor>,
    /// Description of the tensor.
    #[prost(message, optional, tag = "9")]
    pub metadata: Option<Metadata>,
}

/// A tensor of one string.
#[derive(Clone, PartialEq, Message)]
pub struct Tensor {
    /// Type of the elements: 7 for strings.
    #[prost(int32, tag = "1")]
    pub dtype: i32,
    /// The string.
    #[prost(bytes = "vec", repeated, tag = "8")]
    pub string_val: Vec<Vec<u8>>,
}

/// The description of a tensor.
#[derive(Clone, PartialEq, Message)]
pub struct Metadata {
    /// The plugin that displays the tensor.
    #[prost(message, optional, tag = "1")]
    pub plugin_data: Option<Plugin>,
}

/// The plugin that displays a tensor.
#[derive(Clone, PartialEq, Message)]
pub struct Plugin {
    /// Name of the plugin, such as `text`.
    #[prost(string, tag = "1")]
    pub plugin_name: String,
}

/// The state of a session.
#[derive(Clone, Copy, PartialEq, Eq, Message)]
pub struct SessionLog {
    /// State: 1 for a start.
    #[prost(int32, tag = "1")]
    pub status: i32,
}

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
            let path = own_folder(folder, title, &identity)?.join(name);
            File::create_new(&path).map(|file| (file, path))
        };
        let (file, path) = make().map_err(RunError::unwritten(folder, Purpose::Events))?;
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
        if steps == 0 {
            let config = format!(
                "seed {}\n\n```toml\n{}```\n",
                training.seed(),
                training.config().to_commented_toml()
            );
            board.values(0, vec![text("hyperparameters", &config)])?;
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
            scalar("episode/reward", record.reward),
            scalar("episode/steps", f64::from(record.steps)),
            scalar("episode/q0", f64::from(record.q0)),
            scalar("episode/full_share", recent.full()),
        ];
        if let Some(update) = training.latest_update() {
            let norm = |name, x: f32| scalar(name, f64::from(x));
            values.push(norm("update/critic_gradient_norm", update.critic_gradient_norm));
            values.push(norm("update/actor_gradient_norm", update.actor_gradient_norm));
        }
        let (since, before) = self.speed;
        if since.elapsed() >= SPEED_EVERY {
            let updates = training.total_updates();
            let speed = (updates - before) as f64 / since.elapsed().as_secs_f64();
            values.push(scalar("updates_per_s", speed));
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
        frame(&mut self.file, &event.encode_to_vec())
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

/// Writes one record of a `TFRecord` file.
fn frame(to: &mut impl Write, record: &[u8]) -> io::Result<()> {
    let length = (record.len() as u64).to_le_bytes();
    to.write_all(&length)?;
    to.write_all(&masked(&length).to_le_bytes())?;
    to.write_all(record)?;
    to.write_all(&masked(record).to_le_bytes())
}

/// Returns the CRC-32C, masked so that the checksum of a record that contains records differs
/// from theirs.
#[must_use]
pub fn masked(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

fn since_1970() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default()
}

fn scalar(tag: &str, value: f64) -> Value {
    Value { tag: tag.into(), simple_value: Some(value as f32), ..Value::default() }
}

fn text(tag: &str, text: &str) -> Value {
    let plugin_data = Some(Plugin { plugin_name: "text".into() });
    Value {
        tag: format!("{tag}/text_summary"),
        tensor: Some(Tensor { dtype: 7, string_val: vec![text.as_bytes().to_vec()] }),
        metadata: Some(Metadata { plugin_data }),
        ..Value::default()
    }
}

fn evaluation_values(evaluation: &Evaluation) -> Vec<Value> {
    let mut values = vec![scalar("evaluation/cost", evaluation.score.cost)];
    for (rho, result) in DENSITIES.iter().zip(&evaluation.results) {
        values.push(scalar(&format!("evaluation/survive30/{rho}"), result.survive30));
    }
    values
}
