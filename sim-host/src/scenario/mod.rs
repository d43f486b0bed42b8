//! The validated description of a run: leg, medium, set-point, start and end.
//!
//! A scenario comes from a TOML file, from command-line options, or from both, of
//! which the options override the file. A value out of range is rejected with its
//! name, the value and the limit.

mod profile;
mod settings;

use std::ffi::OsString;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use leg_control::config::{Config, ConfigError, RATE_HZ};
use leg_control::guard::Limits;
use leg_control::leg::LegModel;
use leg_control::serial::message::Estimator;
use leg_control::serial::node;
use leg_host::SessionParams;
use leg_host::law::{self, Channels, LawError, LawSettings};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::{Rng, SeedableRng};

pub use profile::{Profile, SetPointCursor, SetPointStep, SetPoints};
pub use settings::{DensitySense, LegPreset, MediumPreset, Points, Settings, StartSettings, Steps};

use crate::faults::{self, Faults};
use crate::sensors::{Figures, Sensor, SensorProfile, SensorSetting};
use leg_plant::{Body, Ground, Leg, Medium, TickPlant};

/// [`BadValue::key`] of the settings of the control law.
pub(crate) const NOISE: &str = "controller.noise";
pub(crate) const STALE_LIMIT_MS: &str = "controller.stale_limit_ms";
/// Longest run, s.
const MAX_DURATION_S: f64 = 86_400.0;
const DEFAULT_DURATION_S: f64 = 60.0;
const DEFAULT_RATE_HZ: u32 = 1000;
/// Largest distance of the end from the start, and of the start from 0, m.
const MAX_DISTANCE_M: f64 = 1e6;
const MAX_GRAVITY_M_S2: f64 = 100.0;

/// A validated run.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Ticks per second.
    pub rate_hz: u32,
    /// Longest duration, s.
    pub duration_s: f64,
    /// Distance from the start at which the run ends, m.
    pub distance_m: Option<f64>,
    /// The leg for which the controller is configured.
    pub leg: Leg,
    /// Density ratio of the medium over x.
    pub density: Profile,
    /// Gravity, m/s2.
    pub gravity_m_s2: f64,
    /// How the controller obtains the density.
    pub density_sense: DensitySense,
    /// Velocity set-point over time and place.
    pub set_points: SetPoints,
    /// State at the start, with the random spread applied.
    pub start: Body,
    /// Seed of everything random in the run.
    pub seed: u64,
    /// Profile of the leg's sensors.
    pub sensor_profile: SensorProfile,
    /// Figures of the leg's sensors: the profile's and the settings'.
    pub sensors: Figures,
    /// Faults to inject.
    pub faults: Faults,
    /// Age from which on a command counts for nothing, and time without one after which the
    /// leg gives up, ns; of the controller the same.
    pub stale_limit_ns: u64,
    /// What the controller takes for the state; `None` stands for the readings.
    pub estimator: Option<Estimator>,
    /// The same as the user chose it: what a controller that is started apart must take. `None`
    /// leaves it to that controller.
    pub required_estimator: Option<Estimator>,
}

impl Scenario {
    /// Returns the demonstration: from rest in water over the shore onto land, with
    /// the density estimated.
    #[must_use]
    pub fn shore() -> Self {
        Self::from_settings(&Settings::shore()).expect("part of the program, and tested")
    }

    /// Returns the time between two ticks, s.
    #[must_use]
    pub fn tick_s(&self) -> f64 {
        1.0 / f64::from(self.rate_hz)
    }

    /// Returns the number of ticks in the full duration.
    #[must_use]
    pub fn ticks(&self) -> u64 {
        (self.duration_s * f64::from(self.rate_hz)).ceil() as u64
    }

    /// Returns the gravity for the controller's configuration, m/s2.
    #[must_use]
    pub fn controller_gravity_m_s2(&self) -> f32 {
        self.gravity_m_s2 as f32
    }

