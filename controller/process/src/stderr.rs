//! Printing on the standard error.

use std::fmt::Display;
use std::io::{self, Write};

/// Prints a line. An error, such as that of a log file on a full disk or of a closed
/// terminal, is ignored: there is no place to report it, and the program's work goes on.
/// (`eprintln!` would panic.)
pub fn print_line(text: impl Display) {
    // In one write, so that lines of several processes do not mix.
    _ = io::stderr().write_all(format!("{text}\n").as_bytes());
}
