//! Checks every measurement before anything is computed from it, and decides when to
//! give up.
//!
//! A measurement is used only if it is finite, in range, and later than the last one.
//! Rejected ones are counted by reason. One tick without a usable measurement is bridged
//! by continuing the last command ([`Verdict::Coast`]); after [`SAFE_AFTER_NS`] in a row
//! the leg gets the safe command ([`Verdict::Safe`]) until
//! [`Limits::recover_after_ticks`] good measurements have come in a row. In the safe
//! state the guard forgets the time of the last measurement, so that no single corrupt
//! time stamp can lock the true ones out.

use crate::measurement::{Contact, Measurement};

/// Time without a usable measurement after which the leg gets the safe command, ns: a
/// twentieth of a stance of the human-size leg. The one such constant: whoever holds a
/// command in place of the controller gives up after the same time.
pub const SAFE_AFTER_NS: u64 = 10_000_000;

/// Fewest ticks of it: at low rates a single lost message is bridged all the same.
const FEWEST_SAFE_AFTER_TICKS: u32 = 3;

/// Returns [`SAFE_AFTER_NS`] in ticks of `tick_ns`, at least 3: 10 at 1 kHz.
#[must_use]
pub const fn safe_after_ticks(tick_ns: u64) -> u32 {
    if tick_ns == 0 || tick_ns > SAFE_AFTER_NS {
        return FEWEST_SAFE_AFTER_TICKS;
    }
    // In 32 bits: a Cortex-M divides 64 in software, with 860 bytes of flash.
    let ticks = (SAFE_AFTER_NS as u32 + tick_ns as u32 / 2) / tick_ns as u32;
    if ticks > FEWEST_SAFE_AFTER_TICKS { ticks } else { FEWEST_SAFE_AFTER_TICKS }
}

/// Largest [`Limits::max_gap_ns`], ns.
const MAX_GAP_NS: u64 = 1_000_000_000;

/// What a measurement must satisfy.
///
/// The defaults leave room around a human-size leg: it lands at 15 m/s from the highest
/// starts of the training (12 m) and runs at up to 25 m/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest speed in either direction, and largest set-point, m/s.
    pub max_speed_m_s: f32,
    /// Lowest and highest mass above the ground, m.
    pub height_m: [f32; 2],
    /// Shortest and longest leg, m.
    pub leg_length_m: [f32; 2],
    /// Lowest and highest measured density ratio.
    pub density_ratio: [f32; 2],
    /// Longest time between two measurements, ns; at most 1 s.
    pub max_gap_ns: u64,
    /// Good measurements in a row that end the safe state.
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
            recover_after_ticks: 3,
        }
    }
}

impl Limits {
    /// Returns whether every range is finite and not empty, so that a measurement can
    /// satisfy it and nothing that does can overflow: magnitudes up to 1e6.
    #[must_use]
    pub fn are_valid(&self) -> bool {
        let most = 1e6;
        let is_range = |[low, high]: [f32; 2]| -most <= low && low < high && high <= most;
        is_range([-self.max_speed_m_s, self.max_speed_m_s])
            && [self.height_m, self.leg_length_m, self.density_ratio].into_iter().all(is_range)
            && self.height_m[0] >= 0.0
            && (1..=MAX_GAP_NS).contains(&self.max_gap_ns)
    }

    /// Checks the values of a measurement by themselves.
    ///
    /// # Errors
    /// [`Reject::NonFinite`] or [`Reject::OutOfRange`].
    #[inline]
    pub fn check<'m>(&self, measurement: &'m Measurement) -> Result<InRange<'m>, Reject> {
        let &Measurement { vx_m_s, y_m, vy_m_s, contact, density_ratio, .. } = measurement;
        let within = |x: f32, [low, high]: [f32; 2]| low <= x && x <= high;
        let is_speed = |x: f32| x.abs() <= self.max_speed_m_s;
        let is_good = is_speed(vx_m_s)
            && is_speed(vy_m_s)
            && within(y_m, self.height_m)
            && match contact {
                Contact::Sensed(_) => true,
                Contact::LegLength(length_m) => within(length_m, self.leg_length_m),
            }
            && density_ratio.is_none_or(|rho| within(rho, self.density_ratio));
        if is_good { Ok(InRange(measurement)) } else { Err(reason(measurement)) }
    }
}

/// Returns why a measurement is not in range. Apart: no good tick calls it.
#[cold]
#[inline(never)]
fn reason(measurement: &Measurement) -> Reject {
    let &Measurement { vx_m_s, y_m, vy_m_s, contact, density_ratio, .. } = measurement;
    let length_m = match contact {
        Contact::Sensed(_) => 0.0,
        Contact::LegLength(length_m) => length_m,
    };
    let values = [vx_m_s, y_m, vy_m_s, length_m, density_ratio.unwrap_or(0.0)];
    if values.iter().all(|x| x.is_finite()) { Reject::OutOfRange } else { Reject::NonFinite }
}

/// Why a tick has no usable measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Reject {
    /// None came.
    Missing,
    /// The sender uses another wire version.
    Version,
    /// A value is NaN or infinite.
    NonFinite,
    /// A value is outside its [`Limits`].
    OutOfRange,
    /// The message has neither a contact reading nor a leg length.
    NoContactSense,
    /// The message belongs to an earlier run.
    OldRun,
    /// The same tick again.
    Stale,
    /// A tick, or a time, before the last one.
    OutOfOrder,
    /// Longer after the last one than [`Limits::max_gap_ns`].
    Gap,
}