    /// Returns the leg's parameters in the form in which a policy states them.
    #[must_use]
    pub fn leg_model(&self) -> LegModel {
        let p = self.leg.parameters();
        LegModel {
            mass_kg: p.mass_kg as f32,
            added_mass_kg: p.added_mass_kg as f32,
            stiffness_n_m: p.stiffness_n_m as f32,
            volume_m3: p.volume_m3 as f32,
            rest_length_m: p.rest_length_m as f32,
            max_elongation_m: p.max_elongation_m as f32,
            area_x_m2: p.area_x_m2 as f32,
            area_y_m2: p.area_y_m2 as f32,
            drag_x: p.drag_x as f32,
            drag_y: p.drag_y as f32,
        }
    }

    /// Returns the parameters on which leg and controller must agree.
    #[must_use]
    pub fn session_params(&self) -> SessionParams {
        let params = SessionParams::at(self.rate_hz)
            .with_gravity(self.controller_gravity_m_s2())
            .with_leg(&self.leg_model())
            .with_stale_limit(self.stale_limit_ns);
        SessionParams { estimator: self.required_estimator, channels: self.channels(), ..params }
    }

    /// Returns what the leg senses, of what an estimator can need.
    #[must_use]
    pub fn channels(&self) -> Channels {
        let has = |sensor| self.sensors.has(sensor);
        Channels {
            state: has(Sensor::State),
            inertial: [Sensor::Accelerometer, Sensor::LegLength, Sensor::LegAngle]
                .into_iter()
                .all(has),
        }
    }

    /// Returns the configuration of a controller for this scenario.
    ///
    /// # Errors
    /// [`ConfigError`] if a value is out of its range.
    pub fn controller_config(&self) -> Result<Config, ConfigError> {
        node::SessionParams {
            rate_hz: self.rate_hz,
            gravity_m_s2: self.controller_gravity_m_s2(),
            stale_limit_ns: u32::try_from(self.stale_limit_ns)
                .map_err(|_| ConfigError::StaleLimit(self.stale_limit_ns))?,
            estimator: self.estimator.unwrap_or_default(),
        }
        .config()
    }

    /// Returns the options of a controller program with this control law.
    #[must_use]
    pub fn law_arguments(&self) -> Vec<OsString> {
        LawSettings::of(self.estimator, self.stale_limit_ns).arguments()
    }

    /// Returns the leg of the plant: that of the controller's configuration, unless a
    /// fault changes its parameters.
    #[must_use]
    pub fn played_leg(&self) -> Leg {
        let mut parameters = *self.leg.parameters();
        self.faults.change_leg(&mut parameters);
        Leg::new(parameters).unwrap_or(self.leg)
    }

    /// Returns the plant at the start of the run: the leg to be played, with the losses that
    /// faults give it.
    #[must_use]
    pub fn plant(&self) -> TickPlant {
        TickPlant::new(self.played_leg(), self.start).with_losses(self.faults.losses())
    }

    /// Returns the medium at `x_m`.
    #[must_use]
    pub fn medium_at(&self, x_m: f64) -> Medium {
        self.medium_of(self.density.at(x_m))
    }

    /// Returns the gravity of the simulated leg, m/s2: the controller's unless a fault changes it.
    #[must_use]
    pub fn played_gravity_m_s2(&self) -> f64 {
        self.gravity_m_s2 * self.faults.gravity_factor()
    }

    /// Returns a medium with the gravity of the simulated leg and a validated density.
    pub(crate) fn medium_of(&self, density_ratio: f64) -> Medium {
        Medium::new(density_ratio, self.played_gravity_m_s2())
            .expect("densities between checked ones, and a checked gravity")
    }

