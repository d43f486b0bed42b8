//! What is measured: an inference, and ticks of a leg that falls, bounces and
//! falls again.

use std::hint::black_box;

use leg_control::actor::{Actor, Observation};
use leg_control::config::Config;
use leg_control::policy::Policy;
use leg_control::wire::{Header, Sample, WIRE_VERSION, flags};
use leg_control::wire_controller::WireController;

/// The kinds of work that are told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// The actor alone.
    Inference,
    /// A tick in the air, between two decisions.
    Flight,
    /// A tick on the ground.
    Stance,
    /// A tick that finds an apex: estimate, cascade and actor.
    Apex,
}

impl Kind {
    pub(super) const ALL: [Self; 4] = [Self::Inference, Self::Flight, Self::Stance, Self::Apex];

    /// Its name for scripts.
    pub(super) fn key(self) -> &'static str {
        match self {
            Self::Inference => "inference",
            Self::Flight => "tick_in_flight",
            Self::Stance => "tick_in_stance",
            Self::Apex => "tick_at_apex",
        }
    }
}

/// A controller just before a tick of some kind, and the tick's sample.
#[derive(Clone)]
pub(super) struct Moment<'a> {
    controller: WireController<'a>,
    sample: Sample,
}

impl Moment<'_> {
    /// The tick.
    #[inline(never)]
    pub(super) fn pass(&mut self) {
        black_box(self.controller.tick(black_box(Some(&self.sample))));
    }
}

/// The actor at work on what it sees in mid-shore.
#[inline(never)]
pub(super) fn infer(actor: &Actor<'_>) {
    let seen = Observation { apex_vx_m_s: 0.3, apex_y_m: 1.5, density_ratio: 0.4 };
    black_box(actor.act(black_box(seen)));
}

/// The ticks of some hops.
pub(super) struct Ticks<'a> {
    flight: Vec<Moment<'a>>,
    stance: Vec<Moment<'a>>,
    apex: Vec<Moment<'a>>,
}

impl<'a> Ticks<'a> {
    /// A leg that stands upright, 80 kg on 20,000 N/m, falls from 1.3 m in air,
    /// at 1 kHz: the hops that the firmware's instructions are counted over.
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
                flags: flags::CONTACT_SENSED | contact,
                run_id: 1,
                seq,
                t_ns: seq * 1_000_000,
            };
            let (set_point_m_s, vx_m_s) = (0.5, 0.4);
            let sample = Sample { header, set_point_m_s, vx_m_s, y_m, vy_m_s, ..Sample::default() };
            let moment = Moment { controller: controller.clone(), sample };
            let command = controller.tick(Some(&sample));
            let kind = match (command.apexes > apexes, stance) {
                (true, _) => &mut ticks.apex,
                (false, true) => &mut ticks.stance,
                (false, false) => &mut ticks.flight,
            };
            kind.push(moment);
            apexes = command.apexes;
        }
        ticks
    }

    /// All of a kind, in their order.
    pub(super) fn of_kind(&self, kind: Kind) -> &[Moment<'a>] {
        match kind {
            Kind::Inference => &[],
            Kind::Flight => &self.flight,
            Kind::Stance => &self.stance,
            Kind::Apex => &self.apex,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_process::policy_file::PolicyFile;

    #[test]
    fn the_leg_hops_and_every_kind_of_tick_is_there() {
        let blob = PolicyFile::load(None).unwrap();
        let ticks = Ticks::of(&blob.policy().unwrap());
        let count = |kind| ticks.of_kind(kind).len();
        assert!((3..10).contains(&count(Kind::Apex)), "{}", count(Kind::Apex));
        assert!(count(Kind::Flight) > 500 && count(Kind::Stance) > 500);
        assert_eq!(count(Kind::Flight) + count(Kind::Stance) + count(Kind::Apex), 3_000);
    }
}
