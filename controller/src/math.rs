//! The square root, of one instruction where the target has it, and a clamp that is total.

// The same bits from both: IEEE 754 defines the square root to the last bit.
#[cfg(all(feature = "m4f-asm", target_arch = "arm", target_abi = "eabihf"))]
pub(crate) use leg_kernel_m4f::sqrt;
#[cfg(not(all(feature = "m4f-asm", target_arch = "arm", target_abi = "eabihf")))]
pub(crate) use libm::sqrtf as sqrt;

/// Clamps to a range; a NaN becomes the lowest value.
pub(crate) fn clamp(x: f32, [low, high]: [f32; 2]) -> f32 {
    if x > low { if x < high { x } else { high } } else { low }
}
