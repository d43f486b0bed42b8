//! Checks every measurement before anything is computed from it, and decides when to
//! give up.
//!
//! A measurement is used only if it is finite, in range, and later than the last one.
//! Rejected ones are counted by reason. One tick without a usable measurement is bridged
//! by continuing the last command ([`Verdict::Coast`]); after the stale limit, 10 ms unless
//! configured otherwise, the leg gets the safe command ([`Verdict::Safe`]) until
//! [`Limits::recover_after_ticks`] good measurements have come, with no bad one and less
//! than the stale limit between them. In the safe state the guard forgets the time of the
//! last measurement, so that no single corrupt time stamp can lock the true ones out.
//!
//! Without an estimator one bad reading rejects its measurement ([`Limits::check`]); with
//! one, only the reading ([`Limits::check_channels`]).

#[cfg(feature = "estimator")]
use crate::measurement::{Aged, LegPosture, Sensors};
use crate::measurement::{Contact, Measurement};

/// Default of the stale limit, ns: the time without a usable measurement after which the
/// leg gets the safe command, a twentieth of a stance of the human-size leg. Whoever holds a
/// command in place of the controller gives up after the same time.
///
/// A run of real links sets another one where messages come later or are lost
/// ([`Config::with_stale_limit`](crate::config::Config::with_stale_limit)).
pub const SAFE_AFTER_NS: u64 = 10_000_000;

/// Fewest ticks of it: at low rates a single lost message is bridged all the same.
const FEWEST_SAFE_AFTER_TICKS: u32 = 3;

/// Returns [`SAFE_AFTER_NS`] in ticks of `tick_ns`, at least 3: 10 at 1 kHz.
#[must_use]
pub const fn safe_after_ticks(tick_ns: u64) -> u32 {
    stale_after_ticks(SAFE_AFTER_NS, tick_ns)
}

/// Returns a stale limit, ns, at most 1 s, in ticks of `tick_ns`, at least 3.
#[must_use]
pub const fn stale_after_ticks(stale_ns: u64, tick_ns: u64) -> u32 {
    let stale_ns = if stale_ns < MAX_GAP_NS { stale_ns } else { MAX_GAP_NS };
    if tick_ns == 0 || tick_ns > stale_ns {
        return FEWEST_SAFE_AFTER_TICKS;
    }
    // In 32 bits: a Cortex-M divides 64 in software, with 860 bytes of flash.
    let ticks = (stale_ns as u32 + tick_ns as u32 / 2) / tick_ns as u32;
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
    /// Good measurements, without a bad one between them, that end the safe state.
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
        if is_good { Ok(InRange(measurement, Channels::ALL)) } else { Err(reason(measurement)) }
    }

    /// Returns whether an estimate of horizontal velocity, height and vertical velocity, m/s and
    /// m, could be that of a leg: one beyond the speeds and heights of measurements has diverged.
    #[inline]
    pub(crate) fn could_be(&self, [vx_m_s, y_m, vy_m_s]: [f32; 3]) -> bool {
        // A NaN is not within.
        vx_m_s.abs() <= self.max_speed_m_s
            && vy_m_s.abs() <= self.max_speed_m_s
            && y_m.abs() <= self.height_m[1]
    }

    /// Checks the readings of a measurement one by one, for an estimator that does without
    /// those that are not usable. A height may then be as far below the ground as it may be
    /// above it: noise is not to be cut off on one side.
    ///
    /// # Errors
    /// [`Reject::NonFinite`] or [`Reject::OutOfRange`] where no velocity and no height is
    /// usable.
    #[inline]
    pub fn check_channels<'m>(&self, measurement: &'m Measurement) -> Result<InRange<'m>, Reject> {
        let &Measurement { vx_m_s, y_m, vy_m_s, contact, density_ratio, .. } = measurement;
        let within = |x: f32, [low, high]: [f32; 2]| low <= x && x <= high;
        let length_is_good = match contact {
            Contact::Sensed(_) => true,
            Contact::LegLength(length_m) => within(length_m, self.leg_length_m),
        };
        let usable = Channels::NONE
            .with(Channels::VX, vx_m_s.abs() <= self.max_speed_m_s)
            .with(Channels::Y, y_m.abs() <= self.height_m[1])
            .with(Channels::VY, vy_m_s.abs() <= self.max_speed_m_s)
            .with(Channels::CONTACT, length_is_good)
            .with(
                Channels::DENSITY,
                density_ratio.is_none_or(|rho| within(rho, self.density_ratio)),
            )
            .union(Channels::RAW);
        if usable.has_any_of(Channels::MOTION) {
            Ok(InRange(measurement, usable))
        } else {
            Err(reason(measurement))
        }
    }

    /// Checks the readings of sensors one by one, for an estimator that does without those
    /// that are not usable. One that is not there counts as usable.
    ///
    /// # Errors
    /// [`Reject::NonFinite`] or [`Reject::OutOfRange`] where neither acceleration nor posture
    /// of the leg is usable.
    #[cfg(feature = "estimator")]
    #[inline]
    pub fn check_sensors<'m>(&self, measurement: &'m Measurement) -> Result<InRange<'m>, Reject> {
        let &Measurement { contact, density_ratio, ref sensors, .. } = measurement;
        let &Sensors { impulse, pitch_rad, pitch_rate_rad_s, posture, .. } = sensors;
        let &Sensors { velocity_m_s, height_m, pressure_pa, .. } = sensors;
        let within = |x: f32, [low, high]: [f32; 2]| low <= x && x <= high;
        let up_to = |x: f32, most: f32| x.abs() <= most;
        let is_posture = |LegPosture { length_m, angle_rad }| {
            within(length_m, self.leg_length_m) && within(angle_rad, [0.0, core::f32::consts::PI])
        };
        let usable = Channels::MOTION
            .with(
                Channels::CONTACT,
                match contact {
                    Contact::Sensed(_) => true,
                    Contact::LegLength(length_m) => within(length_m, self.leg_length_m),
                },
            )
            .with(
                Channels::DENSITY,
                density_ratio.is_none_or(|rho| within(rho, self.density_ratio)),
            )
            .with(Channels::IMPULSE, true)
            .with(Channels::PITCH, pitch_rad.is_none_or(|pitch| up_to(pitch, MAX_PITCH_RAD)))
            .with(
                Channels::PITCH_RATE,
                pitch_rate_rad_s.is_none_or(|rate| up_to(rate, MAX_PITCH_RATE_RAD_S)),
            )
            .with(Channels::POSTURE, posture.is_none_or(is_posture))
            .with(
                Channels::VELOCITY,
                velocity_m_s.is_none_or(|Aged { value: [x, y], .. }| {
                    up_to(x, self.max_speed_m_s) && up_to(y, self.max_speed_m_s)
                }),
            )
            .with(
                Channels::HEIGHT,
                height_m.is_none_or(|height| up_to(height.value, self.height_m[1])),
            )
            .with(
                Channels::PRESSURE,
                pressure_pa.is_none_or(|pressure| up_to(pressure.value, MAX_PRESSURE_PA)),
            );
        let has_posture = posture.is_some() && usable.has(Channels::POSTURE);
        if impulse.is_some() || has_posture {
            Ok(InRange(measurement, usable))
        } else {
            Err(reason(measurement))
        }
    }
}

