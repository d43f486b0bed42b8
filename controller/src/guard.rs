//! The door: nothing unchecked comes past it, and it decides when to give up.
//!
//! A sample is used only if it is of this wire version, finite, in range, says
//! where the foot is, and follows the last one. What fails is counted by kind.
//! One bad tick is bridged by continuing the last command ([`Verdict::Coast`]);
//! after [`Limits::safe_after_ticks`] in a row the leg gets the safe command
//! ([`Verdict::Safe`]) until [`Limits::recover_after_ticks`] good samples have
//! come in a row. In the safe state the guard forgets where the run was, run id
//! included, so that no single corrupt number can lock the true ones out.

use crate::wire::{Header, Sample, WIRE_VERSION, flags};

/// What a sample must satisfy.
///
/// The defaults leave room around a human-size leg: it lands at 15 m/s from the
/// highest starts of the training (12 m) and runs at up to 25 m/s; ten ticks at
/// 1 kHz are a twentieth of a stance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest speed in either direction, and largest set-point, m/s.
    pub max_speed_m_s: f32,
    /// Lowest and highest mass above the ground, m.
    pub height_m: [f32; 2],
    /// Shortest and longest leg, m.
    pub leg_length_m: [f32; 2],
    /// Lowest and highest sensed density ratio.
    pub density_ratio: [f32; 2],
    /// Longest time between two samples, ns.
    pub max_gap_ns: u64,
    /// Bad ticks in a row after which the leg gets the safe command.
    pub safe_after_ticks: u32,
    /// Good samples in a row that end the safe state.
    pub recover_after_ticks: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_speed_m_s: 50.0,
            height_m: [0.0, 100.0],
            leg_length_m: [0.0, 10.0],
            density_ratio: [0.0, 2.0],
            max_gap_ns: 20_000_000,
            safe_after_ticks: 10,
            recover_after_ticks: 3,
        }
    }
}

/// Why a tick brought nothing to go by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reject {
    /// No sample came.
    Missing,
    /// The sender speaks another wire version.
    Version,
    /// A figure is NaN or infinite.
    NonFinite,
    /// A figure is outside its [`Limits`].
    OutOfRange,
    /// Neither contact nor leg length is sensed.
    NoContactSense,
    /// It belongs to an earlier run.
    OldRun,
    /// The same tick again.
    Stale,
    /// A tick, or a time, before the last one.
    OutOfOrder,
    /// Longer after the last one than [`Limits::max_gap_ns`].
    Gap,
}

/// Rejected ticks by kind, since the run's start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// [`Reject::Missing`].
    pub missing: u32,
    /// [`Reject::Version`].
    pub version: u32,
    /// [`Reject::NonFinite`].
    pub non_finite: u32,
    /// [`Reject::OutOfRange`].
    pub out_of_range: u32,
    /// [`Reject::NoContactSense`].
    pub no_contact_sense: u32,
    /// [`Reject::OldRun`].
    pub old_run: u32,
    /// [`Reject::Stale`].
    pub stale: u32,
    /// [`Reject::OutOfOrder`].
    pub out_of_order: u32,
    /// [`Reject::Gap`].
    pub gap: u32,
    /// Times that the safe state was entered.
    pub safe_entered: u32,
}

impl Counts {
    fn add(&mut self, reject: Reject) {
        let count = match reject {
            Reject::Missing => &mut self.missing,
            Reject::Version => &mut self.version,
            Reject::NonFinite => &mut self.non_finite,
            Reject::OutOfRange => &mut self.out_of_range,
            Reject::NoContactSense => &mut self.no_contact_sense,
            Reject::OldRun => &mut self.old_run,
            Reject::Stale => &mut self.stale,
            Reject::OutOfOrder => &mut self.out_of_order,
            Reject::Gap => &mut self.gap,
        };
        *count = count.saturating_add(1);
    }

