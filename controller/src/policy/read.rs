//! Reads the fields of a blob, one after the other.
//!
//! This is the derived `Deserialize` of [`super::Blob`], written by hand: a target reads a
//! policy while the leg runs, and the derived code copies each part over the stack,
//! kilobytes in all. The tests compare the two.

use super::{
    FIRST_FORMAT_VERSION, GainPoint, Manifest, Media, Provenance, TestVector, TestVectors,
};
use crate::actor::{
    Action, ActionScaling, Activation, Activations, Observation, ObservationScaling,
    OutputActivation,
};
use crate::leg::LegModel;
use crate::policy::CRC_LEN;
use crate::postcard_once::Reader;
use postcard::{Error, Result};

/// Reads manifest, test vectors (into `vectors`) and weights. `bytes` are those of a blob
/// of this version after its preamble.
///
/// # Errors
/// The error of postcard, when the fields cannot be decoded.
pub(super) fn fields<'a>(
    bytes: &'a [u8],
    version: u16,
    vectors: &mut TestVectors,
) -> Result<(Manifest<'a>, &'a [u8])> {
    let mut reader = Reader::new(bytes);
    let mut manifest = manifest(&mut reader);
    if version > FIRST_FORMAT_VERSION {
        manifest.activations = activations(&mut reader);
    }
    reader.extend(vectors, test_vector);
    let _padding = reader.bytes();
    let weights = reader.bytes();
    if reader.rest()?.len() == CRC_LEN {
        Ok((manifest, weights))
    } else {
        Err(Error::DeserializeUnexpectedEnd)
    }
}

fn manifest<'a>(from: &mut Reader<'a>) -> Manifest<'a> {
    Manifest {
        name: from.str(),
        widths: from.list(Reader::u16),
        activations: Activations::default(),
        observation: ObservationScaling { offset: from.floats(), scale: from.floats() },
        action: ActionScaling {
            scale: from.floats(),
            offset: from.floats(),
            low: from.floats(),
            high: from.floats(),
        },
        leg: LegModel::from_parameters(from.floats()),
        media: Media { density_ratio: from.floats(), gravity_m_s2: from.floats() },
        provenance: Provenance {
            preset: from.str(),
            seed: from.u64(),
            steps: from.u64(),
            trainer_version: from.str(),
            config: from.str(),
        },
        gains: from.list(gain_point),
    }
}

fn activations(from: &mut Reader<'_>) -> Activations {
    let hidden = match from.u8() {
        0 => Activation::Relu,
        1 => Activation::LeakyRelu(from.f32()),
        2 => Activation::Elu(from.f32()),
        3 => Activation::Tanh,
        4 => Activation::Silu,
        5 => Activation::GeluTanh,
        _ => from.refuse(),
    };
    let output = match from.u8() {
        0 => OutputActivation::Tanh,
        1 => OutputActivation::Linear,
        _ => from.refuse(),
    };
    Activations { hidden, output }
}

fn gain_point(from: &mut Reader<'_>) -> GainPoint {
    let [density_ratio, kp, ki, kd, feed_forward, limit_m_s] = from.floats();
    GainPoint { density_ratio, kp, ki, kd, feed_forward, limit_m_s }
}

fn test_vector(from: &mut Reader<'_>) -> TestVector {
    let [apex_vx_m_s, apex_y_m, density_ratio, touchdown_angle_rad, elongation_speed_m_s] =
        from.floats();
    TestVector {
        observation: Observation { apex_vx_m_s, apex_y_m, density_ratio },
        action: Action { touchdown_angle_rad, elongation_speed_m_s },
    }
}
