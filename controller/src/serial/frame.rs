//! Frames: how a message is carried over any stream of bytes.
//!
//! ```text
//! body  = protocol version (1 byte) | payload (postcard) | CRC-32 of both (4 bytes, little-endian)
//! frame = 00 | COBS(body) | 00
//! ```
//!
//! COBS leaves no 0 inside a frame, so a 0 on the line is always a border, and
//! a receiver is synchronized again at the next one. The 0 in front separates
//! noise on an idle line from the frame: without it, noise would cost the frame
//! behind it. Two borders with nothing between them are ignored. No body is long
//! enough for a full COBS group of 254 bytes.

use core::error::Error;
use core::fmt;

use cobs::{DecodeResult, DecoderState, EncoderState, PushResult};
use serde::{Deserialize, Serialize};

use super::PROTOCOL_VERSION;
use super::message::LineCounts;
use crate::checksum::crc32;
use crate::postcard_once;

/// The most bytes of an encoded message.
pub const MAX_PAYLOAD: usize = 224;
/// Length of the checksum, bytes.
const CRC_LEN: usize = 4;
/// The most bytes inside COBS: version, payload, checksum.
const MAX_BODY: usize = 1 + MAX_PAYLOAD + CRC_LEN;
/// The most bytes of a frame on the line, with two borders and one byte of COBS.
pub const MAX_FRAME: usize = MAX_BODY + 3;

// One group always does: its code is at most 254.
const _: () = assert!(MAX_BODY <= 253);

/// Why the bytes between two borders are no good frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FrameError {
    /// The bytes are too few, or not valid COBS.
    Malformed,
    /// They are more than any message has.
    Oversize,
    /// The checksum does not match.
    Crc,
    /// The frame has another protocol version.
    Version(u8),
}

/// A message is longer than [`MAX_PAYLOAD`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLongError;

/// A payload is no message of this version, or bytes follow the message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnknownMessageError;

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Malformed => f.write_str("a frame that is too short or not valid COBS"),
            Self::Oversize => f.write_str("a frame longer than any message"),
            Self::Crc => f.write_str("a frame with a wrong checksum"),
            Self::Version(version) => write!(f, "a frame of protocol version {version}"),
        }
    }
}

impl fmt::Display for TooLongError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the message is longer than {MAX_PAYLOAD} bytes")
    }
}

impl fmt::Display for UnknownMessageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the payload is no message of this protocol version")
    }
}

impl Error for FrameError {}
impl Error for TooLongError {}
impl Error for UnknownMessageError {}

/// Encodes a message as a frame; returns the part of `frame` that is used.
///
/// # Errors
/// [`TooLongError`] when it is longer than [`MAX_PAYLOAD`].
pub fn encode<'f>(
    message: &impl Serialize,
    frame: &'f mut [u8; MAX_FRAME],
) -> Result<&'f [u8], TooLongError> {
    let [border, _, rest @ ..] = frame;
    let (version, room) = rest.split_first_mut().ok_or(TooLongError)?;
    *version = PROTOCOL_VERSION;
    let room = room.get_mut(..MAX_PAYLOAD).ok_or(TooLongError)?;
    let payload_len = postcard_once::to_slice(message, room).map_err(|_| TooLongError)?.len();
    let (checked, rest) = rest.split_at_mut_checked(1 + payload_len).ok_or(TooLongError)?;
    let (crc, rest) = rest.split_first_chunk_mut::<CRC_LEN>().ok_or(TooLongError)?;
    *crc = crc32(checked).to_le_bytes();
    let end = rest.first_mut().ok_or(TooLongError)?;
    (*border, *end) = (0, 0);

    let body_len = 1 + payload_len + CRC_LEN;
    encode_cobs(frame.get_mut(1..2 + body_len).ok_or(TooLongError)?);
    frame.get(..body_len + 3).ok_or(TooLongError)
}

/// Encodes in place the body that lies behind the first byte; that byte becomes the
/// first code. No byte moves: each 0 becomes a code, and a body has no full group.
fn encode_cobs(encoded: &mut [u8]) {
    let mut state = EncoderState::default();
    for index in 1..encoded.len() {
        if let Some(&byte) = encoded.get(index)
            && let PushResult::ModifyFromStartAndSkip((at, code)) = state.push(byte)
            && let Some(place) = encoded.get_mut(at)
        {
            *place = code;
        }
    }
    let (at, code) = state.finalize();
    if let Some(place) = encoded.get_mut(at) {
        *place = code;
    }
}

