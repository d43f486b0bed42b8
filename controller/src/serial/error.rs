//! What can go wrong at a control node, as it goes over the line.

use core::error::Error;
use core::fmt;

use serde::{Deserialize, Serialize};

use crate::policy::ParseError;

/// Why a slot holds no policy that could run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SlotError {
    /// The slot is erased.
    Empty,
    /// An upload was begun and not committed.
    Unfinished,
    /// The slot's seal is damaged.
    BadSeal,
    /// The policy was rolled back.
    RolledBack,
    /// The blob fails a check.
    Blob(BlobError),
}

/// Which check a blob fails: [`crate::policy::ParseError`] without its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BlobError {
    /// The blob is cut off.
    TooShort,
    /// Bytes follow the blob.
    TooLong,
    /// The bytes are not a policy.
    Magic,
    /// The blob has another format version.
    Version(u16),
    /// The blob is damaged.
    Crc,
    /// Its fields cannot be decoded.
    Malformed,
    /// It does not lie at a multiple of 4 bytes.
    Misaligned,
    /// Architecture and weights do not fit.
    Shape,
    /// A value is not finite.
    NonFinite,
    /// A value is out of range.
    OutOfRange,
    /// It has too few test vectors.
    TooFewTestVectors,
    /// The test vector with this index gives another result.
    TestVector(u8),
}

/// Why a request is refused. Nothing has changed then.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum RequestError {
    /// The control rate is out of range.
    Rate {
        /// Lowest rate, Hz.
        least: u32,
        /// Highest rate, Hz.
        most: u32,
    },
    /// Gravity is not finite and above 0.
    Gravity,
    /// The set-point is not finite, or beyond the guard's limit.
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
    /// The policy committed last waits for the next apex.
    SwapPending,
    /// The processor stalls while it erases its flash, and the mode is live.
    EraseWouldStall,
    /// No upload was begun.
    NotBegun,
    /// A chunk is out of order, or of a forbidden size.
    Offset {
        /// The offset expected next.
        expected: u32,
    },
    /// Part of the blob is missing.
    Incomplete {
        /// Bytes received.
        received: u32,
        /// Bytes announced.
        length: u32,
    },
    /// The blob received is not the one announced.
    WrongBlob {
        /// The checksum of the blob received.
        crc32: u32,
    },
    /// The blob fails a check.
    Blob(BlobError),
    /// The other slot holds no policy to go back to.
    NothingToRollBackTo(SlotError),
    /// The flash, or the memory in its place, does not keep what is written.
    Flash,
    /// The run belongs to the program around the node (a bridge, or the
    /// controller process), which alone resets it and sets its mode.
    InSession,
    /// This node does not implement the request.
    Unsupported,
    /// No policy of this node has that checksum, or it has no such byte.
    NotFound,
    /// The node has not taken the changes requested before.
    Busy,
    /// The stale limit is out of range.
    StaleLimit {
        /// Shortest, ns.
        least_ns: u32,
        /// Longest, ns.
        most_ns: u32,
    },
    /// A deviation of the noise is out of range.
    Noise,
    /// The node was built without the estimator.
    NoEstimator,
}

impl fmt::Display for SlotError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => f.write_str("empty"),
            Self::Unfinished => f.write_str("an upload was begun and not committed"),
            Self::BadSeal => f.write_str("its seal is damaged"),
            Self::RolledBack => f.write_str("rolled back"),
            Self::Blob(error) => error.fmt(f),
        }
    }
}

impl fmt::Display for BlobError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TooShort => "the blob is cut off",
            Self::TooLong => "bytes follow the blob",
            Self::Magic => "the bytes are not a policy blob",
            Self::Version(version) => {
                return write!(
                    f,
                    "the blob has format version {version}; write it with the trainer of the \
                     controller's release"
                );
            }
            Self::Crc => "the blob is damaged",
            Self::Malformed => "the blob's fields cannot be decoded",
            Self::Misaligned => "the blob does not lie at a multiple of 4 bytes",
            Self::Shape => {
                "architecture and weights do not fit, or it is wider than this controller allows"
            }
            Self::NonFinite => "a value is not finite",
            Self::OutOfRange => "a value is out of range",
            Self::TooFewTestVectors => "it has too few test vectors",
            Self::TestVector(index) => {
                return write!(
                    f,
                    "test vector {index} gives another result here: the arithmetic is not that of \
                     the trainer"
                );
            }
        })
    }
}

impl fmt::Display for RequestError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Rate { least, most } => {
                write!(f, "the control rate must be from {least} to {most} Hz")
            }
            Self::Gravity => f.write_str("gravity must be finite and above 0"),
            Self::SetPoint { most_m_s } => {
                write!(f, "a set-point must be from {} to {most_m_s} m/s", -most_m_s)
            }
            Self::NoPolicy => f.write_str("it has no policy to run"),
            Self::TooLong { room } => {
                write!(f, "a slot has room for {room} bytes; train a smaller actor")
            }
            Self::SwapPending => f.write_str(
                "the policy committed last waits for the leg's next apex; try again after it",
            ),
            Self::EraseWouldStall => f.write_str(
                "this board stalls while it erases flash, and in live mode the leg would fall; \
                 upload while no run is on, or in lock-step",
            ),
            Self::NotBegun => {
                f.write_str("no upload is under way (was the board reset?); begin the upload again")
            }
            Self::Offset { expected } => write!(
                f,
                "the next byte expected is {expected} (is another program uploading?); begin the \
                 upload again"
            ),
            Self::Incomplete { received, length } => {
                write!(f, "only {received} of {length} bytes have arrived; begin the upload again")
            }
            Self::WrongBlob { crc32 } => write!(
                f,
                "the blob received has checksum {crc32:08x}, which is not the one announced; \
                 begin the upload again"
            ),
            Self::Blob(error) => write!(f, "the blob received is not a policy to run: {error}"),
            Self::NothingToRollBackTo(error) => {
                write!(f, "the other slot has nothing to go back to: {error}")
            }
            Self::Flash => f.write_str(
                "its flash does not keep what is written; try again, and if it fails again, the \
                 flash is worn out",
            ),
            Self::InSession => f.write_str(
                "the run belongs to the program that was started for it, a bridge or the \
                 controller process, and it alone resets the controller and sets its mode; end \
                 that program first",
            ),
            Self::Unsupported => f.write_str("this controller does not implement the request"),
            Self::NotFound => f.write_str("it has no policy with that checksum any more"),
            Self::Busy => f.write_str(
                "earlier changes still wait for the control loop, which is not ticking; try again \
                 when the leg goes on",
            ),
            Self::StaleLimit { least_ns, most_ns } => {
                write!(f, "a stale limit must be from {least_ns} to {most_ns} ns")
            }
            Self::Noise => {
                f.write_str("each standard deviation of the noise must be from 1e-4 to 1e3")
            }
            Self::NoEstimator => f.write_str(
                "it was built without a state estimator; flash firmware built with the feature \
                 `estimator`, or run by the readings",
            ),
        }
    }
}

impl Error for SlotError {}
impl Error for BlobError {}
impl Error for RequestError {}

impl From<ParseError> for BlobError {
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
