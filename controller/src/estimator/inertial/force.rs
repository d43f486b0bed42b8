//! The specific force on the mass in level axes, from sums that may come late or be missing.

use crate::guard::Channels;
use crate::measurement::{Sensors, SpecificImpulse};
use crate::trig::sin_cos;

/// Time without a reading after which the accelerometer counts as dead, s.
const DEAD_AFTER_S: f32 = 0.05;
const QUARTER_RAD: f32 = core::f32::consts::FRAC_PI_2;

/// What pushed the mass since the last tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Push {
    /// Specific impulse, m/s: horizontal, vertical.
    pub(super) impulse_m_s: [f32; 2],
    /// What the accelerometer felt, where a reading has come in this tick.
    pub(super) felt: Option<Felt>,
}

/// A reading of the accelerometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Felt {
    /// Mean specific force since the reading before, m/s2: horizontal, vertical.
    pub(super) force_m_s2: [f32; 2],
    /// The time since the reading before, s, and one over it.
    pub(super) over_s: f32,
    pub(super) per_s: f32,
}

impl Felt {
    /// Returns the mean of this reading and the one before it.
    pub(super) fn mean_with(&self, before: &Self) -> Self {
        let ([x, y], [x0, y0]) = (self.force_m_s2, before.force_m_s2);
        Self {
            force_m_s2: [0.5 * (x + x0), 0.5 * (y + y0)],
            over_s: self.over_s + before.over_s,
            per_s: 0.5 * self.per_s,
        }
    }
}

/// Converts readings of the accelerometer into pushes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ForceMeter {
    last: Option<SpecificImpulse>,
    /// Specific force of the last reading, m/s2.
    force_m_s2: [f32; 2],
    /// Impulse that was assumed since the last reading, m/s.
    assumed_m_s: [f32; 2],
    missing_s: f32,
    /// Cosine and sine of the pitch.
    axis: [f32; 2],
}

impl ForceMeter {
    /// Returns cosine and sine of the pitch at the last reading of it.
    pub(super) fn axis(&self) -> [f32; 2] {
        self.axis
    }

    /// Takes the readings `dt_s` after the last ones, of an accelerometer with this scale error
    /// along y; returns none where it is dead, or has not begun.
    pub(super) fn push(
        &mut self,
        sensors: &Sensors,
        usable: Channels,
        scale_error: f32,
        dt_s: f32,
    ) -> Option<Push> {
        let pitch_rad = sensors.pitch_rad.filter(|_| usable.has(Channels::PITCH));
        if let Some(pitch_rad) = pitch_rad {
            // The pitch in the middle of the tick turns the impulse of the tick.
            let rate = sensors.pitch_rate_rad_s.filter(|_| usable.has(Channels::PITCH_RATE));
            let back_rad = rate.map_or(0.0, |rate| 0.5 * rate * dt_s);
            let (cosine, minus_sine) = sin_cos(pitch_rad - back_rad + QUARTER_RAD);
            self.axis = [cosine, -minus_sine];
        } else if self.axis == [0.0; 2] {
            self.axis = [1.0, 0.0];
        }
        let reading = sensors.impulse.filter(|_| usable.has(Channels::IMPULSE));
        let Some(reading) = reading else { return self.assume(dt_s) };
        let over_s = self.missing_s + dt_s;
        let was_alive = self.missing_s <= DEAD_AFTER_S;
        self.missing_s = 0.0;
        let last = self.last.replace(reading)?;
        if !was_alive || over_s <= 0.0 {
            self.assumed_m_s = [0.0; 2];
            return None;
        }
        let [x, y] = reading.since(last);
        let y = y - scale_error * y;
        let [cosine, sine] = self.axis;
        let level = [cosine * x - sine * y, sine * x + cosine * y];
        let per_s = 1.0 / over_s;
        self.force_m_s2 = level.map(|impulse| impulse * per_s);
        let [assumed_x, assumed_y] = core::mem::take(&mut self.assumed_m_s);
        let [x, y] = level;
        let felt = Some(Felt { force_m_s2: self.force_m_s2, over_s, per_s });
        Some(Push { impulse_m_s: [x - assumed_x, y - assumed_y], felt })
    }

    /// Continues the last force.
    #[inline(never)]
    fn assume(&mut self, dt_s: f32) -> Option<Push> {
        self.missing_s += dt_s;
        self.last?;
        if self.missing_s > DEAD_AFTER_S {
            return None;
        }
        let impulse_m_s = self.force_m_s2.map(|force| force * dt_s);
        let [x, y] = impulse_m_s;
        self.assumed_m_s[0] += x;
        self.assumed_m_s[1] += y;
        Some(Push { impulse_m_s, felt: None })
    }
}
