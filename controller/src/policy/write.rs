//! Writes the blob of a trained actor.

use super::{
    Blob, CRC_LEN, FIRST_FORMAT_VERSION, MAGIC, MAX_TEST_VECTORS, Manifest, ParseError, Policy,
    TestVector, WriteError,
};
use crate::actor::{Actor, Observation};
use crate::checksum::crc32;
use heapless::Vec;
use serde::Serialize;

/// Observations of the test vectors: all of the trained range, fast and slow,
/// low and high, in water and on land, and one where every input is large.
const TEST_OBSERVATIONS: [[f32; 3]; 12] = [
    [0.0, 1.001, 0.0],
    [0.0, 2.5, 1.0],
    [-1.0, 2.0, 0.0],
    [0.5, 1.5, 1.0],
    [3.0, 4.0, 0.05],
    [-4.0, 1.2, 0.9],
    [0.02, 2.2, 0.5],
    [-0.3, 3.1, 0.3],
    [6.0, 1.8, 0.1],
    [-7.5, 6.0, 0.7],
    [1.7, 0.9, 0.97],
    [11.0, 12.5, 1.0],
];

/// Writes a blob: `packed` holds the weights in the order of
/// [`crate::actor::pack`], layer after layer. Computes test vectors and checksum, reads the
/// result back, and returns its length in bytes.
///
/// `buffer` must lie on a multiple of 4, with room for the weights and about
/// 1 KiB besides (more with a long configuration).
///
/// # Errors
/// [`WriteError`] when the buffer is too small, or the policy would be refused.
pub fn write(
    manifest: &Manifest<'_>,
    packed: &[f32],
    buffer: &mut [u8],
) -> Result<usize, WriteError> {
    match manifest.format_version() {
        FIRST_FORMAT_VERSION => write_with((), manifest, packed, buffer),
        _ => write_with(manifest.activations, manifest, packed, buffer),
    }
}

/// Writes a blob with these bytes behind the manifest.
fn write_with(
    activations: impl Serialize,
    manifest: &Manifest<'_>,
    packed: &[f32],
    buffer: &mut [u8],
) -> Result<usize, WriteError> {
    let invalid = |e| WriteError::Invalid(e);
    let widths = manifest.widths.clone();
    let actor =
        Actor::new(widths, manifest.activations, manifest.observation, manifest.action, packed)
            .map_err(|e| invalid(ParseError::Shape(e)))?;
    let mut blob = Blob {
        magic: MAGIC,
        format_version: manifest.format_version(),
        length: 0,
        manifest: manifest.clone(),
        activations,
        test_vectors: test_vectors(&actor),
        padding: &[],
        weights: bytemuck::try_cast_slice(packed).unwrap_or_default(),
        crc32: 0,
    };
    let too_small = WriteError::BufferTooSmall(buffer.len());
    let unpadded = postcard::to_slice(&blob, buffer).map_err(|_| too_small)?.len();
    let weights_at = unpadded - CRC_LEN - size_of_val(packed);
    let zeros: &[u8] = &[0; 3];
    blob.padding = zeros.get(..(4 - weights_at % 4) % 4).unwrap_or_default();
    let len = unpadded + blob.padding.len();
    blob.length = len as u32;
    let used = postcard::to_slice(&blob, buffer).map_err(|_| too_small)?;
    if let Some((body, crc)) = used.split_last_chunk_mut::<CRC_LEN>() {
        *crc = crc32(body).to_le_bytes();
    }
    Policy::parse(used).map_err(invalid)?;
    Ok(len)
}

fn test_vectors(actor: &Actor<'_>) -> Vec<TestVector, MAX_TEST_VECTORS> {
    TEST_OBSERVATIONS
        .iter()
        .map(|&[apex_vx_m_s, apex_y_m, density_ratio]| {
            let observation = Observation { apex_vx_m_s, apex_y_m, density_ratio };
            TestVector { observation, action: actor.act(observation) }
        })
        .collect()
}
