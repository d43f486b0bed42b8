//! Host and firmware return the same commands, bit for bit, with either state estimator: under
//! faults of every kind, with every sensor there is, and where the estimate is lost.

use leg_control::estimator::SensorNoise;
use leg_control::serial::message::{Estimator, Request, RequestError, SessionParams};
use leg_control::wire::flags;
use leg_host::serial::client::{ClientError, IDENTIFY_TIMEOUT};
use sim_host::scenario::{Scenario, Settings};

use crate::board::{Flashed, image, shipped, skips, ticks};
use crate::identity::{Counts, assert_changed, compare, settings};

/// Ticks with each estimator; `cargo xtask soak` plays 100,000.
const STATE_TICKS: u64 = 8_000;
const INERTIAL_TICKS: u64 = 10_000;
/// Stale limit of leg and controllers, ns.
const STALE_LIMIT_NS: u64 = 60_000_000;

/// Late, lost and damaged messages.
const BAD_LINE: &str = r"
[[fault]]
jitter = 5

[[fault]]
delay = 3

[[fault]]
drop = 0.1

[[fault]]
duplicate = 0.02

[[fault]]
reorder = 0.02

[[fault]]
corrupt = 0.02
bits = 2

[[fault]]
freeze = 30
";

/// Noisy readings of the state, and all other sensors beside them.
const STATE: &str = r#"
sensors = "trained-with"

[sensor]
accelerometer-rate = 1600
leg-angle-rate = 1000
gyro-rate = 1000
pitch-rate = 100
velocity-rate = 10
height-rate = 10
pressure-rate = 50

[[fault]]
noise = 0.3

[[fault]]
noise = 0.02
field = "contact"

[[fault]]
stuck = 20
field = "y"

[[fault]]
nan = 0.02

[[fault]]
medium = 0
at = "1s"
until = "2s"
"#;

/// Every sensor of a leg that senses neither velocity nor height at every tick, with the errors of
/// their models, and noise beyond them.
const INERTIAL: &str = r#"
sensors = "underwater"

[sensor]
height-rate = 10

[[fault]]
noise = 0.5
field = "acceleration"

[[fault]]
noise = 0.02
field = "contact"

[[fault]]
noise = 0.01
field = "leg-angle"

[[fault]]
stuck = 20
field = "leg-length"
"#;

/// Readings that are no numbers.
const NOT_A_NUMBER: [&str; 7] = [
    "nan=0.02,field=pitch",
    "nan=0.02,field=pitch-rate",
    "nan=0.02,field=leg-length",
    "nan=0.02,field=leg-angle",
    "nan=0.02,field=velocity",
    "nan=0.02,field=height",
    "nan=0.02,field=pressure",
];

/// An accelerometer alone in flight: with [`POOR_DENSITY`] a long one loses the estimate.
const NO_SLOW_SENSOR: [&str; 3] =
    ["dead=velocity,at=0s", "dead=height,at=0s", "dead=pressure,at=0s"];
/// Noise density that is stated of the accelerometer, m/s2 per root hertz: after 0.2 s without
/// another sensor a velocity is uncertain by more than 2 m/s.
const POOR_DENSITY: f32 = 5.0;
/// Ticks with it.
const POOR_TICKS: u64 = 3_000;

/// What happens to the sensors and the medium, one after the other.
const EVENTS: [&[&str]; 4] = [
    &NOT_A_NUMBER,
    // Nothing is sensed any more but contact, and everything again later.
    &[
        "dead=acceleration,at=0.6s,until=1.9s",
        "dead=pitch,at=0.6s,until=1.9s",
        "dead=pitch-rate,at=0.6s,until=1.9s",
        "dead=leg-length,at=0.6s,until=1.9s",
        "dead=leg-angle,at=0.6s,until=1.9s",
        "dead=velocity,at=0.6s,until=1.9s",
        "dead=height,at=0.6s,until=1.9s",
        "dead=pressure,at=0.6s,until=1.9s",
    ],
    &["switch=closed,at=0.5s,until=1s", "switch=open,at=1s,until=2s"],
    &["medium=0,at=0.8s,until=1.4s", "medium=0.5,at=1.4s,until=1.8s"],
];

