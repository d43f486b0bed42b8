//! Converts ticks and events to the messages of a recording.

use super::display::{Display, log};
use super::feeder::SideMessage;
use super::pipe::FrameBuffer;
use super::schema::{
    Apex, Command, Config, End, Estimate, Event, EventKind, Law, Loop, Phase, Policy, Sample,
    SetPoint, State,
};
use super::tap::{Known, RingEntry, TickCopy};

/// Converts the entries of the ring to messages, in their order.
#[derive(Debug)]
pub(super) struct Translator {
    /// Wall clock at simulated time 0, ns since 1970.
    started_unix_ns: u64,
    rate_hz: u32,
    /// Simulated duration of the earlier runs, when the leg was put back to its
    /// start, s.
    earlier_runs_s: f64,
    /// The tick of the estimate and the events that follow.
    tick: Option<TickCopy>,
    /// An apex that the controller has not answered yet.
    unanswered: Option<Apex>,
    /// What is added for viewers, if anything is.
    display: Option<Display>,
}

impl Translator {
    /// Creates a translator for a run, with messages for viewers at `display_rate_hz`, 0 for
    /// none.
    pub(super) fn new(config: &Config, display_rate_hz: u32) -> Self {
        let Config { started_unix_ns, rate_hz, .. } = *config;
        let display = Display::of(config, display_rate_hz);
        let (earlier_runs_s, tick, unanswered) = (0.0, None, None);
        Self { started_unix_ns, rate_hz, earlier_runs_s, tick, unanswered, display }
    }

    /// Adds the configuration of the run.
    pub(super) fn begin(&self, config: &Config, frames: &mut FrameBuffer) {
        frames.add(config.started_unix_ns, config);
        if let Some(display) = &self.display {
            display.begin(config, frames);
        }
    }

    /// Converts simulated time to the log time of a message, ns since 1970.
    fn log_time_ns(&self, t_s: f64) -> u64 {
        self.started_unix_ns + (1e9 * t_s).round() as u64
    }

    fn tick_time_ns(&self, seq: u64) -> u64 {
        self.log_time_ns(self.earlier_runs_s + seq as f64 / f64::from(self.rate_hz.max(1)))
    }

    /// Adds the messages of an entry.
    pub(super) fn add(&mut self, entry: &RingEntry, frames: &mut FrameBuffer) {
        match entry {
            RingEntry::Tick(tick) => self.tick(tick, frames),
            RingEntry::Estimate(estimate) => self.estimate(estimate, frames),
            RingEntry::Event(event) => self.event(event, frames),
        }
    }

    /// Adds the messages of a tick.
    pub(super) fn tick(&mut self, tick: &TickCopy, frames: &mut FrameBuffer) {
        let TickCopy { seq, body, sample, command, .. } = tick;
        if let Some(last) = self.tick
            && last.sample.header.run_id != sample.header.run_id
        {
            self.close_apex(false, &last.command, frames);
            self.earlier_runs_s += last.t_s + 1.0 / f64::from(self.rate_hz.max(1));
        }
        let t_s = self.earlier_runs_s + tick.t_s;
        let time_ns = self.log_time_ns(t_s);
        let round_trip_ns = tick.round_trip.as_nanos() as u64;
        frames.add(time_ns, &Sample::from(sample));
        frames.add(time_ns, &Command::in_force(*seq, command, tick.is_new, round_trip_ns));
        if tick.known == Known::State {
            frames.add(time_ns, &state(tick));
        }
        if let Some(display) = &mut self.display {
            display.tick(tick, time_ns, frames);
        }
        // The controller answers an apex in the tick after it.
        if self.tick.is_some_and(|last| last.command.apexes != command.apexes) {
            if tick.known != Known::State && command.apexes > 0 {
                // As the controller has found it.
                self.unanswered = Some(Apex {
                    seq: *seq,
                    t_s,
                    x_m: body.x_m,
                    y_m: command.apex_y_m.into(),
                    vx_m_s: command.apex_vx_m_s.into(),
                    set_point_m_s: sample.set_point_m_s.into(),
                    density_ratio: tick.density_ratio,
                    ..Apex::default()
                });
            }
            self.close_apex(true, command, frames);
        }
        self.tick = Some(*tick);
    }

    fn estimate(&self, estimate: &leg_control::estimator::Estimate, frames: &mut FrameBuffer) {
        let Some(tick) = &self.tick else { return };
        let time_ns = self.log_time_ns(self.earlier_runs_s + tick.t_s);
        frames.add(time_ns, &Estimate::at_tick(tick.seq, estimate));
    }

