//! Pixels, and the finer units in which the library draws.

/// The drawing library works in whole units; several units a pixel make curves smooth.
pub(crate) const UNITS_PER_PX: f64 = 4.0;

/// Converts pixels to the library's units.
pub(crate) const fn px(pixels: f64) -> i32 {
    (UNITS_PER_PX * pixels) as i32
}

/// Converts the library's units to pixels.
pub(crate) fn to_px(units: u32) -> f64 {
    f64::from(units) / UNITS_PER_PX
}
