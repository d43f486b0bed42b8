//! The filter as a whole, on a flight by the equations of the plant.

use super::*;
use crate::estimator::random::Random;
use crate::measurement::{Contact, Sensors};

const TICK_NS: u64 = 1_000_000;
const STALE_NS: u64 = 100_000_000;

fn estimator() -> StateFilter {
    StateFilter::new(&LegModel::HUMAN, 9.81, TICK_NS, STALE_NS, &StateNoise::default())
}

/// A flight that is read every millisecond, with noise of this deviation, m/s and m.
struct Flown {
    model: FlightModel,
    truth: Flight,
    deviation: f32,
    random: Random,
    tick: u64,
}

impl Flown {
    /// Returns a flight that rises at 4 m/s.
    fn new(density_ratio: f32, deviation: f32) -> Self {
        Self {
            model: FlightModel::new(&LegModel::HUMAN, 9.81),
            truth: Flight { vx_m_s: 1.0, y_m: 20.0, vy_m_s: 4.0, density_ratio },
            deviation,
            random: Random::new(),
            tick: 0,
        }
    }

    /// Advances by a millisecond and returns the readings.
    fn read(&mut self) -> Measurement {
        self.model.advance(&mut self.truth, 1e-3);
        self.tick += 1;
        let Flight { vx_m_s, y_m, vy_m_s, .. } = self.truth;
        let mut noisy = |x: f32| x + self.deviation * self.random.normal();
        Measurement {
            t_ns: self.tick * TICK_NS,
            vx_m_s: noisy(vx_m_s),
            y_m: noisy(y_m),
            vy_m_s: noisy(vy_m_s),
            contact: Contact::Sensed(false),
            density_ratio: None,
            sensors: Sensors::default(),
        }
    }

    /// Passes `ticks` readings to an estimator.
    fn play(&mut self, estimator: &mut StateFilter, ticks: u32) {
        for _ in 0..ticks {
            let m = self.read();
            estimator.take(&m, Channels::ALL, Some(false), 1.0);
        }
    }
}

#[test]
fn finds_motion_and_density_under_noise_of_1_m_s() {
    for density_ratio in [0.0, 0.3, 1.0] {
        let mut flown = Flown::new(density_ratio, 1.0);
        let mut estimator = estimator();
        flown.play(&mut estimator, 800);
        let found = estimator.estimate().unwrap();
        let off = [
            (found.vx_m_s - flown.truth.vx_m_s, found.vx_variance),
            (found.y_m - flown.truth.y_m, found.y_variance),
            (found.vy_m_s - flown.truth.vy_m_s, found.vy_variance),
            (found.density_ratio - density_ratio, found.density_variance),
        ];
        for (error, variance) in off {
            assert!(error.abs() < 3.0 * variance.sqrt(), "{error}, {found:?}");
            assert!(variance < 0.15 * 0.15, "{found:?}");
        }
    }
}

/// The cumulative sum, and not the process noise, follows a medium that changes at once.
#[test]
fn finds_a_medium_that_changes_at_once() {
    let mut flown = Flown::new(0.0, 0.2);
    let mut estimator = estimator();
    flown.play(&mut estimator, 600);
    assert!(estimator.density_ratio().abs() < 0.05);
    flown.truth.density_ratio = 1.0;
    flown.play(&mut estimator, 200);
    let found = estimator.density_ratio();
    assert!((found - 1.0).abs() < 0.1, "{found}");
}

