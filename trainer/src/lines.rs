//! Line numbers in text files, for messages.

/// Returns the line, from 1, of the CSV record that begins at this byte. The reader's own line
/// number is that of the line before where this one ends with CR LF or is empty.
pub(crate) fn line_of(text: &[u8], byte: u64) -> usize {
    let newlines = |part: &[u8]| part.split(|&b| b == b'\n').skip(1).count();
    let (before, rest) = text.split_at(text.len().min(byte as usize));
    let blank = rest.iter().take_while(|b| matches!(b, b'\r' | b'\n')).count();
    1 + newlines(before) + newlines(&rest[..blank])
}