/// Rejected ticks by reason, since the start of the run.
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
    /// Ticks whose set-point was refused; they count as used all the same.
    pub set_points_refused: u32,
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

    /// Returns the number of rejected ticks, whatever the reason.
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

    /// Returns the name and the count of each reason, for tables.
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

/// A measurement whose values are finite and in range. Only [`Limits::check`] makes one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InRange<'m>(&'m Measurement);

/// A measurement that has passed every check. Only the guard makes one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trusted<'m>(&'m Measurement);

impl Trusted<'_> {
    /// Returns the measurement.
    #[must_use]
    pub fn measurement(&self) -> &Measurement {
        self.0
    }
}

/// What to do in this tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict<'m> {
    /// Use this measurement; it follows the last one.
    Use(Trusted<'m>),
    /// Use this measurement and forget all before it: a new run, or a recovery.
    Restart(Trusted<'m>),
    /// No usable measurement: continue the last command.
    Coast(Reject),
    /// No usable measurement for too long, or not enough good ones since: the safe
    /// command. The reason is none while good measurements are counted.
    Safe(Option<Reject>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Good so far, or this many bad ticks in a row.
    Running { bad_ticks: u32 },
    /// In the safe state, with this many good measurements in a row.
    Safe { good_ticks: u32 },
}

/// The guard and its memory.
#[derive(Clone, Debug)]
pub struct Guard {
    /// [`Limits::max_gap_ns`].
    max_gap_ns: u64,
    /// [`Limits::recover_after_ticks`].
    recover_after_ticks: u32,
    safe_after_ticks: u32,
    state: State,
    /// Time of the last good measurement, ns; forgotten in the safe state.
    last_ns: Option<u64>,
    /// The next good measurement is the first of another run.
    run_is_new: bool,
    counts: Counts,
}

impl Guard {
    /// Returns a guard that starts in the safe state and trusts the first good measurement.
    /// It judges measurements that [`Limits::check`] of the same limits has checked.
    #[must_use]
    pub fn new(limits: &Limits, tick_ns: u64) -> Self {
        let &Limits { max_gap_ns, recover_after_ticks, .. } = limits;
        let state = State::Safe { good_ticks: recover_after_ticks.saturating_sub(1) };
        Self {
            max_gap_ns,
            recover_after_ticks,
            safe_after_ticks: safe_after_ticks(tick_ns),
            state,
            last_ns: None,
            run_is_new: false,
            counts: Counts::default(),
        }
    }

    /// Returns what was rejected so far in this run.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Announces that the next measurement begins another run: its time may be any, and
    /// with it the counters start at 0.
    pub fn begin_run(&mut self) {
        self.run_is_new = true;
        self.last_ns = None;
    }

    /// Counts a set-point that was refused.
    pub fn count_refused_set_point(&mut self) {
        self.counts.set_points_refused = self.counts.set_points_refused.saturating_add(1);
    }

    /// Judges the measurement of this tick, or why there is none.
    #[inline]
    pub fn judge<'m>(&mut self, measurement: Result<InRange<'m>, Reject>) -> Verdict<'m> {
        match measurement.and_then(|InRange(m)| self.check_time(m.t_ns).map(|()| m)) {
            Ok(measurement) => self.accept(measurement),
            Err(reject) => self.reject(reject),
        }
    }

    fn accept<'m>(&mut self, measurement: &'m Measurement) -> Verdict<'m> {
        self.last_ns = Some(measurement.t_ns);
        let run_is_new = core::mem::take(&mut self.run_is_new);
        if run_is_new {
            self.counts = Counts::default();
        }
        match self.state {
            State::Safe { good_ticks } if good_ticks + 1 < self.recover_after_ticks => {
                self.state = State::Safe { good_ticks: good_ticks + 1 };
                Verdict::Safe(None)
            }
            State::Running { .. } if !run_is_new => {
                self.state = State::Running { bad_ticks: 0 };
                Verdict::Use(Trusted(measurement))
            }
            State::Running { .. } | State::Safe { .. } => {
                self.state = State::Running { bad_ticks: 0 };
                Verdict::Restart(Trusted(measurement))
            }
        }
    }

    fn reject<'m>(&mut self, reject: Reject) -> Verdict<'m> {
        self.counts.add(reject);
        let bad_ticks = match self.state {
            State::Running { bad_ticks } => bad_ticks.saturating_add(1),
            State::Safe { .. } => self.safe_after_ticks,
        };
        if bad_ticks < self.safe_after_ticks {
            self.state = State::Running { bad_ticks };
            return Verdict::Coast(reject);
        }
        if matches!(self.state, State::Running { .. }) {
            self.counts.safe_entered = self.counts.safe_entered.saturating_add(1);
        }
        self.state = State::Safe { good_ticks: 0 };
        self.last_ns = None;
        Verdict::Safe(Some(reject))
    }

    fn check_time(&self, t_ns: u64) -> Result<(), Reject> {
        let Some(last_ns) = self.last_ns else { return Ok(()) };
        if t_ns == last_ns {
            return Err(Reject::Stale);
        }
        if t_ns < last_ns {
            return Err(Reject::OutOfOrder);
        }
        if t_ns - last_ns > self.max_gap_ns { Err(Reject::Gap) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests;
