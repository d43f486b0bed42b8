//! The client of a control node: sends requests and samples and receives the answers.
//!
//! Samples and requests are two independent exchanges, each with at most one unanswered
//! message. A message that is not answered in time, or answered by a damaged frame, is
//! retransmitted under the same number; the node executes nothing twice.

use std::time::{Duration, Instant};

use serde::Serialize;

pub use super::client_error::{ClientError, taken_by};
use super::earlier;
use super::identity::DeviceIdentity;
use super::line::{Came, Line, framed};
use super::pending::{Answered, Pending, RetransmitTimer};
use super::stream::ByteStream;
use leg_control::serial::frame::FrameError;
use leg_control::serial::message::{
    Alarm, LineCounts, Reply, Request, RequestError, SlotReport, Status, ToController, ToHost,
};
use leg_control::wire::{Command, Sample};
use leg_process::Stop;

/// Longest wait for the first reply: a first byte may be lost, and an emulator takes a while to boot.
pub const IDENTIFY_TIMEOUT: Duration = Duration::from_secs(3);
/// Longest wait for the reply to any other request.
pub const REQUEST_TIMEOUT: Duration = Duration::from_secs(3);
/// Longest wait for the answer of a node of an earlier protocol version, after it has answered
/// nothing of this version for a while.
const EARLIER_TIMEOUT: Duration = Duration::from_millis(250);
/// Longest wait on the line before the stop flag is checked.
const LOOK: Duration = Duration::from_millis(50);

/// Counters of this client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Frames sent, retransmissions included.
    pub frames_out: u64,
    /// Samples answered by their command.
    pub commands: u64,
    /// Samples retransmitted.
    pub sample_retries: u64,
    /// Requests answered.
    pub replies: u64,
    /// Requests retransmitted.
    pub request_retries: u64,
    /// Commands for a sample that was answered before.
    pub repeats: u64,
    /// Commands and replies that nothing waits for.
    pub stale: u64,
}

/// What arrived from the node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Received {
    /// Nothing new in that time.
    Nothing,
    /// A command for a posted sample, not older than that of the command before.
    Command {
        /// Sequence number of the sample.
        seq: u32,
        /// The command.
        command: Command,
        /// Whether the command before was for the same sample: a repeated answer or, in live
        /// mode, that of the next tick without a new sample.
        again: bool,
    },
    /// The reply to the request posted last; [`Client::reply`] returns it.
    Reply,
    /// An alarm.
    Alarm(Alarm),
}

/// The sequence numbers for which a command is accepted.
#[derive(Clone, Copy, Debug)]
struct OpenRange {
    /// The number of the last command; at first, of the first sample.
    from: u32,
    /// The number of the newest sample.
    to: u32,
    /// Whether there has been a command for `from`.
    answered: bool,
}

impl OpenRange {
    fn contains(self, seq: u32) -> bool {
        // The numbers may wrap around.
        seq.wrapping_sub(self.from) <= self.to.wrapping_sub(self.from)
    }
}

/// A client over one stream.
pub struct Client {
    line: Line,
    sample: Option<Pending>,
    sample_timer: RetransmitTimer,
    answered_sample: Option<Answered>,
    open: Option<OpenRange>,
    request: Option<Pending>,
    request_timer: RetransmitTimer,
    answered_request: Option<Answered>,
    next_id: u32,
    counts: Counts,
    /// The protocol version of frames that were of another version.
    foreign: Option<u8>,
    stop: Stop,
}

impl Client {
    /// Creates a client over an open stream. Waits end early, with [`ClientError::Stopped`],
    /// when `stop` is raised.
    #[must_use]
    pub fn new(stream: Box<dyn ByteStream>, stop: &Stop) -> Self {
        Self {
            line: Line::new(stream),
            sample: None,
            sample_timer: RetransmitTimer::new(),
            answered_sample: None,
            open: None,
            request: None,
            request_timer: RetransmitTimer::new(),
            answered_request: None,
            // The first id must not be the last one of the program before.
            next_id: random_u32(),
            counts: Counts::default(),
            foreign: None,
            stop: stop.clone(),
        }
    }

