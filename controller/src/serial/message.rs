//! What a host and a flashed controller say to each other.
//!
//! Encoded by postcard, carried by [`super::frame`]. Fields and variants are
//! encoded in their order here: change none without raising
//! [`super::PROTOCOL_VERSION`].
//!
//! Two exchanges run side by side, and neither waits for the other. Samples are
//! answered by commands with the same `turn`; requests by replies with the same
//! `id`. A number that is the last one handled again asks for the last answer
//! again, and nothing is done twice: so a host that hears nothing says it once
//! more, with the same number, as often as it takes. A request that changes
//! nothing ([`Request::is_query`]) is answered afresh whatever its number, so a
//! host that does not know the last one begins with [`Request::Identify`].

use serde::{Deserialize, Serialize};

use crate::policy::ParseError;
use crate::wire::{Command, Sample};

/// Most bytes of a blob in one [`Request::Chunk`].
pub const MAX_CHUNK: usize = 192;

/// Most bytes of a name in any message; longer ones are cut ([`cut`]).
pub const MAX_NAME: usize = 48;

/// The beginning of a name, as much as goes into a message.
#[must_use]
#[inline(never)]
pub fn cut(name: &str) -> &str {
    if name.len() <= MAX_NAME {
        return name;
    }
    // A character is at most 4 bytes long.
    (0..4).find_map(|back| name.get(..MAX_NAME - back)).unwrap_or_default()
}

/// From the host to the controller.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToController<'a> {
    /// What the leg feels. In lock-step it is a tick; live, the newest one is
    /// taken at the next tick.
    Sample {
        /// Number of this sample on the line: any but that of the last one.
        turn: u32,
        /// The sample.
        sample: Sample,
    },
    /// Anything else.
    Request {
        /// Number of this request: any but that of the last one.
        id: u32,
        /// What is asked for.
        #[serde(borrow)]
        request: Request<'a>,
    },
}

/// From the controller to the host.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToHost<'a> {
    /// What the leg is to do.
    Command {
        /// Number of the sample that it answers.
        turn: u32,
        /// The command.
        command: Command,
    },
    /// The answer to a request.
    Reply {
        /// Number of the request.
        id: u32,
        /// What came of it.
        #[serde(borrow)]
        reply: Reply<'a>,
    },
    /// Said unasked: something is wrong here.
    Alarm(Alarm),
}

/// What a host can ask for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request<'a> {
    /// Who is there? Answered by [`Reply::Identity`]. Changes nothing.
    Identify,
    /// Forget the run, and begin another under these terms: idle until a mode
    /// is set, the statistics at 0. Answered by [`Reply::Done`].
    Reset {
        /// Any number; [`Identity::session`] until the next reset or power-up,
        /// so that a host which reconnects knows whether it is expected.
        session: u32,
        /// Ticks a second, Hz.
        rate_hz: u32,
        /// Gravity where the leg is, m/s2.
        gravity_m_s2: f32,
    },
    /// How ticks come about from now on. Answered by [`Reply::Done`].
    SetMode(Mode),
    /// The speed to keep, m/s, in place of that of the samples; `None` gives
    /// way to theirs again. Answered by [`Reply::Done`].
    SetPoint(Option<f32>),
    /// Counters and figures. Answered by [`Reply::Statistics`].
    Statistics,
    /// What lies in the two slots. Answered by [`Reply::Slots`].
    Slots,
    /// Make room in the idle slot for a blob. Answered by [`Reply::Done`].
    Begin {
        /// Bytes of the blob.
        length: u32,
        /// Its CRC-32, as the blob itself says it at its end.
        crc32: u32,
    },
    /// A part of the blob. In ascending order without gaps; a chunk already
    /// there is acknowledged and not written again. Answered by [`Reply::Done`].
    Chunk {
        /// Where it belongs, bytes from the blob's start; a multiple of 4.
        offset: u32,
        /// 1 to [`MAX_CHUNK`] bytes; all but the last a multiple of 4.
        bytes: &'a [u8],
    },
    /// Check the whole blob, test vectors included. Answered by [`Reply::Done`].
    Verify,
    /// Verify once more, then seal the slot: it is the one to run, after a
    /// power-up too, and is swapped in at the next apex, or at once when no
    /// action is in force. Answered by [`Reply::Done`].
    Commit,
    /// Go back to the policy in the other slot, at the next apex and after a
    /// power-up. Answered by [`Reply::Done`].
    RollBack,
}

