//! Axes: their ranges, ticks and numbers.

use std::ops::Range;

use plotters::coord::ranged1d::{BoldPoints, Ranged};
use plotters::coord::types::RangedCoordf64;

/// An axis of a panel.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Quantity and unit, such as `velocity, m/s`; none if empty.
    pub label: String,
    /// The values at its two ends.
    pub range: Range<f64>,
    ticks: Ticks,
}

#[derive(Clone, Debug)]
enum Ticks {
    /// At round values, written by a function.
    Round(fn(f64) -> String),
    /// At given values, with their texts.
    At(Vec<(f64, String)>),
}

impl Axis {
    /// Returns an axis over a range, with ticks at round values.
    #[must_use]
    pub fn new(label: &str, range: Range<f64>) -> Self {
        Self { label: label.to_owned(), range, ticks: Ticks::Round(number) }
    }

    /// Returns an axis that holds all finite values with a little room at both ends. It
    /// is never empty: without values it goes from 0 to 1.
    #[must_use]
    pub fn around(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let finite = values.into_iter().filter(|v| v.is_finite());
        let (low, high) =
            finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return Self::new(label, 0.0..1.0);
        }
        let room = (0.05 * (high - low)).max(1e-6 * high.abs()).max(1e-9);
        Self::new(label, low - room..high + room)
    }

    /// Returns the axis with its numbers written by a function, such as [`percent`].
    #[must_use]
    pub fn written(mut self, format: fn(f64) -> String) -> Self {
        self.ticks = Ticks::Round(format);
        self
    }

    /// Returns the axis with ticks at these values, and no others, with these texts.
    #[must_use]
    pub fn with_ticks(mut self, ticks: Vec<(f64, String)>) -> Self {
        self.ticks = Ticks::At(ticks);
        self
    }

    /// Returns the ticks within the range: value and text. Round values are at most
    /// `most`; given ones stay, whatever their number.
    pub(crate) fn ticks(&self, most: usize) -> Vec<(f64, String)> {
        match &self.ticks {
            Ticks::Round(format) => {
                let axis = RangedCoordf64::from(self.range.clone());
                let values = axis.key_points(BoldPoints(most));
                values.into_iter().map(|value| (value, format(value))).collect()
            }
            Ticks::At(ticks) => {
                let inside = |(value, _): &&(f64, String)| {
                    (self.range.start..=self.range.end).contains(value)
                };
                ticks.iter().filter(inside).cloned().collect()
            }
        }
    }
}

/// Writes a number as short as possible, to six decimals, with thousands grouped from
/// 10,000 on, and with a minus sign instead of a hyphen.
#[must_use]
pub fn number(value: f64) -> String {
    // `+ 0.0`: no negative zero.
    let rounded = (value * 1e6).round() / 1e6 + 0.0;
    let text = if rounded.abs() >= 1e4 { grouped(rounded) } else { format!("{rounded}") };
    text.replace('-', "\u{2212}")
}

/// Writes a share, 0 to 1, in percent.
#[must_use]
pub fn percent(share: f64) -> String {
    number((1e4 * share).round() / 1e2) + " %"
}

/// Writes a count with its thousands grouped, such as 12,000.
#[must_use]
pub fn grouped(count: f64) -> String {
    let digits = format!("{:.0}", count.abs());
    let mut text = String::from(if count <= -0.5 { "-" } else { "" });
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_thousands_grouped() {
        let counts = [0.0, -0.0, 7.0, 999.0, 1_000.0, -15_000.0, 1_234_567.0];
        let texts = ["0", "0", "7", "999", "1,000", "-15,000", "1,234,567"];
        assert_eq!(counts.map(grouped), texts);
        let values = [0.1 + 0.2, -0.0, 2_000.0, -12_000.0];
        assert_eq!(values.map(number), ["0.3", "0", "2000", "\u{2212}12,000"]);
        assert_eq!([0.0, 0.25, 1.0].map(percent), ["0 %", "25 %", "100 %"]);
    }

    #[test]
    fn an_axis_holds_its_values_and_is_never_empty() {
        let axis = Axis::around("v", [1.0, f64::NAN, 3.0]);
        assert!(axis.range.start < 1.0 && axis.range.end > 3.0 && axis.range.end < 3.2);
        assert!(!Axis::around("v", [2.0]).range.is_empty());
        assert!(!Axis::around("v", []).range.is_empty());
    }

    #[test]
    fn ticks_are_round_values_or_those_that_were_given() {
        let texts = |axis: &Axis| axis.ticks(7).into_iter().map(|tick| tick.1).collect::<Vec<_>>();
        let axis = Axis::new("x", -0.1..1.1);
        assert_eq!(texts(&axis), ["0", "0.2", "0.4", "0.6", "0.8", "1"]);
        assert_eq!(texts(&axis.clone().written(percent))[1], "20 %");
        let given = [(0.3, "low"), (7.0, "beyond")].map(|(x, text)| (x, text.to_owned()));
        assert_eq!(texts(&axis.with_ticks(given.into())), ["low"]);
    }
}
