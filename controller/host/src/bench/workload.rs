//! The measured work: an inference, and the ticks of a leg that falls and bounces.

use std::hint::black_box;

use leg_control::actor::{Actor, Observation};
use leg_control::config::Config;
use leg_control::policy::Policy;
use leg_control::wire::{Header, Sample, WIRE_VERSION, flags};
use leg_control::wire_controller::WireController;

/// The kinds of measured work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum WorkKind {
    /// One evaluation of the actor.
    Inference,
    /// A tick in flight, between two apexes.
    Flight,
    /// A tick in stance.
    Stance,
    /// A tick at an apex: density estimate, cascade and actor.
    Apex,
}

impl WorkKind {
    pub(super) const ALL: [Self; 4] = [Self::Inference, Self::Flight, Self::Stance, Self::Apex];

    /// Returns the name of the kind in JSON.
    pub(super) fn key(self) -> &'static str {
        match self {
            Self::Inference => "inference",
            Self::Flight => "tick_in_flight",
            Self::Stance => "tick_in_stance",
            Self::Apex => "tick_at_apex",
        }
    }
}

/// A controller just before a tick, and the tick's sample.
#[derive(Clone)]
pub(super) struct PreparedTick<'a> {
    controller: WireController<'a>,
    sample: Sample,
}

impl PreparedTick<'_> {
    /// Performs the tick.
    #[inline(never)]
    pub(super) fn run(&mut self) {
        black_box(self.controller.tick(black_box(Some(&self.sample))));
    }
}

/// Evaluates the actor for an apex in the middle of the shore.
#[inline(never)]
pub(super) fn infer(actor: &Actor<'_>) {
    let observation = Observation { apex_vx_m_s: 0.3, apex_y_m: 1.5, density_ratio: 0.4 };
    black_box(actor.act(black_box(observation)));
}

/// The ticks of several hops, by kind.
pub(super) struct TickSamples<'a> {
    flight: Vec<PreparedTick<'a>>,
    stance: Vec<PreparedTick<'a>>,
    apex: Vec<PreparedTick<'a>>,
}

impl<'a> TickSamples<'a> {
    /// Simulates an upright leg, 80 kg on 20,000 N/m, that falls from 1.3 m in air, at
    /// 1 kHz. The instruction counts of the firmware are taken over the same hops.
    pub(super) fn of(policy: &Policy<'a>) -> Self {
        const TICK_S: f32 = 1e-3;
        const TICKS: u64 = 3_000;
        let config = Config::at_rate(1_000).expect("a usual rate");
        let mut controller = WireController::new(policy.clone(), config);
        let mut ticks = Self { flight: Vec::new(), stance: Vec::new(), apex: Vec::new() };
        let mut apexes = 0;
        let (mut y_m, mut vy_m_s) = (1.3_f32, 0.0_f32);
        for seq in 0..TICKS {
            let stance = y_m < 1.0;
            let spring_m_s2 = if stance { 20_000.0 / 80.0 * (1.0 - y_m) } else { 0.0 };
            vy_m_s += TICK_S * (spring_m_s2 - 80.0 / 88.0 * 9.81);
            y_m += TICK_S * vy_m_s;
            let contact = if stance { flags::IN_CONTACT } else { 0 };
            let header = Header {
                version: WIRE_VERSION,
                flags: flags::STATE_SENSED | flags::CONTACT_SENSED | contact,
                run_id: 1,
                seq,
                t_ns: seq * 1_000_000,
            };
            let (set_point_m_s, vx_m_s) = (0.5, 0.4);
            let sample = Sample { header, set_point_m_s, vx_m_s, y_m, vy_m_s, ..Sample::default() };
            let tick = PreparedTick { controller: controller.clone(), sample };
            let command = controller.tick(Some(&sample));
            let kind = match (command.apexes > apexes, stance) {
                (true, _) => &mut ticks.apex,
                (false, true) => &mut ticks.stance,
                (false, false) => &mut ticks.flight,
            };
            kind.push(tick);
            apexes = command.apexes;
        }
        ticks
    }

    /// Returns all ticks of a kind, in order.
    pub(super) fn of_kind(&self, kind: WorkKind) -> &[PreparedTick<'a>] {
        match kind {
            WorkKind::Inference => &[],
            WorkKind::Flight => &self.flight,
            WorkKind::Stance => &self.stance,
            WorkKind::Apex => &self.apex,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_process::policy_file::PolicyFile;

    #[test]
    fn the_simulated_hops_contain_every_kind_of_tick() {
        let blob = PolicyFile::load(None).unwrap();
        let ticks = TickSamples::of(&blob.policy().unwrap());
        let count = |kind| ticks.of_kind(kind).len();
        assert!((3..10).contains(&count(WorkKind::Apex)), "{}", count(WorkKind::Apex));
        assert!(count(WorkKind::Flight) > 500 && count(WorkKind::Stance) > 500);
        assert_eq!(
            count(WorkKind::Flight) + count(WorkKind::Stance) + count(WorkKind::Apex),
            3_000
        );
    }
}
