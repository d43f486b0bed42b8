//! A policy with arbitrary weights, for tests.

use leg_control::actor::{ActionScaling, Activations, ObservationScaling, Widths, packed_len};
use leg_control::leg::LegModel;
use leg_control::policy::{
    GainPoint, GainSchedule, Manifest, Media, Provenance, WriteError, write,
};

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

pub(crate) fn weights(widths: &[u16]) -> Vec<f32> {
    let n = packed_len(widths).unwrap();
    (0..n).map(|i| ((i * 37 % 101) as f32 - 50.0) / 400.0).collect()
}

pub(crate) fn blob_of(manifest: &Manifest<'_>) -> Result<Vec<u8>, WriteError> {
    let mut buffer = vec![0_u32; 8 * 1024];
    let buffer: &mut [u8] = bytemuck::cast_slice_mut(&mut buffer);
    let len = write(manifest, &weights(&manifest.widths), buffer)?;
    Ok(buffer[..len].to_vec())
}