    /// Rejected ticks of every kind.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        [
            self.missing,
            self.version,
            self.non_finite,
            self.out_of_range,
            self.no_contact_sense,
            self.old_run,
            self.stale,
            self.out_of_order,
            self.gap,
        ]
        .into_iter()
        .fold(0, u32::saturating_add)
    }

    /// Each kind with its name, for tables.
    #[must_use]
    pub fn by_kind(&self) -> [(&'static str, u32); 9] {
        [
            ("missing", self.missing),
            ("version", self.version),
            ("non-finite", self.non_finite),
            ("out of range", self.out_of_range),
            ("no contact sense", self.no_contact_sense),
            ("old run", self.old_run),
            ("stale", self.stale),
            ("out of order", self.out_of_order),
            ("gap", self.gap),
        ]
    }
}

/// A sample that has passed the guard. Only the guard makes one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trusted(Sample);

impl Trusted {
    /// The sample.
    #[must_use]
    pub fn sample(&self) -> &Sample {
        &self.0
    }

    pub(crate) fn has(&self, flag: u16) -> bool {
        self.0.header.flags & flag != 0
    }
}

/// What to do in this tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// Go by this sample; it follows the last one.
    Use(Trusted),
    /// Go by this sample, and forget all before it: a new run, or a recovery.
    Restart(Trusted),
    /// Nothing to go by: continue the last command.
    Coast,
    /// Nothing to go by for too long: the safe command.
    Safe,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Good so far, or this many bad ticks in a row.
    Running { bad_ticks: u32 },
    /// In the safe command, with this many good samples in a row.
    Safe { good_ticks: u32 },
}

/// The guard and its memory.
#[derive(Clone, Debug)]
pub struct Guard {
    limits: Limits,
    state: State,
    /// The last good sample; forgotten in the safe state.
    last: Option<Header>,
    /// Of the last good sample ever: whose counts these are.
    run_id: Option<u32>,
    counts: Counts,
}

