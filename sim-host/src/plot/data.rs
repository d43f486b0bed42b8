//! Reads the data of a recording for its plot.

use std::collections::VecDeque;
use std::ops::Range;
use std::path::Path;

use leg_control::wire::flags;
use leg_host::estimate::Truth;
use leg_host::estimate::chart::{self, DecimatedLine, Estimates, Line};
use leg_plant::Ground;

use crate::faults::Terrain;
use crate::record::contents::Contents;
use crate::record::read::ReadError;
use crate::record::schema::{AnyMessage, Apex, Command, Estimate, Event, Sample, State};
use crate::replay::{self, Computed};
use crate::scenario::{Scenario, Settings};

/// The data of a run over a span of its time.
#[derive(Clone, Debug, Default)]
pub struct PlotData {
    /// File name and description of the run.
    pub(super) title: String,
    /// End of the whole recording, s.
    pub end_s: f64,
    /// What was wrong with the file, and what could not be computed.
    pub warnings: Vec<String>,
    /// Whether the file is whole: neither cut off nor damaged.
    pub is_complete: bool,
    /// Height of the mass, m.
    pub(super) height: Line,
    /// Horizontal velocity, m/s.
    pub(super) velocity: Line,
    /// Set-point where it changes, m/s.
    pub(super) set_point: Line,
    /// Density of the medium over that of water.
    pub(super) density: Line,
    /// Commanded leg angle from upright, deg.
    pub(super) leg_angle: Line,
    /// Commanded elongation of the spring, cm.
    pub(super) elongation: Line,
    /// All apexes.
    pub(super) apexes: Vec<Apex>,
    /// All other events.
    pub(super) events: Vec<Event>,
    /// Spans under a safe command, s.
    pub(super) safe: Vec<Range<f64>>,
    /// What the controller's estimator held.
    pub(super) estimates: Estimates,
    /// Spans missing from the recording, s.
    pub(super) gaps: Vec<Range<f64>>,
}

/// Returns the estimates of a recording that has none, as of a run of two processes.
fn computed(
    path: &Path,
    contents: &Contents,
    warnings: &mut Vec<String>,
) -> VecDeque<((u32, u64), leg_control::estimator::Estimate)> {
    // A law by its readings estimates nothing.
    let estimates = contents.laws.iter().any(|law| law.estimator != "readings");
    if contents.has_estimates || !estimates {
        return VecDeque::new();
    }
    let (estimates, why) = match replay::estimates(path, contents) {
        Ok(Computed { estimates, ends }) => (estimates, ends),
        Err(error) => (VecDeque::new(), Some(error.to_string())),
    };
    let warning = |why| format!("{}: not all estimates are drawn: {why}", path.display());
    warnings.extend(why.map(warning));
    estimates
}

/// Appends a point if the value has changed.
fn push_change(line: &mut Line, t_s: f64, value: f64) {
    if line.last().is_none_or(|(_, last)| last.to_bits() != value.to_bits()) {
        line.push((t_s, value));
    }
}

impl PlotData {
    /// Reads the part of a recording within `span`, s.
    ///
    /// # Errors
    /// [`ReadError`] if the file is not a recording.
    pub fn read(path: &Path, span: Range<f64>) -> Result<Self, ReadError> {
        let contents = Contents::of(path)?;
        let config = contents.config()?;
        let mut builder = Builder::new(span);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let mut title = format!("{name}: {} at {} Hz", config.time_mode, config.rate_hz);
        builder.configure(config.rate_hz, &config.scenario_toml);
        let mut warnings: Vec<String> = contents.warning().into_iter().collect();
        builder.computed = computed(path, &contents, &mut warnings);
        let mut messages = contents.messages()?;
        while let Some(message) = messages.next_message()? {
            match message {
                AnyMessage::Policy(policy) if policy.seq == 0 => {
                    title = format!("{title}, policy {}", policy.name);
                }
                AnyMessage::Sample(sample) => builder.sample(&sample),
                AnyMessage::Command(command) => builder.command(&command),
                AnyMessage::State(state) => builder.state(&state),
                AnyMessage::Estimate(estimate) => builder.estimate(&estimate),
                AnyMessage::Apex(apex) if builder.span.contains(&apex.t_s) => {
                    builder.data.apexes.push(apex);
                }
                AnyMessage::Event(event) if builder.span.contains(&event.t_s) => {
                    builder.data.events.push(event);
                }
                _ => (),
            }
        }
        let mut data = builder.finish();
        data.title = title;
        data.warnings = warnings;
        data.is_complete = contents.is_complete();
        Ok(data)
    }

    /// Returns whether the span contains fewer than two ticks.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.height.len() < 2
    }

    /// Returns the time span of the data, s.
    #[must_use]
    pub fn span(&self) -> Range<f64> {
        let ends = |line: &Line| Some(line.first()?.0..line.last()?.0);
        ends(&self.height).unwrap_or(0.0..1.0)
    }
}

#[derive(Debug)]
struct Builder {
    span: Range<f64>,
    rate_hz: f64,
    max_elongation_m: f64,
    /// Run id and number of the last sample.
    last: Option<(u32, u64)>,
    /// Ticks of the runs before this one.
    earlier_ticks: u64,
    data: PlotData,
    height: DecimatedLine,
    velocity: DecimatedLine,
    leg_angle: DecimatedLine,
    elongation: DecimatedLine,
    /// Uneven ground, of which estimates of the height count.
    terrain: Option<Terrain>,
    estimates: chart::Builder,
    /// Estimates that the recording does not have.
    computed: VecDeque<((u32, u64), leg_control::estimator::Estimate)>,
}

