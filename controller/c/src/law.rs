//! The control law for those who link it in: no allocation, no process, no clock.

use std::mem::{MaybeUninit, align_of};

use leg_control::config::Config;
use leg_control::policy::{Policy, SHIPPED};
use leg_control::wire::Sample;
use leg_control::wire_controller::WireController;

use crate::messages::{LegCommand, LegSample};

type Law = WireController<'static>;

/// The state of a control law, of fixed size: keep it where you like, and do not copy it while
/// it is in use. It needs no end: the law has no allocator, so there is nothing to free.
#[repr(C)]
#[derive(Debug)]
pub struct LegController {
    opaque: [u64; 512],
}

const _: () = {
    assert!(size_of::<Law>() <= size_of::<LegController>());
    assert!(align_of::<Law>() <= align_of::<LegController>());
};

/// Begins a control law for `rate_hz` ticks a second under a gravity in m/s2, on the readings
/// themselves. `policy` is a policy file of `policy_len` bytes, aligned to 4 bytes, which stays
/// where it is for as long as the law is in use; null is the shipped one. Returns 0; 1 if the
/// policy is not valid, 2 if rate or gravity is out of range, and then the state is not changed.
///
/// # Safety
/// `state` points to a `leg_controller`, `policy` is null or points to `policy_len` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn leg_controller_init(
    state: *mut LegController,
    policy: *const u8,
    policy_len: usize,
    rate_hz: u32,
    gravity_m_s2: f32,
) -> i32 {
    let blob: &'static [u8] = if policy.is_null() {
        SHIPPED
    } else {
        // SAFETY: by contract.
        unsafe { std::slice::from_raw_parts(policy, policy_len) }
    };
    let Ok(policy) = Policy::parse(blob) else { return 1 };
    let config = Config::at_rate(rate_hz).and_then(|config| config.with_gravity(gravity_m_s2));
    let Ok(config) = config else { return 2 };
    // SAFETY: by contract; size and alignment are asserted above.
    unsafe { state.cast::<Law>().write(Law::new(policy, config)) };
    0
}

/// Runs one tick of a law: takes the sample that came, or null where none did, and writes the
/// command for it, which is always finite.
///
/// # Safety
/// `state` was begun by `leg_controller_init`; `sample` is null or points to a sample, `command`
/// to a command, which need not be initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn leg_controller_step(
    state: *mut LegController,
    sample: *const LegSample,
    command: *mut MaybeUninit<LegCommand>,
) {
    // SAFETY: by contract.
    let (law, sample) = unsafe { (&mut *state.cast::<Law>(), sample.as_ref()) };
    let sample: Option<Sample> = sample.map(|sample| bytemuck::cast(*sample));
    let answer: LegCommand = bytemuck::cast(law.tick(sample.as_ref()));
    // SAFETY: by contract.
    unsafe { (*command).write(answer) };
}
