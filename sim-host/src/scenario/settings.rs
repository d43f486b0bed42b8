//! The settings of a run, from a TOML file and from options. All are optional, and
//! options override the file. [`super::Scenario`] is the validated form.

use clap::ValueEnum;
use serde::de::{Deserializer, Error};
use serde::{Deserialize, Serialize};

use super::profile::SetPointStep;
use crate::faults::FaultSetting;
use crate::sensors::{self, SensorProfile, SensorSetting};
use leg_host::law::LawSettings;
use leg_plant::LegParameters;

/// A named leg.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum LegPreset {
    /// Human-sized, 80 kg.
    Human,
    /// Crab-sized, 74 g.
    Crab,
}

/// A named medium.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum MediumPreset {
    /// Water on Earth.
    Water,
    /// Air on Earth, its density neglected.
    Air,
    /// The surface of the Moon.
    Moon,
    /// The surface of Mars.
    Mars,
}

/// How the controller obtains the density of the medium.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum DensitySense {
    /// The controller estimates the density from the motion.
    #[default]
    Estimated,
    /// A sensor of the leg measures the density.
    #[serde(alias = "told")]
    #[value(alias = "told")]
    Measured,
}

/// The settings of a run, not validated.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, clap::Args)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Ticks per second; must equal the controller's [default: 1000].
    #[arg(long = "rate", value_name = "HZ", allow_negative_numbers = true)]
    pub rate_hz: Option<u32>,
    /// Simulated time after which the run ends, s [default: 60].
    #[arg(long = "duration", value_name = "S", allow_negative_numbers = true)]
    pub duration_s: Option<f64>,
    /// Distance from the start at which the run ends, m [default: none].
    #[arg(long = "distance", value_name = "M", allow_negative_numbers = true)]
    pub distance_m: Option<f64>,
    /// Seed of the random start, within its spreads, and of the faults [default: 0].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<u64>,

    /// Leg by name [default: human].
    #[arg(long, value_name = "NAME")]
    pub leg: Option<LegPreset>,
    /// All parameters of a leg instead of `leg`; in a scenario file only.
    #[arg(skip)]
    pub leg_parameters: Option<LegParameters>,

    /// Medium by name [default: air].
    #[arg(long, value_name = "NAME")]
    pub medium: Option<MediumPreset>,
    /// Density of the medium over that of water; overrides the named medium's.
    #[arg(long, value_name = "RATIO", allow_negative_numbers = true)]
    pub density_ratio: Option<f64>,
    /// Density ratio over position, as x:ratio,x:ratio,… with x in m; interpolated linearly.
    #[arg(long, value_name = "PROFILE", value_parser = parse_profile)]
    #[serde(deserialize_with = "points")]
    pub density_profile: Option<Points>,
    /// Gravity, m/s2; overrides the named medium's.
    #[arg(long = "gravity", value_name = "M_S2", allow_negative_numbers = true)]
    pub gravity_m_s2: Option<f64>,
    /// Whether the leg measures the density or the controller estimates it [default: estimated].
    #[arg(long, value_name = "HOW")]
    pub density: Option<DensitySense>,

    /// Velocity set-point, m/s [default: 0].
    #[arg(long = "set-point", value_name = "M_S", allow_negative_numbers = true)]
    pub set_point_m_s: Option<f64>,
    /// Changes of the set-point, such as x30:1,t60:-0.5: 1 m/s from 30 m on, -0.5 m/s from 60 s on.
    #[arg(long = "set-point-steps", value_name = "STEPS", value_parser = parse_steps)]
    pub set_point_steps: Option<Steps>,

    /// Sensors of the leg by name of their profile [default: ideal]; `sim-host sensors` lists
    /// all.
    #[arg(long, value_name = "PROFILE")]
    pub sensors: Option<SensorProfile>,
    /// Set a figure of a sensor, such as accelerometer-bias=0.5; may be given several times;
    /// `sim-host sensors` lists all.
    #[arg(long = "sensor", value_name = "FIGURE=VALUE")]
    #[serde(rename = "sensor", with = "sensors::as_table", skip_serializing_if = "Vec::is_empty")]
    pub sensor_figures: Vec<SensorSetting>,

    /// The control law; a controller that is started apart has its own options.
    #[command(flatten)]
    pub controller: LawSettings,

    /// The start of the run.
    #[command(flatten)]
    pub start: StartSettings,

    /// Inject a fault, as kind=value,key=value,…; may be given several times; `help` lists all.
    #[arg(long = "fault", value_name = "FAULT")]
    #[serde(rename = "fault", skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultSetting>,
}

