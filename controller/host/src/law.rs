//! The settings of the control law that do not come with the leg: what it takes for the state,
//! and how old a message may be. `controller`, the simulator and its bridge take the same.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt;

use clap::ValueEnum;
use leg_control::config::{Config, ConfigError, Estimation, STALE_LIMIT_NS};
use leg_control::estimator::{SensorNoise, StateNoise};
use leg_control::guard::SAFE_AFTER_NS;
use leg_control::serial::message::Estimator;
use serde::{Deserialize, Serialize};

/// What the control law takes for the state, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum EstimatorKind {
    /// The readings of velocity and height themselves: for exact sensors.
    Readings,
    /// An estimate from noisy, late or lost readings of velocity and height.
    State,
    /// An estimate from accelerometer, encoders of the leg and contact, of a leg that senses
    /// neither velocity nor height.
    Inertial,
}

/// Stated standard deviations of sensors, by name.
pub type Noise = BTreeMap<String, f64>;

/// The settings, not validated.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, clap::Args)]
#[serde(deny_unknown_fields, default)]
#[group(skip)]
pub struct LawSettings {
    /// What the control law takes for the state [default: readings].
    #[arg(long, value_name = "NAME")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimator: Option<EstimatorKind>,
    /// Least noise of the sensors that the estimator assumes, standard deviations; for `state`:
    /// velocity=0.01,height=0.01,leg-length=0.001 (m/s, m, m), which are the defaults; for
    /// `inertial`: acceleration (m/s2 per root hertz), acceleration-bias, acceleration-scale,
    /// bias-walk, acceleration-range, pitch, pitch-walk, leg-length, leg-angle, velocity, height,
    /// pressure.
    #[arg(id = "estimator-noise", long, value_name = "NAME=VALUE,…", value_parser = parse_noise)]
    #[serde(rename = "noise", skip_serializing_if = "Option::is_none")]
    pub noise: Option<Noise>,
    /// Age from which on a sample or a command counts for nothing, ms; leg and controller must
    /// agree [default: 10].
    #[arg(long = "stale-limit", value_name = "MS", allow_negative_numbers = true)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stale_limit_ms: Option<f64>,
}

/// A setting is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key}: {what}")]
pub struct LawError {
    /// Name of the setting in a scenario file.
    pub key: &'static str,
    /// The value, and the limit.
    pub what: String,
}

/// [`LawError::key`] of the noise.
pub const NOISE: &str = "noise";
/// [`LawError::key`] of the stale limit.
pub const STALE_LIMIT_MS: &str = "stale_limit_ms";

/// The names of the noise of a kind.
const STATE_NOISE: [&str; 3] = ["velocity", "height", "leg-length"];

/// Those of raw sensors, in the order of [`SensorNoise::figures`].
const INERTIAL_NOISE: [&str; 12] = [
    "acceleration",
    "acceleration-bias",
    "acceleration-scale",
    "bias-walk",
    "acceleration-range",
    "pitch",
    "pitch-walk",
    "leg-length",
    "leg-angle",
    "velocity",
    "height",
    "pressure",
];

fn parse_noise(text: &str) -> Result<Noise, String> {
    text.split(',')
        .map(|pair| {
            let (name, value) = pair.split_once('=').ok_or(format!("`{pair}` has no `=`"))?;
            let value = value.parse().map_err(|_| format!("`{value}` is not a number"))?;
            Ok((name.to_owned(), value))
        })
        .collect()
}

impl LawSettings {
    /// Returns the settings that give this estimator and this stale limit, ns.
    #[must_use]
    pub fn of(estimator: Option<Estimator>, stale_limit_ns: u64) -> Self {
        let (estimator, noise) = estimator.map(parts).unzip();
        Self {
            estimator: estimator.and_then(|name| EstimatorKind::from_str(&name, false).ok()),
            noise: noise.map(|noise| noise.into_iter().map(|(n, x)| (n, x.into())).collect()),
            stale_limit_ms: Some(stale_limit_ns as f64 / 1e6),
        }
    }

    /// Returns these settings, completed by `base`. An estimator given here comes with its own
    /// noise.
    #[must_use]
    pub fn over(self, base: Self) -> Self {
        let noise = if self.estimator.is_some() { self.noise } else { self.noise.or(base.noise) };
        Self {
            estimator: self.estimator.or(base.estimator),
            noise,
            stale_limit_ms: self.stale_limit_ms.or(base.stale_limit_ms),
        }
    }

