//! Makes the ticks of the control law of the rows of a log.

use leg_control::estimator::Acted;
use leg_control::measurement::{Aged, Contact, LegPosture, Measurement, Sensors, SpecificImpulse};
use leg_control::wire::{Sample, flags};
use leg_recording::schema;

use super::Truth;
use super::column::Column;
use super::row::Row;

/// Longest time without a row that is played as ticks without a sample, ns: by then every law is
/// in its safe state.
const LONGEST_GAP_NS: u64 = 1_100_000_000;

/// A tick of the control law, and what is known about it.
#[derive(Clone, Debug, Default)]
pub(super) struct Tick {
    /// Ticks without a sample before it.
    pub(super) empty_before: u64,
    /// The sample; none where a row has no reading.
    pub(super) sample: Option<Sample>,
    /// What another controller made the leg do.
    pub(super) acted: Option<Acted>,
    /// The true state.
    pub(super) truth: Option<Truth>,
    /// The estimate that was recorded.
    pub(super) recorded: Option<schema::Estimate>,
    /// Time since the first tick, ns.
    pub(super) t_ns: u64,
    /// Begin of its run, ns; times of samples count from it.
    pub(super) run_begins_ns: u64,
}

/// The state between rows.
#[derive(Clone, Debug)]
pub(super) struct Assembler {
    tick_ns: u64,
    first_ns: Option<i128>,
    last_ns: u64,
    seq: u64,
    set_point_m_s: f32,
    force: ForceSum,
}

/// The sum of a specific force.
#[derive(Clone, Copy, Debug, Default)]
struct ForceSum {
    /// Time of the last reading, ns.
    last_ns: Option<u64>,
    sum_m_s: [f64; 2],
}

impl ForceSum {
    /// Adds a reading, m/s2: the mean since the one before. Returns the sum.
    fn add(&mut self, t_ns: u64, force_m_s2: [f64; 2]) -> SpecificImpulse {
        let last_ns = self.last_ns.replace(t_ns).unwrap_or(t_ns);
        let dt_s = 1e-9 * t_ns.saturating_sub(last_ns) as f64;
        for (sum, force) in self.sum_m_s.iter_mut().zip(force_m_s2) {
            *sum += force * dt_s;
        }
        counts(self.sum_m_s)
    }
}

/// Returns a specific impulse, m/s, in whole counts, which wrap.
fn counts(impulse_m_s: [f64; 2]) -> SpecificImpulse {
    let unit_m_s = f64::from(SpecificImpulse::UNIT_M_S);
    SpecificImpulse(impulse_m_s.map(|x| (x / unit_m_s).round() as i64 as i32))
}

impl Assembler {
    /// Returns an assembler for a law with this tick, ns, and first set-point, m/s.
    pub(super) fn new(tick_ns: u64, set_point_m_s: f32) -> Self {
        Self {
            tick_ns,
            first_ns: None,
            last_ns: 0,
            seq: 0,
            set_point_m_s,
            force: ForceSum::default(),
        }
    }

    /// Returns the tick of the next row.
    pub(super) fn tick(&mut self, row: &Row) -> Tick {
        let is_first = self.first_ns.is_none();
        let since_ns = row.time_ns - *self.first_ns.get_or_insert(row.time_ns);
        let t_ns = u64::try_from(since_ns.max(0)).unwrap_or(u64::MAX);
        let gap_ns = t_ns.saturating_sub(self.last_ns).min(LONGEST_GAP_NS);
        let periods = (gap_ns + self.tick_ns / 2) / self.tick_ns;
        self.last_ns = self.last_ns.max(t_ns);
        self.set_point_m_s = row.single(Column::SetPoint).unwrap_or(self.set_point_m_s);
        let sample = self.sample(t_ns, row);
        self.seq += 1;
        let acted = Acted {
            leg_angle_rad: row.single(Column::HeldAngle),
            elongation_m: row.single(Column::Elongation),
        };
        Tick {
            empty_before: if is_first { 0 } else { periods.saturating_sub(1) },
            sample,
            acted: (acted != Acted::default()).then_some(acted),
            truth: Truth::of(row),
            recorded: None,
            t_ns,
            run_begins_ns: 0,
        }
    }

    /// Returns the message of the readings in a row; none if it has none.
    fn sample(&mut self, t_ns: u64, row: &Row) -> Option<Sample> {
        let sensors = self.sensors(t_ns, row);
        let contact = match (row.truth(Column::Contact), row.single(Column::LegLength)) {
            (Some(is_loaded), _) => Some(Contact::Sensed(is_loaded)),
            (None, length_m) => length_m.map(Contact::LegLength),
        };
        let channel = |column| row.single(column).unwrap_or(f32::NAN);
        let measurement = Measurement {
            t_ns,
            vx_m_s: channel(Column::Vx),
            y_m: channel(Column::Y),
            vy_m_s: channel(Column::Vy),
            contact: contact.unwrap_or(Contact::Sensed(false)),
            density_ratio: row.single(Column::Density),
            sensors,
        };
        let mut sample = Sample::new(1, self.seq, &measurement, self.set_point_m_s);
        if contact.is_none() {
            sample.header.flags &= !(flags::CONTACT_SENSED | flags::IN_CONTACT);
        }
        (sample.header.flags != 0).then_some(sample)
    }