    fn event(&mut self, event: &leg_plant::Event, frames: &mut FrameBuffer) {
        let Some(tick) = self.tick else { return };
        let t_s = self.earlier_runs_s + tick.t_s + event.t_s;
        let leg_plant::Body { x_m, vx_m_s, y_m, vy_m_s } = event.body;
        let (kind, foot_x_m, foot_y_m) = match event.kind {
            leg_plant::EventKind::Touchdown { foot_x_m, foot_y_m } => {
                (EventKind::Touchdown, foot_x_m, foot_y_m)
            }
            leg_plant::EventKind::LiftOff => (EventKind::LiftOff, 0.0, 0.0),
            leg_plant::EventKind::Fall => (EventKind::Fall, 0.0, 0.0),
            leg_plant::EventKind::Apex => {
                self.close_apex(false, &tick.command, frames);
                self.unanswered = Some(Apex {
                    seq: tick.seq,
                    t_s,
                    x_m,
                    y_m,
                    vx_m_s,
                    set_point_m_s: tick.sample.set_point_m_s.into(),
                    density_ratio: tick.density_ratio,
                    ..Apex::default()
                });
                return;
            }
        };
        let number = kind.into();
        let event = Event {
            seq: tick.seq,
            t_s,
            kind: number,
            x_m,
            vx_m_s,
            y_m,
            vy_m_s,
            foot_x_m,
            foot_y_m,
        };
        let time_ns = self.log_time_ns(t_s);
        frames.add(time_ns, &event);
        if self.display.is_some() && kind == EventKind::Fall {
            log::fall(time_ns, frames);
        }
    }

    fn close_apex(
        &mut self,
        answered: bool,
        command: &leg_control::wire::Command,
        frames: &mut FrameBuffer,
    ) {
        if let Some(apex) = self.unanswered.take() {
            let apex = Apex {
                answered,
                density_estimate: command.density_ratio.into(),
                seen_vx_m_s: command.apex_vx_m_s.into(),
                velocity_offset_m_s: command.velocity_offset_m_s.into(),
                ..apex
            };
            let time_ns = self.log_time_ns(apex.t_s);
            frames.add(time_ns, &apex);
            if self.display.is_some() {
                log::apex(&apex, time_ns, frames);
            }
        }
    }

    /// Draws the ground anew with the next picture, in a medium of this density.
    pub(super) fn redraw(&mut self, density_ratio: f64) {
        if let Some(display) = &mut self.display {
            display.redraw(density_ratio);
        }
    }

    /// Adds a message that does not come from the loop; the end of the run by
    /// [`end`](Self::end).
    pub(super) fn side(&self, message: &SideMessage, frames: &mut FrameBuffer) {
        match message {
            SideMessage::Policy(policy) => self.policy(policy, frames),
            SideMessage::SetPoint(set_point) => self.set_point(set_point, frames),
            SideMessage::Law(law) => self.law(law, frames),
            SideMessage::Loop(timing) => self.timing(timing, frames),
            SideMessage::End(_) => (),
        }
    }

    /// Adds a policy at the tick before which the controller received it.
    fn policy(&self, policy: &Policy, frames: &mut FrameBuffer) {
        let time_ns = self.tick_time_ns(policy.seq);
        frames.add(time_ns, policy);
        if self.display.is_some() {
            log::policy(policy, time_ns, frames);
        }
    }

    /// Adds a set-point at the tick before which the controller received it.
    fn set_point(&self, set_point: &SetPoint, frames: &mut FrameBuffer) {
        let time_ns = self.tick_time_ns(set_point.seq);
        frames.add(time_ns, set_point);
        if self.display.is_some() {
            log::set_point(*set_point, time_ns, frames);
        }
    }

    /// Adds how the control law runs, at the start of the recording.
    fn law(&self, law: &Law, frames: &mut FrameBuffer) {
        frames.add(self.started_unix_ns, law);
    }

    /// Adds the timing of a tick.
    fn timing(&self, timing: &Loop, frames: &mut FrameBuffer) {
        frames.add(self.tick_time_ns(timing.seq), timing);
    }

    /// Adds an apex that was never answered, and the result of the run after all else.
    pub(super) fn end(&mut self, end: Option<&End>, frames: &mut FrameBuffer) {
        if let Some(tick) = self.tick {
            self.close_apex(false, &tick.command, frames);
        }
        let Some(end) = end else { return };
        let time_ns = frames.latest_ns();
        if self.display.is_some() {
            log::end(end, time_ns, frames);
        }
        frames.add(time_ns, end);
    }
}

/// Returns the true state of the leg at a tick.
fn state(tick: &TickCopy) -> State {
    let (phase, foot_x_m, foot_y_m) = match tick.phase {
        leg_plant::Phase::Flight => (Phase::Flight, 0.0, 0.0),
        leg_plant::Phase::Stance { foot_x_m, foot_y_m } => (Phase::Stance, foot_x_m, foot_y_m),
        leg_plant::Phase::Fallen => (Phase::Fallen, 0.0, 0.0),
    };
    let leg_plant::Body { x_m, vx_m_s, y_m, vy_m_s } = tick.body;
    State {
        seq: tick.seq,
        x_m,
        vx_m_s,
        y_m,
        vy_m_s,
        phase: phase.into(),
        foot_x_m,
        foot_y_m,
        density_ratio: tick.density_ratio,
    }
}
