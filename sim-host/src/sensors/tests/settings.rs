//! Settings of sensors, and the lists.

use super::*;
use crate::record::config;
use crate::scenario::{Scenario, Settings};

fn refusal(text: &str) -> String {
    match Settings::from_toml(text) {
        Ok(settings) => Scenario::from_settings(&settings).expect_err(text).to_string(),
        Err(cause) => cause.to_string(),
    }
}

#[test]
fn file_and_command_line_give_the_same_setting() {
    let text = "sensors = \"imu\"\n[sensor]\naccelerometer-bias = 0.5\ncontact-bounce = 0";
    let file = Settings::from_toml(text).unwrap();
    let options = Settings {
        sensors: Some(SensorProfile::Imu),
        sensor_figures: ["accelerometer-bias=0.5", "contact-bounce=0"]
            .map(|setting| setting.parse().unwrap())
            .into(),
        ..Settings::default()
    };
    assert_eq!(file, options);
    let scenario = Scenario::from_settings(&file).unwrap();
    assert_eq!(scenario.sensor_profile, SensorProfile::Imu);
    assert_eq!(scenario.sensors.of(Sensor::Accelerometer, Quantity::Bias), 0.5);
    assert_eq!(scenario.sensors.of(Sensor::Contact, Quantity::Bounce), 0.0);
    let plain = Figures::of_profile(SensorProfile::Imu);
    let noise = |figures: &Figures| figures.of(Sensor::Accelerometer, Quantity::Noise);
    assert_eq!(noise(&scenario.sensors), noise(&plain));
}

#[test]
fn options_override_single_figures_of_the_file() {
    let file = Settings::from_toml(
        "sensors = \"imu\"\n[sensor]\naccelerometer-bias = 0.5\npitch-bias = 0.1",
    );
    let options =
        Settings { sensor_figures: vec!["pitch-bias=0.2".parse().unwrap()], ..Settings::default() };
    let scenario = Scenario::from_settings(&options.over(file.unwrap())).unwrap();
    assert_eq!(scenario.sensors.of(Sensor::Pitch, Quantity::Bias), 0.2);
    assert_eq!(scenario.sensors.of(Sensor::Accelerometer, Quantity::Bias), 0.5);
}

#[test]
fn a_recording_keeps_profile_and_figures_in_its_configuration() {
    let settings = Settings::from_toml(
        "sensors = \"trained-with\"\n[sensor]\nstate-uniform = 0.05\n[start]\ny_m = 1.5\n\
         [[fault]]\nnoise = 0.1",
    );
    let settings = settings.unwrap();
    let scenario = Scenario::from_settings(&settings).unwrap();
    let kept = config::of_run(&settings, &scenario, leg_host::TimeMode::LockStep).unwrap();
    assert_eq!(Settings::from_toml(&kept.scenario_toml).unwrap(), settings);
    let plain = Settings::default();
    assert!(!toml::to_string(&plain).unwrap().contains("sensor"));
}

#[test]
fn an_invalid_setting_is_refused_with_thing_value_limit_and_remedy() {
    for (text, parts) in [
        ("sensors = \"imx\"", ["imx", "ideal", "underwater"]),
        ("[sensor]\nnoise = 1.0", ["`noise` is not a figure", "state-…", "pressure-…"]),
        ("[sensor]\ngyro-nois = 1.0", ["`gyro-nois` is not", "gyro-rate", "gyro-noise"]),
        ("[sensor]\npitch-range = 1.0", ["`pitch-range` is not", "pitch-rate", "pitch-walk"]),
        (
            "sensors = \"imu\"\n[sensor]\naccelerometer-bias = 101",
            ["accelerometer-bias is 101", "from 0 to 100", "m/s2"],
        ),
        ("[sensor]\nstate-noise = -1", ["state-noise is -1", "from 0 to 100", "m/s, m"]),
        ("[sensor]\nstate-noise = nan", ["state-noise is NaN", "from 0 to 100", "m/s, m"]),
        (
            "[sensor]\ngyro-bias = 1",
            ["gyro-bias=1", "no sensor `gyro` in the profile ideal", "gyro-rate above 0 adds it"],
        ),
        (
            "[sensor]\ncontact-rate = 0\nleg-length-rate = 0",
            ["contact-rate and leg-length-rate are 0", "one of them must be above 0", "stands"],
        ),
    ] {
        let message = refusal(text);
        assert!(parts.iter().all(|part| message.contains(part)), "{text}: {message}");
    }
    for (option, what) in [
        ("gyro-bias", "`gyro-bias` is not figure=value"),
        ("gyro-bias=much", "gyro-bias is `much`; it must be a number"),
    ] {
        let message = option.parse::<SensorSetting>().unwrap_err().to_string();
        assert!(message.contains(what), "{message}");
    }
    let twice: Vec<SensorSetting> =
        ["state-noise=1", "state-noise=2"].map(|setting| setting.parse().unwrap()).into();
    let message = Figures::check(SensorProfile::Ideal, &twice).unwrap_err().to_string();
    assert_eq!(message, "`state-noise` is set twice; set it once");
}