#[test]
fn one_channel_that_is_missing_leaves_the_others_in_force_until_the_stale_limit() {
    let all_but = [
        Channels::Y.union(Channels::VY),
        Channels::VX.union(Channels::VY),
        Channels::VX.union(Channels::Y),
    ];
    for usable in all_but {
        let mut flown = Flown::new(0.3, 0.1);
        let mut estimator = estimator();
        flown.play(&mut estimator, 400);
        for tick in 0..=102 {
            let m = flown.read();
            let bad = |channel, x| if usable.has(channel) { x } else { f32::NAN };
            let m = Measurement {
                vx_m_s: bad(Channels::VX, m.vx_m_s),
                y_m: bad(Channels::Y, m.y_m),
                vy_m_s: bad(Channels::VY, m.vy_m_s),
                ..m
            };
            let events = estimator.take(&m, usable, Some(false), 1.0);
            // The sum of a hundred times is not exact.
            assert!(events.is_some() || tick > 98, "tick {tick} with {usable:?} alone");
            if let Some(found) = estimator.estimate() {
                assert!((found.vx_m_s - flown.truth.vx_m_s).abs() < 0.1, "{found:?}");
                assert!((found.y_m - flown.truth.y_m).abs() < 0.1, "{found:?}");
                assert!((found.vy_m_s - flown.truth.vy_m_s).abs() < 0.1, "{found:?}");
            }
        }
        assert_eq!(estimator.estimate(), None);
    }
}

#[test]
fn a_reading_with_a_flipped_bit_changes_nothing() {
    let mut flown = Flown::new(0.0, 0.1);
    let mut estimator = estimator();
    flown.play(&mut estimator, 400);
    let before = estimator.estimate().unwrap();
    for _ in 0..3 {
        let m = Measurement { vy_m_s: -45.0, y_m: 90.0, vx_m_s: 30.0, ..flown.read() };
        estimator.take(&m, Channels::ALL, Some(false), 1.0);
        flown.play(&mut estimator, 20);
    }
    let found = estimator.estimate().unwrap();
    assert!((found.vy_m_s - flown.truth.vy_m_s).abs() < 0.05, "{found:?}");
    assert!((found.density_ratio - before.density_ratio).abs() < 0.1, "{found:?}");
    assert!(found.vy_variance < 2.0 * before.vy_variance, "{found:?}");
}

#[test]
fn readings_with_gaps_give_the_same_flight() {
    let mut flown = Flown::new(1.0, 0.05);
    let mut estimator = estimator();
    for tick in 0..900_u32 {
        let m = flown.read();
        if tick % 30 == 7 || tick < 40 {
            estimator.take(&m, Channels::ALL, Some(false), 1.0);
        }
    }
    let found = estimator.estimate().unwrap();
    assert!((found.density_ratio - 1.0).abs() < 0.1, "{found:?}");
    assert!((found.vy_m_s - flown.truth.vy_m_s).abs() < 0.1, "{found:?}");
}

#[test]
fn the_apex_passes_once_and_is_found_from_before_and_from_behind() {
    let mut flown = Flown::new(0.0, 0.2);
    let mut estimator = estimator();
    let ay = 80.0 / 88.0 * 9.81;
    let top_m = 20.0 + 0.5 * 4.0 * 4.0 / ay;
    let mut passed = 0;
    for tick in 0..900_u32 {
        let m = flown.read();
        let events = estimator.take(&m, Channels::ALL, Some(false), 1.0);
        passed += u32::from(events.is_some_and(|events| events.passed_apex));
        if tick > 250 {
            let apex = estimator.apex().unwrap();
            assert!((apex.y_m - top_m).abs() < 0.15, "{apex:?} in {tick}");
            assert!((apex.vx_m_s - 1.0).abs() < 0.1, "{apex:?} in {tick}");
        }
    }
    assert_eq!(passed, 1);
}

/// A leg whose model overflows: no estimate, and no number that is not finite.
#[test]
fn a_state_that_overflows_ends_the_estimate() {
    let leg = LegModel { volume_m3: 1e9, area_x_m2: 1e9, area_y_m2: 1e9, ..LegModel::HUMAN };
    let mut estimator = StateFilter::new(&leg, 9.81, TICK_NS, STALE_NS, &StateNoise::default());
    let mut flown = Flown::new(0.0, 0.5);
    for _ in 0..500 {
        let m = flown.read();
        estimator.take(&m, Channels::ALL, Some(false), 1.0);
        let finite = |e: Estimate| (e.vx_m_s + e.y_m + e.vy_m_s + e.density_ratio).is_finite();
        assert!(estimator.estimate().is_none_or(finite));
    }
}
