//! Numbers for output.

/// Rounds a number to some digits after the point; a small negative one becomes 0 and not -0, which
/// would be printed as `-0.000`.
#[must_use]
pub fn rounded(value: f64, digits: usize) -> f64 {
    let scale = (0..digits).fold(1.0, |scale, _| 10.0 * scale);
    // Adding 0 turns -0 into 0.
    (value * scale).round() / scale + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_has_no_sign() {
        for (value, text) in
            [(-0.0004, "0.000"), (-0.0006, "-0.001"), (-0.0, "0.000"), (2.5, "2.500")]
        {
            assert_eq!(format!("{:.3}", rounded(value, 3)), text);
        }
        assert_eq!(format!("{:+.2}", rounded(-0.001, 2)), "+0.00");
        assert!(rounded(f64::NAN, 2).is_nan() && rounded(f64::NEG_INFINITY, 2).is_infinite());
    }
}