#[test]
fn each_profile_has_the_sensors_and_figures_of_its_description() {
    use Quantity::{Bias, Bounce, Jitter, Latency, Noise, Rate, Resolution, Uniform};
    let has = |profile| {
        let figures = Figures::of_profile(profile);
        Sensor::ALL.into_iter().skip(1).filter(|sensor| figures.has(*sensor)).collect::<Vec<_>>()
    };
    let state = [Sensor::State, Sensor::Contact, Sensor::LegLength];
    assert_eq!(has(SensorProfile::Ideal), state);
    assert_eq!(has(SensorProfile::TrainedWith), state);
    let imu = [
        Sensor::Contact,
        Sensor::LegLength,
        Sensor::LegAngle,
        Sensor::Accelerometer,
        Sensor::Gyro,
        Sensor::Pitch,
    ];
    assert_eq!(has(SensorProfile::Imu), imu);
    let slow = [Sensor::Velocity, Sensor::Pressure];
    assert_eq!(has(SensorProfile::Underwater), [&imu[..], &slow].concat());

    let ideal = Figures::of_profile(SensorProfile::Ideal);
    let errors = [Latency, Jitter, Noise, Uniform, Bias, Resolution, Bounce];
    for sensor in state {
        assert!(errors.iter().all(|&error| ideal.of(sensor, error) == 0.0), "{sensor:?}");
    }
    let trained_with = Figures::of_profile(SensorProfile::TrainedWith);
    assert_eq!(trained_with.of(Sensor::State, Uniform), 0.1);
    assert_eq!(trained_with.of(Sensor::Sample, Latency), 0.02);
    let imu = Figures::of_profile(SensorProfile::Imu);
    let near = |value: f64, expected: f64| (value / expected - 1.0).abs() < 1e-3;
    assert!(near(imu.of(Sensor::Accelerometer, Bias), 0.1961), "20 mg");
    assert!(near(imu.of(Sensor::Accelerometer, Noise), 0.001_716), "175 ug");
    assert!(near(imu.of(Sensor::Gyro, Noise), 2.443e-4), "0.014 dps");
    assert!(near(imu.of(Sensor::LegAngle, Resolution), std::f64::consts::TAU / 16_384.0));
    assert_eq!(imu.of(Sensor::LegLength, Noise), 0.001);
    assert_eq!(imu.of(Sensor::Pitch, Bias), 0.01);
    assert_eq!((imu.of(Sensor::Contact, Latency), imu.of(Sensor::Contact, Jitter)), (0.001, 0.002));
    let underwater = Figures::of_profile(SensorProfile::Underwater);
    assert!((5.0..=10.0).contains(&underwater.of(Sensor::Velocity, Rate)));
}

#[test]
fn the_list_has_every_figure_with_unit_range_and_source() {
    let text = help();
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
    for row in catalog::TABLE {
        let name = row.figure.to_string();
        assert!(text.contains(&format!("  {name} ")), "{name}");
        assert!((0.0..=row.most).contains(&row.value) && !row.source.is_empty(), "{name}");
        let twin = catalog::TABLE.iter().filter(|other| other.figure == row.figure).count();
        assert_eq!((twin, catalog::named(&name).is_some()), (1, true), "{name}");
    }
    let json = serde_json::to_value(Listing::new()).unwrap();
    for profile in SensorProfile::ALL {
        assert!(text.contains(profile.name()));
        for own in profile.own_figures() {
            let figure = &json["profiles"][profile as usize]["figures"][own.figure.to_string()];
            assert_eq!(
                (figure["value"].as_f64(), figure["source"].as_str()),
                (Some(own.value), Some(own.source))
            );
        }
    }
    let bias = json["figures"].as_array().unwrap().iter().find(|row| row["name"] == "pitch-bias");
    let bias = bias.unwrap();
    assert_eq!((bias["unit"].as_str(), bias["most"].as_f64()), (Some("rad"), Some(3.2)));
}