/// The largest pitch, rad: a quarter turn.
#[cfg(feature = "estimator")]
const MAX_PITCH_RAD: f32 = core::f32::consts::FRAC_PI_2;
/// The largest rate of the pitch, rad/s.
#[cfg(feature = "estimator")]
const MAX_PITCH_RATE_RAD_S: f32 = 100.0;
/// The largest pressure, Pa: that of the deepest sea.
#[cfg(feature = "estimator")]
const MAX_PRESSURE_PA: f32 = 2e8;

/// A set of the readings of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Channels(u16);

impl Channels {
    /// No reading.
    pub const NONE: Self = Self(0);
    /// The horizontal velocity.
    pub const VX: Self = Self(1);
    /// The height.
    pub const Y: Self = Self(1 << 1);
    /// The vertical velocity.
    pub const VY: Self = Self(1 << 2);
    /// Contact, or the leg length that shows it.
    pub const CONTACT: Self = Self(1 << 3);
    /// The density ratio; also where it is not measured.
    pub const DENSITY: Self = Self(1 << 4);
    /// Velocities and height.
    pub const MOTION: Self = Self((1 << 3) - 1);
    /// The specific impulse.
    pub const IMPULSE: Self = Self(1 << 5);
    /// The orientation.
    pub const PITCH: Self = Self(1 << 6);
    /// The rate of the orientation.
    pub const PITCH_RATE: Self = Self(1 << 7);
    /// Length and angle of the leg.
    pub const POSTURE: Self = Self(1 << 8);
    /// The velocity over the ground.
    pub const VELOCITY: Self = Self(1 << 9);
    /// The height of an echo sounder.
    pub const HEIGHT: Self = Self(1 << 10);
    /// The pressure.
    pub const PRESSURE: Self = Self(1 << 11);
    /// Readings of raw sensors.
    const RAW: Self = Self(((1 << 12) - 1) & !((1 << 5) - 1));
    /// Every reading.
    pub const ALL: Self = Self((1 << 12) - 1);

    fn with(self, channel: Self, is_usable: bool) -> Self {
        if is_usable { self.union(channel) } else { self }
    }

    /// Returns the channels of this set and of `other`.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns whether every channel of `other` is in this set.
    #[must_use]
    pub fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    fn has_any_of(self, other: Self) -> bool {
        self.0 & other.0 != 0
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
    /// Measurements of which only a part of the readings was used.
    pub used_in_part: u32,
    /// Times that the estimate was lost: too uncertain, beyond the limits of measurements, or in
    /// contradiction to the readings.
    pub estimates_lost: u32,
    /// Ticks whose set-point was refused; they count as used all the same.
    pub set_points_refused: u32,
    /// Ticks that were rejected: the sum, at hand for every command.
    rejected: u32,
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
        self.rejected = self.rejected.saturating_add(1);
    }

