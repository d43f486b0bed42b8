//! A zero-order hold: the command in force at the leg between two commands.

use leg_control::guard::stale_after_ticks;
use leg_control::wire::{Command, Header, WIRE_VERSION};

use leg_plant::LegCommand;

/// Holds the last valid command until the next one arrives.
///
/// The ramp of a held command continues, so a late command delays a change but
/// does not interrupt the push. Without a valid command for as long as the controller's
/// guard coasts ([`stale_after_ticks`]), and before the first, the safe command is in
/// force: leg upright, spring passive. A command older than that is not valid.
#[derive(Debug)]
pub(super) struct CommandHold {
    /// Ticks without a valid command after which the leg changes to the safe one.
    safe_after_ticks: u32,
    last: Option<Command>,
    silent_ticks: u32,
    /// Ticks without a new valid command.
    pub(super) held_ticks: u64,
    /// Times that the leg changed to its own safe command.
    pub(super) silences: u64,
    /// Commands that were rejected.
    pub(super) refused: u64,
}

impl CommandHold {
    /// Returns a hold without a command, for ticks of this length and this stale limit, ns.
    pub(super) fn new(tick_ns: u64, stale_limit_ns: u64) -> Self {
        let safe_after_ticks = stale_after_ticks(stale_limit_ns, tick_ns);
        let silent_ticks = safe_after_ticks;
        Self { safe_after_ticks, last: None, silent_ticks, held_ticks: 0, silences: 0, refused: 0 }
    }

    /// Discards the command in force, before another run.
    pub(super) fn reset(&mut self) {
        (self.last, self.silent_ticks) = (None, self.safe_after_ticks);
    }

    /// Takes the command that arrived in this tick, if any. Returns whether it is
    /// valid and now in force.
    pub(super) fn update(&mut self, now: &Header, fresh: Option<Command>) -> bool {
        if let Some(command) = fresh {
            if self.is_valid(now, &command) {
                self.last = Some(command);
                self.silent_ticks = 0;
                return true;
            }
            self.refused += 1;
        }
        self.held_ticks += 1;
        if self.silent_ticks < self.safe_after_ticks {
            self.silent_ticks += 1;
            self.silences += u64::from(self.silent_ticks == self.safe_after_ticks);
        }
        false
    }

    /// Returns whether a command is of this run, newer than the one in force, not
    /// too old, and finite.
    fn is_valid(&self, now: &Header, command: &Command) -> bool {
        let Header { version, run_id, seq, .. } = command.header;
        let values = [command.leg_angle_rad, command.elongation_m, command.elongation_rate_m_s];
        (version, run_id) == (WIRE_VERSION, now.run_id)
            && seq <= now.seq
            && now.seq - seq <= u64::from(self.safe_after_ticks)
            && self.last.is_none_or(|last| seq > last.header.seq)
            && values.iter().all(|value| value.is_finite())
    }

    fn current(&self) -> Option<&Command> {
        self.last.as_ref().filter(|_| self.silent_ticks < self.safe_after_ticks)
    }

    /// Returns the command in force as it arrived, or the leg's own safe command.
    pub(super) fn in_force(&self, now: &Header) -> Command {
        self.current().copied().unwrap_or_else(|| Command::safe(now))
    }

