//! The command in force at the leg, also when the next one is late.

use leg_control::wire::{Command, Header, WIRE_VERSION};

use leg_plant::LegCommand;

/// Ticks without a command that counts after which the leg takes the safe one
/// by itself; a command older than this counts no more. As many as the
/// controller's guard bridges without a sample.
pub const SAFE_AFTER_TICKS: u32 = 10;

/// What the leg holds on to between two commands.
///
/// A command's ramp goes on until the next one comes: a late command costs the
/// leg a change of plan, not its push. Without any for [`SAFE_AFTER_TICKS`], and
/// before the first, the leg stands upright and passive.
#[derive(Debug)]
pub(super) struct Held {
    last: Option<Command>,
    silent_ticks: u32,
    /// Ticks for which none came that counts.
    pub(super) ticks: u64,
    /// Times that the leg took its own safe command.
    pub(super) silences: u64,
    /// Commands that do not count.
    pub(super) refused: u64,
}

impl Default for Held {
    fn default() -> Self {
        let silent_ticks = SAFE_AFTER_TICKS;
        Self { last: None, silent_ticks, ticks: 0, silences: 0, refused: 0 }
    }
}

impl Held {
    /// Before another run: no command of this one is in force any more.
    pub(super) fn forget(&mut self) {
        (self.last, self.silent_ticks) = (None, SAFE_AFTER_TICKS);
    }

    /// Takes in what came for this tick, if anything did; whether it counts.
    pub(super) fn take(&mut self, now: &Header, fresh: Option<Command>) -> bool {
        if let Some(command) = fresh {
            if self.counts(now, &command) {
                self.last = Some(command);
                self.silent_ticks = 0;
                return true;
            }
            self.refused += 1;
        }
        self.ticks += 1;
        if self.silent_ticks < SAFE_AFTER_TICKS {
            self.silent_ticks += 1;
            self.silences += u64::from(self.silent_ticks == SAFE_AFTER_TICKS);
        }
        false
    }

    /// Whether a command is for this run, not older than the one in force, not
    /// too old, and can be followed.
    fn counts(&self, now: &Header, command: &Command) -> bool {
        let Header { version, run_id, seq, .. } = command.header;
        let figures = [command.leg_angle_rad, command.elongation_m, command.elongation_rate_m_s];
        (version, run_id) == (WIRE_VERSION, now.run_id)
            && seq <= now.seq
            && now.seq - seq <= u64::from(SAFE_AFTER_TICKS)
            && self.last.is_none_or(|last| seq > last.header.seq)
            && figures.iter().all(|figure| figure.is_finite())
    }

    fn current(&self) -> Option<&Command> {
        self.last.as_ref().filter(|_| self.silent_ticks < SAFE_AFTER_TICKS)
    }

    /// The command in force, as it came, or the leg's own safe one.
    pub(super) fn in_force(&self, now: &Header) -> Command {
        self.current().copied().unwrap_or_else(|| Command::safe(now))
    }

    /// The same as the plant follows it from this tick on: its ramp counts from
    /// the tick that it answers.
    pub(super) fn acting(&self, now: &Header) -> LegCommand {
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
    fn a_late_command_stays_in_force_and_its_ramp_goes_on() {
        let mut held = Held::default();
        assert_eq!(held.in_force(&at(0)), Command::safe(&at(0)), "before the first");
        assert!(held.take(&at(0), Some(command(0))));
        assert_eq!(held.acting(&at(0)).elongation_m, f64::from(-0.001_f32));
        assert!(!held.take(&at(1), None));
        assert_eq!(held.in_force(&at(1)), command(0));
        let later = held.acting(&at(4));
        assert!((later.elongation_m - 0.001).abs() < 1e-9, "{later:?}");
        assert_eq!((held.ticks, held.silences), (1, 0));
    }

    #[test]
    fn a_silent_controller_leaves_the_leg_safe_after_ten_ticks_and_is_heard_again() {
        let mut held = Held::default();
        held.take(&at(0), Some(command(0)));
        let limit = u64::from(SAFE_AFTER_TICKS);
        for seq in 1..limit {
            held.take(&at(seq), None);
            assert_eq!(held.in_force(&at(seq)), command(0), "tick {seq}");
        }
        for seq in limit..limit + 5 {
            held.take(&at(seq), None);
            assert_eq!(held.in_force(&at(seq)), Command::safe(&at(seq)));
        }
        assert_eq!((held.silences, held.ticks), (1, limit + 4));
        assert!(held.take(&at(20), Some(command(19))), "a tick late, but of this run");
        assert_eq!(held.in_force(&at(20)), command(19));
    }

    #[test]
    fn what_cannot_be_followed_does_not_count() {
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
            let mut held = Held::default();
            assert!(held.take(&at(45), Some(command(45))));
            let mut bad = command(50);
            change(&mut bad);
            assert!(!held.take(&at(50), Some(bad)), "change {i}");
            assert_eq!((held.refused, held.in_force(&at(50))), (1, command(45)), "change {i}");
        }
        let mut held = Held::default();
        assert!(!held.take(&at(30), Some(command(19))), "eleven ticks old");
        assert!(held.take(&at(30), Some(command(20))));
    }
}
