//! Columns of numbers in a CSV file, by their names in its first line.

use super::{Failure, input};
use crate::lines::line_of;
use anyhow::{Context, anyhow};

/// A row: its line in the file, from 1, and its numbers.
pub(super) type Row<const N: usize> = (usize, [f32; N]);

/// Reads these columns of every row. Other columns are skipped.
pub(super) fn read<const N: usize>(
    source: &[u8],
    name: &str,
    columns: [&'static str; N],
) -> Result<Vec<Row<N>>, Failure> {
    // Spreadsheets write a byte order mark.
    let source = source.strip_prefix(b"\xef\xbb\xbf").unwrap_or(source);
    let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(source);
    let headers = reader.headers().with_context(|| name.to_owned()).map_err(input)?.clone();
    let all = match columns.split_last() {
        Some((last, [])) => (*last).to_owned(),
        Some((last, rest)) => format!("{} and {last}", rest.join(", ")),
        None => String::new(),
    };
    let mut places = [("", 0); N];
    for (place, wanted) in places.iter_mut().zip(columns) {
        let mut found = (0..headers.len()).filter(|&i| headers[i].trim() == wanted);
        *place = match (found.next(), found.next()) {
            (Some(column), None) => (wanted, column),
            (None, _) => {
                let must = format!("the first line must name {all}");
                return Err(input(anyhow!("{name}: no column {wanted}; {must}")));
            }
            (Some(_), Some(_)) => {
                let must = format!("the first line must name {all} once each");
                return Err(input(anyhow!("{name}: more than one column {wanted}; {must}")));
            }
        };
    }
    let mut rows = Vec::new();
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).with_context(|| name.to_owned()).map_err(input)? {
        let line = line_of(source, record.position().map_or(0, csv::Position::byte));
        let mut values = [0.0_f32; N];
        for (value, (header, column)) in values.iter_mut().zip(places) {
            let bad = |what: &str| {
                let place = format!("{name}, line {line}, column {header}");
                input(anyhow!("{place}: {what} a finite number, of magnitude below 3.4e38"))
            };
            let text = record.get(column).unwrap_or_default().trim();
            if text.is_empty() {
                return Err(bad("the value is missing; give"));
            }
            let finite = text.parse().ok().filter(|x: &f32| x.is_finite());
            *value = finite.ok_or_else(|| bad(&format!("'{text}' is not")))?;
        }
        if record.len() > headers.len() {
            return Err(input(anyhow!(
                "{name}, line {line}: {} values, but the first line names {}; remove the rest",
                record.len(),
                headers.len()
            )));
        }
        rows.push((line, values));
    }
    Ok(rows)
}
