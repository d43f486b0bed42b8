//! Reads a blob and checks it.

use super::{
    CRC_LEN, FIRST_FORMAT_VERSION, FORMAT_VERSION, Field, MAGIC, MIN_TEST_VECTORS, Manifest,
    PREAMBLE_LEN, ParseError, TestVector, TestVectors, read,
};
use crate::actor::Actor;
use crate::checksum::crc32;
use crate::leg::all_within;

// Far beyond any leg; within them no value of a command can overflow.
const MAX_SPEED_M_S: f32 = 100.0;
const MAX_DENSITY_RATIO: f32 = 100.0;
const MAX_GRAVITY_M_S2: f32 = 1000.0;
const MAX_GAIN: f32 = 1000.0;

/// A checked policy over the bytes of its blob. There is no other way to make one.
#[derive(Clone, Debug)]
pub struct Policy<'a> {
    manifest: Manifest<'a>,
    actor: Actor<'a>,
    crc32: u32,
}

impl<'a> Policy<'a> {
    /// Checks a blob and reads it in place.
    ///
    /// # Errors
    /// [`ParseError`] for bytes that are no valid blob, or that are not aligned to 4 bytes.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, ParseError> {
        let mut vectors = TestVectors::new();
        // Checked where it is returned, not moved out and in: a copy would take
        // as much of a target's stack again.
        let mut policy = Self::read(bytes, &mut vectors);
        if let Ok(read) = &policy
            && let Err(error) = read.check(&vectors)
        {
            policy = Err(error);
        }
        policy
    }

    /// Reads a blob whose checksum holds. Apart, so that its stack is free
    /// again when the test vectors are run.
    #[inline(never)]
    fn read(bytes: &'a [u8], vectors: &mut TestVectors) -> Result<Self, ParseError> {
        let (version, crc32) = check_frame(bytes)?;
        let fields = bytes.get(PREAMBLE_LEN..).unwrap_or_default();
        let (manifest, weights) =
            read::fields(fields, version, vectors).map_err(|_| ParseError::Malformed)?;
        if !weights.len().is_multiple_of(4) {
            return Err(ParseError::WeightBytes(weights.len()));
        }
        let weights = bytemuck::try_cast_slice(weights).map_err(|_| ParseError::Misaligned)?;
        let Manifest { activations, observation, action, .. } = manifest;
        let actor = Actor::new(manifest.widths.clone(), activations, observation, action, weights)?;
        Ok(Self { manifest, actor, crc32 })
    }

    fn check(&self, vectors: &TestVectors) -> Result<(), ParseError> {
        check_values(&self.manifest, self.actor.weights(), vectors)?;
        check_test_vectors(&self.actor, vectors)
    }

    /// Returns everything in the blob but weights and test vectors.
    #[must_use]
    pub fn manifest(&self) -> &Manifest<'a> {
        &self.manifest
    }

    /// Returns the frozen actor.
    #[must_use]
    pub fn actor(&self) -> &Actor<'a> {
        &self.actor
    }

    /// Returns the checksum of the blob, which serves as its short identity.
    #[must_use]
    pub fn crc32(&self) -> u32 {
        self.crc32
    }
}

/// Returns the length of a blob from its preamble, bytes; none unless the bytes start as a
/// blob of this format. For a slot of flash, where other bytes follow: [`Policy::parse`]
/// takes the blob and nothing more.
#[must_use]
pub fn stated_length(bytes: &[u8]) -> Option<usize> {
    let (magic, rest) = bytes.split_first_chunk::<8>()?;
    let (version, rest) = rest.split_first_chunk::<2>()?;
    let length = rest.first_chunk::<4>()?;
    let known = *magic == MAGIC && is_known(u16::from_le_bytes(*version));
    known.then(|| u32::from_le_bytes(*length) as usize)
}

fn is_known(version: u16) -> bool {
    (FIRST_FORMAT_VERSION..=FORMAT_VERSION).contains(&version)
}

/// Checks magic, version, length and checksum, before any field is decoded; returns version
/// and checksum.
fn check_frame(bytes: &[u8]) -> Result<(u16, u32), ParseError> {
    let found = bytes.len();
    let too_short = ParseError::TooShort { expected: PREAMBLE_LEN + CRC_LEN, found };
    let (magic, rest) = bytes.split_first_chunk::<8>().ok_or(too_short)?;
    if *magic != MAGIC {
        return Err(ParseError::Magic(*magic));
    }
    let (version, rest) = rest.split_first_chunk::<2>().ok_or(too_short)?;
    let version = u16::from_le_bytes(*version);
    if !is_known(version) {
        return Err(ParseError::Version(version));
    }
    let length = rest.first_chunk::<4>().ok_or(too_short)?;
    let expected = u32::from_le_bytes(*length) as usize;
    if found < expected.max(PREAMBLE_LEN + CRC_LEN) {
        return Err(ParseError::TooShort { expected, found });
    }
    if found > expected {
        return Err(ParseError::TooLong { expected, found });
    }
    let (body, stored) = bytes.split_last_chunk::<CRC_LEN>().ok_or(too_short)?;
    let stored = u32::from_le_bytes(*stored);
    let computed = crc32(body);
    if stored != computed {
        return Err(ParseError::Crc { stored, computed });
    }
    Ok((version, stored))
}

