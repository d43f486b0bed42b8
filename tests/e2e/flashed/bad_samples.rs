//! Samples as broken sensors and a broken line make them.

use leg_control::wire::{Header, Sample, SensorReadings, WIRE_VERSION, flags};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Makes bad samples around the good ones of a run, the same for the same seed.
pub(crate) struct BadSamples {
    rng: Pcg64,
    before: Sample,
}

/// Bad samples in a row after which the guard enters its safe state, and some more.
const LONG_BURST: u32 = 14;

impl BadSamples {
    pub(crate) fn new(seed: u64) -> Self {
        Self { rng: Pcg64::new(seed.into(), 5), before: Sample::default() }
    }

    /// Returns how many bad samples precede the next good one: mostly none, sometimes one or
    /// two, rarely enough for the safe state.
    pub(crate) fn burst(&mut self) -> u32 {
        match self.rng.random_range(0..10_000) {
            0..4 => LONG_BURST,
            4..300 => self.rng.random_range(1..3),
            _ => 0,
        }
    }

    /// Returns a bad sample in place of `good`.
    pub(crate) fn bad(&mut self, good: &Sample) -> Sample {
        let mut bad = *good;
        match self.rng.random_range(0..9) {
            // Stale, out of order, too late.
            0 => bad = self.before,
            1 => bad.header.seq = good.header.seq.saturating_sub(self.rng.random_range(2..50)),
            2 => bad.header.t_ns += 1_000_000_000,
            // Of another run or another build.
            3 => bad.header.run_id = good.header.run_id.wrapping_sub(1),
            4 => bad.header.version = WIRE_VERSION + 1,
            // Values that are no numbers or beyond any leg.
            5 => *self.value(&mut bad) = f32::NAN,
            6 => *self.value(&mut bad) = 1e6,
            // Contact not sensed.
            7 => bad.header.flags &= !(flags::CONTACT_SENSED | flags::LEG_LENGTH_SENSED),
            _ => bad = self.random(),
        }
        bad
    }

    /// Remembers a sample that was sent, for stale ones.
    pub(crate) fn sent(&mut self, sample: &Sample) {
        self.before = *sample;
    }

    fn value<'s>(&mut self, sample: &'s mut Sample) -> &'s mut f32 {
        let sensors = &mut sample.sensors;
        match self.rng.random_range(0..12) {
            0 => &mut sample.vx_m_s,
            1 => &mut sample.vy_m_s,
            2 => &mut sample.y_m,
            3 => &mut sample.leg_length_m,
            4 => &mut sensors.pitch_rad,
            5 => &mut sensors.pitch_rate_rad_s,
            6 => &mut sensors.leg_angle_rad,
            7 => &mut sensors.velocity_m_s[0],
            8 => &mut sensors.velocity_m_s[1],
            9 => &mut sensors.height_m,
            10 => &mut sensors.pressure_pa,
            _ => &mut sample.set_point_m_s,
        }
    }

    /// Returns a sample of random bits.
    fn random(&mut self) -> Sample {
        let rng = &mut self.rng;
        Sample {
            header: Header {
                version: WIRE_VERSION,
                flags: rng.random(),
                run_id: rng.random(),
                seq: rng.random(),
                t_ns: rng.random(),
            },
            set_point_m_s: f32::from_bits(rng.random()),
            vx_m_s: f32::from_bits(rng.random()),
            y_m: f32::from_bits(rng.random()),
            vy_m_s: f32::from_bits(rng.random()),
            leg_length_m: f32::from_bits(rng.random()),
            density_ratio: f32::from_bits(rng.random()),
            sensors: SensorReadings {
                pitch_rad: f32::from_bits(rng.random()),
                pitch_rate_rad_s: f32::from_bits(rng.random()),
                leg_angle_rad: f32::from_bits(rng.random()),
                impulse: rng.random(),
                velocity_m_s: [rng.random(), rng.random()].map(f32::from_bits),
                height_m: f32::from_bits(rng.random()),
                pressure_pa: f32::from_bits(rng.random()),
                velocity_age_ns: rng.random(),
                height_age_ns: rng.random(),
                pressure_age_ns: rng.random(),
            },
        }
    }
}
