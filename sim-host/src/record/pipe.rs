//! What goes over the pipe from a run to its recorder: frames, each a message
//! ready for the file.
//!
//! | bytes | meaning |
//! |---|---|
//! | 1 | [`Channel`] by its number, or [`FLUSH`] |
//! | 8 | time, ns from 1970, little-endian |
//! | 4 | number of the message in its channel, little-endian |
//! | 4 | length of the message, little-endian |
//! | so many | the message, protobuf |

use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::schema::{Channel, Recorded};

/// A frame without a message: everything before it goes to the disk's file now.
const FLUSH: u8 = 0xff;
const HEAD: usize = 17;
/// No message is longer: a policy is 1 MiB at most, a scenario far less.
const MOST: usize = 1 << 24;

/// Frames on their way.
#[derive(Debug, Default)]
pub(super) struct Frames {
    bytes: Vec<u8>,
    sent: [u32; Channel::ALL.len()],
}

impl Frames {
    /// Adds a message.
    pub(super) fn add<M: Recorded>(&mut self, log_time_ns: u64, message: &M) {
        let sequence = &mut self.sent[M::CHANNEL as usize];
        self.bytes.push(M::CHANNEL as u8);
        self.bytes.extend(log_time_ns.to_le_bytes());
        self.bytes.extend(sequence.to_le_bytes());
        self.bytes.extend((message.encoded_len() as u32).to_le_bytes());
        message.encode(&mut self.bytes).expect("a vector takes any length");
        *sequence = sequence.wrapping_add(1);
    }

    /// Asks for what is on the way to be written out.
    pub(super) fn add_flush(&mut self) {
        self.bytes.push(FLUSH);
        self.bytes.extend([0; HEAD - 1]);
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

/// What comes out of the pipe.
#[derive(Debug)]
pub(super) enum Incoming<'a> {
    Message { channel: Channel, log_time_ns: u64, sequence: u32, message: &'a [u8] },
    Flush,
}

/// The next frame, its message in `buffer`; `None` where the pipe ends, be it
/// in the middle of a frame.
///
/// # Errors
/// When the pipe breaks, or what comes is no frame.
pub(super) fn read<'a>(
    pipe: &mut impl Read,
    buffer: &'a mut Vec<u8>,
) -> io::Result<Option<Incoming<'a>>> {
    let mut head = [0; HEAD];
    if !fill(pipe, &mut head)? {
        return Ok(None);
    }
    let [number, rest @ ..] = head;
    if number == FLUSH {
        return Ok(Some(Incoming::Flush));
    }
    let (time, rest) = rest.split_at(8);
    let (sequence, len) = rest.split_at(4);
    let word = |bytes: &[u8]| bytes.iter().rev().fold(0, |word, byte| word << 8 | u64::from(*byte));
    let len = word(len) as usize;
    let channel = Channel::ALL.get(usize::from(number)).copied();
    let (Some(channel), true) = (channel, len <= MOST) else {
        return Err(io::Error::new(ErrorKind::InvalidData, "what comes is no frame"));
    };
    buffer.resize(len, 0);
    if !fill(pipe, buffer)? {
        return Ok(None);
    }
    Ok(Some(Incoming::Message {
        channel,
        log_time_ns: word(time),
        sequence: word(sequence) as u32,
        message: buffer,
    }))
}

/// Whether there was enough to fill the buffer.
fn fill(pipe: &mut impl Read, buffer: &mut [u8]) -> io::Result<bool> {
    match pipe.read_exact(buffer) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

/// Writes all of it, and waits for a reader that takes nothing for so long
/// only; for a pipe that does not block.
///
/// # Errors
/// [`ErrorKind::TimedOut`], or what the system says.
pub(super) fn write_patiently(
    pipe: &mut (impl Write + AsFd),
    mut bytes: &[u8],
    patience: Duration,
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
                let left = patience.saturating_sub(since.elapsed());
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

/// Waits until the file is ready, or the time is over; whether it is ready.
///
/// # Errors
/// What the system says.
pub(super) fn wait(file: &impl AsFd, flags: PollFlags, time: Duration) -> io::Result<bool> {
    let time = Timespec::try_from(time).map_err(io::Error::other)?;
    match poll(&mut [PollFd::new(file, flags)], Some(&time)) {
        Ok(ready) => Ok(ready > 0),
        Err(rustix::io::Errno::INTR) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use prost::Message;

    use super::super::schema::{Config, End};
    use super::*;

    #[test]
    fn frames_come_out_as_they_went_in_and_a_cut_one_not_at_all() {
        let mut frames = Frames::default();
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
                    Incoming::Flush => None,
                    Incoming::Message { channel, log_time_ns, sequence, message } => {
                        Some((channel, log_time_ns, sequence, message.to_vec()))
                    }
                });
            }
            all
        };
        let all = read_all(frames.as_slice());
        assert_eq!(all.len(), 4);
        assert_eq!(all[0], Some((Channel::End, 7, 0, end(1).encode_to_vec())));
        assert!(matches!(all[1], Some((Channel::Config, u64::MAX, 0, _))));
        assert_eq!(all[2], None);
        assert_eq!(all[3], Some((Channel::End, 9, 1, end(2).encode_to_vec())));
        for cut in whole..frames.len() {
            assert_eq!(read_all(&frames.as_slice()[..cut]), all[..3]);
        }
        let mut noise: &[u8] = &[0x55; 64];
        assert!(read(&mut noise, &mut Vec::new()).is_err());
    }
}
