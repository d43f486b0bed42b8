//! Where in a text file something stands, for messages.

/// The line, from 1, of the CSV record that is read from this byte on. (The reader's
/// own figure is that of the line before when this one ends with CR LF, or is empty.)
pub(crate) fn line_of(text: &[u8], byte: u64) -> usize {
    let newlines = |part: &[u8]| part.split(|&b| b == b'\n').skip(1).count();
    let (before, rest) = text.split_at(text.len().min(byte as usize));
    let blank = rest.iter().take_while(|b| matches!(b, b'\r' | b'\n')).count();
    1 + newlines(before) + newlines(&rest[..blank])
}