    /// Returns the command in force as the plant follows it from this tick on.
    /// Its ramp starts at the tick that it answers.
    pub(super) fn plant_command(&self, now: &Header) -> LegCommand {
        let command = self.in_force(now);
        let age_s = 1e-9 * now.t_ns.saturating_sub(command.header.t_ns) as f64;
        let rate_m_s = f64::from(command.elongation_rate_m_s);
        let start_m = f64::from(command.elongation_m);
        LegCommand {
            leg_angle_rad: command.leg_angle_rad.into(),
            elongation_m: if age_s > 0.0 { start_m + rate_m_s * age_s } else { start_m },
            elongation_rate_m_s: rate_m_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_control::guard::SAFE_AFTER_NS;

    fn at(seq: u64) -> Header {
        Header { version: WIRE_VERSION, flags: 0, run_id: 4, seq, t_ns: seq * 1_000_000 }
    }

    fn command(seq: u64) -> Command {
        Command {
            header: at(seq),
            leg_angle_rad: 1.5,
            elongation_m: -0.001,
            elongation_rate_m_s: 0.5,
            ..Command::default()
        }
    }

    #[test]
    fn a_held_command_stays_in_force_and_its_ramp_continues() {
        let mut hold = CommandHold::new(1_000_000, SAFE_AFTER_NS);
        assert_eq!(hold.in_force(&at(0)), Command::safe(&at(0)), "before the first");
        assert!(hold.update(&at(0), Some(command(0))));
        assert_eq!(hold.plant_command(&at(0)).elongation_m, f64::from(-0.001_f32));
        assert!(!hold.update(&at(1), None));
        assert_eq!(hold.in_force(&at(1)), command(0));
        let later = hold.plant_command(&at(4));
        assert!((later.elongation_m - 0.001).abs() < 1e-9, "{later:?}");
        assert_eq!((hold.held_ticks, hold.silences), (1, 0));
    }

    #[test]
    fn a_silent_controller_leaves_the_leg_safe_until_it_sends_again() {
        let mut hold = CommandHold::new(1_000_000, SAFE_AFTER_NS);
        hold.update(&at(0), Some(command(0)));
        let limit = u64::from(hold.safe_after_ticks);
        for seq in 1..limit {
            hold.update(&at(seq), None);
            assert_eq!(hold.in_force(&at(seq)), command(0), "tick {seq}");
        }
        for seq in limit..limit + 5 {
            hold.update(&at(seq), None);
            assert_eq!(hold.in_force(&at(seq)), Command::safe(&at(seq)));
        }
        assert_eq!((hold.silences, hold.held_ticks), (1, limit + 4));
        assert!(hold.update(&at(20), Some(command(19))), "a tick late, but valid");
        assert_eq!(hold.in_force(&at(20)), command(19));
    }

    #[test]
    fn gives_up_after_the_same_time_as_the_guard_at_every_rate() {
        for (tick_ns, ticks) in [(1_000_000, 10), (250_000, 40), (10_000_000, 3)] {
            let mut hold = CommandHold::new(tick_ns, SAFE_AFTER_NS);
            hold.update(&at(0), Some(command(0)));
            let safe_at = (1..100).find(|&seq| {
                hold.update(&at(seq), None);
                hold.in_force(&at(seq)).is_safe()
            });
            assert_eq!(safe_at, Some(ticks), "{tick_ns} ns");
        }
    }

    #[test]
    fn a_longer_stale_limit_accepts_and_holds_older_commands() {
        let mut hold = CommandHold::new(1_000_000, 600_000_000);
        assert!(hold.update(&at(600), Some(command(0))), "600 ms old");
        for seq in 601..1_200 {
            hold.update(&at(seq), None);
            assert_eq!(hold.in_force(&at(seq)), command(0), "tick {seq}");
        }
        hold.update(&at(1_200), None);
        assert!(hold.in_force(&at(1_200)).is_safe());
        let mut hold = CommandHold::new(1_000_000, 600_000_000);
        assert!(!hold.update(&at(601), Some(command(0))));
    }

    #[test]
    fn rejects_a_command_of_another_run_too_old_or_not_finite() {
        type Change = fn(&mut Command);
        let changes: [Change; 7] = [
            |c| c.header.version += 1,
            |c| c.header.run_id += 1,
            |c| c.header.seq = 51,
            |c| c.header.seq = 44,
            |c| c.leg_angle_rad = f32::NAN,
            |c| c.elongation_m = f32::INFINITY,
            |c| c.elongation_rate_m_s = f32::NEG_INFINITY,
        ];
        for (i, change) in changes.into_iter().enumerate() {
            let mut hold = CommandHold::new(1_000_000, SAFE_AFTER_NS);
            assert!(hold.update(&at(45), Some(command(45))));
            let mut bad = command(50);
            change(&mut bad);
            assert!(!hold.update(&at(50), Some(bad)), "change {i}");
            assert_eq!((hold.refused, hold.in_force(&at(50))), (1, command(45)), "change {i}");
        }
        let mut hold = CommandHold::new(1_000_000, SAFE_AFTER_NS);
        assert!(!hold.update(&at(30), Some(command(19))), "eleven ticks old");
        assert!(hold.update(&at(30), Some(command(20))));
    }
}
