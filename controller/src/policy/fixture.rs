//! A made-up policy, for tests.

extern crate std;
use super::*;
use crate::actor::packed_len;
use std::vec;
use std::vec::Vec as StdVec;

pub(crate) fn manifest() -> Manifest<'static> {
    Manifest {
        name: "test",
        widths: Widths::from_slice(&[3, 50, 50, 2]).unwrap(),
        activations: Activations::default(),
        observation: ObservationScaling { offset: [0.0, 2.5, 0.5], scale: [0.33, 0.4, 2.0] },
        action: ActionScaling {
            scale: [1.0, 1.5],
            offset: [1.57, 1.0],
            low: [0.314, 0.0],
            high: [2.6, 2.0],
        },
        leg: LegModel::HUMAN,
        media: Media { density_ratio: [0.0, 1.0], gravity_m_s2: [9.81, 9.81] },
        provenance: Provenance {
            preset: "test",
            seed: 7,
            steps: 0,
            trainer_version: "0",
            config: "",
        },
        gains: GainSchedule::from_slice(&[GainPoint { limit_m_s: 1.0, ..Default::default() }])
            .unwrap(),
    }
}

pub(crate) fn weights(widths: &[u16]) -> StdVec<f32> {
    let n = packed_len(widths).unwrap();
    (0..n).map(|i| ((i * 37 % 101) as f32 - 50.0) / 400.0).collect()
}

/// Aligned bytes of any length, for the tests that flip and cut.
pub(crate) struct Bytes(StdVec<u32>, usize);

impl Bytes {
    pub(crate) fn new(bytes: &[u8]) -> Self {
        let mut words = vec![0_u32; bytes.len().div_ceil(4)];
        bytemuck::cast_slice_mut::<u32, u8>(&mut words)[..bytes.len()].copy_from_slice(bytes);
        Self(words, bytes.len())
    }

    pub(crate) fn get(&self) -> &[u8] {
        &bytemuck::cast_slice::<u32, u8>(&self.0)[..self.1]
    }
}

pub(crate) fn blob_of(manifest: &Manifest<'_>) -> Result<StdVec<u8>, WriteError> {
    let mut buffer = vec![0_u32; 8 * 1024];
    let buffer: &mut [u8] = bytemuck::cast_slice_mut(&mut buffer);
    let len = write(manifest, &weights(&manifest.widths), buffer)?;
    Ok(buffer[..len].to_vec())
}
