//! What an estimator held, against the truth, as rows of a chart.

use std::collections::VecDeque;
use std::ops::Range;

use leg_charts::{Axis, Mark, Panel, color};
use leg_control::estimator::Estimate;

use super::Truth;

/// Points of a line, at least this and at most twice this many; more could not be
/// distinguished in a plot.
const POINTS: usize = 2_500;
/// Time for which true states are kept, s: the largest age of a measurement that an estimate may
/// be for, and a little more.
const KEPT_S: f64 = 1.25;
/// Standard deviations of the bands.
const BAND: f64 = 2.0;
/// Names of the quantities: title, axis.
const QUANTITIES: [(&str, &str); 4] = [
    ("Horizontal velocity", "velocity, m/s"),
    ("Height above the ground", "height, m"),
    ("Vertical velocity", "velocity, m/s"),
    ("Density of the medium over that of water", "density ratio"),
];

/// A line over time, s.
pub type Line = Vec<(f64, f64)>;

/// A line that drops every second point when it grows too long.
#[derive(Debug, Default)]
pub struct DecimatedLine {
    /// The points that are left.
    pub line: Line,
    stride: usize,
    seen: usize,
}

impl DecimatedLine {
    /// Appends a point.
    pub fn push(&mut self, t_s: f64, value: f64) {
        if self.seen.is_multiple_of(self.stride.max(1)) {
            self.line.push((t_s, value));
            if self.line.len() >= 2 * POINTS {
                self.stride = 2 * self.stride.max(1);
                let mut i = 0;
                self.line.retain(|_| {
                    i += 1;
                    i % 2 == 1
                });
            }
        }
        self.seen += 1;
    }
}

/// A quantity of the estimate over time.
#[derive(Clone, Debug, Default)]
struct Quantity {
    truth: Line,
    estimate: Line,
    /// Estimate less truth at the time of the measurement; not finite where the truth is not
    /// known.
    error: Line,
    /// Standard deviation that the estimator states, at the places of `estimate`.
    deviation: Line,
    /// Number of estimates in flight, and of those within the band.
    in_flight: u32,
    within: u32,
}

/// Estimates over time; without quantities if there were none.
#[derive(Clone, Debug, Default)]
pub struct Estimates(Vec<Quantity>);

#[derive(Debug, Default)]
struct QuantityBuilder {
    truth: DecimatedLine,
    estimate: DecimatedLine,
    error: DecimatedLine,
    deviation: DecimatedLine,
    in_flight: u32,
    within: u32,
}

/// Collects true states and estimates, in the order of their ticks.
#[derive(Debug, Default)]
pub struct Builder {
    quantities: [QuantityBuilder; 4],
    /// True states of late: time, s, values, and whether in flight.
    states: VecDeque<(f64, [f64; 4], bool)>,
    /// Time of the last measurement, ns.
    last_ns: Option<u64>,
}

impl Builder {
    /// Adds the true state at a time, in the order of time; what is drawn lies in `span`.
    pub fn truth(&mut self, t_s: f64, truth: &Truth, span: &Range<f64>) {
        if span.contains(&t_s) {
            for (quantity, value) in self.quantities.iter_mut().zip(truth.values) {
                if value.is_finite() {
                    quantity.truth.push(t_s, value);
                }
            }
        }
        self.states.push_back((t_s, truth.values, truth.in_flight.unwrap_or(true)));
        while self.states.pop_front_if(|(then_s, ..)| *then_s < t_s - KEPT_S).is_some() {}
    }

    /// Adds an estimate for a measurement at a time, whose true state was added before; `tick_s`
    /// is the length of a tick.
    pub fn estimate(&mut self, t_s: f64, e: &Estimate, tick_s: f64, span: &Range<f64>) {
        // Without a new measurement the estimate stays.
        if self.last_ns.replace(e.t_ns) == Some(e.t_ns) || !span.contains(&t_s) {
            return;
        }
        let at = self.states.partition_point(|(then_s, ..)| *then_s < t_s - 0.5 * tick_s);
        let known = self.states.get(at).filter(|(then_s, ..)| *then_s < t_s + 0.5 * tick_s);
        let (truth, is_flight) = known.map_or(([f64::NAN; 4], false), |known| (known.1, known.2));
        let values = [
            (e.vx_m_s, e.vx_variance),
            (e.y_m, e.y_variance),
            (e.vy_m_s, e.vy_variance),
            (e.density_ratio, e.density_variance),
        ];
        for ((quantity, (value, variance)), truth) in
            self.quantities.iter_mut().zip(values).zip(truth)
        {
            let (error, deviation) = (f64::from(value) - truth, f64::from(variance).sqrt());
            quantity.estimate.push(t_s, value.into());
            quantity.error.push(t_s, error);
            quantity.deviation.push(t_s, deviation);
            if is_flight && !e.in_stance && error.is_finite() {
                quantity.in_flight += 1;
                quantity.within += u32::from(error.abs() <= BAND * deviation);
            }
        }
    }

