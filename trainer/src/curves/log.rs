//! The log of a training, a CSV file with a row for every episode.

use super::{By, Zero};
use crate::lines::line_of;
use std::path::{Path, PathBuf};

/// Columns that a log must have; others are ignored.
const COLUMNS: [&str; 4] = ["stage", "total_steps", "reward", "steps"];

/// The columns of an episode that are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Episode {
    /// Stage of the training, from 1.
    pub stage: u64,
    /// Environment steps of the training at the episode's end.
    pub total_steps: u64,
    /// Sum of its rewards.
    pub reward: f64,
    /// Number of its steps.
    pub steps: u64,
}

/// A parsed log: at least one episode, with ascending steps and stages.
#[derive(Clone, Debug, PartialEq)]
pub struct Log {
    path: PathBuf,
    episodes: Vec<Episode>,
}

/// The reason why a file is no log.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file cannot be read.
    #[error("{0}: {1}")]
    Unreadable(String, std::io::Error),
    /// The file is not CSV.
    #[error("{0}: {1}")]
    Csv(String, csv::Error),
    /// The first line lacks a column or names it twice.
    #[error(
        "{file}, line 1: {found} column {column}; the log of a training has one each of \
         stage, total_steps, reward and steps: give a file that trainer train wrote"
    )]
    Header {
        /// Path of the file.
        file: String,
        /// `no`, or `more than one`.
        found: &'static str,
        /// The column's name.
        column: &'static str,
    },
    /// The log has no episode.
    #[error("{0}: no episode after the first line; let the training run on")]
    Empty(String),
    /// A cell does not fit its column.
    #[error("{file}, line {line}, column {column}: {found}, expected {expected}")]
    Cell {
        /// Path of the file.
        file: String,
        /// Line in the file, from 1.
        line: usize,
        /// The column's name.
        column: &'static str,
        /// Content of the cell.
        found: String,
        /// What was expected.
        expected: String,
    },
}

/// A row, with what messages need.
struct Row<'a> {
    file: &'a str,
    text: &'a [u8],
    record: &'a csv::StringRecord,
    columns: &'a [usize; COLUMNS.len()],
}

impl Row<'_> {
    fn cell(&self, i: usize) -> &str {
        self.record.get(self.columns[i]).unwrap_or_default().trim()
    }

    fn bad(&self, i: usize, expected: impl Into<String>) -> LogError {
        let cell = self.cell(i);
        LogError::Cell {
            file: self.file.into(),
            line: line_of(self.text, self.record.position().map_or(0, csv::Position::byte)),
            column: COLUMNS[i],
            found: if cell.is_empty() {
                "the value is missing".into()
            } else {
                format!("'{cell}'")
            },
            expected: expected.into(),
        }
    }

    fn count(&self, i: usize, least: u64) -> Result<u64, LogError> {
        let count = self.cell(i).parse().ok().filter(|&n| n >= least);
        count.ok_or_else(|| self.bad(i, format!("a whole number, at least {least}")))
    }

    fn episode(&self, last: Option<&Episode>) -> Result<Episode, LogError> {
        let reward = self.cell(2).parse().ok().filter(|x: &f64| x.is_finite());
        Ok(Episode {
            stage: self.count(0, last.map_or(1, |e| e.stage))?,
            total_steps: self.count(1, last.map_or(1, |e| e.total_steps + 1))?,
            reward: reward.ok_or_else(|| self.bad(2, "a finite number"))?,
            steps: self.count(3, 1)?,
        })
    }
}

impl Log {
    /// Reads a log.
    ///
    /// # Errors
    /// [`LogError`] when the file cannot be read or is no log.
    pub fn read(path: &Path) -> Result<Self, LogError> {
        let name = path.display().to_string();
        let text = std::fs::read(path).map_err(|e| LogError::Unreadable(name, e))?;
        Self::parse(path, &text)
    }

    pub(crate) fn parse(path: &Path, text: &[u8]) -> Result<Self, LogError> {
        let name = path.display().to_string();
        let malformed = |e| LogError::Csv(name.clone(), e);
        let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(text);
        let columns = columns(&name, reader.headers().map_err(malformed)?)?;
        let mut episodes: Vec<Episode> = Vec::new();
        let mut record = csv::StringRecord::new();
        while reader.read_record(&mut record).map_err(malformed)? {
            let row = Row { file: &name, text, record: &record, columns: &columns };
            episodes.push(row.episode(episodes.last())?);
        }
        if episodes.is_empty() {
            return Err(LogError::Empty(name));
        }
        Ok(Self { path: path.to_owned(), episodes })
    }