fn start(estimator: Estimator) -> Flashed {
    let mut flashed = Flashed::start_image(&image("estimator"), Some(&shipped()), |stream| stream);
    flashed.params.stale_limit_ns = STALE_LIMIT_NS as u32;
    flashed.params.estimator = estimator;
    flashed
}

fn scenario(settings: &Settings) -> Scenario {
    let mut scenario = Scenario::from_settings(settings).expect("valid settings");
    // The leg holds commands as long.
    scenario.stale_limit_ns = STALE_LIMIT_NS;
    scenario
}

fn parsed(sensors: &str) -> Settings {
    Settings::from_toml(&format!("{sensors}{BAD_LINE}")).expect("valid settings")
}

/// Checks that there was something to compare: flight and stance, water and land.
fn assert_covered(counts: &Counts) {
    assert!(counts.in_flight > 1_000 && counts.in_stance > 100, "{counts:?}");
    assert!(counts.in_water > 100 && counts.on_land > 100, "{counts:?}");
}

#[test]
fn host_and_firmware_agree_with_the_estimator_for_noisy_states_under_faults_of_every_kind() {
    if skips() {
        return;
    }
    let noise = Estimator::State { velocity_m_s: 0.02, height_m: 0.01, leg_length_m: 0.002 };
    let harsh = parsed(STATE);
    let counts = compare(&mut start(noise), ticks(STATE_TICKS), |run, left| {
        scenario(&settings(run, left).over(Settings { seed: Some(run), ..harsh.clone() }))
    });
    assert_covered(&counts);
    assert_changed(&counts);
}

#[test]
fn host_and_firmware_agree_with_the_estimator_for_raw_sensors_under_faults_of_every_kind() {
    if skips() {
        return;
    }
    let wanted = ticks(INERTIAL_TICKS);
    let length = (wanted / 8).clamp(2_500, 10_000);
    let with_events = |run: u64, left: u64| {
        raw_sensors(run, left.min(length), EVENTS[(run as usize - 1) % EVENTS.len()])
    };
    let estimator = with_events(1, wanted).estimator.expect("that for raw sensors");
    let Estimator::Inertial { figures } = estimator else { panic!("{estimator:?}") };
    let counts = compare(&mut start(estimator), wanted, with_events);
    assert_covered(&counts);
    assert_changed(&counts);
    let sensed = flags::ANY_OF_SENSORS | flags::CONTACT_SENSED | flags::LEG_LENGTH_SENSED;
    assert_eq!(counts.flags & sensed, sensed, "{:#x}", counts.flags);
    assert_eq!(counts.flags & flags::STATE_SENSED, 0, "{:#x}", counts.flags);

    let mut noise = SensorNoise::from_figures(figures);
    noise.acceleration_density = POOR_DENSITY;
    let poor = Estimator::Inertial { figures: noise.figures() };
    let counts = compare(&mut start(poor), POOR_TICKS, |run, left| {
        raw_sensors(run, left.min(length), &NO_SLOW_SENSOR)
    });
    assert!(counts.lost >= 1 && counts.recovered >= 1, "{counts:?}");
}

/// Returns a run of a leg with raw sensors, on the way from water onto land, with these faults
/// beside those of [`INERTIAL`].
fn raw_sensors(run: u64, length: u64, faults: &[&str]) -> Scenario {
    let parse = |text: &&str| text.parse().expect("a fault");
    let own = Settings {
        density_profile: Some(vec![[3.2, 1.0], [3.6, 0.0]]),
        faults: faults.iter().map(parse).collect(),
        ..settings(run, length)
    };
    scenario(&own.over(Settings { seed: Some(run), ..parsed(INERTIAL) }))
}

#[test]
fn firmware_without_the_estimator_refuses_it_by_name() {
    if skips() {
        return;
    }
    let mut flashed = Flashed::start(Some(&shipped()));
    let estimator = Estimator::State { velocity_m_s: 0.1, height_m: 0.1, leg_length_m: 0.1 };
    let params = SessionParams { estimator, ..flashed.params };
    let refused = flashed.client.have_done(&Request::Reset { session: 3, params }).unwrap_err();
    assert!(matches!(refused, ClientError::Refused(RequestError::NoEstimator)), "{refused}");
    assert!(refused.to_string().contains("flash firmware built with the feature `estimator`"));
    // Nothing has changed.
    assert_eq!(flashed.client.identify(IDENTIFY_TIMEOUT).unwrap().session, None);
}