    /// Closes the stream, until [`Client::replace_stream`]. A port is free only then, and one
    /// that is plugged in again gets its old name only then.
    pub fn close_stream(&mut self) {
        self.line.close();
    }

    /// Continues over another stream. Unanswered messages are dropped; counters stay.
    pub fn replace_stream(&mut self, stream: Box<dyn ByteStream>) {
        self.line.replace(stream);
        (self.sample, self.open, self.request) = (None, None, None);
        (self.sample_timer, self.request_timer) = (RetransmitTimer::new(), RetransmitTimer::new());
    }

    /// Returns the counters.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Returns the counters of what arrived.
    #[must_use]
    pub fn line_counts(&self) -> &LineCounts {
        self.line.counts()
    }

    /// Returns the other processes that have the device of the line open.
    #[must_use]
    pub fn other_users(&self) -> Vec<String> {
        self.line.other_users()
    }

    /// Makes waits ignore the stop flag from now on, for what must still be sent before leaving.
    pub fn disregard_stop(&mut self) {
        self.stop = Stop::default();
    }

    /// Sends a sample; it replaces one that is unanswered. Numbers ascend. If the stream is
    /// broken, [`Client::listen`] reports it.
    pub fn post_sample(&mut self, seq: u32, sample: &Sample) {
        let first = OpenRange { from: seq, to: seq, answered: false };
        self.open = Some(self.open.map_or(first, |open| OpenRange { to: seq, ..open }));
        let frame = frame_of(&ToController::Sample { seq, sample: *sample });
        let pending = self.sample.insert(Pending::new(seq, frame, &self.sample_timer));
        send(&mut self.line, pending, &mut self.counts);
    }

    /// Sends a request; it replaces one that is unanswered. If the stream is broken,
    /// [`Client::listen`] reports it.
    pub fn post_request(&mut self, request: &Request<'_>) {
        let id = self.next_id;
        self.next_id = id.wrapping_add(1);
        let frame = frame_of(&ToController::Request { id, request: *request });
        let pending = self.request.insert(Pending::new(id, frame, &self.request_timer));
        send(&mut self.line, pending, &mut self.counts);
    }

    /// Returns for how long the request posted last has been unanswered.
    #[must_use]
    pub fn request_age(&self) -> Option<Duration> {
        self.request.as_ref().map(Pending::age)
    }

    /// Drops the request posted last.
    pub fn drop_request(&mut self) {
        self.request = None;
    }

    /// Waits at most `timeout` for a message, and retransmits what is due. May return
    /// [`Received::Nothing`] sooner.
    ///
    /// # Errors
    /// [`ClientError::Line`] when the stream is broken and everything that
    /// arrived before was returned; [`ClientError::Stopped`].
    pub fn listen(&mut self, timeout: Duration) -> Result<Received, ClientError> {
        if self.stop.is_raised() {
            return Err(ClientError::Stopped);
        }
        self.retransmit_due();
        let due = [&self.sample, &self.request].into_iter().flatten().map(Pending::wait).min();
        let wait = timeout.min(due.unwrap_or(LOOK)).min(LOOK);
        match self.line.receive(wait)? {
            Came::Nothing => Ok(Received::Nothing),
            Came::Bad(fault) => {
                if let FrameError::Version(version) = fault {
                    self.foreign = Some(version);
                } else {
                    self.answer_was_damaged();
                }
                Ok(Received::Nothing)
            }
            Came::Frame => Ok(self.take()),
        }
    }

    fn retransmit_due(&mut self) {
        if let Some(sample) = self.sample.as_mut().filter(|sample| sample.wait().is_zero()) {
            sample.retransmit_after_timeout();
            self.counts.sample_retries += 1;
            send(&mut self.line, sample, &mut self.counts);
        }
        if let Some(request) = self.request.as_mut().filter(|request| request.wait().is_zero()) {
            request.retransmit_after_timeout();
            self.counts.request_retries += 1;
            send(&mut self.line, request, &mut self.counts);
        }
    }