    /// Returns these counts and those of another run, added.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            missing: self.missing.saturating_add(other.missing),
            version: self.version.saturating_add(other.version),
            non_finite: self.non_finite.saturating_add(other.non_finite),
            out_of_range: self.out_of_range.saturating_add(other.out_of_range),
            no_contact_sense: self.no_contact_sense.saturating_add(other.no_contact_sense),
            old_run: self.old_run.saturating_add(other.old_run),
            stale: self.stale.saturating_add(other.stale),
            out_of_order: self.out_of_order.saturating_add(other.out_of_order),
            gap: self.gap.saturating_add(other.gap),
            safe_entered: self.safe_entered.saturating_add(other.safe_entered),
            used_in_part: self.used_in_part.saturating_add(other.used_in_part),
            estimates_lost: self.estimates_lost.saturating_add(other.estimates_lost),
            set_points_refused: self.set_points_refused.saturating_add(other.set_points_refused),
            rejected: self.rejected.saturating_add(other.rejected),
        }
    }

    /// Returns the number of rejected ticks, whatever the reason.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        self.rejected
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
pub struct InRange<'m>(&'m Measurement, Channels);

/// A measurement that has passed every check. Only the guard makes one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trusted<'m>(&'m Measurement, Channels);

impl Trusted<'_> {
    /// Returns the readings that are usable: all, unless they were checked one by one.
    #[must_use]
    pub fn usable(&self) -> Channels {
        self.1
    }

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
    /// In the safe state, with this many good measurements since the last bad one, and this
    /// many ticks without any since the last good one.
    Safe { good_ticks: u32, missing_ticks: u32 },
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
    /// Returns a guard that starts in the safe state and trusts the first good measurement,
    /// and that gives up after `stale_ns` without one. It judges measurements that [`Limits::check`] of the same limits has checked.
    #[must_use]
    pub fn new(limits: &Limits, tick_ns: u64, stale_ns: u64) -> Self {
        let &Limits { max_gap_ns, recover_after_ticks, .. } = limits;
        let state =
            State::Safe { good_ticks: recover_after_ticks.saturating_sub(1), missing_ticks: 0 };
        Self {
            max_gap_ns,
            recover_after_ticks,
            safe_after_ticks: stale_after_ticks(stale_ns, tick_ns),
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

    /// Counts an estimate that was lost.
    #[cfg(feature = "estimator")]
    pub(crate) fn count_lost_estimate(&mut self) {
        self.counts.estimates_lost = self.counts.estimates_lost.saturating_add(1);
    }

    /// Counts a set-point that was refused.
    pub fn count_refused_set_point(&mut self) {
        self.counts.set_points_refused = self.counts.set_points_refused.saturating_add(1);
    }

    /// Judges the measurement of this tick, or why there is none.
    #[inline]
    pub fn judge<'m>(&mut self, measurement: Result<InRange<'m>, Reject>) -> Verdict<'m> {
        match measurement.and_then(|m| self.check_time(m.0.t_ns).map(|()| m)) {
            Ok(InRange(measurement, usable)) => self.accept(Trusted(measurement, usable)),
            Err(reject) => self.reject(reject),
        }
    }

    fn accept<'m>(&mut self, measurement: Trusted<'m>) -> Verdict<'m> {
        self.last_ns = Some(measurement.0.t_ns);
        let run_is_new = core::mem::take(&mut self.run_is_new);
        if run_is_new {
            self.counts = Counts::default();
        }
        if measurement.usable() != Channels::ALL {
            self.counts.used_in_part = self.counts.used_in_part.saturating_add(1);
        }
        match self.state {
            State::Safe { good_ticks, .. } if good_ticks + 1 < self.recover_after_ticks => {
                self.state = State::Safe { good_ticks: good_ticks + 1, missing_ticks: 0 };
                Verdict::Safe(None)
            }
            State::Running { .. } if !run_is_new => {
                self.state = State::Running { bad_ticks: 0 };
                Verdict::Use(measurement)
            }
            State::Running { .. } | State::Safe { .. } => {
                self.state = State::Running { bad_ticks: 0 };
                Verdict::Restart(measurement)
            }
        }
    }

    fn reject<'m>(&mut self, reject: Reject) -> Verdict<'m> {
        self.counts.add(reject);
        let bad_ticks = match self.state {
            State::Running { bad_ticks } => bad_ticks.saturating_add(1),
            State::Safe { good_ticks, missing_ticks }
                if reject == Reject::Missing && missing_ticks + 1 < self.safe_after_ticks =>
            {
                let missing_ticks = missing_ticks + 1;
                self.state = State::Safe { good_ticks, missing_ticks };
                return Verdict::Safe(Some(reject));
            }
            State::Safe { .. } => self.safe_after_ticks,
        };
        if bad_ticks < self.safe_after_ticks {
            self.state = State::Running { bad_ticks };
            return Verdict::Coast(reject);
        }
        if matches!(self.state, State::Running { .. }) {
            self.counts.safe_entered = self.counts.safe_entered.saturating_add(1);
        }
        self.state = State::Safe { good_ticks: 0, missing_ticks: 0 };
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