/// The start of a run, not validated.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, clap::Args)]
#[serde(deny_unknown_fields, default)]
pub struct StartSettings {
    /// Position at the start, m [default: 0].
    #[arg(long = "start-x", value_name = "M", allow_negative_numbers = true)]
    pub x_m: Option<f64>,
    /// Height at the start, m [default: twice the leg's rest length].
    #[arg(long = "start-y", value_name = "M", allow_negative_numbers = true)]
    pub y_m: Option<f64>,
    /// Horizontal velocity at the start, m/s [default: 0].
    #[arg(long = "start-vx", value_name = "M_S", allow_negative_numbers = true)]
    pub vx_m_s: Option<f64>,
    /// Vertical velocity at the start, m/s [default: 0].
    #[arg(long = "start-vy", value_name = "M_S", allow_negative_numbers = true)]
    pub vy_m_s: Option<f64>,
    /// Largest random change of the horizontal velocity, m/s [default: 0].
    #[arg(long = "start-vx-spread", value_name = "M_S", allow_negative_numbers = true)]
    pub vx_spread_m_s: Option<f64>,
    /// Largest random increase of the height, m [default: 0].
    #[arg(long = "start-y-spread", value_name = "M", allow_negative_numbers = true)]
    pub y_spread_m: Option<f64>,
}

/// Points of a profile. The alias hides the list from clap, which would otherwise
/// accept the option several times.
pub type Points = Vec<[f64; 2]>;
/// Changes of the set-point.
pub type Steps = Vec<SetPointStep>;

/// Deserialises points of exactly two numbers; an array type would accept a third.
fn points<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Points>, D::Error> {
    let point = |numbers: Vec<f64>| {
        numbers.try_into().map_err(|numbers| {
            D::Error::custom(format!("{numbers:?}: a point must be two numbers, [x, value]"))
        })
    };
    Vec::deserialize(deserializer)?.into_iter().map(point).collect::<Result<_, _>>().map(Some)
}

fn parse_pair(text: &str) -> Result<(&str, f64), String> {
    let (left, right) = text.split_once(':').ok_or(format!("`{text}` has no `:`"))?;
    let value = right.parse().map_err(|_| format!("`{right}` is not a number"))?;
    Ok((left, value))
}

fn parse_profile(text: &str) -> Result<Points, String> {
    let point = |text: &str| {
        let (place, value) = parse_pair(text)?;
        let place = place.parse().map_err(|_| format!("`{place}` is not a number"))?;
        Ok([place, value])
    };
    text.split(',').map(point).collect()
}

fn parse_steps(text: &str) -> Result<Steps, String> {
    let step = |text: &str| {
        let (from, m_s) = parse_pair(text)?;
        let number = |text: &str| text.parse().map_err(|_| format!("`{text}` is not a number"));
        match (from.strip_prefix('t'), from.strip_prefix('x')) {
            (Some(t), _) => Ok(SetPointStep { from_t_s: Some(number(t)?), from_x_m: None, m_s }),
            (_, Some(x)) => Ok(SetPointStep { from_t_s: None, from_x_m: Some(number(x)?), m_s }),
            _ => Err(format!("`{from}` must be t<seconds> or x<metres>")),
        }
    };
    text.split(',').map(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_lists_from_options() {
        assert_eq!(parse_profile("15:1,30:0"), Ok(vec![[15.0, 1.0], [30.0, 0.0]]));
        assert_eq!(
            parse_steps("x30:1,t5.5:-0.5"),
            Ok(vec![
                SetPointStep { from_t_s: None, from_x_m: Some(30.0), m_s: 1.0 },
                SetPointStep { from_t_s: Some(5.5), from_x_m: None, m_s: -0.5 },
            ])
        );
        for bad in ["", "15", "15:", ":1", "a:1", "15:1,"] {
            assert!(parse_profile(bad).is_err(), "{bad}");
        }
        for bad in ["", "30:1", "y3:1", "x:1", "t1:z"] {
            assert!(parse_steps(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn rejects_a_point_without_exactly_two_numbers() {
        let read = toml::from_str::<Settings>("density_profile = [[15, 1], [30.0, 0.0]]").unwrap();
        assert_eq!(read.density_profile, Some(vec![[15.0, 1.0], [30.0, 0.0]]));
        for (bad, point) in [
            ("[[1.0, 2.0, 3.0]]", "[1.0, 2.0, 3.0]"),
            ("[[0.0, 1.0], [7.5]]", "[7.5]"),
            ("[[]]", "[]"),
        ] {
            let refused = toml::from_str::<Settings>(&format!("density_profile = {bad}"));
            let message = refused.unwrap_err().to_string();
            let what = format!("{point}: a point must be two numbers");
            assert!(message.contains(&what) && message.contains("density_profile"), "{message}");
        }
    }

    #[test]
    fn rejects_unknown_keys() {
        let refused = toml::from_str::<Settings>("rat_hz = 1000").unwrap_err().to_string();
        assert!(refused.contains("rat_hz") && refused.contains("rate_hz"), "{refused}");
        assert!(toml::from_str::<Settings>("[start]\nz_m = 1.0").is_err());
        assert!(toml::from_str::<Settings>("set_point_steps = [{ at = 1, m_s = 1.0 }]").is_err());
    }
}