    /// Handles a damaged frame. If only one answer is due, it was that one, and the message is
    /// retransmitted at once.
    fn answer_was_damaged(&mut self) {
        let (pending, retries) = match (&mut self.sample, &mut self.request) {
            (Some(sample), None) => (sample, &mut self.counts.sample_retries),
            (None, Some(request)) => (request, &mut self.counts.request_retries),
            _ => return,
        };
        if !pending.may_be_answered() {
            return;
        }
        pending.retransmit();
        *retries += 1;
        send(&mut self.line, pending, &mut self.counts);
    }

    fn take(&mut self) -> Received {
        match self.line.message::<ToHost<'_>>() {
            Some(ToHost::Command { seq, command }) => {
                if let Some(pending) = self.sample.take_if(|pending| pending.number == seq) {
                    self.answered_sample = pending.answered(&mut self.sample_timer);
                } else if let Some(twice) = self.answered_sample.take_if(|last| last.number == seq)
                {
                    self.sample_timer.was_too_soon(twice.took);
                }
                if let Some(open) = self.open.filter(|open| open.contains(seq)) {
                    let again = open.answered && open.from == seq;
                    self.open = Some(OpenRange { from: seq, answered: true, ..open });
                    self.counts.commands += u64::from(!again);
                    self.counts.repeats += u64::from(again);
                    return Received::Command { seq, command, again };
                }
            }
            Some(ToHost::Reply { id, .. }) => {
                if let Some(pending) = self.request.take_if(|pending| pending.number == id) {
                    self.answered_request = pending.answered(&mut self.request_timer);
                    self.counts.replies += 1;
                    return Received::Reply;
                }
                if let Some(twice) = self.answered_request.take_if(|last| last.number == id) {
                    self.request_timer.was_too_soon(twice.took);
                }
            }
            Some(ToHost::Alarm(alarm)) => return Received::Alarm(alarm),
            None => {
                self.line.count_unknown();
                return Received::Nothing;
            }
        }
        self.counts.stale += 1;
        Received::Nothing
    }

    /// Returns the reply that [`Received::Reply`] has announced.
    #[must_use]
    pub fn reply(&self) -> Option<Reply<'_>> {
        match self.line.message() {
            Some(ToHost::Reply { reply, .. }) => Some(reply),
            _ => None,
        }
    }

    /// Sends a request and waits for the reply. An unanswered sample is dropped.
    ///
    /// # Errors
    /// [`ClientError`]; a refusal is [`ClientError::Refused`].
    pub fn request(
        &mut self,
        request: &Request<'_>,
        timeout: Duration,
    ) -> Result<Reply<'_>, ClientError> {
        self.sample = None;
        let (begun, bad) = (Instant::now(), bad_frames(self.line.counts()));
        self.foreign = None;
        self.post_request(request);
        loop {
            match self.listen(timeout)? {
                Received::Reply => break,
                Received::Alarm(alarm @ Alarm::Crash(_)) => return Err(ClientError::Alarm(alarm)),
                Received::Alarm(Alarm::NoPolicy { .. })
                | Received::Command { .. }
                | Received::Nothing => (),
            }
            let waited = begun.elapsed();
            if waited >= timeout {
                self.request = None;
                let bad = bad_frames(self.line.counts()) - bad;
                let others = self.other_users();
                let is_serial_port = self.line.is_serial_port();
                return Err(match self.foreign {
                    Some(theirs) => ClientError::ProtocolVersion { theirs },
                    None if bad > 0 => ClientError::Noise { waited, others, is_serial_port, bad },
                    None => ClientError::Silent { waited, others, is_serial_port },
                });
            }
        }
        match self.reply() {
            Some(Reply::Refused(refusal)) => Err(ClientError::Refused(refusal)),
            Some(reply) => Ok(reply),
            None => Err(ClientError::WrongReply),
        }
    }

    /// Sends a request that changes something and waits until it is done.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn have_done(&mut self, request: &Request<'_>) -> Result<(), ClientError> {
        match self.request(request, REQUEST_TIMEOUT)? {
            Reply::Done => Ok(()),
            _ => Err(ClientError::WrongReply),
        }
    }

    /// Sends [`Request::Identify`] until it is answered, at most for `timeout`
    /// ([`IDENTIFY_TIMEOUT`] is usual); returns the identity.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn identify(&mut self, timeout: Duration) -> Result<DeviceIdentity, ClientError> {
        let silent = match self.request(&Request::Identify, timeout) {
            Ok(Reply::Identity(identity)) => return Ok(DeviceIdentity::from(&identity)),
            Ok(_) => return Err(ClientError::WrongReply),
            Err(silent @ ClientError::Silent { .. }) => silent,
            Err(other) => return Err(other),
        };
        Err(match self.earlier_version()? {
            Some(theirs) => ClientError::ProtocolVersion { theirs },
            None => silent,
        })
    }

    /// Returns the protocol version of a node that answers only requests of an earlier one;
    /// `None` when it answers none.
    fn earlier_version(&mut self) -> Result<Option<u8>, ClientError> {
        for request in earlier::identify_requests() {
            self.line.send(&request);
            self.counts.frames_out += 1;
        }
        let begun = Instant::now();
        while self.foreign.is_none() && begun.elapsed() < EARLIER_TIMEOUT {
            self.listen(EARLIER_TIMEOUT)?;
        }
        Ok(self.foreign)
    }

    /// Returns the contents of the two slots: A, then B.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn slots(&mut self) -> Result<[SlotReport<'_>; 2], ClientError> {
        match self.request(&Request::Slots, REQUEST_TIMEOUT)? {
            Reply::Slots(slots) => Ok(slots),
            _ => Err(ClientError::WrongReply),
        }
    }

    /// Reads the JSON report of the process around the node; `None` from a board.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn report(&mut self) -> Result<Option<Vec<u8>>, ClientError> {
        match self.read_all(|offset| Request::Report { offset }) {
            Err(ClientError::Refused(RequestError::Unsupported)) => Ok(None),
            report => report.map(Some),
        }
    }

    /// Reads the blob with this checksum; `None` when the node does not have it.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn read_policy(&mut self, crc32: u32) -> Result<Option<Vec<u8>>, ClientError> {
        match self.read_all(|offset| Request::Read { crc32, offset }) {
            Err(ClientError::Refused(RequestError::NotFound)) => Ok(None),
            blob => blob.map(Some),
        }
    }

    fn read_all(
        &mut self,
        request: impl Fn(u32) -> Request<'static>,
    ) -> Result<Vec<u8>, ClientError> {
        let mut all = Vec::new();
        loop {
            match self.request(&request(all.len() as u32), REQUEST_TIMEOUT)? {
                Reply::Bytes([]) => return Ok(all),
                Reply::Bytes(part) => all.extend_from_slice(part),
                _ => return Err(ClientError::WrongReply),
            }
        }
    }

    /// Requests the state of the node.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn status(&mut self) -> Result<Status, ClientError> {
        match self.request(&Request::Status, REQUEST_TIMEOUT)? {
            Reply::Status(status) => Ok(status),
            _ => Err(ClientError::WrongReply),
        }
    }
}

/// Returns the number of bad frames of every kind.
fn bad_frames(line: &LineCounts) -> u32 {
    line.crc_errors + line.malformed + line.oversize + line.version
}

fn frame_of(message: &ToController<'_>) -> Vec<u8> {
    // A chunk is the longest message, and `upload` makes none that does not fit.
    framed(message).unwrap_or_default()
}

fn send(line: &mut Line, message: &Pending, counts: &mut Counts) {
    line.send(&message.frame);
    counts.frames_out += 1;
}

/// Returns a number that differs between programs started at the same time.
#[must_use]
pub fn random_u32() -> u32 {
    use std::hash::{BuildHasher, Hasher};
    // The standard library seeds its maps from the system.
    std::collections::hash_map::RandomState::new().build_hasher().finish() as u32
}
