//! The standard output.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write, stdout};

/// Prints a text and ends its last line. A reader that has seen enough and gone,
/// as `head` does, is no failure: the rest is then for nobody.
///
/// # Errors
/// When it cannot be written for another reason, such as a full disk.
pub fn line(text: impl Display) -> io::Result<()> {
    let text = text.to_string();
    let text = text.strip_suffix('\n').unwrap_or(&text);
    let mut out = stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(gone) if gone.kind() == ErrorKind::BrokenPipe => Ok(()),
        result => result,
    }
}
