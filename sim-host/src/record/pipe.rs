//! The frames on the pipe from a run to its writer process, each one message.
//!
//! | bytes | content |
//! |---|---|
//! | 1 | number of the [`Channel`], above those that of the [`DisplayTopic`], or [`FLUSH`] |
//! | 8 | log time, ns since 1970, little-endian |
//! | 4 | number of the message in its channel, little-endian |
//! | 4 | length of the message, little-endian |
//! | length | the message, protobuf |

use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use prost::Message;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::display::DisplayTopic;
use super::schema::{Channel, Recorded};

/// Channel number of a frame without a message; the writer then flushes its file.
const FLUSH: u8 = 0xff;
const HEADER_LEN: usize = 17;
/// Number of topics.
pub(super) const TOPICS: usize = Channel::ALL.len() + DisplayTopic::ALL.len();
/// Longest message accepted: a policy has 1 MiB at most, a scenario far less.
const MAX_MESSAGE_LEN: usize = 1 << 24;

/// Frames to be sent.
#[derive(Debug, Default)]
pub(super) struct FrameBuffer {
    bytes: Vec<u8>,
    next_sequence: [u32; TOPICS],
    latest_ns: u64,
}

impl FrameBuffer {
    /// Appends a message.
    pub(super) fn add<M: Recorded>(&mut self, log_time_ns: u64, message: &M) {
        self.push(M::CHANNEL as u8, log_time_ns, message);
    }

    /// Appends a message for viewers, of the type that the topic has.
    pub(super) fn add_display(
        &mut self,
        topic: DisplayTopic,
        log_time_ns: u64,
        message: &impl Message,
    ) {
        self.push(Channel::ALL.len() as u8 + topic as u8, log_time_ns, message);
    }

    fn push(&mut self, number: u8, log_time_ns: u64, message: &impl Message) {
        let sequence = &mut self.next_sequence[usize::from(number)];
        self.bytes.push(number);
        self.bytes.extend(log_time_ns.to_le_bytes());
        self.bytes.extend(sequence.to_le_bytes());
        self.bytes.extend((message.encoded_len() as u32).to_le_bytes());
        message.encode(&mut self.bytes).expect("a vector grows as needed");
        *sequence = sequence.wrapping_add(1);
        self.latest_ns = self.latest_ns.max(log_time_ns);
    }

    /// Returns the latest log time of all messages that were added, ns since 1970.
    pub(super) fn latest_ns(&self) -> u64 {
        self.latest_ns
    }

    /// Appends a request to flush the file.
    pub(super) fn add_flush(&mut self) {
        self.bytes.push(FLUSH);
        self.bytes.extend([0; HEADER_LEN - 1]);
    }

    pub(super) fn len(&self) -> usize {
        self.bytes.len()
    }

    pub(super) fn clear(&mut self) {
        self.bytes.clear();
    }

    pub(super) fn as_slice(&self) -> &[u8] {
        &self.bytes
    }
}

/// A received frame.
#[derive(Debug)]
pub(super) enum Frame<'a> {
    Message { topic: usize, log_time_ns: u64, sequence: u32, message: &'a [u8] },
    Flush,
}

/// Reads the next frame, its message into `buffer`. Returns `None` at the end
/// of the pipe, also if the last frame is incomplete.
///
/// # Errors
/// If the pipe fails, or the bytes are not a frame.
pub(super) fn read<'a>(
    pipe: &mut impl Read,
    buffer: &'a mut Vec<u8>,
) -> io::Result<Option<Frame<'a>>> {
    let mut header = [0; HEADER_LEN];
    if !fill(pipe, &mut header)? {
        return Ok(None);
    }
    let [number, rest @ ..] = header;
    if number == FLUSH {
        return Ok(Some(Frame::Flush));
    }
    let (time, rest) = rest.split_at(8);
    let (sequence, len) = rest.split_at(4);
    let integer = |bytes: &[u8]| bytes.iter().rev().fold(0, |n, byte| n << 8 | u64::from(*byte));
    let len = integer(len) as usize;
    let topic = usize::from(number);
    if topic >= TOPICS || len > MAX_MESSAGE_LEN {
        return Err(io::Error::new(ErrorKind::InvalidData, "the bytes are not a frame"));
    }
    buffer.resize(len, 0);
    if !fill(pipe, buffer)? {
        return Ok(None);
    }
    Ok(Some(Frame::Message {
        topic,
        log_time_ns: integer(time),
        sequence: integer(sequence) as u32,
        message: buffer,
    }))
}