    fn sensors(&mut self, t_ns: u64, row: &Row) -> Sensors {
        let both = |x, y| Some([row.get(x)?, row.get(y)?]);
        let age_ns = |column| (1e9 * row.get(column).unwrap_or(0.0)).round() as u32;
        let aged = |value, age| row.single(value).map(|value| Aged { value, age_ns: age_ns(age) });
        let sum = both(Column::ImpulseX, Column::ImpulseY).map(counts);
        let force = both(Column::ForceX, Column::ForceY);
        let length_and_angle = row.single(Column::LegLength).zip(row.single(Column::LegAngle));
        Sensors {
            impulse: sum.or_else(|| force.map(|force| self.force.add(t_ns, force))),
            pitch_rad: row.single(Column::Pitch),
            pitch_rate_rad_s: row.single(Column::PitchRate),
            posture: length_and_angle
                .map(|(length_m, angle_rad)| LegPosture { length_m, angle_rad }),
            velocity_m_s: row
                .single(Column::VelocityX)
                .zip(row.single(Column::VelocityY))
                .map(|(x, y)| Aged { value: [x, y], age_ns: age_ns(Column::VelocityAge) }),
            height_m: aged(Column::Height, Column::HeightAge),
            pressure_pa: aged(Column::Pressure, Column::PressureAge),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    const MS: i128 = 1_000_000;

    fn row(time_ns: i128, cells: &[(Column, &str)]) -> Row {
        let mut row = Row::new(time_ns);
        for (column, text) in cells {
            row.set(*column, text, Path::new("log"), String::new).unwrap();
        }
        row
    }

    #[test]
    fn a_force_is_summed_over_the_time_since_its_reading_before() {
        let mut assembler = Assembler::new(1_000_000, 0.0);
        let force = |x: &'static str| [(Column::ForceX, x), (Column::ForceY, "9.81")];
        let mut sum = |ms: i128, cells: &[(Column, &str)]| {
            let tick = assembler.tick(&row(5_000 * MS + ms * MS, cells));
            tick.sample.and_then(|sample| {
                let has = sample.header.flags & flags::IMPULSE_SENSED != 0;
                has.then_some(sample.sensors.impulse)
            })
        };
        let unit = 65_536.0;
        assert_eq!(sum(0, &force("100")), Some([0, 0]), "the sum begins");
        assert_eq!(sum(1, &force("-2")), Some([-131, 643]));
        assert_eq!(sum(2, &[(Column::Contact, "1")]), None, "not read");
        let x = (unit * (-0.002 + 3.0 * 0.003_f64)).round() as i32;
        assert_eq!(sum(4, &force("3")), Some([x, (unit * 9.81 * 0.004_f64).round() as i32]));
    }

    #[test]
    fn a_sum_of_any_size_wraps_as_on_the_wire() {
        let counts_of = |x: f64| counts([x, 0.0]).0[0];
        assert_eq!(counts_of(-0.5), -32_768);
        assert_eq!(counts_of(32_768.0), i32::MIN);
        assert_eq!(counts_of(65_536.25), 16_384);
        for count in [i32::MIN, -1, 0, 7, i32::MAX] {
            assert_eq!(counts_of(f64::from(count) / 65_536.0), count);
        }
    }

    #[test]
    fn missing_rows_are_ticks_without_a_sample_up_to_a_second() {
        let mut assembler = Assembler::new(1_000_000, 0.0);
        let at = [0, 1_000_000, 2_200_000, 4_900_000, 6_000_000, 5_500_000, 7_000_000];
        let mut empty = |ns: i128| assembler.tick(&row(ns, &[])).empty_before;
        assert_eq!(at.map(&mut empty), [0, 0, 0, 2, 0, 0, 0]);
        assert_eq!(empty(MS * 1_000_000_000), 1_099);
    }

    #[test]
    fn a_row_without_a_reading_has_no_sample_and_a_set_point_holds_on() {
        let mut assembler = Assembler::new(1_000_000, 0.5);
        assert!(assembler.tick(&row(0, &[(Column::TrueY, "1")])).sample.is_none());
        let set_point = |sample: Option<Sample>| sample.unwrap().set_point_m_s;
        let y = (Column::Y, "1.5");
        assert_eq!(set_point(assembler.tick(&row(MS, &[y])).sample), 0.5);
        let both = [y, (Column::SetPoint, "-1")];
        assert_eq!(set_point(assembler.tick(&row(2 * MS, &both)).sample), -1.0);
        assert_eq!(set_point(assembler.tick(&row(3 * MS, &[y])).sample), -1.0);
    }

    #[test]
    fn each_reading_is_where_the_wire_has_it_and_half_of_a_pair_is_none() {
        let mut assembler = Assembler::new(1_000_000, 0.0);
        let cells = [
            (Column::LegLength, "0.97"),
            (Column::LegAngle, "1.5"),
            (Column::Contact, "1"),
            (Column::VelocityX, "0.25"),
            (Column::VelocityY, "-0.5"),
            (Column::VelocityAge, "0.1"),
            (Column::Pressure, "200000"),
            (Column::PitchRate, "0.125"),
        ];
        let sample = assembler.tick(&row(0, &cells)).sample.unwrap();
        let m = sample.measurement().unwrap();
        assert_eq!(m.contact, Contact::Sensed(true));
        let posture = LegPosture { length_m: 0.97, angle_rad: 1.5 };
        let velocity = Aged { value: [0.25, -0.5], age_ns: 100_000_000 };
        let expected = Sensors {
            posture: Some(posture),
            velocity_m_s: Some(velocity),
            pressure_pa: Some(Aged { value: 200_000.0, age_ns: 0 }),
            pitch_rate_rad_s: Some(0.125),
            ..Sensors::default()
        };
        assert_eq!(m.sensors, expected);
        assert!(m.vx_m_s.is_nan() && m.density_ratio.is_none());
        let half = assembler.tick(&row(MS, &[(Column::VelocityX, "1"), (Column::Y, "1")]));
        let flags = half.sample.unwrap().header.flags;
        assert_eq!(flags, flags::Y_SENSED, "no contact either");
    }
}
