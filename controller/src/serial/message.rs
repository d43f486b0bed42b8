//! The messages between a host and a control node.
//!
//! Postcard encodes them, and [`super::frame`] carries them. Fields and
//! variants are encoded in the order in which they stand here: a change raises
//! [`super::PROTOCOL_VERSION`].
//!
//! Two exchanges run side by side, and neither waits for the other. The node
//! answers a sample by a command with the same `seq`, and a request by a reply
//! with the same `id`. When a number repeats the last one, the node sends the
//! last answer again and does nothing twice; a host that receives no answer
//! therefore retransmits its message, with the same number, as often as it
//! takes. A request that changes nothing ([`Request::is_query`]) is answered
//! afresh whatever its number, so a host that does not know the last number
//! begins with [`Request::Identify`].

use core::fmt;

use serde::{Deserialize, Serialize};

pub use super::error::{BlobError, RequestError, SlotError};
use crate::wire::{Command, Sample};

/// The most bytes of a blob in one [`Request::Chunk`] or [`Reply::Bytes`].
pub const MAX_CHUNK: usize = 192;

/// The most bytes of a name in any message. [`cut`] shortens longer ones.
pub const MAX_NAME: usize = 48;

/// The most bytes of [`Request::Begin`]'s `origin`.
pub const MAX_ORIGIN: usize = 192;

/// Returns the beginning of a name, as much as fits a message.
#[must_use]
#[inline(never)]
pub fn cut(name: &str) -> &str {
    if name.len() <= MAX_NAME {
        return name;
    }
    // A character is at most 4 bytes long.
    (0..4).find_map(|back| name.get(..MAX_NAME - back)).unwrap_or_default()
}

/// A message from the host to the node.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToController<'a> {
    /// A sensor sample. In lock-step it is a tick; in live mode the newest one
    /// is used at the next tick.
    Sample {
        /// Sequence number on the line: any but that of the last sample.
        seq: u32,
        /// The sample.
        sample: Sample,
    },
    /// A request.
    Request {
        /// Sequence number: any but that of the last request.
        id: u32,
        /// The request.
        #[serde(borrow)]
        request: Request<'a>,
    },
}

/// A message from the node to the host.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToHost<'a> {
    /// A command to the leg.
    Command {
        /// Sequence number of the sample that it answers.
        seq: u32,
        /// The command.
        command: Command,
    },
    /// The answer to a request.
    Reply {
        /// Sequence number of the request.
        id: u32,
        /// The answer.
        #[serde(borrow)]
        reply: Reply<'a>,
    },
    /// A fault of the node, sent without a request.
    Alarm(Alarm),
}

/// A request to a control node.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request<'a> {
    /// Answered by [`Reply::Identity`]. Changes nothing.
    Identify,
    /// Forgets the run and begins another with these parameters: idle until a
    /// mode is set, and with all statistics at 0. Answered by [`Reply::Done`].
    Reset {
        /// Any number. [`Identity::session`] repeats it until the next reset or
        /// power-up, so that a host which reconnects knows whether its run is
        /// still there.
        session: u32,
        /// How the control law runs.
        params: SessionParams,
    },
    /// Sets what makes a tick. Answered by [`Reply::Done`].
    SetMode(Mode),
    /// Sets the speed to keep, m/s, in place of that in the samples; `None`
    /// returns to that in the samples. Answered by [`Reply::Done`].
    SetPoint(Option<f32>),
    /// Answered by [`Reply::Status`]. Changes nothing.
    Status,
    /// Answered by [`Reply::Slots`]. Changes nothing.
    Slots,
    /// Begins an upload: makes room for a blob in the idle slot. Answered by
    /// [`Reply::Done`].
    Begin {
        /// Length of the blob, bytes.
        length: u32,
        /// CRC-32 of the blob, which is also its last word.
        crc32: u32,
        /// Where the blob comes from, such as a file, at most [`MAX_ORIGIN`]
        /// bytes. A node that has no memory for it ignores it.
        origin: &'a str,
    },
    /// Sends a part of the blob. Chunks come in ascending order without gaps; one
    /// that is already there is acknowledged and not written again. Answered by
    /// [`Reply::Done`].
    Chunk {
        /// Offset from the start of the blob, bytes; a multiple of 4.
        offset: u32,
        /// 1 to [`MAX_CHUNK`] bytes; in all chunks but the last a multiple of 4.
        bytes: &'a [u8],
    },
    /// Checks the whole blob, test vectors included. Answered by [`Reply::Done`].
    Verify,
    /// Verifies once more and seals the slot. The policy then runs after every
    /// power-up, and from the next apex on, or at once when no action is in
    /// force. Answered by [`Reply::Done`].
    Commit,
    /// Goes back to the policy in the other slot, from the next apex on and
    /// after every power-up. Answered by [`Reply::Done`].
    RollBack,
    /// Reads a policy of the node. Answered by [`Reply::Bytes`], which is empty
    /// at the end of the blob; a node need not implement it. Changes nothing.
    Read {
        /// CRC-32 of the blob.
        crc32: u32,
        /// Offset from the start of the blob, bytes.
        offset: u32,
    },
    /// Reads the report of the program around the node, a JSON document.
    /// Offset 0 makes a new one. Answered by [`Reply::Bytes`], which is empty
    /// at its end, or by [`RequestError::Unsupported`]. Changes nothing.
    Report {
        /// Offset from the start of the document, bytes.
        offset: u32,
    },
}