    /// Returns the estimates.
    #[must_use]
    pub fn finish(self) -> Estimates {
        if self.last_ns.is_none() {
            return Estimates::default();
        }
        let finished = self.quantities.map(|quantity| Quantity {
            truth: quantity.truth.line,
            estimate: quantity.estimate.line,
            error: quantity.error.line,
            deviation: quantity.deviation.line,
            in_flight: quantity.in_flight,
            within: quantity.within,
        });
        Estimates(finished.into())
    }
}

impl Estimates {
    /// Returns a row for each quantity: a panel with estimate and truth, and where the truth is
    /// known one with the error.
    #[must_use]
    pub fn rows(&self, span: &Range<f64>) -> Vec<Vec<Panel>> {
        let last = self.0.len().saturating_sub(1);
        let row = |(i, (quantity, names)): (usize, (&Quantity, _))| {
            let x = Axis::new(if i == last { "time, s" } else { "" }, span.clone());
            quantity.panels(names, &x)
        };
        self.0.iter().zip(QUANTITIES).enumerate().map(row).collect()
    }
}

impl Quantity {
    fn panels(&self, (title, label): (&str, &str), x: &Axis) -> Vec<Panel> {
        let band = |middle: &Line| -> Vec<(f64, f64, f64)> {
            let places = middle.iter().zip(&self.deviation);
            places.map(|((t, m), (_, d))| (*t, m - BAND * d, m + BAND * d)).collect()
        };
        let zero: Line = self.estimate.iter().map(|(t, _)| (*t, 0.0)).collect();
        let (around_estimate, around_zero) = (band(&self.estimate), band(&zero));
        let band_label = "\u{b1}2 standard deviations";
        let edges = |band: &[(f64, f64, f64)]| {
            trimmed(band.iter().flat_map(|(_, low, high)| [*low, *high]).collect(), 0.05)
        };
        let values = |line: &Line| line.iter().map(|point| point.1).collect::<Vec<f64>>();
        let shown = [values(&self.truth), trimmed(values(&self.estimate), 0.02)].concat();
        let value_axis = Axis::around(label, shown.into_iter().chain(edges(&around_estimate)));
        let shown = [trimmed(values(&self.error), 0.05), edges(&around_zero)].concat();
        let largest = shown.into_iter().map(f64::abs).fold(0.0, f64::max);
        let error_label = format!("error in {label}");
        let error_axis = Axis::around(&error_label, [-1.3 * largest, 1.3 * largest]);
        let share = 100.0 * f64::from(self.within) / f64::from(self.in_flight.max(1));
        let error_title = if self.in_flight == 0 {
            "Estimate less truth".to_owned()
        } else {
            format!("Estimate less truth: {share:.1} % of the flight within the band")
        };
        let band = Mark::band(around_estimate, color::BLUE).label(band_label);
        let estimate = Mark::line(self.estimate.clone(), color::BLUE).width_px(1.0);
        if self.truth.is_empty() {
            let panel = Panel::new(format!("{title}: estimate"), x.clone(), value_axis);
            return vec![panel.with(band).with(estimate.label("estimate"))];
        }
        let truth = Mark::line(self.truth.clone(), color::ORANGE).width_px(2.0).label("true");
        vec![
            Panel::new(format!("{title}: estimate and truth"), x.clone(), value_axis)
                .with(band)
                .with(truth)
                .with(estimate.label("estimate")),
            Panel::new(error_title, x.clone(), error_axis)
                .with(Mark::band(around_zero, color::BLUE).label(band_label))
                .with(Mark::line(zero, color::INK.with_opacity(0.4)).width_px(1.0))
                .with(Mark::line(self.error.clone(), color::BLUE).width_px(1.0).label("error")),
        ]
    }
}

