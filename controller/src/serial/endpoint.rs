//! One end of a byte stream: bytes in, frames out.

use embedded_io::{Read, Write};

use super::frame::{self, MAX_FRAME, Receiver};
use super::handler::{Outcome, RequestHandler, done};
use super::message::{Alarm, DeviceCounts, LineCounts, Reply, Request, ToController, ToHost};
use super::node::{NodeChange, NodeHandle};
use super::store::PolicyStore;

/// Bytes read from a stream at once.
const READ_LEN: usize = 64;

/// Answers a repeated request as before, without carrying it out again.
#[derive(Clone, Copy, Debug, Default)]
pub struct RepeatFilter {
    /// The last request: its number, and its outcome if it was no query.
    last: Option<(u32, Option<Outcome>)>,
}

impl RepeatFilter {
    /// Carries out the request, unless it repeats the last one, and returns the
    /// reply. The reply borrows from the store of the handler.
    pub fn answer<'h, S: PolicyStore>(
        &mut self,
        id: u32,
        request: &Request<'_>,
        handler: &'h mut RequestHandler<S>,
        node: &impl NodeHandle,
        line: &LineCounts,
        device: &DeviceCounts,
    ) -> Reply<'h> {
        let repeated = self.last.filter(|(last, _)| *last == id);
        if repeated.is_some() {
            let _ = node.change(NodeChange::CountRepeated);
        }
        if let Some((_, Some(outcome))) = repeated {
            return done(outcome);
        }
        let reply = handler.answer(request, node, line, device);
        let outcome = match reply {
            _ if request.is_query() => None,
            Reply::Refused(error) => Some(Err(error)),
            _ => Some(Ok(())),
        };
        self.last = Some((id, outcome));
        reply
    }
}

/// The node's end of a byte stream.
///
/// Each host that is connected has an endpoint of its own; handler and node are
/// passed to each call. Commands of live ticks do not come this way: whoever
/// calls [`super::node::ControlNode::live_tick`] encodes its result as
/// [`ToHost::Command`] with [`frame::encode`].
#[derive(Debug)]
pub struct Endpoint {
    receiver: Receiver,
    filter: RepeatFilter,
    out: [u8; MAX_FRAME],
}

impl Default for Endpoint {
    fn default() -> Self {
        Self::new()
    }
}

impl Endpoint {
    /// Makes an endpoint that has received nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self { receiver: Receiver::new(), filter: RepeatFilter { last: None }, out: [0; MAX_FRAME] }
    }

    /// Returns the frame of an alarm.
    pub fn alarm(&mut self, alarm: Alarm) -> Option<&[u8]> {
        frame::encode(&ToHost::Alarm(alarm), &mut self.out).ok()
    }

    /// Takes a byte from the stream; returns the frame to send when the byte ends
    /// a message that is answered now. Requests call `device`.
    pub fn push<S: PolicyStore>(
        &mut self,
        byte: u8,
        handler: &mut RequestHandler<S>,
        node: &impl NodeHandle,
        device: impl FnOnce() -> DeviceCounts,
    ) -> Option<&[u8]> {
        self.push_with(byte, |message, filter, line| match message {
            ToController::Sample { seq, sample } => {
                let command = node.sample(seq, &sample)?;
                Some(ToHost::Command { seq, command })
            }
            ToController::Request { id, request } => {
                let reply = filter.answer(id, &request, handler, node, line, &device());
                Some(ToHost::Reply { id, reply })
            }
        })
    }

    /// Takes a byte as [`Self::push`] does, and has `answer` answer messages.
    pub fn push_with<'r>(
        &mut self,
        byte: u8,
        answer: impl FnOnce(ToController<'_>, &mut RepeatFilter, &LineCounts) -> Option<ToHost<'r>>,
    ) -> Option<&[u8]> {
        self.receiver.push(byte)?.ok()?;
        let Ok(message) = frame::decode(self.receiver.payload()) else {
            self.receiver.count_unknown();
            return None;
        };
        let answer = answer(message, &mut self.filter, self.receiver.counts())?;
        // Every message fits (see the tests).
        frame::encode(&answer, &mut self.out).ok()
    }

    /// Reads once from a stream, and writes the answers to what it has read.
    /// Returns the bytes read; 0 when the stream has ended.
    ///
    /// # Errors
    /// When the stream cannot be read from or written to.
    pub fn serve<T: Read + Write, S: PolicyStore>(
        &mut self,
        stream: &mut T,
        handler: &mut RequestHandler<S>,
        node: &impl NodeHandle,
        device: impl Fn() -> DeviceCounts,
    ) -> Result<usize, T::Error> {
        let mut bytes = [0; READ_LEN];
        let count = stream.read(&mut bytes)?;
        for &byte in bytes.get(..count).unwrap_or_default() {
            if let Some(frame) = self.push(byte, handler, node, &device) {
                stream.write_all(frame)?;
                stream.flush()?;
            }
        }
        Ok(count)
    }
}