impl Request<'_> {
    /// Returns whether the request changes nothing.
    #[must_use]
    pub fn is_query(&self) -> bool {
        matches!(
            self,
            Self::Identify | Self::Status | Self::Slots | Self::Read { .. } | Self::Report { .. }
        )
    }
}

/// How the control law of a session runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SessionParams {
    /// Ticks a second, Hz.
    pub rate_hz: u32,
    /// Gravity where the leg is, m/s2.
    pub gravity_m_s2: f32,
    /// Age from which on a sample counts for nothing, ns.
    pub stale_limit_ns: u32,
    /// What the law takes for the state.
    pub estimator: Estimator,
}

/// What the control law takes for the state, with the noise of its sensors: standard
/// deviations. [`crate::config::Estimation`] as a message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Estimator {
    /// The readings themselves.
    #[default]
    Readings,
    /// An estimate from noisy readings of the state channels.
    State {
        /// Of both velocities, m/s.
        velocity_m_s: f32,
        /// Of the height, m.
        height_m: f32,
        /// Of the leg length, m.
        leg_length_m: f32,
    },
    /// An estimate from accelerometer, encoders of the leg and contact.
    Inertial {
        /// The figures of [`crate::estimator::SensorNoise`] in their order.
        figures: [f32; 12],
    },
}

/// What makes a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// Nothing does: samples are answered by the safe command. The run before is
    /// forgotten, and its last command is no longer in force.
    #[default]
    Idle,
    /// Each sample is a tick, and time waits for it.
    LockStep,
    /// A timer is the tick, at the rate of the last [`Request::Reset`], and the
    /// newest sample is used.
    Live,
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Idle => "idle",
            Self::LockStep => "lock-step",
            Self::Live => "live",
        })
    }
}

/// The answer to a request.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Reply<'a> {
    /// Answers [`Request::Identify`].
    #[serde(borrow)]
    Identity(Identity<'a>),
    /// The request is carried out.
    Done,
    /// Answers [`Request::Status`].
    Status(Status),
    /// Answers [`Request::Slots`]: A, then B.
    #[serde(borrow)]
    Slots([SlotReport<'a>; 2]),
    /// The request is refused, and nothing has changed.
    Refused(RequestError),
    /// Answers [`Request::Read`] and [`Request::Report`]: at most [`MAX_CHUNK`]
    /// bytes from the offset on.
    Bytes(&'a [u8]),
}

/// The device that runs the node, and its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity<'a> {
    /// [`crate::wire::WIRE_VERSION`].
    pub wire_version: u16,
    /// The board, such as `mps2-an386`; `process` for a process.
    pub board: &'a str,
    /// Version of the firmware or of the program.
    pub firmware: &'a str,
    /// Number of the last [`Request::Reset`]; `None` since power-up.
    pub session: Option<u32>,
    /// What makes a tick.
    pub mode: Mode,
    /// Ticks a second, Hz.
    pub rate_hz: u32,
    /// Gravity, m/s2.
    pub gravity_m_s2: f32,
    /// The policy that runs; `None` when no slot holds a good one.
    #[serde(borrow)]
    pub policy: Option<PolicyReport<'a>>,
}

/// A policy that has passed every check.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PolicyReport<'a> {
    /// Its slot.
    pub slot: Slot,
    /// Its name.
    pub name: &'a str,
    /// CRC-32 of the blob.
    pub crc32: u32,
    /// [`crate::leg::LegModel::fingerprint`] of the leg it was trained on.
    pub leg: u32,
}

/// One of the two places for a policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Slot {
    /// The first slot.
    A,
    /// The second slot.
    B,
}

impl Slot {
    /// Both slots.
    pub const ALL: [Self; 2] = [Self::A, Self::B];

    /// Returns the other slot.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

impl fmt::Display for Slot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::A => "A",
            Self::B => "B",
        })
    }
}

