//! Sine and cosine of a leg angle, in f32 alone.
//!
//! A leg angle lies between 0 and pi, so one shift by a quarter turn is all the
//! reduction that is needed. `libm` reduces any argument and computes in f64, which a
//! Cortex-M4F does in software: 11 KiB of flash, and some hundred instructions more at
//! every apex.

/// A quarter turn, as the sum of two floats.
const QUARTER_HIGH: f32 = core::f32::consts::FRAC_PI_2;
/// The rest of it, beyond the precision of the first.
const QUARTER_LOW: f32 = -4.371_139e-8;

/// Returns sine and cosine of an angle from 0 to pi, rad, each within 2e-7.
///
/// Taylor series around a quarter turn, up to the twelfth and thirteenth power:
/// the remainder is below 7e-9. Not inlined, to save flash: no ordinary tick calls it.
#[inline(never)]
pub(crate) fn sin_cos(angle_rad: f32) -> (f32, f32) {
    let a = (angle_rad - QUARTER_HIGH) - QUARTER_LOW;
    let u = a * a;
    let even = 1.0
        + u * (-1.0 / 2.0
            + u * (1.0 / 24.0
                + u * (-1.0 / 720.0
                    + u * (1.0 / 40_320.0
                        + u * (-1.0 / 3_628_800.0 + u * (1.0 / 479_001_600.0))))));
    let odd = 1.0
        + u * (-1.0 / 6.0
            + u * (1.0 / 120.0
                + u * (-1.0 / 5_040.0
                    + u * (1.0 / 362_880.0
                        + u * (-1.0 / 39_916_800.0 + u * (1.0 / 6_227_020_800.0))))));
    // Around a quarter turn sine is even, and cosine odd and falling.
    (even, -(a * odd))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    #[test]
    fn sine_and_cosine_of_every_leg_angle_are_within_2e_7() {
        let steps = 1_000_000_u32;
        let (mut sine, mut cosine) = (0.0_f64, 0.0_f64);
        for k in 0..=steps {
            let angle = core::f32::consts::PI * (k as f32 / steps as f32);
            let (s, c) = sin_cos(angle);
            sine = sine.max((f64::from(s) - f64::from(angle).sin()).abs());
            cosine = cosine.max((f64::from(c) - f64::from(angle).cos()).abs());
        }
        std::println!("sine within {sine:.2e}, cosine within {cosine:.2e}");
        assert!(sine < 2e-7 && cosine < 2e-7, "{sine:.2e}, {cosine:.2e}");
    }

    #[test]
    fn sine_of_upright_is_exactly_1() {
        let (s, c) = sin_cos(core::f32::consts::FRAC_PI_2);
        assert_eq!(s, 1.0);
        assert!(c.abs() < 1e-7);
    }
}
