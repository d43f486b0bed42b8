//! Numbers of sixteen bits, as files store weights of half precision.

/// Returns the value of an IEEE 754 binary16, which f32 holds exactly.
pub(crate) fn from_float16(bits: u16) -> f32 {
    let (sign, exponent, fraction) =
        (u32::from(bits >> 15) << 31, u32::from(bits >> 10 & 0x1f), u32::from(bits & 0x3ff));
    let magnitude = match (exponent, fraction) {
        // Zero or subnormal: multiples of 2^-24.
        (0, _) => fraction as f32 / 16_777_216.0,
        (0x1f, _) => f32::from_bits(0x7f80_0000 | fraction << 13),
        _ => f32::from_bits((exponent + 112) << 23 | fraction << 13),
    };
    f32::from_bits(magnitude.to_bits() | sign)
}

/// Returns the value of a bfloat16, the upper half of an f32.
pub(crate) fn from_bfloat16(bits: u16) -> f32 {
    f32::from_bits(u32::from(bits) << 16)
}

#[cfg(test)]
mod tests {
    use super::{from_bfloat16, from_float16};

    #[test]
    fn reads_numbers_of_sixteen_bits() {
        for (bits, value) in [
            (0x0000, 0.0),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x3555, 0.333_251_95),
            (0x7bff, 65504.0),
            (0x0001, 5.960_464_5e-8),
            (0x03ff, 6.097_555e-5),
            (0x0400, 6.103_515_6e-5),
            (0xfc00, f32::NEG_INFINITY),
        ] {
            assert_eq!(from_float16(bits).to_bits(), f32::to_bits(value), "{bits:04x}");
        }
        assert!(from_float16(0x7e00).is_nan());
        assert_eq!((from_bfloat16(0x3f80), from_bfloat16(0xc049)), (1.0, -3.140_625));
    }
}
