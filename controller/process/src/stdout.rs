//! Printing on standard output.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write, stdout};

use crate::remedy;

/// Prints `text`, followed by a line feed unless it already ends with one.
///
/// A reader that has closed the pipe, as `head` does, is not an error; the text
/// is then discarded.
///
/// # Errors
/// Returns the system's error when writing fails for any other reason, such as a
/// full disk. Its message names the standard output, and what helps.
pub fn print_line(text: impl Display) -> io::Result<()> {
    let text = text.to_string();
    let text = text.strip_suffix('\n').unwrap_or(&text);
    let mut out = stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        Err(error) => {
            let remedy = remedy::of_write(&error).map_or_else(String::new, |r| format!("; {r}"));
            let text = format!("the standard output cannot be written: {error}{remedy}");
            Err(io::Error::new(error.kind(), text))
        }
        Ok(()) => Ok(()),
    }
}
