//! Where the mass is, seen from the foot: angles and vectors in the plane of the leg.
//!
//! Vectors are [`nalgebra::Vector2`], x ahead and y up, m. Sine and cosine come from
//! [`crate::trig`]; the angle of a vector comes from micromath, whose `atan2` is within
//! 3 mrad (test below): plenty for a hip that only must not fight the ground. micromath
//! returns NaN where the squares of both coordinates vanish or overflow, so such vectors
//! never reach it.

use crate::command::UPRIGHT_RAD;
use crate::trig::sin_cos;
use micromath::F32Ext;
use nalgebra::Vector2;

/// Sum of the coordinates between which a vector from foot to mass has an angle, m. Any
/// leg lies far inside; so do the squares of the coordinates in the range of f32.
const LENGTH_WITH_ANGLE_M: core::ops::RangeInclusive<f32> = 1e-6..=1e6;

/// Returns the vector from the foot to the mass of a leg of this length, m, at this angle
/// from the +x axis, rad, 0 to pi.
pub(crate) fn foot_to_mass(length_m: f32, angle_rad: f32) -> Vector2<f32> {
    let (sine, cosine) = sin_cos(angle_rad);
    Vector2::new(length_m * cosine, length_m * sine)
}

/// Returns the angle of the leg from the +x axis, rad, 0 to pi, for the vector from foot
/// to mass, m, with the mass above the ground or on it; upright where the vector has no
/// angle (the mass on the foot, or a vector beyond any leg).
pub(crate) fn leg_angle_rad(foot_to_mass: Vector2<f32>) -> f32 {
    let (x, y) = (foot_to_mass.x, foot_to_mass.y.abs());
    if LENGTH_WITH_ANGLE_M.contains(&(x.abs() + y)) { F32Ext::atan2(y, x) } else { UPRIGHT_RAD }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    #[test]
    fn the_angle_is_within_3_mrad() {
        let worst = (0..=3141)
            .map(|i| i as f32 * 1e-3)
            .map(|a| (leg_angle_rad(Vector2::new(a.cos(), a.sin())) - a).abs())
            .fold(0.0_f32, f32::max);
        assert!(worst < 3e-3, "{worst} rad");
    }

    /// Every power of two with both signs, its neighbours, zeros, subnormals, limits, NaN.
    fn boundaries() -> Vec<f32> {
        let exponents = (0..=255_u32).flat_map(|e| {
            [0, 1, 0x40_0000, 0x7f_fffe, 0x7f_ffff].map(|mantissa| e << 23 | mantissa)
        });
        exponents.flat_map(|bits| [bits, bits | 1 << 31]).map(f32::from_bits).collect()
    }

    #[test]
    fn every_pair_of_boundary_values_has_an_angle_from_0_to_pi() {
        let values = boundaries();
        assert!(values.len() > 2_500);
        for &x in &values {
            for &y in &values {
                let angle = leg_angle_rad(Vector2::new(x, y));
                assert!((0.0..=core::f32::consts::PI).contains(&angle), "({x:e}, {y:e}): {angle}");
            }
        }
    }

    #[test]
    fn foot_to_mass_and_leg_angle_are_inverse() {
        for i in 1..314 {
            let angle = i as f32 * 1e-2;
            let vector = foot_to_mass(1.2, angle);
            assert!((vector.x.hypot(vector.y) - 1.2).abs() < 1e-6);
            assert!((leg_angle_rad(vector) - angle).abs() < 3e-3);
        }
    }
}
