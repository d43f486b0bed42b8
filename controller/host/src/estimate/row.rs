//! A row of a log as its cells have it, from whatever file.

use std::path::{Path, PathBuf};

use super::column::{COLUMNS, Column, Content};

/// Largest magnitude of a number; what the law takes is checked by its guard.
const MOST: f64 = 1e9;
/// Largest age, s: an age is at most 2^32 ns.
const MOST_AGE_S: f64 = 4.0;
/// Times up to this count, s: 200 years.
const MOST_TIME_S: i128 = 6_400_000_000;
const NS_PER_S: i128 = 1_000_000_000;

/// Longest part of a file that a message repeats, characters.
const MOST_SHOWN: usize = 200;

/// Returns a text from a file for a message: a long one only up to its first characters.
pub(super) fn shown(text: &str) -> String {
    match text.char_indices().nth(MOST_SHOWN) {
        Some((end, _)) => format!("{}… ({} bytes)", &text[..end], text.len()),
        None => text.to_owned(),
    }
}

/// A cell that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}, {place}, column {}: `{value}`; it must be {limit}", path.display(), column.name())]
pub struct CellError {
    /// The file.
    pub path: PathBuf,
    /// Line or message.
    pub place: String,
    /// The column.
    pub column: Column,
    /// What stands there.
    pub value: String,
    /// What may stand there.
    pub limit: String,
}

/// A row: its time and the cells that are not empty.
#[derive(Clone, Debug)]
pub(super) struct Row {
    /// Time since any instant, ns.
    pub(super) time_ns: i128,
    cells: [Option<f64>; COLUMNS],
}

impl Row {
    /// Returns a row without cells.
    pub(super) fn new(time_ns: i128) -> Self {
        Self { time_ns, cells: [None; COLUMNS] }
    }

    /// Returns the number in a cell.
    pub(super) fn get(&self, column: Column) -> Option<f64> {
        self.cells[column as usize]
    }

    /// Returns the number in a cell in 32 bits; no bit is lost of one that had them.
    pub(super) fn single(&self, column: Column) -> Option<f32> {
        self.get(column).map(|x| x as f32)
    }

    /// Returns the truth value in a cell.
    pub(super) fn truth(&self, column: Column) -> Option<bool> {
        self.get(column).map(|x| x > 0.0)
    }

    /// Sets a cell from its text; an empty one, and `nan`, stand for nothing sensed.
    pub(super) fn set(
        &mut self,
        column: Column,
        text: &str,
        path: &Path,
        place: impl Fn() -> String,
    ) -> Result<(), CellError> {
        let text = text.trim();
        if text.is_empty() || text.eq_ignore_ascii_case("nan") {
            return Ok(());
        }
        let error = |limit: &str| CellError {
            path: path.to_owned(),
            place: place(),
            column,
            value: shown(text),
            limit: limit.to_owned(),
        };
        let within = |x: f64| (x.abs() <= MOST).then_some(x);
        let number = match column.content() {
            Content::Time => {
                let limit = "a number of seconds from -6.4e9 to 6.4e9";
                self.time_ns = nanoseconds(text).ok_or_else(|| error(limit))?;
                return Ok(());
            }
            // Read in the precision in which it is used: 64 bits between would round twice.
            Content::Single => text.parse::<f32>().ok().map(f64::from).and_then(within),
            Content::Double => text.parse::<f64>().ok().and_then(within),
            Content::Age => text.parse().ok().filter(|age| (0.0..=MOST_AGE_S).contains(age)),
            Content::Truth => match text.to_ascii_lowercase().as_str() {
                "1" | "1.0" | "true" => Some(1.0),
                "0" | "0.0" | "false" => Some(0.0),
                _ => None,
            },
        };
        let limit = match column.content() {
            Content::Truth => "1 or 0, true or false, or empty".to_owned(),
            Content::Age => format!("a number of seconds from 0 to {MOST_AGE_S}, or empty"),
            _ => format!("a number from -{MOST:e} to {MOST:e}, or empty"),
        };
        self.cells[column as usize] = Some(number.ok_or_else(|| error(&limit))?);
        Ok(())
    }
}