/// Leaves out a share of the values at each end: before the first measurements of a quantity its
/// error and band are so wide that beside them nothing else could be seen.
fn trimmed(mut values: Vec<f64>, share: f64) -> Vec<f64> {
    values.retain(|value| value.is_finite());
    values.sort_by(f64::total_cmp);
    let cut = (share * values.len() as f64) as usize;
    values[cut..values.len() - cut].to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(t_ns: u64, vx_m_s: f32) -> Estimate {
        Estimate {
            t_ns,
            in_stance: false,
            vx_m_s,
            y_m: 0.0,
            vy_m_s: 0.0,
            density_ratio: 0.0,
            vx_variance: 1.0,
            y_variance: 0.0,
            vy_variance: 0.0,
            density_variance: 0.0,
            innovation: 0.0,
        }
    }

    /// Estimates with standard deviation 1 whose errors are those given, one a tick of 1 ms.
    fn built(errors: &[f32], delay_ticks: u64) -> Estimates {
        let mut builder = Builder::default();
        let span = 0.0..f64::INFINITY;
        let truth = |tick: u64| 3.0 + tick as f32;
        for tick in 0..errors.len() as u64 + delay_ticks {
            let values = [truth(tick).into(), 0.0, 0.0, 0.0];
            let state = Truth { values, in_flight: Some(true) };
            builder.truth(1e-3 * tick as f64, &state, &span);
            let Some(of) = tick.checked_sub(delay_ticks) else { continue };
            let vx_m_s = truth(of) + errors[of as usize];
            let t_ns = 1_000_000 * of;
            let estimate = estimate(t_ns, vx_m_s);
            let t_s = 1e-9 * t_ns as f64;
            // The second time there is no new measurement.
            builder.estimate(t_s, &estimate, 1e-3, &span);
            builder.estimate(t_s, &estimate, 1e-3, &span);
        }
        builder.finish()
    }

    #[test]
    fn an_error_is_against_the_truth_at_the_time_of_the_measurement() {
        for delay_ticks in [0, 1, 40] {
            let estimates = built(&[0.5, -1.5, 2.5, -4.0], delay_ticks);
            let vx = &estimates.0[0];
            let errors: Vec<f64> = vx.error.iter().map(|point| point.1).collect();
            assert_eq!(errors, [0.5, -1.5, 2.5, -4.0], "{delay_ticks} ticks late");
            assert_eq!((vx.within, vx.in_flight), (2, 4));
        }
    }

    #[test]
    fn draws_a_row_for_each_quantity_only_where_there_are_estimates() {
        assert!(built(&[], 0).rows(&(0.0..1.0)).is_empty());
        let rows = built(&[0.5, -1.5, 2.5, -4.0], 0).rows(&(0.0..1.0));
        assert_eq!(rows.iter().map(Vec::len).collect::<Vec<_>>(), [2; 4]);
        assert!(rows[0][1].title.contains("50.0 % of the flight"), "{}", rows[0][1].title);
    }

    #[test]
    fn a_log_without_truth_has_one_panel_for_each_quantity() {
        let mut builder = Builder::default();
        for tick in 0..10 {
            builder.estimate(
                1e-3 * tick as f64,
                &estimate(tick * 1_000_000, 1.0),
                1e-3,
                &(0.0..1.0),
            );
        }
        let rows = builder.finish().rows(&(0.0..1.0));
        assert_eq!(rows.iter().map(Vec::len).collect::<Vec<_>>(), [1; 4]);
        assert!(rows[0][0].title.ends_with(": estimate"), "{}", rows[0][0].title);
    }

    #[test]
    fn a_decimated_line_has_even_spacing_and_keeps_its_start() {
        let mut decimated = DecimatedLine::default();
        (0..1_000_000).for_each(|i| decimated.push(f64::from(i), 0.0));
        let times: Vec<f64> = decimated.line.iter().map(|p| p.0).collect();
        assert!((POINTS..2 * POINTS).contains(&times.len()), "{}", times.len());
        assert!(times.windows(2).all(|w| w[1] - w[0] == times[1] - times[0]));
        assert_eq!(times[0], 0.0);
    }

    #[test]
    fn a_wide_band_at_the_beginning_does_not_flatten_the_rest() {
        let values = (0..1_000).map(|i| if i < 5 { 1e6 } else { f64::from(i % 3) });
        assert_eq!(trimmed(values.collect(), 0.02).last(), Some(&2.0));
        assert!(trimmed(vec![f64::NAN], 0.1).is_empty());
    }
}
