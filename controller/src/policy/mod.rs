//! The policy blob: a frozen actor with everything needed to check and run it.
//!
//! # Format, versions 1 and 2
//! One postcard message, of these fields in this order:
//!
//! | field | encoding | meaning |
//! |---|---|---|
//! | magic | 8 bytes | `LEGACTOR` |
//! | format version | u16, fixed, little-endian | 1 or 2 |
//! | length | u32, fixed, little-endian | of the whole blob, bytes |
//! | [`Manifest`] | postcard | name, widths, scalings, leg, media, provenance, cascade gains |
//! | [`Activations`] | postcard, in version 2 alone | functions between the layers and at the end; in version 1 ReLU and tanh |
//! | test vectors | postcard, 8 to 16 | [`TestVector`]: an observation and its action |
//! | padding | byte string of 0 to 3 zeros | puts the weights on a multiple of 4 |
//! | weights | byte string | f32, little-endian, packed by [`crate::actor::pack`], layer after layer |
//! | CRC-32 | u32, fixed, little-endian | ISO HDLC, over all bytes before it |
//!
//! The blob must lie at a 4-byte aligned address ([`Aligned`] and
//! [`include_policy!`](crate::include_policy) ensure that); weights are then
//! read in place. A blob is refused whole, with a [`ParseError`], unless every check
//! passes. The last check computes the action of every test vector with the kernel that
//! will run it, and compares all bits.

mod aligned;
mod error;
mod parse;
mod read;
mod write;

use crate::actor::{Action, ActionScaling, Activations, Observation, ObservationScaling, Widths};
use crate::leg::LegModel;
use heapless::Vec;
use serde::{Deserialize, Serialize};

pub use aligned::Aligned;
pub use error::{Field, ParseError, WriteError};
pub use parse::{Policy, stated_length};
pub use write::write;

/// The first eight bytes of a blob.
pub const MAGIC: [u8; 8] = *b"LEGACTOR";
/// The newest format described above, of a network with other functions than ReLU and tanh.
pub const FORMAT_VERSION: u16 = 2;
/// The oldest format, in which every network with ReLU and tanh is still written, so that
/// earlier controllers run it.
pub const FIRST_FORMAT_VERSION: u16 = 1;
/// Fewest test vectors in a blob.
pub const MIN_TEST_VECTORS: usize = 8;
/// Most test vectors in a blob.
pub const MAX_TEST_VECTORS: usize = 16;
/// Most points in a gain schedule.
pub const MAX_GAIN_POINTS: usize = 16;

/// The policy that comes with the crate: the trainer's preset `robust`, made by
/// the command in `controller/policies/README.md`.
pub const SHIPPED: &[u8] = crate::include_policy!("../../policies/robust.bin");

/// Bytes before the manifest: magic, format version, length.
pub const PREAMBLE_LEN: usize = 8 + 2 + 4;
/// Bytes of the checksum at the end.
const CRC_LEN: usize = 4;

/// Everything in a blob but the weights and the test vectors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest<'a> {
    /// What to call the policy.
    pub name: &'a str,
    /// Widths from the inputs to the outputs.
    pub widths: Widths,
    /// Functions between the layers and at the end; behind the manifest in the blob.
    #[serde(skip)]
    pub activations: Activations,
    /// From an observation to the network's inputs.
    pub observation: ObservationScaling,
    /// From the network's outputs to an action.
    pub action: ActionScaling,
    /// The leg it was trained on.
    pub leg: LegModel,
    /// The media it was trained in.
    pub media: Media,
    /// Where it comes from.
    #[serde(borrow)]
    pub provenance: Provenance<'a>,
    /// Recommended cascade gains, by ascending density.
    pub gains: GainSchedule,
}

impl Manifest<'_> {
    /// Returns the version of the format in which a blob with this manifest is written.
    #[must_use]
    pub fn format_version(&self) -> u16 {
        let is_first = self.activations == Activations::default();
        if is_first { FIRST_FORMAT_VERSION } else { FORMAT_VERSION }
    }
}

/// Points of a gain schedule, by ascending density.
pub type GainSchedule = Vec<GainPoint, MAX_GAIN_POINTS>;

/// Ranges of media, lowest and highest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Media {
    /// Fluid density over that of water.
    pub density_ratio: [f32; 2],
    /// Gravity, m/s2.
    pub gravity_m_s2: [f32; 2],
}

/// How a policy was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance<'a> {
    /// The trainer's preset, or where it was imported from.
    pub preset: &'a str,
    /// Seed of everything random in the training.
    pub seed: u64,
    /// Environment steps trained.
    pub steps: u64,
    /// Version of the trainer.
    pub trainer_version: &'a str,
    /// All hyperparameters, TOML (the plant's tolerance among them).
    pub config: &'a str,
}

/// Gains of the velocity cascade at one density; see [`crate::velocity`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GainPoint {
    /// Fluid density over that of water at which these hold.
    pub density_ratio: f32,
    /// Proportional gain, dimensionless (m/s of offset per m/s of error).
    pub kp: f32,
    /// Integral gain per apex, dimensionless.
    pub ki: f32,
    /// Derivative gain per apex, dimensionless.
    pub kd: f32,
    /// Feed-forward of the set-point, dimensionless.
    pub feed_forward: f32,
    /// Bound of the offset's magnitude, m/s.
    pub limit_m_s: f32,
}

/// An observation and the action that must come of it, bit for bit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TestVector {
    /// Input.
    pub observation: Observation,
    /// Output.
    pub action: Action,
}

/// Test vectors of a blob.
type TestVectors = Vec<TestVector, MAX_TEST_VECTORS>;

/// The whole message, borrowed from the blob; `A` is nothing in version 1, and
/// [`Activations`] in version 2.
#[derive(Serialize, Deserialize)]
struct Blob<'a, A> {
    magic: [u8; 8],
    #[serde(with = "postcard::fixint::le")]
    format_version: u16,
    #[serde(with = "postcard::fixint::le")]
    length: u32,
    #[serde(borrow)]
    manifest: Manifest<'a>,
    activations: A,
    test_vectors: TestVectors,
    padding: &'a [u8],
    weights: &'a [u8],
    #[serde(with = "postcard::fixint::le")]
    crc32: u32,
}

#[cfg(test)]
pub(crate) mod fixture;
#[cfg(test)]
mod tests;
