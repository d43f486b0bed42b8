//! Why a blob is refused, or cannot be written.

use super::{FIRST_FORMAT_VERSION, FORMAT_VERSION, MAX_TEST_VECTORS, MIN_TEST_VECTORS};
use crate::actor::{Action, ShapeError};
use core::fmt;

/// Why bytes are not a policy that can be run.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum ParseError {
    /// Fewer bytes than the blob's length field states, or than its preamble.
    TooShort {
        /// Bytes needed.
        expected: usize,
        /// Bytes given.
        found: usize,
    },
    /// More bytes than the blob's length field states.
    TooLong {
        /// Bytes of the blob.
        expected: usize,
        /// Bytes given.
        found: usize,
    },
    /// It does not start with [`super::MAGIC`].
    Magic([u8; 8]),
    /// Another format version.
    Version(u16),
    /// The checksum does not match the bytes.
    Crc {
        /// Stored in the blob.
        stored: u32,
        /// Of the bytes.
        computed: u32,
    },
    /// The fields cannot be decoded although the checksum matches.
    Malformed,
    /// The weights are not at a multiple of 4 bytes in memory.
    Misaligned,
    /// Architecture and weights do not belong together.
    Shape(ShapeError),
    /// The byte string of weights is not a whole number of floats.
    WeightBytes(usize),
    /// A value of the field is not finite.
    NonFinite(Field),
    /// A value of the field is out of range.
    OutOfRange(Field),
    /// Fewer test vectors than a blob must carry.
    TestVectors(usize),
    /// The action of a test vector is computed differently here.
    TestVector {
        /// Which, from 0.
        index: usize,
        /// The action in the blob.
        expected: Action,
        /// The action computed here.
        found: Action,
    },
}

/// The field of a blob that an error is about. Not a text: a target, which prints nothing,
/// would carry it in flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Field {
    /// From an observation to the network's inputs.
    Observation,
    /// From the network's outputs to an action.
    Action,
    /// Ranges of media.
    Media,
    /// The network.
    Weights,
    /// Observations and actions to compare with.
    TestVectors,
    /// Lowest and highest angle.
    AngleClip,
    /// Lowest and highest elongation speed.
    SpeedClip,
    /// Lowest and highest density ratio of the media.
    DensityRatio,
    /// Lowest and highest gravity of the media.
    Gravity,
    /// The leg it was trained on.
    Leg,
    /// The cascade's gain schedule.
    Gains,
}

impl Field {
    /// Returns the name of the field and the range of its values.
    const fn named(self) -> (&'static str, &'static str) {
        match self {
            Self::Observation => ("observation scaling", "finite"),
            Self::Action => ("action scaling", "finite"),
            Self::Media => ("media", "finite"),
            Self::Weights => ("weights", "finite"),
            Self::TestVectors => ("test vectors", "finite"),
            Self::AngleClip => ("clip of the angle", "low to high, within 0 to pi rad"),
            Self::SpeedClip => ("clip of the elongation speed", "low to high, within 0 to 100 m/s"),
            Self::DensityRatio => ("media: density ratio", "low to high, within 0 to 100"),
            Self::Gravity => ("media: gravity", "low to high, above 0, at most 1000 m/s2"),
            Self::Leg => {
                ("leg", "each parameter from 0 to 1e9, mass, volume and rest length above 0")
            }
            Self::Gains => (
                "cascade gains",
                "at least one point, by ascending density, gains within +-1000, \
                 limits from 0 to 100 m/s",
            ),
        }
    }
}

impl From<ShapeError> for ParseError {
    fn from(error: ShapeError) -> Self {
        Self::Shape(error)
    }
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooShort { expected, found } => write!(
                f,
                "{found} bytes, but the policy has at least {expected}: \
                 it was cut off; copy it again"
            ),
            Self::TooLong { expected, found } => {
                write!(f, "{found} bytes, but the policy has {expected}: remove what follows it")
            }
            Self::Magic(_) => {
                write!(f, "it does not start with \"LEGACTOR\": this is another kind of file")
            }
            Self::Version(v) => write!(
                f,
                "format version {v}, this build reads {FIRST_FORMAT_VERSION} to {FORMAT_VERSION}: \
                 export the policy again"
            ),
            Self::Crc { stored, computed } => write!(
                f,
                "CRC-32 {computed:08x}, stored is {stored:08x}: it was damaged; copy it again"
            ),
            Self::Malformed => write!(f, "the fields cannot be decoded: export the policy again"),
            Self::Misaligned => write!(
                f,
                "it does not lie on a multiple of 4 bytes: load it into an aligned buffer"
            ),
            Self::Shape(e) => write!(f, "{e}: export the policy again"),
            Self::WeightBytes(n) => {
                write!(f, "{n} bytes of weights are not a whole number of 4-byte floats")
            }
            Self::NonFinite(field) => {
                let (name, _) = field.named();
                write!(f, "{name} holds a value that is not finite: train or export it again")
            }
            Self::OutOfRange(field) => {
                let (name, range) = field.named();
                write!(
                    f,
                    "{name} ({range}) is out of range: correct it and export the policy again"
                )
            }
            Self::TestVectors(n) => {
                write!(f, "{n} test vectors, needed are {MIN_TEST_VECTORS} to {MAX_TEST_VECTORS}")
            }
            Self::TestVector { index, expected, found } => write!(
                f,
                "test vector {index} gives angle {} rad, elongation speed {} m/s here, \
                 but {} and {} where it was made: this build computes differently; do not run it",
                found.touchdown_angle_rad,
                found.elongation_speed_m_s,
                expected.touchdown_angle_rad,
                expected.elongation_speed_m_s
            ),
        }
    }
}

impl core::error::Error for ParseError {}

/// Why a blob cannot be written.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum WriteError {
    /// The buffer is smaller than the blob.
    BufferTooSmall(usize),
    /// What was written would be refused when read back.
    Invalid(ParseError),
}

impl fmt::Display for WriteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BufferTooSmall(n) => write!(f, "the policy does not fit a buffer of {n} bytes"),
            Self::Invalid(e) => write!(f, "the policy cannot be written: {e}"),
        }
    }
}

impl core::error::Error for WriteError {}
