//! Frames over a stream of bytes.

use std::io;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::stream::{ByteStream, Closed};
use leg_control::serial::frame::{self, FrameError, MAX_FRAME, Receiver, TooLongError};
use leg_control::serial::message::LineCounts;

/// Bytes read from the stream at once.
const CHUNK: usize = 1024;

/// The result of a wait on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Came {
    /// No frame is complete.
    Nothing,
    /// A good frame; [`Line::message`] returns its message.
    Frame,
    /// A bad frame.
    Bad(FrameError),
}

/// A stream, and the frames found in it.
///
/// A write that fails is not reported at once: the peer may have sent its last
/// message (why it crashed) before it closed the stream, and that message is
/// still to be read. [`Line::receive`] returns the failure once nothing is left.
pub(super) struct Line {
    stream: Box<dyn ByteStream>,
    /// The first write that failed.
    broken: Option<io::Error>,
    receiver: Receiver,
    bytes: Box<[u8; CHUNK]>,
    /// The part of `bytes` that is not decoded yet.
    unread: std::ops::Range<usize>,
}

impl Line {
    pub(super) fn new(stream: Box<dyn ByteStream>) -> Self {
        Self {
            stream,
            broken: None,
            receiver: Receiver::new(),
            bytes: Box::new([0; CHUNK]),
            unread: 0..0,
        }
    }

    /// Continues over another stream; counters stay.
    pub(super) fn replace(&mut self, stream: Box<dyn ByteStream>) {
        self.stream = stream;
        self.broken = None;
        self.unread = 0..0;
        // Ends a frame that was cut off.
        self.receiver.push(0);
    }

    /// Closes the stream, so that its device can be opened again.
    pub(super) fn close(&mut self) {
        self.stream = Box::new(Closed);
    }

    pub(super) fn counts(&self) -> &LineCounts {
        self.receiver.counts()
    }

    /// Returns the other processes that may take bytes away.
    pub(super) fn other_users(&self) -> Vec<String> {
        self.stream.other_users()
    }

    /// Returns whether the line is a serial port.
    pub(super) fn is_serial_port(&self) -> bool {
        self.stream.is_serial_port()
    }

    /// Sends a frame. After a failure nothing more is sent.
    pub(super) fn send(&mut self, frame: &[u8]) {
        if self.broken.is_none() {
            self.broken = self.stream.write_all(frame).err();
        }
    }

    /// Waits at most `timeout` for bytes and reads them up to the end of a frame. Returns
    /// [`Came::Nothing`] also when a frame is not complete yet.
    ///
    /// # Errors
    /// When the stream has ended or broken, after everything that arrived
    /// before was read.
    pub(super) fn receive(&mut self, timeout: Duration) -> io::Result<Came> {
        if self.unread.is_empty() {
            let timeout = if self.broken.is_some() { Duration::ZERO } else { timeout };
            let count = self.stream.read(&mut *self.bytes, timeout)?;
            if count == 0
                && let Some(error) = self.broken.take()
            {
                return Err(error);
            }
            self.unread = 0..count;
        }
        for at in self.unread.by_ref() {
            match self.receiver.push(self.bytes[at]) {
                None => (),
                Some(Ok(_)) => return Ok(Came::Frame),
                Some(Err(error)) => return Ok(Came::Bad(error)),
            }
        }
        Ok(Came::Nothing)
    }

    /// Returns the payload of the last frame.
    pub(super) fn payload(&self) -> &[u8] {
        self.receiver.payload()
    }

    /// Returns the message of the last frame; `None` when it is unknown.
    pub(super) fn message<'a, M: Deserialize<'a>>(&'a self) -> Option<M> {
        frame::decode(self.payload()).ok()
    }

    pub(super) fn count_unknown(&mut self) {
        self.receiver.count_unknown();
    }
}

/// Encodes a message as a frame.
///
/// # Errors
/// [`TooLongError`].
pub(super) fn framed(message: &impl Serialize) -> Result<Vec<u8>, TooLongError> {
    let mut frame = [0; MAX_FRAME];
    frame::encode(message, &mut frame).map(<[u8]>::to_vec)
}
