//! What the end-to-end tests share.

use std::path::PathBuf;

/// The repository's root.
#[must_use]
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..")
}
use controller::policy::*;
/// temp
pub fn policy() -> Policy<'static> {
    use controller::actor::*;
    let w = [0.12f32, 0., 0., 0., 0., 0.6];
    let b = [0.0f32, -0.73];
    let mut packed = Vec::new();
    pack(&w, &b, 3, |x| packed.push(x));
    let m = Manifest {
        name: "t",
        widths: Widths::from_slice(&[3, 2]).unwrap(),
        observation: ObservationScaling::IDENTITY,
        action: ActionScaling {
            scale: [1.0, 1.5],
            offset: [1.5708, 1.0],
            low: [0.4, 0.],
            high: [2.6, 2.],
        },
        leg: controller::leg::LegModel::HUMAN,
        media: Media { density_ratio: [0., 1.], gravity_m_s2: [9.81, 9.81] },
        provenance: Provenance { preset: "", seed: 0, steps: 0, trainer_version: "", config: "" },
        gains: GainSchedule::from_slice(&[GainPoint {
            density_ratio: 0.,
            limit_m_s: 1.,
            ..Default::default()
        }])
        .unwrap(),
    };
    let buf: &'static mut [u64] = Box::leak(vec![0u64; 1024].into_boxed_slice());
    let bytes: &'static mut [u8] = bytemuck::cast_slice_mut(buf);
    let n = write(&m, &packed, bytes).unwrap();
    Policy::parse(&bytes[..n]).unwrap()
}