impl Request<'_> {
    /// Whether it only asks, and changes nothing.
    #[must_use]
    pub fn is_query(&self) -> bool {
        matches!(self, Self::Identify | Self::Statistics | Self::Slots)
    }
}

/// How ticks come about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// They do not: samples are answered by the safe command. The run before
    /// is forgotten, its last command not in force any more.
    #[default]
    Idle,
    /// Each sample is a tick; time waits for it.
    LockStep,
    /// The board's timer is the tick, at the rate of the last
    /// [`Request::Reset`]; the newest sample counts.
    Live,
}

/// The answer to a request.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Reply<'a> {
    /// To [`Request::Identify`].
    #[serde(borrow)]
    Identity(Identity<'a>),
    /// It is done.
    Done,
    /// To [`Request::Statistics`].
    Statistics(Statistics),
    /// To [`Request::Slots`]: A, then B.
    #[serde(borrow)]
    Slots([SlotReport<'a>; 2]),
    /// It is not done, and nothing has changed.
    Refused(Refusal),
}

/// Who answers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity<'a> {
    /// [`crate::wire::WIRE_VERSION`].
    pub wire_version: u16,
    /// The board, such as `mps2-an386`.
    pub board: &'a str,
    /// Version of the firmware.
    pub firmware: &'a str,
    /// Of the last [`Request::Reset`]; none since power-up.
    pub session: Option<u32>,
    /// How ticks come about.
    pub mode: Mode,
    /// Ticks a second, Hz.
    pub rate_hz: u32,
    /// Gravity, m/s2.
    pub gravity_m_s2: f32,
    /// The policy that runs; none when no slot holds a good one.
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
    /// The blob's checksum.
    pub crc32: u32,
    /// The leg it was trained on, by [`crate::leg::LegModel::fingerprint`].
    pub leg: u32,
}

/// One of the two places for a policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Slot {
    /// The first.
    A,
    /// The second.
    B,
}

/// What lies in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SlotReport<'a> {
    /// Higher is newer; 0 is as it came with the flash image.
    pub sequence: u32,
    /// Whether it runs now.
    pub running: bool,
    /// Name and checksum, or why it cannot run.
    #[serde(borrow)]
    pub content: Result<(&'a str, u32), SlotFault>,
}

/// Why a slot holds nothing to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SlotFault {
    /// Erased.
    Empty,
    /// An upload was begun and not committed.
    Unfinished,
    /// Its seal does not hold.
    BadSeal,
    /// It was rolled back.
    RolledBack,
    /// The blob fails a check.
    Blob(BlobFault),
}

/// Which check a blob fails: [`crate::policy::ParseError`] without its figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BlobFault {
    /// Cut off.
    TooShort,
    /// Something follows it.
    TooLong,
    /// Not a policy at all.
    Magic,
    /// Another format version.
    Version(u16),
    /// Damaged.
    Crc,
    /// Fields that cannot be decoded.
    Malformed,
    /// Not at a multiple of 4 bytes.
    Misaligned,
    /// Architecture and weights do not fit.
    Shape,
    /// A figure is not finite.
    NonFinite,
    /// A figure is out of range.
    OutOfRange,
    /// Too few test vectors.
    TooFewTestVectors,
    /// This test vector comes out otherwise.
    TestVector(u8),
}