impl Builder {
    fn new(span: Range<f64>) -> Self {
        Self {
            span,
            rate_hz: 1000.0,
            max_elongation_m: f64::INFINITY,
            last: None,
            earlier_ticks: 0,
            data: PlotData::default(),
            height: DecimatedLine::default(),
            velocity: DecimatedLine::default(),
            leg_angle: DecimatedLine::default(),
            elongation: DecimatedLine::default(),
            terrain: None,
            estimates: chart::Builder::default(),
            computed: VecDeque::new(),
        }
    }

    fn configure(&mut self, rate_hz: u32, scenario: &str) {
        self.rate_hz = f64::from(rate_hz.max(1));
        // Limits the drawn ramp to what the leg can follow; unknown if the scenario is invalid.
        let settings = Settings::from_toml(scenario).ok();
        if let Some(scenario) = settings.and_then(|s| Scenario::from_settings(&s).ok()) {
            self.max_elongation_m = scenario.leg.parameters().max_elongation_m;
            self.terrain = scenario.faults.terrain();
        }
    }

    fn time_s(&self, seq: u64) -> f64 {
        (self.earlier_ticks as f64 + seq as f64) / self.rate_hz
    }

    /// Returns the time of a tick if it lies in the span.
    fn time_in_span(&self, seq: u64) -> Option<f64> {
        Some(self.time_s(seq)).filter(|t_s| self.span.contains(t_s))
    }

    fn sample(&mut self, sample: &Sample) {
        match self.last.replace((sample.run_id, sample.seq)) {
            Some((run_id, last)) if run_id != sample.run_id => {
                self.earlier_ticks = self.earlier_ticks.saturating_add(last.saturating_add(1));
            }
            Some((_, last)) if sample.seq > last.saturating_add(1) => {
                let gap = self.time_s(last + 1)..self.time_s(sample.seq);
                if self.span.contains(&gap.start) && self.span.contains(&gap.end) {
                    self.data.gaps.push(gap);
                }
            }
            _ => (),
        }
        self.data.end_s = self.time_s(sample.seq);
        if let Some(t_s) = self.time_in_span(sample.seq) {
            push_change(&mut self.data.set_point, t_s, sample.set_point_m_s.into());
        }
    }

    fn command(&mut self, command: &Command) {
        let Some(t_s) = self.time_in_span(command.tick) else { return };
        let upright_rad = f64::from(command.leg_angle_rad) - std::f64::consts::FRAC_PI_2;
        self.leg_angle.push(t_s, upright_rad.to_degrees());
        // The ramp starts at the tick that the command answers.
        let age_s = command.tick.saturating_sub(command.seq) as f64 / self.rate_hz;
        let ramp_m =
            f64::from(command.elongation_m) + f64::from(command.elongation_rate_m_s) * age_s;
        self.elongation.push(t_s, 100.0 * ramp_m.clamp(0.0, self.max_elongation_m));
        if command.flags & u32::from(flags::SAFE) != 0 {
            let next_s = t_s + 1.0 / self.rate_hz;
            match self.data.safe.last_mut() {
                Some(span) if t_s - span.end < 0.5 / self.rate_hz => span.end = next_s,
                _ => self.data.safe.push(t_s..next_s),
            }
        }
    }

    fn estimate(&mut self, estimate: &Estimate) {
        let t_s = self.time_s(0) + 1e-9 * estimate.t_ns as f64;
        self.estimates.estimate(t_s, &estimate.into(), 1.0 / self.rate_hz, &self.span);
    }

    fn state(&mut self, state: &State) {
        let ground_m = self.terrain.map_or(0.0, |terrain| Ground::height_m(&terrain, state.x_m));
        let truth = Truth::from(state).over(ground_m);
        self.estimates.truth(self.time_s(state.seq), &truth, &self.span);
        if let Some((run_id, _)) = self.last {
            let now = (run_id, state.seq);
            while let Some((at, estimate)) = self.computed.pop_front_if(|(at, _)| *at <= now) {
                if at == now {
                    self.estimate(&Estimate::at_tick(state.seq, &estimate));
                }
            }
        }
        let Some(t_s) = self.time_in_span(state.seq) else { return };
        self.height.push(t_s, state.y_m);
        self.velocity.push(t_s, state.vx_m_s);
        push_change(&mut self.data.density, t_s, state.density_ratio);
    }

    fn finish(self) -> PlotData {
        let mut data = self.data;
        data.height = self.height.line;
        data.velocity = self.velocity.line;
        data.leg_angle = self.leg_angle.line;
        data.elongation = self.elongation.line;
        data.estimates = self.estimates.finish();
        // Step lines continue to the end.
        let end_s = data.span().end;
        for line in [&mut data.set_point, &mut data.density] {
            if let Some(&(_, level)) = line.last() {
                line.push((end_s, level));
            }
        }
        data
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_line_has_points_only_where_it_changes() {
        let mut line = Line::new();
        for (t, level) in [(0.0, 1.0), (1.0, 1.0), (2.0, 0.5), (3.0, 0.5)] {
            push_change(&mut line, t, level);
        }
        assert_eq!(line, [(0.0, 1.0), (2.0, 0.5)]);
    }
}