    /// Validates settings.
    ///
    /// # Errors
    /// The first [`BadValue`].
    pub fn from_settings(settings: &Settings) -> Result<Self, BadValue> {
        let s = settings;
        let leg = leg(s)?;
        let guard = Limits::default();
        let speed = f64::from(guard.max_speed_m_s);
        let (medium, density) = medium(s, &guard)?;

        let rate_hz = s.rate_hz.unwrap_or(DEFAULT_RATE_HZ);
        if !RATE_HZ.contains(&rate_hz) {
            let limit = format!("it must be from {} to {}", RATE_HZ.start(), RATE_HZ.end());
            return Err(BadValue::new("rate_hz", rate_hz, limit));
        }
        let duration_s = s.duration_s.unwrap_or(DEFAULT_DURATION_S);
        above_zero("duration_s", duration_s, MAX_DURATION_S)?;
        if let Some(distance_m) = s.distance_m {
            above_zero("distance_m", distance_m, MAX_DISTANCE_M)?;
        }

        let set_points = SetPoints {
            start_m_s: within("set_point_m_s", s.set_point_m_s.unwrap_or(0.0), [-speed, speed])?,
            steps: s.set_point_steps.clone().unwrap_or_default(),
        };
        for step in &set_points.steps {
            within("set_point_steps: m_s", step.m_s, [-speed, speed])?;
            match (step.from_t_s, step.from_x_m) {
                (Some(t_s), None) => {
                    within("set_point_steps: from_t_s", t_s, [0.0, MAX_DURATION_S])
                }
                (None, Some(x_m)) => {
                    within("set_point_steps: from_x_m", x_m, [-MAX_DISTANCE_M, MAX_DISTANCE_M])
                }
                _ => Err(BadValue::new(
                    "set_point_steps",
                    format!("{{ m_s = {} }}", step.m_s),
                    "each step must have either from_t_s or from_x_m",
                )),
            }?;
        }

        let seed = s.seed.unwrap_or(0);
        let density_sense = s.density.unwrap_or_default();
        let density_is_measured = density_sense == DensitySense::Measured;
        let sensor_profile = s.sensors.unwrap_or_default();
        let sensors = Figures::check(sensor_profile, &s.sensor_figures)
            .map_err(|cause| BadValue { key: "sensor", what: cause.to_string() })?;
        let chosen = s.controller.estimator().map_err(law)?;
        let (estimator, required_estimator) = match chosen {
            // What the sensors of the run are known for.
            Some(Estimator::Inertial { .. }) if s.controller.noise.is_none() => {
                (Some(Estimator::Inertial { figures: sensors.stated().figures() }), None)
            }
            None if sensor_profile != SensorProfile::Ideal => (Some(sensors.estimator()), None),
            chosen => (chosen, chosen),
        };
        let run = faults::RunParameters { seed, rate_hz, density_is_measured, sensors: &sensors };
        let faults = Faults::check(&s.faults, &run)
            .map_err(|cause| BadValue { key: "fault", what: cause.to_string() })?;
        let mut start = start(&s.start, seed, &leg, &guard)?;
        if let Some(terrain) = faults.terrain() {
            start.y_m += terrain.height_m(start.x_m);
        }

        Ok(Self {
            rate_hz,
            duration_s,
            distance_m: s.distance_m,
            leg,
            density,
            gravity_m_s2: medium.gravity_m_s2(),
            density_sense,
            set_points,
            start,
            seed,
            sensor_profile,
            sensors,
            faults,
            stale_limit_ns: s.controller.stale_limit_ns().map_err(law)?,
            estimator,
            required_estimator,
        })
    }
}

impl Settings {
    /// Returns the settings of [`Scenario::shore`].
    #[must_use]
    pub fn shore() -> Self {
        Self::from_toml(include_str!("../../scenarios/shore.toml"))
            .expect("the scenario file is part of the program, and tested")
    }

