//! Opens a log, and finds out what it has.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};

use leg_recording::other;
use leg_recording::read::ReadError;
use leg_recording::schema::Channel;

use super::column::Column;
use super::csv_rows::CsvRows;
use super::json_rows::JsonRows;
use super::row::{CellError, Row, shown};
use crate::law::EstimatorKind;

/// Rows from which columns and rate are found out.
const FIRST_ROWS: usize = 1_000;
/// Encoding of JSON messages in MCAP.
const JSON: &str = "json";

/// Why a log cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// Opening or reading failed.
    #[error("cannot read {}: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        cause: io::Error,
    },
    /// The file is no CSV.
    #[error("{}: {cause}", path.display())]
    Csv {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        cause: csv::Error,
    },
    /// The MCAP file cannot be read.
    #[error(transparent)]
    Mcap(#[from] ReadError),
    /// A cell cannot be used.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// A message is no JSON object.
    #[error("{}, message {number} of {topic}: it is not a JSON object ({cause})", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Number of the message in its topic, from 1.
        number: u64,
        /// What is wrong.
        cause: String,
    },
    /// A column is missing, or there are too many.
    #[error("{}: {what}", path.display())]
    Columns {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The MCAP file has no such channel, or several.
    #[error("{}: {what}; it has {}{flaw}", path.display(), list(channels))]
    Channel {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
        /// Whether the file is cut off or damaged, as an addition to the sentence.
        flaw: String,
        /// Its topics, with the encoding of their messages.
        channels: Vec<String>,
    },
    /// The log has no row.
    #[error("{}: it has no row", .0.display())]
    Empty(PathBuf),
}

fn list(channels: &[String]) -> String {
    if channels.is_empty() { "no channel".to_owned() } else { channels.join(", ") }
}

/// What kind of file a log is.
#[derive(Debug)]
pub(super) enum Kind {
    /// A recording of `sim-host`.
    Recording,
    /// Rows.
    Rows(Log),
}

/// A log of rows.
#[derive(Debug)]
pub(super) struct Log {
    path: PathBuf,
    rows: Rows,
    /// The first rows, not yet returned.
    first: VecDeque<Row>,
    columns: Vec<Column>,
}

enum Rows {
    Csv(Box<CsvRows>),
    Json(Box<JsonRows>),
}

impl std::fmt::Debug for Rows {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Csv(_) => "Csv",
            Self::Json(_) => "Json",
        })
    }
}

/// Opens a log of any kind; `channel` names the topic of an MCAP file.
pub(super) fn open(path: &Path, channel: Option<&str>) -> Result<Kind, LogError> {
    let io = |cause| LogError::Io { path: path.to_owned(), cause };
    let mut file = BufReader::new(File::open(path).map_err(io)?);
    if !other::is_mcap(file.fill_buf().map_err(io)?) {
        if let Some(channel) = channel {
            let what = format!("the channel {channel} is wanted, but this is no MCAP file");
            return Err(LogError::Columns { path: path.to_owned(), what });
        }
        let rows = CsvRows::open(path, file)?;
        return Log::new(path, Rows::Csv(Box::new(rows))).map(Kind::Rows);
    }
    drop(file);
    let Some(topic) = topic(path, channel)? else { return Ok(Kind::Recording) };
    let rows = JsonRows::open(path, topic)?;
    Log::new(path, Rows::Json(Box::new(rows))).map(Kind::Rows)
}

/// Returns the topic with JSON messages of an MCAP file; none of a recording.
fn topic(path: &Path, wanted: Option<&str>) -> Result<Option<String>, LogError> {
    let (found, flaw) = other::encodings(path)?;
    let error = |what: String| LogError::Channel {
        path: path.to_owned(),
        what,
        flaw: flaw.as_ref().map_or_else(String::new, |flaw| format!("; {flaw}")),
        channels: found.iter().map(|(topic, how)| format!("{topic} ({how})")).collect(),
    };
    let ours = Channel::Sample.topic();
    let is_ours = |topic: &str| topic == ours && found.get(topic).is_some_and(|e| e == "protobuf");
    match wanted {
        Some(wanted) if is_ours(wanted) => Ok(None),
        Some(wanted) => match found.get(wanted) {
            Some(encoding) if encoding == JSON => Ok(Some(wanted.to_owned())),
            Some(encoding) => Err(error(format!(
                "the messages of {wanted} are in `{encoding}`; those in `{JSON}` can be read, and \
                 those of a recording"
            ))),
            None => Err(error(format!("it has no channel {wanted}"))),
        },
        None if is_ours(ours) => Ok(None),
        None => {
            let json: Vec<&String> =
                found.iter().filter(|(_, how)| *how == JSON).map(|(topic, _)| topic).collect();
            match json[..] {
                [topic] => Ok(Some(topic.clone())),
                [] => {
                    Err(error(format!("it has neither samples ({ours}) nor messages in `{JSON}`")))
                }
                _ => Err(error(format!("several channels have messages in `{JSON}`; choose one"))),
            }
        }
    }
}

impl Log {
    fn new(path: &Path, mut rows: Rows) -> Result<Self, LogError> {
        let mut first = VecDeque::new();
        while first.len() < FIRST_ROWS
            && let Some(row) = rows.next_row()?
        {
            first.push_back(row);
        }
        if first.is_empty() {
            return Err(LogError::Empty(path.to_owned()));
        }
        let columns = match &rows {
            Rows::Csv(csv) => csv.columns(),
            Rows::Json(json) => Column::all().filter(|c| json.names.contains(c.name())).collect(),
        };
        let log = Self { path: path.to_owned(), rows, first, columns };
        log.check()?;
        Ok(log)
    }