/// Returns a time in seconds in whole nanoseconds, exactly, whatever the clock began with: a
/// number in 64 bits would lose them in seconds since 1970.
fn nanoseconds(text: &str) -> Option<i128> {
    let (sign, digits) = match text.strip_prefix('-') {
        Some(rest) => (-1, rest),
        None => (1, text.strip_prefix('+').unwrap_or(text)),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let is_plain = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    if digits.len() > 1_000 || !is_plain(whole) || !is_plain(fraction) {
        let seconds: f64 = text.parse().ok()?;
        return (seconds.abs() <= MOST_TIME_S as f64).then(|| (1e9 * seconds).round() as i128);
    }
    if whole.is_empty() && fraction.is_empty() {
        return None;
    }
    let seconds = if whole.is_empty() { 0 } else { whole.parse::<i128>().ok()? };
    let kept = &fraction[..fraction.len().min(9)];
    let kept_ns = format!("{kept:0<9}").parse::<i128>().ok()?;
    let rounds_up = fraction.as_bytes().get(9).is_some_and(|digit| *digit >= b'5');
    (seconds <= MOST_TIME_S).then(|| sign * (seconds * NS_PER_S + kept_ns + i128::from(rounds_up)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(column: Column, text: &str) -> Result<Row, String> {
        let mut row = Row::new(0);
        let done = row.set(column, text, Path::new("log.csv"), || "line 7".to_owned());
        done.map(|()| row).map_err(|error| error.to_string())
    }

    #[test]
    fn a_time_keeps_its_nanoseconds_whenever_its_clock_began() {
        for (text, ns) in [
            ("0", 0),
            ("0.001", 1_000_000),
            ("1764518400.123456789", 1_764_518_400_123_456_789),
            ("-1.5", -1_500_000_000),
            ("+.25", 250_000_000),
            ("3.", 3_000_000_000),
            ("0.0000000015", 2),
            ("0.0000000014999", 1),
            ("1e-3", 1_000_000),
            ("2.5E3", 2_500_000_000_000),
        ] {
            assert_eq!(nanoseconds(text), Some(ns), "{text}");
        }
        for bad in ["", ".", "-", "1.2.3", "12:30", "inf", "nan", "1e10", "6400000001", "0x10"] {
            assert_eq!(nanoseconds(bad), None, "{bad}");
        }
    }

    #[test]
    fn a_cell_keeps_every_bit_of_a_number_in_32_bits() {
        for bits in [0x3f80_0001_u32, 0xbdcc_cccd, 0x3eaa_aaab, 0x0080_0001, 0x8000_0000] {
            let x = f32::from_bits(bits);
            let row = set(Column::Vx, &x.to_string()).unwrap();
            assert_eq!(row.single(Column::Vx).map(f32::to_bits), Some(bits), "{x}");
        }
    }

    #[test]
    fn an_empty_cell_and_nan_stand_for_nothing_sensed() {
        for text in ["", "  ", "nan", "NaN"] {
            assert_eq!(set(Column::Y, text).unwrap().get(Column::Y), None);
        }
        assert_eq!(set(Column::Contact, "TRUE").unwrap().truth(Column::Contact), Some(true));
        assert_eq!(set(Column::Contact, "0").unwrap().truth(Column::Contact), Some(false));
    }

    #[test]
    fn an_unusable_cell_is_named_with_file_place_column_value_and_limit() {
        for (column, text, message) in [
            (
                Column::Y,
                "1,5",
                "log.csv, line 7, column y_m: `1,5`; it must be a number from -1e9 to 1e9, or empty",
            ),
            (Column::Vy, "inf", "column vy_m_s: `inf`; it must be a number from -1e9 to 1e9"),
            (Column::Pressure, "1e10", "column pressure_pa: `1e10`"),
            (
                Column::Contact,
                "2",
                "column contact: `2`; it must be 1 or 0, true or false, or empty",
            ),
            (
                Column::HeightAge,
                "-0.1",
                "column height_age_s: `-0.1`; it must be a number of seconds from 0 to 4",
            ),
            (Column::HeightAge, "4.1", "from 0 to 4, or empty"),
            (Column::Time, "noon", "column time_s: `noon`; it must be a number of seconds"),
        ] {
            let refused = set(column, text).unwrap_err();
            assert!(refused.contains(message), "{refused}");
        }
    }
}