    /// Reads settings from TOML text.
    ///
    /// # Errors
    /// The error of the TOML parser, with its position.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        toml::from_str(text)
    }

    /// Reads a scenario file.
    ///
    /// # Errors
    /// [`ScenarioError`].
    pub fn from_file(path: &Path) -> Result<Self, ScenarioError> {
        let text = std::fs::read_to_string(path)
            .map_err(|cause| ScenarioError::Read { path: path.to_owned(), cause })?;
        Self::from_toml(&text)
            .map_err(|cause| ScenarioError::Toml { path: path.to_owned(), cause: Box::new(cause) })
    }

    /// Returns these settings, completed by `base`.
    ///
    /// A medium, leg or set-point given here replaces all settings of `base` for the
    /// same quantity; a medium, for example, also replaces a density profile. Faults
    /// are appended to those of `base`.
    #[must_use]
    pub fn over(self, base: Self) -> Self {
        let sets_density =
            self.medium.is_some() || self.density_ratio.is_some() || self.density_profile.is_some();
        let sets_gravity = self.medium.is_some() || self.gravity_m_s2.is_some();
        let sets_leg = self.leg.is_some() || self.leg_parameters.is_some();
        let sets_speed = self.set_point_m_s.is_some();
        Self {
            rate_hz: self.rate_hz.or(base.rate_hz),
            duration_s: self.duration_s.or(base.duration_s),
            distance_m: self.distance_m.or(base.distance_m),
            seed: self.seed.or(base.seed),
            leg: if sets_leg { self.leg } else { base.leg },
            leg_parameters: if sets_leg { self.leg_parameters } else { base.leg_parameters },
            medium: self.medium.or(base.medium),
            density_ratio: if sets_density { self.density_ratio } else { base.density_ratio },
            density_profile: if sets_density { self.density_profile } else { base.density_profile },
            gravity_m_s2: if sets_gravity { self.gravity_m_s2 } else { base.gravity_m_s2 },
            density: self.density.or(base.density),
            set_point_m_s: self.set_point_m_s.or(base.set_point_m_s),
            set_point_steps: if sets_speed {
                self.set_point_steps
            } else {
                self.set_point_steps.or(base.set_point_steps)
            },
            controller: self.controller.over(base.controller),
            start: StartSettings {
                x_m: self.start.x_m.or(base.start.x_m),
                y_m: self.start.y_m.or(base.start.y_m),
                vx_m_s: self.start.vx_m_s.or(base.start.vx_m_s),
                vy_m_s: self.start.vy_m_s.or(base.start.vy_m_s),
                vx_spread_m_s: self.start.vx_spread_m_s.or(base.start.vx_spread_m_s),
                y_spread_m: self.start.y_spread_m.or(base.start.y_spread_m),
            },
            sensors: self.sensors.or(base.sensors),
            sensor_figures: SensorSetting::merged(base.sensor_figures, self.sensor_figures),
            faults: base.faults.into_iter().chain(self.faults).collect(),
        }
    }
}

/// Returns the error of a setting of the control law.
fn law(LawError { key, what }: LawError) -> BadValue {
    BadValue { key: if key == law::NOISE { NOISE } else { STALE_LIMIT_MS }, what }
}

fn leg(s: &Settings) -> Result<Leg, BadValue> {
    match (s.leg, s.leg_parameters) {
        (Some(_), Some(_)) => {
            Err(BadValue::new("leg", "both a name and leg_parameters", "give only one of the two"))
        }
        (Some(LegPreset::Crab), None) => Ok(Leg::crab()),
        (Some(LegPreset::Human) | None, None) => Ok(Leg::human()),
        (None, Some(parameters)) => Leg::new(parameters)
            .map_err(|cause| BadValue { key: "leg_parameters", what: cause.to_string() }),
    }
}

/// Returns the medium's gravity and its density over x.
fn medium(s: &Settings, guard: &Limits) -> Result<(Medium, Profile), BadValue> {
    let mut medium = match s.medium {
        Some(MediumPreset::Water) => Medium::WATER,
        Some(MediumPreset::Air) | None => Medium::AIR,
        Some(MediumPreset::Moon) => Medium::MOON,
        Some(MediumPreset::Mars) => Medium::MARS,
    };
    if let Some(gravity) = s.gravity_m_s2 {
        above_zero("gravity_m_s2", gravity, MAX_GRAVITY_M_S2)?;
        medium = Medium::new(medium.density_ratio(), gravity)
            .map_err(|cause| BadValue { key: "gravity_m_s2", what: cause.to_string() })?;
    }
    let limits = guard.density_ratio.map(f64::from);
    let density = match (s.density_ratio, &s.density_profile) {
        (Some(_), Some(_)) => {
            let what = "both a density_ratio and a density_profile";
            return Err(BadValue::new("density_profile", what, "give only one of the two"));
        }
        (Some(ratio), None) => Profile::constant(within("density_ratio", ratio, limits)?),
        (None, Some(points)) => {
            let profile = Profile::new(points.clone())
                .map_err(|what| BadValue { key: "density_profile", what })?;
            for value in profile.range() {
                within("density_profile", value, limits)?;
            }
            profile
        }
        (None, None) => Profile::constant(medium.density_ratio()),
    };
    Ok((medium, density))
}