    /// Returns whether the log has all of these columns.
    fn has(&self, columns: &[Column]) -> bool {
        columns.iter().all(|column| self.columns.contains(column))
    }

    /// Checks that there are the columns without which nothing can be estimated.
    fn check(&self) -> Result<(), LogError> {
        let error = |what| Err(LogError::Columns { path: self.path.clone(), what });
        for pair in [
            [Column::ForceX, Column::ForceY],
            [Column::ImpulseX, Column::ImpulseY],
            [Column::VelocityX, Column::VelocityY],
        ] {
            if let [Some(there), None] | [None, Some(there)] =
                pair.map(|column| self.has(&[column]).then_some(column))
            {
                let [x, y] = pair.map(Column::name);
                return error(format!(
                    "it has {} alone; {x} and {y} belong together",
                    there.name()
                ));
            }
        }
        if self.has(&[Column::ForceX]) && self.has(&[Column::ImpulseX]) {
            let [force, sum] = [Column::ForceX, Column::ImpulseX].map(Column::name);
            return error(format!("it has both {force} and {sum}; keep one of them"));
        }
        if self.has(&[Column::LegAngle]) && !self.has(&[Column::LegLength]) {
            let [angle, length] = [Column::LegAngle, Column::LegLength].map(Column::name);
            return error(format!("it has {angle} without {length}; the leg is known by both"));
        }
        if !self.has(&[Column::Contact]) && !self.has(&[Column::LegLength]) {
            let [contact, length] = [Column::Contact, Column::LegLength].map(Column::name);
            return error(format!(
                "it has neither {contact} nor {length}; one of them must show whether the foot stands"
            ));
        }
        Ok(())
    }

    /// Returns the estimator for the columns of the log; none where no estimator can do with
    /// them.
    pub(super) fn estimator(&self) -> Option<EstimatorKind> {
        let is_raw = self.has(&[Column::ForceX])
            || self.has(&[Column::ImpulseX])
            || self.has(&[Column::LegLength, Column::LegAngle]);
        if self.has(&[Column::Vx, Column::Y, Column::Vy]) {
            Some(EstimatorKind::State)
        } else if is_raw {
            Some(EstimatorKind::Inertial)
        } else {
            None
        }
    }

    /// Checks that an estimator can do with the columns.
    pub(super) fn check_estimator(&self, estimator: EstimatorKind) -> Result<(), LogError> {
        let any = |columns: &[Column]| columns.iter().any(|column| self.has(&[*column]));
        let (is_enough, needed) = match estimator {
            EstimatorKind::State => {
                (any(&[Column::Vx, Column::Y, Column::Vy]), "vx_m_s, y_m and vy_m_s")
            }
            EstimatorKind::Inertial => (
                any(&[Column::ForceX, Column::ImpulseX])
                    || self.has(&[Column::LegLength, Column::LegAngle]),
                "an accelerometer or leg_length_m and leg_angle_rad",
            ),
            EstimatorKind::Readings => (true, ""),
        };
        if is_enough {
            return Ok(());
        }
        let what =
            format!("its columns are not those of the estimator chosen, which needs {needed}");
        Err(LogError::Columns { path: self.path.clone(), what })
    }

    /// Checks that the time rises anywhere in the first rows.
    pub(super) fn check_time(&self) -> Result<(), LogError> {
        let rows = self.first.len();
        if rows < 2 || self.rate_hz().is_some() {
            return Ok(());
        }
        let time = Column::Time.name();
        let what = format!("{time} never rises in the first {rows} rows; sort the rows by it");
        Err(LogError::Columns { path: self.path.clone(), what })
    }

    /// Returns the rows a second, by the median time between the first.
    pub(super) fn rate_hz(&self) -> Option<f64> {
        let times = self.first.iter().zip(self.first.iter().skip(1));
        let mut between: Vec<i128> = times.map(|(a, b)| b.time_ns - a.time_ns).collect();
        between.retain(|ns| *ns > 0);
        between.sort_unstable();
        between.get(between.len() / 2).map(|ns| 1e9 / *ns as f64)
    }

    /// Returns the next row, none after the last.
    pub(super) fn next_row(&mut self) -> Result<Option<Row>, LogError> {
        match self.first.pop_front() {
            Some(row) => Ok(Some(row)),
            None => self.rows.next_row(),
        }
    }

    /// Returns what is noteworthy about the file, for the user. It is complete only after the
    /// last row.
    pub(super) fn warnings(&self) -> Vec<String> {
        let unknown = match &self.rows {
            Rows::Csv(csv) => csv.unknown.clone(),
            Rows::Json(json) => {
                let is_unknown = |name: &&String| Column::named(name).is_none();
                json.names.iter().filter(is_unknown).cloned().collect()
            }
        };
        let path = self.path.display();
        let unused = (!unknown.is_empty())
            .then(|| format!("{path}: these columns are not used: {}", shown(&unknown.join(", "))));
        let flaw = match &self.rows {
            Rows::Csv(_) => None,
            Rows::Json(json) => json.reader.warning(),
        };
        unused.into_iter().chain(flaw).collect()
    }
}

impl Rows {
    fn next_row(&mut self) -> Result<Option<Row>, LogError> {
        match self {
            Self::Csv(rows) => rows.next_row(),
            Self::Json(rows) => rows.next_row(),
        }
    }
}