/// Finite, and where the control law relies on it, in range. Apart, so that its
/// stack is free again when the test vectors are run.
#[inline(never)]
fn check_values(
    manifest: &Manifest<'_>,
    weights: &[f32],
    vectors: &[TestVector],
) -> Result<(), ParseError> {
    let (o, a, m) = (&manifest.observation, &manifest.action, &manifest.media);
    let finite: [(Field, &[&[f32]]); 4] = [
        (Field::Observation, &[&o.offset, &o.scale]),
        (Field::Action, &[&a.offset, &a.scale, &a.low, &a.high]),
        (Field::Media, &[&m.density_ratio, &m.gravity_m_s2]),
        (Field::Weights, &[weights]),
    ];
    for (field, values) in finite {
        if !values.iter().all(|values| all_finite(values)) {
            return Err(ParseError::NonFinite(field));
        }
    }
    let vector_is_finite = |v: &TestVector| {
        let (o, a) = (&v.observation, &v.action);
        let observation = [o.apex_vx_m_s, o.apex_y_m, o.density_ratio];
        all_finite(&observation) && all_finite(&[a.touchdown_angle_rad, a.elongation_speed_m_s])
    };
    if !vectors.iter().all(vector_is_finite) {
        return Err(ParseError::NonFinite(Field::TestVectors));
    }
    // Low and high of the policy, least and most of what they may be.
    let ranges = [
        (Field::AngleClip, [a.low[0], a.high[0]], 0.0, core::f32::consts::PI),
        (Field::SpeedClip, [a.low[1], a.high[1]], 0.0, MAX_SPEED_M_S),
        (Field::DensityRatio, m.density_ratio, 0.0, MAX_DENSITY_RATIO),
        (Field::Gravity, m.gravity_m_s2, f32::MIN_POSITIVE, MAX_GRAVITY_M_S2),
    ];
    for (field, [low, high], least, most) in ranges {
        if !(low <= high && all_within(&[low, high], least, most)) {
            return Err(ParseError::OutOfRange(field));
        }
    }
    if !manifest.leg.is_physical() {
        return Err(ParseError::OutOfRange(Field::Leg));
    }
    check_gains(manifest)
}

/// Returns whether no value is infinite or NaN. Not inlined, to save flash.
#[inline(never)]
fn all_finite(values: &[f32]) -> bool {
    values.iter().all(|x| x.is_finite())
}

fn check_gains(manifest: &Manifest<'_>) -> Result<(), ParseError> {
    let gains = &manifest.gains;
    let finite = |p: &super::GainPoint| {
        all_finite(&[p.density_ratio, p.kp, p.ki, p.kd, p.feed_forward, p.limit_m_s])
    };
    if !gains.iter().all(finite) {
        return Err(ParseError::NonFinite(Field::Gains));
    }
    let ascending =
        gains.iter().zip(gains.iter().skip(1)).all(|(a, b)| a.density_ratio < b.density_ratio);
    let in_range = |p: &super::GainPoint| {
        all_within(&[p.kp, p.ki, p.kd, p.feed_forward], -MAX_GAIN, MAX_GAIN)
            && all_within(&[p.limit_m_s], 0.0, MAX_SPEED_M_S)
    };
    if gains.is_empty() || !ascending || !gains.iter().all(in_range) {
        return Err(ParseError::OutOfRange(Field::Gains));
    }
    Ok(())
}

fn check_test_vectors(actor: &Actor<'_>, vectors: &[TestVector]) -> Result<(), ParseError> {
    if vectors.len() < MIN_TEST_VECTORS {
        return Err(ParseError::TestVectors(vectors.len()));
    }
    for (index, vector) in vectors.iter().enumerate() {
        let (expected, found) = (vector.action, actor.act(vector.observation));
        let same_bits = expected.touchdown_angle_rad.to_bits()
            == found.touchdown_angle_rad.to_bits()
            && expected.elongation_speed_m_s.to_bits() == found.elongation_speed_m_s.to_bits();
        if !same_bits {
            return Err(ParseError::TestVector { index, expected, found });
        }
    }
    Ok(())
}