fn start(s: &StartSettings, seed: u64, leg: &Leg, guard: &Limits) -> Result<Body, BadValue> {
    let speed = f64::from(guard.max_speed_m_s);
    let top = f64::from(guard.height_m[1]);
    let default_y_m = 2.0 * leg.parameters().rest_length_m;
    let vx_spread_m_s =
        within("start.vx_spread_m_s", s.vx_spread_m_s.unwrap_or(0.0), [0.0, speed])?;
    let y_spread_m = within("start.y_spread_m", s.y_spread_m.unwrap_or(0.0), [0.0, top])?;
    let x_m = s.x_m.unwrap_or(0.0);
    let vx_m_s = within("start.vx_m_s", s.vx_m_s.unwrap_or(0.0), [-speed, speed])?;
    let y_m = s.y_m.unwrap_or(default_y_m);
    above_zero("start.y_m", y_m, top)?;
    let spread = [
        ("start.vx_m_s", vx_m_s, "start.vx_spread_m_s", vx_spread_m_s, speed),
        ("start.y_m", y_m, "start.y_spread_m", y_spread_m, top),
    ];
    for (key, value, spread_key, spread, limit) in spread {
        if value.abs() + spread > limit {
            let value = format!("{value} with {spread_key} {spread}");
            let limit = format!("together they must be at most {limit}");
            return Err(BadValue::new(key, value, limit));
        }
    }
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut unit = || (rng.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64);
    Ok(Body {
        x_m: within("start.x_m", x_m, [-MAX_DISTANCE_M, MAX_DISTANCE_M])?,
        vx_m_s: vx_m_s + vx_spread_m_s * (2.0 * unit() - 1.0),
        y_m: y_m + y_spread_m * unit(),
        vy_m_s: within("start.vy_m_s", s.vy_m_s.unwrap_or(0.0), [-speed, speed])?,
    })
}

fn within(key: &'static str, value: f64, [low, high]: [f64; 2]) -> Result<f64, BadValue> {
    if value >= low && value <= high {
        Ok(value)
    } else {
        Err(BadValue::new(key, value, format!("it must be from {low} to {high}")))
    }
}

fn above_zero(key: &'static str, value: f64, high: f64) -> Result<(), BadValue> {
    if value > 0.0 && value <= high {
        Ok(())
    } else {
        Err(BadValue::new(key, value, format!("it must be above 0 and at most {high}")))
    }
}

/// A setting out of its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key}: {what}")]
pub struct BadValue {
    /// Name of the setting in a scenario file.
    pub key: &'static str,
    /// The value and the limit.
    pub what: String,
}

impl BadValue {
    fn new(key: &'static str, value: impl fmt::Display, limit: impl fmt::Display) -> Self {
        Self { key, what: format!("{value}: {limit}") }
    }
}

/// Why a scenario cannot be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error("cannot read the scenario {}: {cause}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        cause: io::Error,
    },
    /// The file is not valid TOML, or has an unknown key or a wrong type.
    #[error("{}: {cause}", path.display())]
    Toml {
        /// The file.
        path: PathBuf,
        /// The error of the TOML parser, with its position.
        cause: Box<toml::de::Error>,
    },
    /// A value is out of range.
    #[error("{}{cause}", origin.as_ref().map(|path| format!("{}: ", path.display())).unwrap_or_default())]
    Value {
        /// The file; `None` for options.
        origin: Option<PathBuf>,
        /// The value.
        cause: BadValue,
    },
}

/// Loads a scenario from a file, command-line options, or both.
///
/// # Errors
/// [`ScenarioError`], which names the file or the command line.
pub fn load(file: Option<&Path>, options: Settings) -> Result<Scenario, ScenarioError> {
    load_with_settings(file, options).map(|(scenario, _)| scenario)
}

/// Like [`load`]; also returns the merged settings.
///
/// # Errors
/// Like [`load`].
pub fn load_with_settings(
    file: Option<&Path>,
    options: Settings,
) -> Result<(Scenario, Settings), ScenarioError> {
    let mut settings = options;
    if let Some(path) = file {
        let base = Settings::from_file(path)?;
        // Validated alone first, so that the error names the file.
        Scenario::from_settings(&base)
            .map_err(|cause| ScenarioError::Value { origin: Some(path.to_owned()), cause })?;
        settings = settings.over(base);
    }
    let scenario = Scenario::from_settings(&settings)
        .map_err(|cause| ScenarioError::Value { origin: None, cause })?;
    Ok((scenario, settings))
}

#[cfg(test)]
mod tests;
