//! Messages about changes of the peer and of the safe state.

use leg_control::guard::{safe_after_ticks, stale_after_ticks};

use super::tick_stats::{RxStatus, TickStats};
use crate::link::Role;

/// How the peer went away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Gone {
    /// It fell silent in the middle of its run.
    Silent,
    /// It announced the end of its run.
    EndOfRun,
}

/// Finds the changes that the user should know about in the sequence of tick records,
/// and reports each once.
#[derive(Debug)]
pub(super) struct Transitions {
    role: Role,
    /// Silence after which the peer is reported as lost, ns: the same after which leg and
    /// controller use their safe command.
    lost_after_ns: u64,
    tick_ns: u64,
    run_id: u32,
    /// When the last message of the peer arrived.
    received_ns: Option<u64>,
    /// Ticks since then.
    stale_ticks: u64,
    /// How the peer went away; reported.
    gone: Option<Gone>,
    /// Whether a command other than the safe one was in force in this run.
    was_active: bool,
    /// Since when a safe command is in force although the peer sends; reported.
    safe_since_ns: Option<u64>,
}

impl Transitions {
    pub(super) fn new(role: Role, rate_hz: u32) -> Self {
        let tick_ns = 1_000_000_000 / u64::from(rate_hz.max(1));
        Self {
            role,
            tick_ns,
            lost_after_ns: u64::from(safe_after_ticks(tick_ns)) * tick_ns,
            run_id: 0,
            received_ns: None,
            stale_ticks: 0,
            gone: None,
            was_active: false,
            safe_since_ns: None,
        }
    }

    /// Returns the same for messages that count for nothing from this age on, ns.
    pub(super) fn with_stale_limit(self, stale_limit_ns: u64) -> Self {
        let ticks = stale_after_ticks(stale_limit_ns, self.tick_ns);
        Self { lost_after_ns: u64::from(ticks) * self.tick_ns, ..self }
    }

    /// Processes the record of a tick. Returns the message about a change.
    pub(super) fn update(&mut self, tick: &TickStats) -> Option<String> {
        let peer = self.role.peer();
        match tick.rx {
            RxStatus::EndOfRun => {
                (self.gone, self.received_ns) = (Some(Gone::EndOfRun), Some(tick.woke_ns));
                (self.was_active, self.safe_since_ns) = (false, None);
                Some(format!("the run of the {peer} is over: safe command until the next begins"))
            }
            // Follows the end of a run.
            RxStatus::Idle if self.gone == Some(Gone::EndOfRun) => None,
            RxStatus::Idle => {
                (self.received_ns, self.was_active, self.safe_since_ns) = (None, false, None);
                self.gone.take().map(|_| format!("the run of the {peer} is over"))
            }
            RxStatus::Stale => {
                let silent_ns = tick.woke_ns.saturating_sub(self.received_ns?);
                self.stale_ticks += 1;
                let is_lost = tick.safe && silent_ns >= self.lost_after_ns;
                (is_lost && self.gone.is_none()).then(|| {
                    self.gone = Some(Gone::Silent);
                    (self.was_active, self.safe_since_ns) = (false, None);
                    let ms = 1e-6 * silent_ns as f64;
                    let ticks = self.stale_ticks;
                    format!(
                        "no message from the {peer} for {ms:.0} ms, {ticks} ticks: safe command \
                         until it sends again"
                    )
                })
            }
            RxStatus::New => {
                let before_ns = self.received_ns.replace(tick.woke_ns);
                self.stale_ticks = 0;
                if tick.run_id != self.run_id {
                    (self.run_id, self.was_active, self.safe_since_ns) = (tick.run_id, false, None);
                }
                if self.gone.take().is_some() {
                    let silent_ns = tick.woke_ns - before_ns.unwrap_or(tick.woke_ns);
                    let s = 1e-9 * silent_ns as f64;
                    return Some(format!("the {peer} sends again after {s:.3} s"));
                }
                self.update_rejection(tick)
            }
        }
    }

    /// Reports when the guard of a controller starts or stops rejecting the samples of
    /// a peer that sends.
    fn update_rejection(&mut self, tick: &TickStats) -> Option<String> {
        if self.role != Role::Controller {
            return None;
        }
        match (tick.safe, self.safe_since_ns) {
            (true, None) if self.was_active => {
                self.safe_since_ns = Some(tick.woke_ns);
                let peer = Role::Leg;
                Some(format!(
                    "the samples of the {peer} are rejected: safe command until valid ones arrive"
                ))
            }
            (false, since_ns) => {
                (self.was_active, self.safe_since_ns) = (true, None);
                since_ns.map(|since_ns| {
                    let s = 1e-9 * (tick.woke_ns - since_ns) as f64;
                    format!("valid samples again after {s:.3} s")
                })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn update(transitions: &mut Transitions, ms: u64, rx: RxStatus, safe: bool) -> Option<String> {
        let tick = TickStats { woke_ns: ms * 1_000_000, rx, safe, ..TickStats::default() };
        transitions.update(&tick)
    }

    #[test]
    fn the_loss_and_the_return_of_a_peer_are_reported_once() {
        let mut transitions = Transitions::new(Role::Leg, 1000);
        for ms in 0..30 {
            let message = update(&mut transitions, ms, RxStatus::Idle, true);
            assert_eq!(message, None, "no peer has connected yet");
        }
        assert_eq!(update(&mut transitions, 30, RxStatus::New, false), None);
        let messages: Vec<_> = (31..100)
            .filter_map(|ms| update(&mut transitions, ms, RxStatus::Stale, ms >= 40))
            .collect();
        assert_eq!(
            messages,
            [
                "no message from the controller for 10 ms, 10 ticks: safe command until it sends again"
            ]
        );
        let messages: Vec<_> = (100..200)
            .filter_map(|ms| update(&mut transitions, ms, RxStatus::New, false))
            .collect();
        assert_eq!(messages, ["the controller sends again after 0.070 s"]);
    }

    #[test]
    fn the_end_of_a_run_and_the_start_of_the_next_are_reported_once() {
        let mut transitions = Transitions::new(Role::Controller, 1000);
        let mut messages = Vec::new();
        for ms in 0..100 {
            messages.extend(update(&mut transitions, ms, RxStatus::New, false));
        }
        messages.extend(update(&mut transitions, 100, RxStatus::EndOfRun, false));
        for ms in 101..300 {
            messages.extend(update(&mut transitions, ms, RxStatus::Idle, false));
        }
        for ms in 300..400 {
            messages.extend(update(&mut transitions, ms, RxStatus::New, false));
        }
        assert_eq!(
            messages,
            [
                "the run of the simulator is over: safe command until the next begins",
                "the simulator sends again after 0.200 s"
            ]
        );
    }

    #[test]
    fn rejected_samples_are_reported_once_and_not_at_the_start() {
        let mut transitions = Transitions::new(Role::Controller, 1000);
        let mut messages = Vec::new();
        for ms in 0..300 {
            // Safe at the start, before the density is estimated, and once in between.
            let safe = ms < 8 || (100..150).contains(&ms);
            messages.extend(update(&mut transitions, ms, RxStatus::New, safe));
        }
        assert_eq!(
            messages,
            [
                "the samples of the simulator are rejected: safe command until valid ones arrive",
                "valid samples again after 0.050 s"
            ]
        );
    }
}
