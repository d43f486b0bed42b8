//! Frames: how a message is carried over any stream of bytes.
//!
//! ```text
//! body  = protocol version (1 byte) | payload (postcard) | CRC-32 of both (4 bytes, little-endian)
//! frame = 00 | COBS(body) | 00
//! ```
//!
//! COBS leaves no 0 inside a frame, so a 0 on the line is always a border, and
//! whoever listens is in step again at the next one. The 0 in front shuts off
//! noise from an idle line: without it, noise would cost the frame behind it.
//! An empty frame, between two zeros, is nothing at all. No body is long enough
//! for a full COBS group of 254 bytes.
//!
//! COBS is written out here, a dozen lines each way: the `cobs` crate indexes
//! slices, and the image is to have no panicking path.

use serde::{Deserialize, Serialize};

use super::PROTOCOL_VERSION;
use super::message::LineCounts;
use crate::checksum::crc32;
use crate::postcard_once;

/// Most bytes of a message, encoded.
pub const MAX_PAYLOAD: usize = 224;
/// Bytes of the checksum.
const CRC_LEN: usize = 4;
/// Most bytes inside COBS: version, payload, checksum.
const MAX_BODY: usize = 1 + MAX_PAYLOAD + CRC_LEN;
/// Most bytes of a frame on the line: two borders and one byte of COBS.
pub const MAX_FRAME: usize = MAX_BODY + 3;

// One group always does: its code is at most 254.
const _: () = assert!(MAX_BODY <= 253);

/// What came between two borders and is no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FrameFault {
    /// Not as COBS has it, or too short.
    Malformed,
    /// Longer than any message.
    Oversize,
    /// The checksum does not match.
    Crc,
    /// A frame of another protocol version.
    Version(u8),
}

/// A message longer than [`MAX_PAYLOAD`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLong;

/// A payload that is no message of this version, or one with something behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unknown;

/// Why a message was not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SendFault<E> {
    /// It is longer than any frame.
    TooLong,
    /// The writer took no more bytes.
    Full,
    /// The writer's own fault.
    Io(E),
}

/// Puts a message into a frame; returns the part of `frame` that is used.
///
/// # Errors
/// [`TooLong`] when it is longer than [`MAX_PAYLOAD`].
pub fn encode<'f>(
    message: &impl Serialize,
    frame: &'f mut [u8; MAX_FRAME],
) -> Result<&'f [u8], TooLong> {
    let mut body = [0_u8; MAX_BODY];
    let (version, rest) = body.split_first_mut().ok_or(TooLong)?;
    *version = PROTOCOL_VERSION;
    let room = rest.get_mut(..MAX_PAYLOAD).ok_or(TooLong)?;
    let payload_len = postcard_once::to_slice(message, room).map_err(|_| TooLong)?.len();
    let (checked, rest) = body.split_at_mut_checked(1 + payload_len).ok_or(TooLong)?;
    let crc = rest.first_chunk_mut::<CRC_LEN>().ok_or(TooLong)?;
    *crc = crc32(checked).to_le_bytes();
    let body = body.get(..1 + payload_len + CRC_LEN).ok_or(TooLong)?;

    // A group is a run without zeros, led by its length plus 1.
    let mut len = 0_usize;
    let mut places = frame.iter_mut();
    let mut put = |byte: u8| {
        if let Some(place) = places.next() {
            *place = byte;
            len += 1;
        }
    };
    put(0);
    for group in body.split(|&byte| byte == 0) {
        put(group.len() as u8 + 1);
        for &byte in group {
            put(byte);
        }
    }
    put(0);
    frame.get(..len).ok_or(TooLong)
}

/// Reads a payload as one message, and nothing behind it.
///
/// # Errors
/// [`Unknown`] when it is anything else.
pub fn decode<'p, M: Deserialize<'p>>(payload: &'p [u8]) -> Result<M, Unknown> {
    match postcard_once::take_from_bytes(payload) {
        Ok((message, [])) => Ok(message),
        _ => Err(Unknown),
    }
}