/// Decodes a payload that is one message, with nothing behind it.
///
/// # Errors
/// [`UnknownMessageError`] when it is anything else.
pub fn decode<'p, M: Deserialize<'p>>(payload: &'p [u8]) -> Result<M, UnknownMessageError> {
    match postcard_once::take_from_bytes(payload) {
        Ok((message, [])) => Ok(message),
        _ => Err(UnknownMessageError),
    }
}

/// Finds frames in a stream of bytes that may hold anything.
#[derive(Debug)]
pub struct Receiver {
    body: [u8; MAX_BODY],
    /// Bytes of the body so far; more than there is room for when it is oversize.
    len: usize,
    /// Bytes of the last good frame's payload, while it is still there.
    payload_len: usize,
    cobs: DecoderState,
    /// Whether the last frame was a bad one.
    after_bad: bool,
    counts: LineCounts,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// Makes a receiver. Bytes before the first border count as a frame.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            body: [0; MAX_BODY],
            len: 0,
            payload_len: 0,
            cobs: DecoderState::Idle,
            after_bad: false,
            counts: LineCounts::ZERO,
        }
    }

    /// Returns the counts so far. Each run of bytes between two borders is in one of
    /// `frames`, `crc_errors`, `malformed`, `oversize` and `version`.
    #[must_use]
    pub fn counts(&self) -> &LineCounts {
        &self.counts
    }

    /// Counts a good frame whose payload the caller could not decode.
    pub fn count_unknown(&mut self) {
        self.counts.unknown = self.counts.unknown.saturating_add(1);
    }

    /// Takes a byte. At the end of a frame it returns the payload, or the error.
    pub fn push(&mut self, byte: u8) -> Option<Result<&[u8], FrameError>> {
        let is_valid = match self.cobs.feed(byte) {
            Ok(DecodeResult::DataContinue(byte)) => {
                if let Some(place) = self.body.get_mut(self.len) {
                    *place = byte;
                }
                self.len = self.len.saturating_add(1);
                return None;
            }
            Ok(DecodeResult::DataComplete) => true,
            Ok(_) => return None,
            Err(_) => false,
        };
        let len = core::mem::take(&mut self.len);
        let checked = match self.body.get(..len) {
            None => Err(FrameError::Oversize),
            Some(body) if is_valid => check(body),
            Some(_) => Err(FrameError::Malformed),
        };
        let count = match checked {
            Ok(_) => &mut self.counts.frames,
            Err(FrameError::Malformed) => &mut self.counts.malformed,
            Err(FrameError::Oversize) => &mut self.counts.oversize,
            Err(FrameError::Crc) => &mut self.counts.crc_errors,
            Err(FrameError::Version(_)) => &mut self.counts.version,
        };
        *count = count.saturating_add(1);
        let followed_bad = core::mem::replace(&mut self.after_bad, checked.is_err());
        if followed_bad && checked.is_ok() {
            self.counts.resyncs = self.counts.resyncs.saturating_add(1);
        }
        self.payload_len = checked.map_or(0, <[u8]>::len);
        Some(checked.map(|_| self.payload()))
    }

    /// Returns the payload of the frame that the last byte ended: empty after a
    /// bad frame, and meaningless once the next frame has begun.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        self.body.get(1..1 + self.payload_len).unwrap_or_default()
    }
}

/// Checks a body and returns its payload.
fn check(body: &[u8]) -> Result<&[u8], FrameError> {
    let (checked, crc) = body.split_last_chunk::<CRC_LEN>().ok_or(FrameError::Malformed)?;
    let (&version, payload) = checked.split_first().ok_or(FrameError::Malformed)?;
    if u32::from_le_bytes(*crc) != crc32(checked) {
        return Err(FrameError::Crc);
    }
    if version != PROTOCOL_VERSION {
        return Err(FrameError::Version(version));
    }
    Ok(payload)
}
