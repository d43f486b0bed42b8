//! Why the safe state of a controller holds, in words; and time stamps in another unit, which
//! no guard refuses, since real ones may come early, late and at any rate.
//!
//! The loop notes what it refuses, without waiting; a thread beside it prints the reason.

use std::fmt;
use std::time::{Duration, Instant};

use leg_control::guard::{Counts, Limits};
use leg_control::wire::{Command, Header, Sample, WIRE_VERSION};
use triple_buffer::{Input, Output, triple_buffer};

/// Time for which the safe state holds before it is reported, and between two reports.
const REPORT_EVERY: Duration = Duration::from_secs(1);

/// What the loop notes of a safe state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct SafeState {
    /// Run that this is of, counted by the loop, and whether it has ended.
    run: u64,
    has_ended: bool,
    /// Samples under it; 0 where it does not hold.
    samples: u64,
    /// Samples among them that were refused.
    refused: u64,
    last: Option<Refusal>,
    /// Successive samples whose time stamps do not advance by about a tick.
    odd: u64,
    /// By how much they advance, ns.
    step_ns: u64,
}

/// Successive samples with odd time stamps from which on they are reported.
const ODD: u64 = 100;

/// A sample that was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Refusal {
    /// Name of the reason, as in [`Counts::by_kind`].
    kind: &'static str,
    sample: Sample,
    /// The last sample that was not refused.
    good: Header,
}

/// The loop's end: call it once a tick.
#[derive(Debug)]
pub(super) struct SafeStateWatch {
    now: SafeState,
    counts: Counts,
    /// The sample before, and the last that was not refused.
    before: Header,
    good: Header,
    tick_ns: u64,
    out: Input<SafeState>,
}

/// The end of the thread that prints.
#[derive(Debug)]
pub(super) struct SafeStateReporter {
    input: Output<SafeState>,
    tick_ns: u64,
    /// Run that `since` is of.
    run: u64,
    /// When a safe state was last reported or, before, first seen; and its samples then.
    since: Option<(Instant, u64)>,
}

/// Returns both ends, for a controller of this rate.
pub(super) fn watch(rate_hz: u32) -> (SafeStateWatch, SafeStateReporter) {
    let (out, input) = triple_buffer(&SafeState::default());
    let tick_ns = 1_000_000_000 / u64::from(rate_hz.max(1));
    let watch = SafeStateWatch {
        now: SafeState::default(),
        counts: Counts::default(),
        before: Header::default(),
        good: Header::default(),
        tick_ns,
        out,
    };
    (watch, SafeStateReporter { input, tick_ns, run: 0, since: None })
}

impl SafeStateWatch {
    /// Notes what became of a tick. Never waits nor allocates.
    #[inline]
    pub(super) fn note(&mut self, sample: Option<&Sample>, command: &Command, counts: &Counts) {
        let Some(sample) = sample else { return };
        let is_refused = counts.rejected() != self.counts.rejected();
        let is_odd = self.is_odd(&sample.header);
        let is_unusual = is_refused || is_odd || command.is_safe();
        if is_unusual || self.now.samples > 0 || self.now.odd > 0 {
            self.note_unusual(sample, command, counts, is_refused, is_odd);
        } else {
            self.good = sample.header;
        }
        self.before = sample.header;
    }

    /// Returns whether the time since the sample before is far from a tick for each number.
    fn is_odd(&self, header: &Header) -> bool {
        let Header { run_id, seq, t_ns, .. } = self.before;
        let step_ns = header.t_ns.wrapping_sub(t_ns);
        header.run_id == run_id
            && header.seq == seq.wrapping_add(1)
            && !(self.tick_ns / 2..=self.tick_ns * 2).contains(&step_ns)
    }

    #[cold]
    fn note_unusual(
        &mut self,
        sample: &Sample,
        command: &Command,
        counts: &Counts,
        is_refused: bool,
        is_odd: bool,
    ) {
        if is_odd {
            self.now.step_ns = sample.header.t_ns.saturating_sub(self.before.t_ns);
            self.now.odd += 1;
        } else {
            self.now.odd = 0;
        }
        if is_refused {
            let before = self.counts.by_kind();
            let risen = counts.by_kind().into_iter().zip(before).find(|(now, then)| now.1 > then.1);
            let kind = risen.map_or("refused", |((kind, _), _)| kind);
            self.now.last = Some(Refusal { kind, sample: *sample, good: self.good });
            self.now.refused += u64::from(command.is_safe());
        } else {
            self.good = sample.header;
        }
        self.counts = *counts;
        if command.is_safe() {
            self.now.samples += 1;
        } else if self.now.samples > 0 {
            (self.now.samples, self.now.refused) = (0, 0);
        }
        self.out.write(self.now);
    }