/// Sends a message, whole, over anything that takes bytes.
///
/// # Errors
/// [`SendFault`] when the message is too long, or the writer fails or takes no
/// more; part of the frame may then have gone, which the receiver sees as a
/// damaged one.
pub fn send<W: embedded_io::Write>(
    writer: &mut W,
    message: &impl Serialize,
) -> Result<(), SendFault<W::Error>> {
    let mut frame = [0; MAX_FRAME];
    let mut rest = encode(message, &mut frame).map_err(|TooLong| SendFault::TooLong)?;
    while !rest.is_empty() {
        let taken = writer.write(rest).map_err(SendFault::Io)?;
        rest = rest.get(taken..).unwrap_or_default();
        if taken == 0 {
            return Err(SendFault::Full);
        }
    }
    writer.flush().map_err(SendFault::Io)
}

/// Finds frames in a stream of bytes that may hold anything.
#[derive(Clone, Debug)]
pub struct Receiver {
    body: [u8; MAX_BODY],
    /// Bytes of the body so far.
    len: usize,
    /// Bytes of the last good frame's payload, while it is still there.
    payload_len: usize,
    state: State,
    /// Whether the last frame was a bad one.
    astray: bool,
    counts: LineCounts,
}

/// Where in a frame the line is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// At a border.
    Border,
    /// In a group with this many bytes to come.
    Group(u8),
    /// In a frame that is too long already.
    Oversize,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// A receiver that has heard nothing. Before the first border it takes
    /// what it hears for a frame.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            body: [0; MAX_BODY],
            len: 0,
            payload_len: 0,
            state: State::Border,
            astray: false,
            counts: LineCounts::ZERO,
        }
    }

    /// What came so far. Each run of bytes between two borders is in one of
    /// `frames`, `crc_errors`, `malformed`, `oversize` and `version`.
    #[must_use]
    pub fn counts(&self) -> &LineCounts {
        &self.counts
    }

    /// Counts a good frame whose payload is no message that the caller knows.
    pub fn count_unknown(&mut self) {
        self.counts.unknown = self.counts.unknown.saturating_add(1);
    }

    /// Takes a byte. At the end of a frame: its payload, or what is wrong.
    pub fn push(&mut self, byte: u8) -> Option<Result<&[u8], FrameFault>> {
        if byte != 0 {
            self.take(byte);
            return None;
        }
        let state = core::mem::replace(&mut self.state, State::Border);
        if state == State::Border {
            return None;
        }
        let len = core::mem::take(&mut self.len);
        let checked = match state {
            State::Oversize => Err(FrameFault::Oversize),
            State::Group(0) => self.body.get(..len).ok_or(FrameFault::Malformed).and_then(check),
            State::Group(_) | State::Border => Err(FrameFault::Malformed),
        };
        let count = match checked {
            Ok(_) => &mut self.counts.frames,
            Err(FrameFault::Malformed) => &mut self.counts.malformed,
            Err(FrameFault::Oversize) => &mut self.counts.oversize,
            Err(FrameFault::Crc) => &mut self.counts.crc_errors,
            Err(FrameFault::Version(_)) => &mut self.counts.version,
        };
        *count = count.saturating_add(1);
        let was_astray = core::mem::replace(&mut self.astray, checked.is_err());
        if was_astray && checked.is_ok() {
            self.counts.resyncs = self.counts.resyncs.saturating_add(1);
        }
        self.payload_len = checked.map_or(0, <[u8]>::len);
        Some(checked.map(|_| self.payload()))
    }

    /// The payload of the frame that the last byte ended: empty after a bad
    /// frame, and of no meaning once the next frame has begun.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        self.body.get(1..1 + self.payload_len).unwrap_or_default()
    }

    fn take(&mut self, byte: u8) {
        self.state = match self.state {
            State::Border => State::Group(byte - 1),
            // Between two groups there was a 0.
            State::Group(0) => self.store(0, byte - 1),
            State::Group(left) => self.store(byte, left - 1),
            State::Oversize => State::Oversize,
        };
    }

    fn store(&mut self, byte: u8, left: u8) -> State {
        let Some(place) = self.body.get_mut(self.len) else { return State::Oversize };
        *place = byte;
        self.len += 1;
        State::Group(left)
    }
}

/// The payload of a body.
fn check(body: &[u8]) -> Result<&[u8], FrameFault> {
    let (checked, crc) = body.split_last_chunk::<CRC_LEN>().ok_or(FrameFault::Malformed)?;
    let (&version, payload) = checked.split_first().ok_or(FrameFault::Malformed)?;
    if u32::from_le_bytes(*crc) != crc32(checked) {
        return Err(FrameFault::Crc);
    }
    if version != PROTOCOL_VERSION {
        return Err(FrameFault::Version(version));
    }
    Ok(payload)
}