    /// Returns the estimator, if one is set.
    ///
    /// # Errors
    /// [`LawError`] when a noise has another name or value than the estimator knows.
    pub fn estimator(&self) -> Result<Option<Estimator>, LawError> {
        let noise = self.noise.clone().unwrap_or_default();
        let error = |what| LawError { key: NOISE, what };
        let estimator = match self.estimator {
            Some(EstimatorKind::State) => {
                let usual = StateNoise::default();
                let [velocity_m_s, height_m, leg_length_m] = values(
                    &noise,
                    STATE_NOISE,
                    [usual.velocity_m_s, usual.height_m, usual.leg_length_m],
                )
                .map_err(error)?;
                Estimator::State { velocity_m_s, height_m, leg_length_m }
            }
            Some(EstimatorKind::Inertial) => {
                let usual = SensorNoise::default().figures();
                let figures = values(&noise, INERTIAL_NOISE, usual).map_err(error)?;
                Estimator::Inertial { figures }
            }
            readings => {
                values(&noise, [], []).map_err(error)?;
                return Ok(readings.map(|_| Estimator::Readings));
            }
        };
        estimator
            .try_into()
            .and_then(|estimation: Estimation| Config::default().with_estimation(estimation))
            .map_err(|cause: ConfigError| error(cause.to_string()))?;
        Ok(Some(estimator))
    }

    /// Returns the stale limit, ns.
    ///
    /// # Errors
    /// [`LawError`] outside [`STALE_LIMIT_NS`].
    pub fn stale_limit_ns(&self) -> Result<u64, LawError> {
        let Some(ms) = self.stale_limit_ms else { return Ok(SAFE_AFTER_NS) };
        let [least_ms, most_ms] =
            [STALE_LIMIT_NS.start(), STALE_LIMIT_NS.end()].map(|ns| *ns as f64 / 1e6);
        if (least_ms..=most_ms).contains(&ms) {
            return Ok((1e6 * ms).round() as u64);
        }
        let what = format!("{ms}: it must be from {least_ms} to {most_ms} ms");
        Err(LawError { key: STALE_LIMIT_MS, what })
    }

    /// Returns the options that give these settings to another program.
    #[must_use]
    pub fn arguments(&self) -> Vec<OsString> {
        let mut all = Vec::new();
        let mut add = |option: &str, value: String| all.extend([option.into(), value.into()]);
        if let Some(kind) = self.estimator.and_then(|kind| kind.to_possible_value()) {
            add("--estimator", kind.get_name().to_owned());
        }
        if let Some(noise) = self.noise.as_ref().filter(|noise| !noise.is_empty()) {
            let pairs: Vec<_> =
                noise.iter().map(|(name, value)| format!("{name}={value}")).collect();
            add("--estimator-noise", pairs.join(","));
        }
        if let Some(ms) = self.stale_limit_ms {
            add("--stale-limit", ms.to_string());
        }
        all
    }
}

/// Returns the values of the names, `usual` where none is given.
fn values<const N: usize>(
    noise: &Noise,
    names: [&str; N],
    usual: [f32; N],
) -> Result<[f32; N], String> {
    if let Some((name, value)) = noise.iter().find(|(name, _)| !names.contains(&name.as_str())) {
        return Err(if names.is_empty() {
            format!(
                "{name}={value}: the readings themselves have no noise to state; choose an estimator"
            )
        } else {
            format!("{name}={value}: this estimator knows {}", names.join(", "))
        });
    }
    let mut values = usual;
    for (value, name) in values.iter_mut().zip(names) {
        *value = noise.get(name).map_or(*value, |&given| given as f32);
    }
    Ok(values)
}

/// Returns the name of an estimator, and the names and values of its noise.
#[must_use]
pub fn parts(estimator: Estimator) -> (String, Vec<(String, f32)>) {
    let (name, noise) = match estimator {
        Estimator::Readings => ("readings", Vec::new()),
        Estimator::State { velocity_m_s, height_m, leg_length_m } => {
            let values = [velocity_m_s, height_m, leg_length_m];
            ("state", STATE_NOISE.map(str::to_owned).into_iter().zip(values).collect())
        }
        Estimator::Inertial { figures } => {
            ("inertial", INERTIAL_NOISE.map(str::to_owned).into_iter().zip(figures).collect())
        }
    };
    (name.to_owned(), noise)
}

/// Returns the estimator of a name and its noise, the inverse of [`parts`].
///
/// # Errors
/// A message with the name that is not known.
fn from_parts<'a>(
    name: &str,
    noise: impl Iterator<Item = (&'a str, f32)>,
) -> Result<Estimator, String> {
    let kind = EstimatorKind::from_str(name, false)
        .map_err(|_| format!("there is no estimator `{name}`"))?;
    let noise = noise.map(|(name, value)| (name.to_owned(), value.into())).collect();
    let settings = LawSettings { estimator: Some(kind), noise: Some(noise), stale_limit_ms: None };
    let estimator = settings.estimator().map_err(|error| error.what)?;
    Ok(estimator.unwrap_or_default())
}

/// Returns the estimator of a recorded law.
///
/// # Errors
/// A message with the name of an estimator or of a noise that this program does not know.
pub fn of_recording(law: &leg_recording::schema::Law) -> Result<Estimator, String> {
    from_parts(&law.estimator, law.noise.iter().map(|noise| (noise.name.as_str(), noise.deviation)))
}

/// Formats an estimator with its noise.
#[derive(Clone, Copy, Debug)]
pub struct Described(pub Estimator);

impl fmt::Display for Described {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, noise) = parts(self.0);
        f.write_str(&name)?;
        for (i, (name, value)) in noise.iter().enumerate() {
            write!(f, "{}{name}={value}", if i == 0 { " with noise " } else { "," })?;
        }
        Ok(())
    }
}