impl Guard {
    /// A guard that starts in the safe state but trusts the first good sample.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        let state = State::Safe { good_ticks: limits.recover_after_ticks.saturating_sub(1) };
        Self { limits, state, last: None, run_id: None, counts: Counts::default() }
    }

    /// What was rejected so far.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Judges this tick's sample, or that there is none.
    pub fn judge(&mut self, sample: Option<&Sample>) -> Verdict {
        match self.check(sample) {
            Ok(sample) => self.accept(sample),
            Err(reject) => self.reject(reject),
        }
    }

    fn accept(&mut self, sample: Sample) -> Verdict {
        self.last = Some(sample.header);
        let run_id = self.run_id.replace(sample.header.run_id);
        let new_run = run_id.is_some_and(|run_id| run_id != sample.header.run_id);
        if new_run {
            self.counts = Counts::default();
        }
        match self.state {
            State::Safe { good_ticks } if good_ticks + 1 < self.limits.recover_after_ticks => {
                self.state = State::Safe { good_ticks: good_ticks + 1 };
                Verdict::Safe
            }
            State::Running { .. } if !new_run => {
                self.state = State::Running { bad_ticks: 0 };
                Verdict::Use(Trusted(sample))
            }
            State::Running { .. } | State::Safe { .. } => {
                self.state = State::Running { bad_ticks: 0 };
                Verdict::Restart(Trusted(sample))
            }
        }
    }

    fn reject(&mut self, reject: Reject) -> Verdict {
        self.counts.add(reject);
        let bad_ticks = match self.state {
            State::Running { bad_ticks } => bad_ticks.saturating_add(1),
            State::Safe { .. } => self.limits.safe_after_ticks,
        };
        if bad_ticks < self.limits.safe_after_ticks {
            self.state = State::Running { bad_ticks };
            return Verdict::Coast;
        }
        if matches!(self.state, State::Running { .. }) {
            self.counts.safe_entered = self.counts.safe_entered.saturating_add(1);
        }
        self.state = State::Safe { good_ticks: 0 };
        self.last = None;
        Verdict::Safe
    }

    fn check(&self, sample: Option<&Sample>) -> Result<Sample, Reject> {
        let sample = *sample.ok_or(Reject::Missing)?;
        if sample.header.version != WIRE_VERSION {
            return Err(Reject::Version);
        }
        self.check_figures(&sample)?;
        self.check_order(&sample.header)?;
        Ok(sample)
    }

    fn check_figures(&self, sample: &Sample) -> Result<(), Reject> {
        let has = |flag| sample.header.flags & flag != 0;
        if !has(flags::CONTACT_SENSED) && !has(flags::LEG_LENGTH_SENSED) {
            return Err(Reject::NoContactSense);
        }
        let l = &self.limits;
        let speeds = [-l.max_speed_m_s, l.max_speed_m_s];
        let figures = [
            (true, sample.set_point_m_s, speeds),
            (true, sample.vx_m_s, speeds),
            (true, sample.vy_m_s, speeds),
            (true, sample.y_m, l.height_m),
            (has(flags::LEG_LENGTH_SENSED), sample.leg_length_m, l.leg_length_m),
            (has(flags::DENSITY_SENSED), sample.density_ratio, l.density_ratio),
        ];
        let sensed = figures.iter().filter(|(is_sensed, ..)| *is_sensed);
        if !sensed.clone().all(|(_, x, _)| x.is_finite()) {
            return Err(Reject::NonFinite);
        }
        if !sensed.clone().all(|(_, x, [low, high])| low <= x && x <= high) {
            return Err(Reject::OutOfRange);
        }
        Ok(())
    }

    fn check_order(&self, header: &Header) -> Result<(), Reject> {
        let Some(last) = self.last else { return Ok(()) };
        if header.run_id != last.run_id {
            // Run ids only rise; half the range counts as the past, so that they may wrap.
            let newer = header.run_id.wrapping_sub(last.run_id) < u32::MAX / 2;
            return if newer { Ok(()) } else { Err(Reject::OldRun) };
        }
        if header.seq == last.seq {
            return Err(Reject::Stale);
        }
        if header.seq < last.seq || header.t_ns <= last.t_ns {
            return Err(Reject::OutOfOrder);
        }
        if header.t_ns - last.t_ns > self.limits.max_gap_ns {
            return Err(Reject::Gap);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample(seq: u64) -> Sample {
        Sample {
            header: Header {
                version: WIRE_VERSION,
                flags: flags::CONTACT_SENSED,
                run_id: 1,
                seq,
                t_ns: seq * 1_000_000,
            },
            y_m: 2.0,
            ..Default::default()
        }
    }

    fn running() -> Guard {
        let mut guard = Guard::new(Limits::default());
        assert!(matches!(guard.judge(Some(&sample(100))), Verdict::Restart(_)));
        guard
    }

    fn rejected_as(change: impl Fn(&mut Sample)) -> &'static str {
        let mut guard = running();
        let mut bad = sample(101);
        change(&mut bad);
        assert_eq!(guard.judge(Some(&bad)), Verdict::Coast);
        assert_eq!(guard.counts().rejected(), 1);
        guard.counts().by_kind().iter().find(|(_, n)| *n == 1).unwrap().0
    }

    #[test]
    fn each_kind_of_bad_sample_is_counted_as_what_it_is() {
        assert_eq!(rejected_as(|s| s.header.version = 9), "version");
        assert_eq!(rejected_as(|s| s.vx_m_s = f32::NAN), "non-finite");
        assert_eq!(rejected_as(|s| s.set_point_m_s = f32::INFINITY), "non-finite");
        assert_eq!(rejected_as(|s| s.y_m = -0.5), "out of range");
        assert_eq!(rejected_as(|s| s.vy_m_s = 51.0), "out of range");
        assert_eq!(rejected_as(|s| s.header.flags = 0), "no contact sense");
        assert_eq!(rejected_as(|s| s.header.run_id = 0), "old run");
        assert_eq!(rejected_as(|s| s.header.seq = 100), "stale");
        assert_eq!(rejected_as(|s| s.header.seq = 99), "out of order");
        assert_eq!(rejected_as(|s| s.header.t_ns = 5), "out of order");
        assert_eq!(rejected_as(|s| s.header.t_ns += 30_000_000), "gap");
    }

    #[test]
    fn what_is_not_sensed_is_not_judged() {
        let mut guard = running();
        let unsensed = Sample { leg_length_m: f32::NAN, density_ratio: -7.0, ..sample(101) };
        assert!(matches!(guard.judge(Some(&unsensed)), Verdict::Use(_)));
    }

    #[test]
    fn silence_leads_to_the_safe_command_and_good_samples_back() {
        let mut guard = running();
        let limits = Limits::default();
        for _ in 1..limits.safe_after_ticks {
            assert_eq!(guard.judge(None), Verdict::Coast);
        }
        assert_eq!(guard.judge(None), Verdict::Safe);
        assert_eq!(guard.counts().missing, limits.safe_after_ticks);
        assert_eq!(guard.counts().safe_entered, 1);
        assert_eq!(guard.judge(Some(&sample(900))), Verdict::Safe);
        assert_eq!(guard.judge(Some(&sample(901))), Verdict::Safe);
        assert!(matches!(guard.judge(Some(&sample(902))), Verdict::Restart(_)));
        assert!(matches!(guard.judge(Some(&sample(903))), Verdict::Use(_)));
    }

    #[test]
    fn a_corrupt_sequence_number_does_not_lock_out_the_true_ones() {
        let mut guard = running();
        let mut far = sample(101);
        far.header.seq = u64::MAX;
        assert!(matches!(guard.judge(Some(&far)), Verdict::Use(_)));
        let after =
            (102..130).position(|k| matches!(guard.judge(Some(&sample(k))), Verdict::Restart(_)));
        let limits = Limits::default();
        let expected = limits.safe_after_ticks + limits.recover_after_ticks - 1;
        assert_eq!(after, Some(expected as usize));
    }

    #[test]
    fn a_new_epoch_restarts_with_counters_at_zero() {
        let mut guard = running();
        guard.judge(None);
        let mut new = sample(0);
        new.header.run_id = 2;
        assert!(matches!(guard.judge(Some(&new)), Verdict::Restart(_)));
        assert_eq!(guard.counts().rejected(), 0);
    }

    #[test]
    fn a_new_epoch_after_silence_counts_from_zero_and_must_be_trusted_anew() {
        let mut guard = running();
        for _ in 0..20 {
            guard.judge(None);
        }
        let of_run = |run_id, seq| {
            let mut new = sample(seq);
            new.header.run_id = run_id;
            new
        };
        assert_eq!(guard.judge(Some(&of_run(2, 0))), Verdict::Safe);
        assert_eq!(guard.counts().rejected(), 0);
        assert_eq!(guard.judge(Some(&of_run(2, 1))), Verdict::Safe);
        assert!(matches!(guard.judge(Some(&of_run(2, 2))), Verdict::Restart(_)));
        // Now that it runs again, the run before is the past.
        assert_eq!(guard.judge(Some(&of_run(1, 3))), Verdict::Coast);
        assert_eq!(guard.counts().old_run, 1);
    }

    proptest! {
        #[test]
        fn what_is_used_is_finite_and_in_range(figures in prop::collection::vec(any::<u32>(), 6),
            flags in any::<u16>(), seq in any::<u64>(), t_ns in any::<u64>()) {
            let f = |i: usize| f32::from_bits(figures[i]);
            let header = Header { version: WIRE_VERSION, flags, run_id: 1, seq, t_ns };
            let any = Sample { header, set_point_m_s: f(0), vx_m_s: f(1), y_m: f(2), vy_m_s: f(3),
                leg_length_m: f(4), density_ratio: f(5) };
            let mut guard = Guard::new(Limits::default());
            if let Verdict::Restart(t) | Verdict::Use(t) = guard.judge(Some(&any)) {
                let s = t.sample();
                prop_assert!(s.vx_m_s.abs() <= 50.0 && s.vy_m_s.abs() <= 50.0);
                prop_assert!((0.0..=100.0).contains(&s.y_m) && s.set_point_m_s.abs() <= 50.0);
            }
        }
    }
}
