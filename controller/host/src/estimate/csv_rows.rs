//! The rows of a CSV file.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use csv::StringRecord;

use super::column::Column;
use super::log::LogError;
use super::row::{Row, shown};

/// Longest row, bytes; what is longer, as an endless device, is no log.
const MOST_BYTES: usize = 1 << 23;

/// A file of which no more is read than a row may be long, until the next row begins.
struct Limited {
    file: BufReader<File>,
    left: usize,
}

impl Read for Limited {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(into)?;
        self.left = self.left.checked_sub(read).ok_or_else(|| {
            let what = format!("a row is longer than {} MiB; is this a log?", MOST_BYTES >> 20);
            io::Error::new(io::ErrorKind::InvalidData, what)
        })?;
        Ok(read)
    }
}

/// The rows of a CSV file.
pub(super) struct CsvRows {
    path: PathBuf,
    reader: csv::Reader<Limited>,
    /// The column at each place.
    places: Vec<Option<Column>>,
    /// Names that are none of a column.
    pub(super) unknown: Vec<String>,
    record: StringRecord,
}

impl CsvRows {
    /// Reads the header.
    pub(super) fn open(path: &Path, file: BufReader<File>) -> Result<Self, LogError> {
        let mut reader = csv::ReaderBuilder::new()
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(Limited { file, left: MOST_BYTES });
        let csv = |cause| LogError::Csv { path: path.to_owned(), cause };
        let header = reader.headers().map_err(csv)?.clone();
        let names: Vec<&str> =
            header.iter().map(|name| name.trim_start_matches('\u{feff}')).collect();
        let places: Vec<_> = names.iter().map(|name| Column::named(name)).collect();
        let error = |what| LogError::Columns { path: path.to_owned(), what };
        for column in Column::all() {
            if places.iter().filter(|place| **place == Some(column)).count() > 1 {
                return Err(error(format!("line 1: more than one column {}", column.name())));
            }
        }
        if !places.contains(&Some(Column::Time)) {
            let time = Column::Time.name();
            return Err(error(format!(
                "line 1 has no column {time}: `{}`",
                shown(&names.join(","))
            )));
        }
        let unknown = names.iter().zip(&places).filter(|(_, place)| place.is_none());
        let unknown = unknown.map(|(name, _)| format!("`{name}`")).collect();
        let path = path.to_owned();
        Ok(Self { path, reader, places, unknown, record: StringRecord::new() })
    }

    /// Returns the columns.
    pub(super) fn columns(&self) -> Vec<Column> {
        self.places.iter().copied().flatten().collect()
    }

    /// Returns the next row, none after the last.
    pub(super) fn next_row(&mut self) -> Result<Option<Row>, LogError> {
        let Self { path, reader, places, record, .. } = self;
        let csv = |cause| LogError::Csv { path: path.clone(), cause };
        reader.get_mut().left = MOST_BYTES;
        if !reader.read_record(record).map_err(csv)? {
            return Ok(None);
        }
        let line = record.position().map_or(0, csv::Position::line);
        if record.len() != places.len() {
            let (cells, header) = (record.len(), places.len());
            let what = format!("line {line}: {cells} cells where line 1 has {header}");
            return Err(LogError::Columns { path: path.clone(), what });
        }
        let place = || format!("line {line}");
        let mut row = Row::new(0);
        for (column, text) in places.iter().zip(record.iter()) {
            let Some(column) = *column else { continue };
            if column == Column::Time && text.is_empty() {
                let what = format!("line {line}: no {}", column.name());
                return Err(LogError::Columns { path: path.clone(), what });
            }
            row.set(column, text, path, place)?;
        }
        Ok(Some(row))
    }
}