/// What a leg senses, or what a control law needs of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Channels {
    /// Velocities and height.
    pub state: bool,
    /// An accelerometer and the leg's joints.
    pub inertial: bool,
}

impl Default for Channels {
    /// Returns those of a leg that senses its state.
    fn default() -> Self {
        Self { state: true, inertial: false }
    }
}

impl Channels {
    /// Returns what the law with this estimator needs.
    #[must_use]
    pub fn needed_by(estimator: Estimator) -> Self {
        match estimator {
            Estimator::Readings | Estimator::State { .. } => Self { state: true, inertial: false },
            Estimator::Inertial { .. } => Self { state: false, inertial: true },
        }
    }

    /// Returns whether all of `needed` is among these.
    #[must_use]
    pub fn include(self, needed: Self) -> bool {
        (self.state || !needed.state) && (self.inertial || !needed.inertial)
    }
}

impl fmt::Display for Channels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match (self.state, self.inertial) {
            (true, false) => "velocity and height",
            (false, true) => "an inertial sensor and the leg's joints",
            (true, true) => "velocity, height, an inertial sensor and the leg's joints",
            (false, false) => "contact only",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(estimator: Option<EstimatorKind>, noise: &str) -> LawSettings {
        let noise = (!noise.is_empty()).then(|| parse_noise(noise).unwrap());
        LawSettings { estimator, noise, stale_limit_ms: None }
    }

    #[test]
    fn each_estimator_knows_its_own_noise() {
        let state = Some(EstimatorKind::State);
        assert_eq!(
            settings(state, "velocity=0.5,leg-length=0.25").estimator(),
            Ok(Some(Estimator::State { velocity_m_s: 0.5, height_m: 0.01, leg_length_m: 0.25 }))
        );
        assert_eq!(settings(None, "").estimator(), Ok(None));
        let readings = Some(EstimatorKind::Readings);
        assert_eq!(settings(readings, "").estimator(), Ok(Some(Estimator::Readings)));
        for (kind, noise, part) in [
            (state, "speed=1", "speed=1: this estimator knows velocity, height, leg-length"),
            (state, "height=0", "1e-4 to 1e3"),
            (state, "height=nan", "1e-4 to 1e3"),
            (readings, "height=1", "height=1: the readings themselves"),
            (None, "height=1", "choose an estimator"),
        ] {
            let refused = settings(kind, noise).estimator().unwrap_err().to_string();
            assert!(refused.contains(part), "{refused}");
        }
        for bad in ["height", "height=a", "", "height=1,"] {
            assert!(parse_noise(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_stale_limit_is_in_milliseconds_and_within_its_limits() {
        let limit = |ms| LawSettings { stale_limit_ms: Some(ms), ..LawSettings::default() };
        assert_eq!(LawSettings::default().stale_limit_ns(), Ok(10_000_000));
        assert_eq!(limit(0.05).stale_limit_ns(), Ok(50_000));
        assert_eq!(limit(1000.0).stale_limit_ns(), Ok(1_000_000_000));
        for bad in [0.0, -10.0, 0.049, 1000.1, f64::NAN, f64::INFINITY] {
            let refused = limit(bad).stale_limit_ns().unwrap_err().to_string();
            assert!(refused.contains("from 0.05 to 1000 ms"), "{refused}");
        }
    }

    #[test]
    fn the_settings_of_a_law_give_it_bit_for_bit() {
        for (velocity_m_s, height_m) in [(0.1, 1.0 / 3.0), (1e-4, 999.9), (0.7, 2.0 / 7.0)] {
            let state = Estimator::State { velocity_m_s, height_m, leg_length_m: 0.001 };
            let mut figures = SensorNoise::default().figures();
            figures[0] = velocity_m_s;
            figures[10] = height_m;
            let inertial = Estimator::Inertial { figures };
            let limits = [50_000, 12_345_678, 10_000_000, 999_999_999];
            for (ns, estimator) in limits.into_iter().flat_map(|ns| [(ns, state), (ns, inertial)]) {
                let settings = LawSettings::of(Some(estimator), ns);
                assert_eq!(settings.estimator(), Ok(Some(estimator)));
                assert_eq!(settings.stale_limit_ns(), Ok(ns));
                let texts: Vec<_> = settings.arguments().into_iter().skip(3).collect();
                assert_eq!(parse_noise(texts[0].to_str().unwrap()), Ok(settings.noise.unwrap()));
            }
        }
    }

    #[test]
    fn another_estimator_does_not_inherit_the_noise() {
        let base = LawSettings {
            stale_limit_ms: Some(300.0),
            ..settings(Some(EstimatorKind::State), "height=0.5")
        };
        let readings = settings(Some(EstimatorKind::Readings), "").over(base.clone());
        assert_eq!((readings.noise, readings.stale_limit_ms), (None, Some(300.0)));
        assert_eq!(LawSettings::default().over(base.clone()), base);
        assert_eq!(
            base.arguments(),
            ["--estimator", "state", "--estimator-noise", "height=0.5", "--stale-limit", "300"]
        );
    }
}