/// The content of a slot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SlotReport<'a> {
    /// A higher number is newer; 0 is a policy that came with the image.
    pub sequence: u32,
    /// Whether the policy of this slot runs now.
    pub running: bool,
    /// Name and CRC-32 of the policy, or why it cannot run.
    #[serde(borrow)]
    pub content: Result<(&'a str, u32), SlotError>,
}

/// A fault of the node, sent without a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Alarm {
    /// After power-up: no slot holds a good policy, so the leg stays in the safe
    /// command.
    NoPolicy {
        /// Why the policy of slot A does not run.
        a: SlotError,
        /// Why the policy of slot B does not run.
        b: SlotError,
    },
    /// The program has crashed; the leg is in its safe state until power-up.
    Crash(Crash),
}

/// How the program has crashed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Crash {
    /// A panic.
    Panic {
        /// Line of its source file.
        line: u32,
    },
    /// A fault of the processor.
    HardFault {
        /// Program counter.
        pc: u32,
    },
}

impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPolicy { a, b } => write!(
                f,
                "no policy to run (slot A: {a}; slot B: {b}); the leg stays in the safe command \
                 until a policy is uploaded"
            ),
            Self::Crash(crash) => write!(
                f,
                "its program has crashed ({crash}); the leg is in its safe state until the board \
                 is powered up again"
            ),
        }
    }
}

impl fmt::Display for Crash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Panic { line } => write!(f, "a panic at line {line}"),
            Self::HardFault { pc } => write!(f, "a fault at {pc:#010x}"),
        }
    }
}

/// A tick of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunTick {
    /// The run.
    pub run_id: u32,
    /// Sequence number of the tick in the run.
    pub seq: u64,
}

/// What a node is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Activity {
    /// No leg is there, or it has sent no sample yet.
    Waiting,
    /// The node answers samples by the safe command.
    Safe,
    /// The node answers samples by its policy.
    Running,
}

/// What the guard has rejected, and how often it gave up, in one run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RejectCounts {
    /// Ticks without a usable sample.
    pub ticks: u32,
    /// Of these, ticks without any sample.
    pub missing: u32,
    /// Of these, ticks that repeated the sample before.
    pub stale: u32,
    /// Times that the safe state was entered.
    pub safe_entered: u32,
}

/// Counters of a run, since the last reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunCounts {
    /// Ticks run.
    pub ticks: u64,
    /// Ticks without a new sample.
    pub missed: u64,
    /// Live mode: samples replaced by a newer one before their tick.
    pub overwritten: u32,
    /// Live mode: ticks that began before the one before had ended.
    pub overruns: u32,
    /// Samples and requests received again, and answered again.
    pub repeated: u32,
    /// Policies swapped in.
    pub swaps: u32,
}

/// The state of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunStatus {
    /// What the node is doing.
    pub activity: Activity,
    /// The last tick with a sample.
    pub last: Option<RunTick>,
    /// Slot of the policy that waits for the next apex.
    pub pending: Option<Slot>,
    /// Counters since the last reset.
    pub counts: RunCounts,
    /// Apexes of this run.
    pub apexes: u32,
    /// What the guard has rejected in this run.
    pub rejected: RejectCounts,
}

/// The state of a node: of its run, and of line and stack since power-up, of
/// which a host takes differences.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// The run.
    pub run: RunStatus,
    /// Frames received, that of this request included.
    pub line: LineCounts,
    /// The device.
    pub device: DeviceCounts,
}

/// Counters that only the device knows, since power-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceCounts {
    /// Commands and replies without room to be sent.
    pub unsent: u32,
    /// Bytes that came too fast to be kept.
    pub lost_bytes: u32,
    /// Greatest depth of the stack, bytes.
    pub stack_used: u32,
    /// Size of the stack, bytes.
    pub stack_size: u32,
}

/// Frames received over a line, counted by the receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LineCounts {
    /// Good frames.
    pub frames: u32,
    /// Frames with a wrong checksum.
    pub crc_errors: u32,
    /// Frames that are too short, or not valid COBS.
    pub malformed: u32,
    /// Frames longer than any message.
    pub oversize: u32,
    /// Frames of another protocol version.
    pub version: u32,
    /// Good frames without a message known here.
    pub unknown: u32,
    /// Good frames that followed a bad one.
    pub resyncs: u32,
}

impl LineCounts {
    /// No frame received.
    pub const ZERO: Self = Self {
        frames: 0,
        crc_errors: 0,
        malformed: 0,
        oversize: 0,
        version: 0,
        unknown: 0,
        resyncs: 0,
    };
}
