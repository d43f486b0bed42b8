//! Colours: one ink, one palette, one scale for values.

use std::ops::Range;

use plotters::style::{Color as _, RGBColor, ShapeStyle};

use crate::units::px;

/// A colour with an opacity, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Color {
    rgb: (u8, u8, u8),
    opacity: f64,
}

impl Color {
    /// Returns an opaque colour from red, green and blue.
    #[must_use]
    pub const fn rgb(red: u8, green: u8, blue: u8) -> Self {
        Self { rgb: (red, green, blue), opacity: 1.0 }
    }

    /// Returns the same colour with an opacity, 0 to 1.
    #[must_use]
    pub const fn with_opacity(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }

    pub(crate) fn filled(self) -> ShapeStyle {
        let (red, green, blue) = self.rgb;
        RGBColor(red, green, blue).mix(self.opacity).filled()
    }

    pub(crate) fn stroke(self, width_px: f64) -> ShapeStyle {
        ShapeStyle { filled: false, ..self.filled() }.stroke_width(px(width_px).cast_unsigned())
    }

    pub(crate) fn as_rgb(self) -> RGBColor {
        let (red, green, blue) = self.rgb;
        RGBColor(red, green, blue)
    }
}

/// Text, axes, and whatever a chart is about when it shows one thing only.
pub const INK: Color = Color::rgb(38, 44, 56);
/// Data of others, beside our own.
pub const BLACK: Color = Color::rgb(20, 20, 20);
/// Grid lines.
pub const GRID: Color = Color::rgb(228, 231, 237);
/// Water; the first series.
pub const BLUE: Color = Color::rgb(40, 116, 190);
/// Touchdown, and set-points.
pub const ORANGE: Color = Color::rgb(214, 96, 38);
/// Lift-off, and goals.
pub const GREEN: Color = Color::rgb(20, 138, 118);
/// Warnings, such as a safe state.
pub const YELLOW: Color = Color::rgb(230, 170, 30);
/// Falls.
pub const RED: Color = Color::rgb(206, 32, 41);
/// Missing data.
pub const GREY: Color = Color::rgb(90, 96, 108);
/// The ground that the leg hops on.
pub const SAND: Color = Color::rgb(196, 178, 142);

/// Series side by side, in this order. They differ in hue and in lightness, so that
/// readers with any colour vision can distinguish them.
pub const SERIES: [Color; 8] = [
    BLUE,
    ORANGE,
    GREEN,
    YELLOW,
    Color::rgb(128, 70, 150),
    Color::rgb(110, 186, 232),
    GREY,
    Color::rgb(222, 130, 176),
];

/// Number of distinct colours on a value scale.
pub(crate) const SHADES: u32 = 64;

/// Returns the colour of a value on a scale, from dark blue through green to yellow,
/// or `None` if the value is not finite. Values beyond the scale take the colour of its
/// end. Lightness rises evenly, so that readers with any colour vision see the order.
#[must_use]
pub fn shade(value: f64, scale: &Range<f64>) -> Option<Color> {
    const STOPS: [(f64, f64, f64); 5] = [
        (68.0, 1.0, 84.0),
        (59.0, 82.0, 139.0),
        (33.0, 145.0, 140.0),
        (94.0, 201.0, 98.0),
        (253.0, 231.0, 37.0),
    ];
    if !value.is_finite() {
        return None;
    }
    let share = ((value - scale.start) / (scale.end - scale.start)).clamp(0.0, 1.0);
    let share = (share * f64::from(SHADES)).round() / f64::from(SHADES);
    let place = share * (STOPS.len() - 1) as f64;
    let low = (place as usize).min(STOPS.len() - 2);
    let part = place - low as f64;
    let (a, b) = (STOPS[low], STOPS[low + 1]);
    let mix = |a: f64, b: f64| (a + part * (b - a)).round() as u8;
    Some(Color::rgb(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2)))
}