/// Why a request is refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Refusal {
    /// A control rate out of range: least and most, Hz.
    Rate {
        /// Lowest, Hz.
        least: u32,
        /// Highest, Hz.
        most: u32,
    },
    /// A gravity that is not finite and above 0.
    Gravity,
    /// A set-point that is not finite or beyond the guard's limit, m/s.
    SetPoint {
        /// Greatest magnitude, m/s.
        most_m_s: f32,
    },
    /// No slot holds a policy that could run.
    NoPolicy,
    /// The blob does not fit a slot.
    TooLong {
        /// Bytes that a slot has for a blob.
        room: u32,
    },
    /// The last policy committed is not yet swapped in: the next apex does it.
    SwapPending,
    /// This board stands still while it erases its flash: set the mode to idle first.
    EraseWouldStall,
    /// No upload was begun.
    NotBegun,
    /// A chunk out of order, or of a forbidden size.
    Offset {
        /// The offset expected next.
        expected: u32,
    },
    /// Not all of the blob is there yet.
    Incomplete {
        /// Bytes that are there.
        received: u32,
        /// Bytes announced.
        length: u32,
    },
    /// The blob is not the one announced.
    WrongBlob {
        /// The checksum that was found.
        crc32: u32,
    },
    /// The blob fails a check.
    Blob(BlobFault),
    /// The other slot holds nothing to go back to.
    NothingToRollBackTo(SlotFault),
    /// The flash did not take what was written.
    Flash,
    /// Said by a bridge that shares its line: a run is on, and the bridge alone
    /// resets the controller and sets its mode.
    InSession,
}

/// Said unasked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Alarm {
    /// After power-up: no slot holds a good policy; the leg stays in the safe command.
    NoPolicy {
        /// Why not slot A.
        a: SlotFault,
        /// Why not slot B.
        b: SlotFault,
    },
    /// The program broke off; the leg is in its safe state until power-up.
    Crash(Crash),
}

/// How the program broke off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Crash {
    /// A panic, at this line of some file.
    Panic {
        /// The line.
        line: u32,
    },
    /// A fault of the processor.
    HardFault {
        /// Where, the program counter.
        pc: u32,
    },
}

/// Counters and figures: of the run since the last reset, of the line and the
/// stack since power-up (a host takes differences).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Statistics {
    /// What came over the line, this request included.
    pub line: LineCounts,
    /// Ticks run.
    pub ticks: u32,
    /// Live: ticks that no new sample had come for.
    pub missed: u32,
    /// Live: samples replaced by a newer one before their tick.
    pub overwritten: u32,
    /// Live: ticks that began when the one before was not done.
    pub overruns: u32,
    /// Samples and requests said again, answered again.
    pub repeated: u32,
    /// Policies swapped in.
    pub swaps: u32,
    /// Line: commands or replies that found no room to be sent.
    pub unsent: u32,
    /// Line: bytes that came too fast to be kept.
    pub lost_bytes: u32,
    /// Deepest stack, bytes.
    pub stack_used: u32,
    /// Room for the stack, bytes.
    pub stack_size: u32,
}

/// What came over a line, counted at its end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LineCounts {
    /// Good frames.
    pub frames: u32,
    /// Frames whose checksum does not match.
    pub crc_errors: u32,
    /// Frames that are no frame: too short, or not as COBS has it.
    pub malformed: u32,
    /// Frames longer than any message.
    pub oversize: u32,
    /// Frames of another protocol version.
    pub version: u32,
    /// Good frames that hold no message known here.
    pub unknown: u32,
    /// Times that a good frame came after one or more bad ones.
    pub resyncs: u32,
}

impl LineCounts {
    /// Nothing came yet.
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

impl Slot {
    /// Both.
    pub const ALL: [Self; 2] = [Self::A, Self::B];

    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

impl From<ParseError> for BlobFault {
    fn from(error: ParseError) -> Self {
        match error {
            ParseError::TooShort { .. } => Self::TooShort,
            ParseError::TooLong { .. } => Self::TooLong,
            ParseError::Magic(_) => Self::Magic,
            ParseError::Version(version) => Self::Version(version),
            ParseError::Crc { .. } => Self::Crc,
            ParseError::Malformed => Self::Malformed,
            ParseError::Misaligned => Self::Misaligned,
            ParseError::Shape(_) | ParseError::WeightBytes(_) => Self::Shape,
            ParseError::NonFinite(_) => Self::NonFinite,
            ParseError::OutOfRange(_) => Self::OutOfRange,
            ParseError::TestVectors(_) => Self::TooFewTestVectors,
            // There are at most 16.
            ParseError::TestVector { index, .. } => Self::TestVector(index as u8),
        }
    }
}