/// Fills the buffer; returns false if the pipe ends before.
fn fill(pipe: &mut impl Read, buffer: &mut [u8]) -> io::Result<bool> {
    match pipe.read_exact(buffer) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

/// Writes all bytes to a non-blocking pipe. Fails if the reader takes nothing
/// for `timeout`.
///
/// # Errors
/// [`ErrorKind::TimedOut`], or the error of the system.
pub(super) fn write_all(
    pipe: &mut (impl Write + AsFd),
    mut bytes: &[u8],
    timeout: Duration,
) -> io::Result<()> {
    let mut since = Instant::now();
    while !bytes.is_empty() {
        match pipe.write(bytes) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(n) => {
                bytes = &bytes[n..];
                since = Instant::now();
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                let left = timeout.saturating_sub(since.elapsed());
                if left.is_zero() {
                    return Err(ErrorKind::TimedOut.into());
                }
                wait(pipe, PollFlags::OUT, left)?;
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => (),
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Reads the writer's next line; empty if it ended without one.
///
/// # Errors
/// [`ErrorKind::TimedOut`], or the error of the system.
pub(super) fn read_line(reports: &mut (impl Read + AsFd), timeout: Duration) -> io::Result<String> {
    let deadline = Instant::now() + timeout;
    let (mut line, mut byte) = (Vec::new(), [0]);
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        if !wait(reports, PollFlags::IN, left)? {
            continue;
        }
        match reports.read(&mut byte)? {
            1 if byte != *b"\n" => line.extend(byte),
            _ => return Ok(String::from_utf8_lossy(&line).into_owned()),
        }
    }
}

/// Waits until the file is ready; returns false after `timeout`.
///
/// # Errors
/// The error of the system.
pub(super) fn wait(file: &impl AsFd, flags: PollFlags, timeout: Duration) -> io::Result<bool> {
    let timeout = Timespec::try_from(timeout).map_err(io::Error::other)?;
    match poll(&mut [PollFd::new(file, flags)], Some(&timeout)) {
        Ok(ready) => Ok(ready > 0),
        Err(rustix::io::Errno::INTR) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::schema::{Config, End};
    use super::*;

    #[test]
    fn reads_the_frames_written_and_ignores_an_incomplete_one() {
        let mut frames = FrameBuffer::default();
        let end = |ticks| End { ticks, ..End::default() };
        frames.add(7, &end(1));
        frames.add(u64::MAX, &Config { rate_hz: 9, ..Config::default() });
        frames.add_flush();
        let whole = frames.len();
        frames.add(9, &end(2));

        let read_all = |bytes: &[u8]| {
            let (mut pipe, mut buffer, mut all) = (bytes, Vec::new(), Vec::new());
            while let Some(frame) = read(&mut pipe, &mut buffer).unwrap() {
                all.push(match frame {
                    Frame::Flush => None,
                    Frame::Message { topic, log_time_ns, sequence, message } => {
                        Some((topic, log_time_ns, sequence, message.to_vec()))
                    }
                });
            }
            all
        };
        let all = read_all(frames.as_slice());
        assert_eq!(all.len(), 4);
        assert_eq!(all[0], Some((Channel::End as usize, 7, 0, end(1).encode_to_vec())));
        assert!(
            matches!(all[1], Some((topic, u64::MAX, 0, _)) if topic == Channel::Config as usize)
        );
        assert_eq!(all[2], None);
        assert_eq!(all[3], Some((Channel::End as usize, 9, 1, end(2).encode_to_vec())));
        for cut in whole..frames.len() {
            assert_eq!(read_all(&frames.as_slice()[..cut]), all[..3]);
        }
        let mut noise: &[u8] = &[0x55; 64];
        assert!(read(&mut noise, &mut Vec::new()).is_err());
    }
}