    /// Whether the first line of a file is that of a log.
    #[must_use]
    pub fn recognises(path: &Path) -> bool {
        let Ok(mut reader) = csv::Reader::from_path(path) else { return false };
        reader.headers().is_ok_and(|headers| columns("", headers).is_ok())
    }

    /// Returns the path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the episodes, at least one.
    #[must_use]
    pub fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    /// Returns the number of steps of the longest episode.
    #[must_use]
    pub fn longest(&self) -> u64 {
        self.episodes.iter().map(|e| e.steps).max().unwrap_or(0)
    }

    /// Returns the position of the end of each episode, counted from `zero`.
    pub(crate) fn ends(&self, by: By, zero: Zero) -> Vec<f64> {
        let ends: Vec<f64> = match by {
            By::Steps => self.episodes.iter().map(|e| e.total_steps as f64).collect(),
            By::Episodes => (1..=self.episodes.len()).map(|n| n as f64).collect(),
        };
        let origin = match zero {
            Zero::Start => 0.0,
            Zero::LastStage => self.changes().last().map_or(0.0, |&i| ends[i - 1]),
        };
        ends.into_iter().map(|end| end - origin).collect()
    }

    /// Returns the index of the first episode of every stage except the first.
    pub(crate) fn changes(&self) -> Vec<usize> {
        let pairs = self.episodes.windows(2).enumerate();
        pairs.filter(|(_, w)| w[1].stage > w[0].stage).map(|(i, _)| i + 1).collect()
    }
}

/// Returns the index of each column of [`COLUMNS`].
fn columns(file: &str, headers: &csv::StringRecord) -> Result<[usize; COLUMNS.len()], LogError> {
    let mut at = [0; COLUMNS.len()];
    for (at, column) in at.iter_mut().zip(COLUMNS) {
        let mut found = (0..headers.len()).filter(|&i| headers[i].trim() == column);
        let bad = |found| LogError::Header { file: file.into(), found, column };
        *at = found.next().ok_or_else(|| bad("no"))?;
        if found.next().is_some() {
            return Err(bad("more than one"));
        }
    }
    Ok(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "episode,stage,total_steps,density_ratio,reward,steps,q0\n";

    fn parse(text: &str) -> Result<Log, LogError> {
        Log::parse(Path::new("run.csv"), text.as_bytes())
    }

    #[test]
    fn reads_episodes_and_stages_of_a_log() {
        let rows = "1,1,5,1,2.5,5,NaN\n2,1,8,1,0,3,0\n3,2,9,0,-0.5,1,0\n4,2,14,0,4,5,0\n";
        let log = parse(&format!("{HEADER}{rows}")).unwrap();
        assert_eq!(log.episodes()[2], Episode { stage: 2, total_steps: 9, reward: -0.5, steps: 1 });
        assert_eq!((log.longest(), log.changes()), (5, vec![2]));
        assert_eq!(log.ends(By::Steps, Zero::Start), [5.0, 8.0, 9.0, 14.0]);
        assert_eq!(log.ends(By::Steps, Zero::LastStage), [-3.0, 0.0, 1.0, 6.0]);
        assert_eq!(log.ends(By::Episodes, Zero::LastStage), [-1.0, 0.0, 1.0, 2.0]);
    }

    #[test]
    fn errors_name_the_line_and_the_column() {
        let row = |cells: &str| format!("{HEADER}1,1,5,1,2,5,0\n{cells}\n");
        for (text, expected) in [
            (String::new(), "run.csv, line 1: no column stage"),
            ("vx,y,rho\n".into(), "run.csv, line 1: no column stage"),
            (format!("steps,{HEADER}"), "run.csv, line 1: more than one column steps"),
            (HEADER.into(), "run.csv: no episode after the first line"),
            (row("2,1,9,1,NaN,4,0"), "line 3, column reward: 'NaN', expected a finite number"),
            (row("2,1,9,1,inf,4,0"), "line 3, column reward: 'inf', expected a finite number"),
            (row("2,1,9,1,1"), "line 3, column steps: the value is missing, expected a whole"),
            (
                row("\r\n2,1,5,1,1,4,0"),
                "line 4, column total_steps: '5', expected a whole number, at least 6",
            ),
            (row("2,0,9,1,1,4,0"), "column stage: '0', expected a whole number, at least 1"),
            (row("2,1,9,1,1,-4,0"), "column steps: '-4', expected a whole number, at least 1"),
        ] {
            let error = parse(&text).unwrap_err().to_string();
            assert!(error.contains(expected), "{expected}: {error}");
        }
    }
}