    /// Notes that the run has ended, and forgets it.
    pub(super) fn restart(&mut self) {
        self.out.write(SafeState { has_ended: true, ..self.now });
        self.now = SafeState { run: self.now.run + 1, ..SafeState::default() };
        self.counts = Counts::default();
    }
}

impl SafeStateReporter {
    /// Returns a message once a second while the safe state holds and samples come, and one at
    /// the end of a run that ended in it before the next was due.
    pub(super) fn message(&mut self, now: Instant) -> Option<String> {
        let state = *self.input.read();
        if state.run != self.run {
            (self.run, self.since) = (state.run, None);
        }
        let samples = state.samples.max(if state.odd >= ODD { state.odd } else { 0 });
        if samples == 0 {
            self.since = None;
            return None;
        }
        let (since, reported) = *self.since.get_or_insert((now, 0));
        let is_due = state.has_ended || now.duration_since(since) >= REPORT_EVERY;
        if !is_due || samples <= reported {
            return None;
        }
        self.since = Some((now, samples));
        Some(Explained { state, tick_ns: self.tick_ns }.to_string())
    }
}

/// Formats the reason for a safe state.
struct Explained {
    state: SafeState,
    tick_ns: u64,
}

impl fmt::Display for Explained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let SafeState { samples, refused, last, odd, step_ns, .. } = self.state;
        if samples > 0 {
            write!(f, "safe state for {samples} samples: {refused} of them refused")?;
            match last {
                Some(refusal) if refused > 0 => write!(f, ", the last: {refusal}")?,
                _ => f.write_str("; no apex yet from which the leg falls")?,
            }
        }
        if odd < ODD {
            return Ok(());
        }
        let tick_ns = self.tick_ns;
        let separator = if samples > 0 { "; " } else { "" };
        write!(
            f,
            "{separator}the time stamps of the samples advance by {step_ns} ns a tick, in place of \
             {tick_ns} ns"
        )?;
        let is_times = |factor: u64| (step_ns * factor).abs_diff(tick_ns) < tick_ns / 100;
        match (is_times(1_000), is_times(1_000_000)) {
            (true, _) => f.write_str(": are they in microseconds?"),
            (_, true) => f.write_str(": are they in milliseconds?"),
            _ => Ok(()),
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, sample, good } = self;
        let Header { version, flags, run_id, seq, t_ns } = sample.header;
        match *kind {
            "version" => write!(f, "wire version {version} instead of {WIRE_VERSION}"),
            "no contact sense" => {
                write!(f, "neither contact nor leg length is sensed, by its flags {flags:#06x}")
            }
            "old run" => write!(f, "run id {run_id} is older than {}", good.run_id),
            "stale" => write!(f, "sequence number {seq} came again"),
            "out of order" if seq < good.seq => {
                write!(f, "sequence number {seq} is lower than {} before", good.seq)
            }
            "out of order" => write!(f, "stamp {t_ns} ns is not after {} ns before", good.t_ns),
            "gap" => write!(
                f,
                "stamp {t_ns} ns is {} ms after that before, of {} ns; at most {} ms are allowed",
                t_ns.saturating_sub(good.t_ns) as f64 / 1e6,
                good.t_ns,
                Limits::default().max_gap_ns / 1_000_000
            ),
            kind => {
                write!(f, "{kind}")?;
                let limits = Limits::default();
                let speed = [-limits.max_speed_m_s, limits.max_speed_m_s];
                for (name, value, [low, high]) in [
                    ("vx_m_s", sample.vx_m_s, speed),
                    ("y_m", sample.y_m, limits.height_m),
                    ("vy_m_s", sample.vy_m_s, speed),
                    ("leg_length_m", sample.leg_length_m, limits.leg_length_m),
                    ("density_ratio", sample.density_ratio, limits.density_ratio),
                ] {
                    if !(low..=high).contains(&value) {
                        write!(f, ": {name} is {value}, it must be from {low} to {high}")?;
                    }
                }
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_control::config::Config;
    use leg_control::policy::{Policy, SHIPPED};
    use leg_control::wire::flags;
    use leg_control::wire_controller::WireController;

    /// Returns the message after samples that `spoil` has changed, at 1 kHz.
    fn message(spoil: impl Fn(u64, &mut Sample)) -> Option<String> {
        let mut controller =
            WireController::new(Policy::parse(SHIPPED).unwrap(), Config::default());
        let (mut watch, mut reporter) = watch(1000);
        let start = Instant::now();
        assert_eq!(reporter.message(start), None);
        for seq in 0..=2 * ODD {
            let mut sample = Sample {
                header: Header {
                    version: WIRE_VERSION,
                    flags: flags::STATE_SENSED | flags::CONTACT_SENSED,
                    run_id: 1,
                    seq,
                    t_ns: seq * 1_000_000,
                },
                y_m: 2.0,
                // It rises: there is no apex yet.
                vy_m_s: 1.0,
                ..Sample::default()
            };
            spoil(seq, &mut sample);
            let command = controller.tick(Some(&sample));
            watch.note(Some(&sample), &command, controller.counts());
        }
        assert_eq!(reporter.message(start), None, "not at once");
        let message = reporter.message(start + REPORT_EVERY);
        assert_eq!(reporter.message(start + 3 * REPORT_EVERY), None, "no more samples came");
        message
    }

    /// Returns both ends after this many samples without contact.
    fn refused(samples: u64) -> (SafeStateWatch, SafeStateReporter) {
        let (mut watch, reporter) = watch(1000);
        refuse(&mut watch, samples);
        (watch, reporter)
    }

    fn refuse(watch: &mut SafeStateWatch, samples: u64) {
        let mut controller =
            WireController::new(Policy::parse(SHIPPED).unwrap(), Config::default());
        for seq in 0..samples {
            let header = Header {
                version: WIRE_VERSION,
                flags: flags::STATE_SENSED,
                run_id: 1,
                seq,
                t_ns: seq * 1_000_000,
            };
            let sample = Sample { header, y_m: 2.0, ..Sample::default() };
            let command = controller.tick(Some(&sample));
            watch.note(Some(&sample), &command, controller.counts());
        }
    }

    #[test]
    fn a_run_that_ends_within_a_second_is_explained_at_its_end_and_once() {
        let (mut watch, mut reporter) = refused(300);
        let start = Instant::now();
        assert_eq!(reporter.message(start), None);
        watch.restart();
        let message = reporter.message(start).unwrap();
        assert!(message.contains("300 of them refused, the last: neither contact"), "{message}");
        assert_eq!(reporter.message(start + 2 * REPORT_EVERY), None);
    }

    #[test]
    fn a_shorter_run_after_a_longer_one_is_explained_too() {
        let (mut watch, mut reporter) = refused(300);
        let start = Instant::now();
        assert_eq!(reporter.message(start), None);
        assert!(reporter.message(start + REPORT_EVERY).is_some());
        watch.restart();
        assert_eq!(reporter.message(start + REPORT_EVERY), None, "it was reported");
        refuse(&mut watch, 200);
        let start = start + REPORT_EVERY;
        assert_eq!(reporter.message(start), None);
        let message = reporter.message(start + REPORT_EVERY).unwrap();
        assert!(message.contains("safe state for 200 samples"), "{message}");
    }

    #[test]
    fn names_the_reason_of_the_last_refusal_with_value_and_limit() {
        type Spoil = fn(u64, &mut Sample);
        let cases: [(Spoil, &str); 9] = [
            (
                |_, s| s.header.version = 3,
                "201 of them refused, the last: wire version 3 instead of 2",
            ),
            (|_, s| s.header.flags = flags::STATE_SENSED, "by its flags 0x00e0"),
            (|_, s| s.vx_m_s = 51.0, "out of range: vx_m_s is 51, it must be from -50 to 50"),
            (|_, s| s.y_m = f32::NAN, "non-finite: y_m is NaN, it must be from 0 to 100"),
            (|seq, s| s.header.seq = seq / 100, "sequence number 1 came again"),
            (|seq, s| s.header.t_ns = seq * 30_000_000, "at most 20 ms are allowed"),
            (|seq, s| s.header.t_ns = 500 - seq, "stamp 300 ns is not after"),
            (|_, _| (), "0 of them refused; no apex yet"),
            (
                |seq, s| s.header.t_ns = seq,
                "by 1 ns a tick, in place of 1000000 ns: are they in milli",
            ),
        ];
        for (spoil, part) in cases {
            let message = message(spoil).expect(part);
            assert!(message.starts_with("safe state for "), "{message}");
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }

    #[test]
    fn time_stamps_in_another_unit_are_named_whatever_the_state() {
        let stamped = |step_ns: u64| {
            message(move |seq, sample| {
                sample.vy_m_s = -1.0;
                sample.header.t_ns = seq * step_ns;
            })
        };
        let named = stamped(1_000).expect("a message");
        assert!(
            named.contains("by 1000 ns a tick") && named.ends_with("in microseconds?"),
            "{named}"
        );
        let named = stamped(10_000_000).expect("a message");
        assert!(named.ends_with("by 10000000 ns a tick, in place of 1000000 ns"), "{named}");
        for fine_ns in [600_000, 1_000_000, 1_900_000] {
            assert_eq!(stamped(fine_ns), None, "{fine_ns}");
        }
    }

    #[test]
    fn a_controller_that_has_left_its_safe_state_has_nothing_to_report() {
        assert_eq!(message(|_, sample| sample.vy_m_s = -1.0), None);
    }
}
