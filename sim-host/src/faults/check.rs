//! Checks fault settings and converts them to effects.

use std::fmt::Display;
use std::ops::RangeInclusive;

use crate::faults::stage::Window;
use crate::faults::stage::actuator::{Drive, Limit};
use crate::faults::stage::message::FreezeMode;
use crate::faults::stage::sensor::{Reading, ReadingFault, SensorTarget};

use leg_plant::Losses;

use crate::sensors::Figures;

use super::catalog::FaultKind;
use super::field::{ACCELERATION, FIELDS, most};
use super::setting::{FaultError, FaultSetting};
use super::{
    ActuatorFault, Direction, Fault, FaultEffect, Faults, LegFault, MessageFault, RandomTerrain,
    SensorFault, Terrain, Trigger,
};

const SHARE: RangeInclusive<f64> = 0.0..=1.0;
/// Mass and stiffness of the simulated leg over those of the model.
const FACTOR: RangeInclusive<f64> = 0.1..=10.0;
const DELAY_TICKS: RangeInclusive<u32> = 0..=1000;
const DURATION_TICKS: RangeInclusive<u32> = 1..=1_000_000;
const DEFAULT_CHANCE: f64 = 0.001;
const MAX_TIME_S: f64 = 86_400.0;
const MAX_PLACE_M: f64 = 1e6;

/// The parameters of a run that faults depend on.
pub(crate) struct RunParameters<'a> {
    pub(crate) seed: u64,
    pub(crate) rate_hz: u32,
    pub(crate) density_is_measured: bool,
    pub(crate) sensors: &'a Figures,
}

impl Faults {
    /// Checks all settings.
    pub(crate) fn check(
        settings: &[FaultSetting],
        run: &RunParameters<'_>,
    ) -> Result<Self, FaultError> {
        let mut all: Vec<Fault> = Vec::with_capacity(settings.len());
        for setting in settings {
            let effect = Checker { setting, run }.effect()?;
            if effect.is_single() && all.iter().any(|fault| fault.setting.kind == setting.kind) {
                let name = setting.kind.name();
                let what = format!("{setting}: a run can have only one {name} fault");
                return Err(FaultError(what));
            }
            all.push(Fault { setting: setting.clone(), effect });
        }
        Ok(Self { all, seed: run.seed, rate_hz: run.rate_hz })
    }
}

struct Checker<'a> {
    setting: &'a FaultSetting,
    run: &'a RunParameters<'a>,
}

impl Checker<'_> {
    fn effect(&self) -> Result<FaultEffect, FaultError> {
        match self.setting.kind {
            FaultKind::Drop => self.message(MessageFault::Drop(self.share()?)),
            FaultKind::Delay => {
                let ticks = self.whole("value", self.value(), DELAY_TICKS)?;
                self.message(MessageFault::Delay { ticks, jitter_ticks: 0 })
            }
            FaultKind::Jitter => {
                let jitter_ticks = self.whole("value", self.value(), DELAY_TICKS)?;
                self.message(MessageFault::Delay { ticks: 0, jitter_ticks })
            }
            FaultKind::Duplicate => self.message(MessageFault::Duplicate(self.share()?)),
            FaultKind::Reorder => self.message(MessageFault::Reorder(self.share()?)),
            FaultKind::Corrupt => {
                let bits = match self.key("bits") {
                    Some(text) => self.whole("bits", text, 1..=64)?,
                    None => 1,
                };
                self.message(MessageFault::Corrupt { share: self.share()?, bits })
            }
            FaultKind::Freeze => {
                let mode = match self.key("as") {
                    Some("last") | None => FreezeMode::Last,
                    Some("nothing") => FreezeMode::Nothing,
                    Some(other) => return Err(self.bad("as", other, "it must be last or nothing")),
                };
                let ticks = self.whole("value", self.value(), DURATION_TICKS)?;
                self.message(MessageFault::Freeze { ticks, chance: self.chance()?, mode })
            }
            FaultKind::Noise => self.noise(),
            FaultKind::Bias => {
                if self.key("field").is_none() {
                    let what = "bias needs field=, because each reading has its own unit";
                    return Err(FaultError(format!("{}: {what}", self.setting)));
                }
                let readings = self.readings()?;
                let most = most(readings);
                let by = self.number("value", self.value(), -most..=most)?;
                self.sensor(SensorFault::Readings(readings, ReadingFault::Bias(by)))
            }
            FaultKind::Nan => self.not_a_number(),
            FaultKind::Stuck => {
                let target = self.field()?;
                let ticks = self.whole("value", self.value(), DURATION_TICKS)?;
                self.sensor(SensorFault::Stuck { target, ticks, chance: self.chance()? })
            }
            FaultKind::Dead => {
                let target = self.target("value", self.value())?;
                Ok(FaultEffect::Sensor {
                    fault: SensorFault::Dead(target),
                    window: self.lasting()?,
                })
            }
            FaultKind::Switch => {
                let is_closed = match self.value() {
                    "closed" => true,
                    "open" => false,
                    other => return Err(self.bad("value", other, "it must be closed or open")),
                };
                self.target("value", "contact")?;
                let fault = SensorFault::Switch { is_closed };
                Ok(FaultEffect::Sensor { fault, window: self.lasting()? })
            }
            FaultKind::Lag => {
                self.actuator(ActuatorFault::Lag(self.number("value", self.value(), 0.0..=10.0)?))
            }
            FaultKind::Saturate => self.saturate(),
            FaultKind::Bandwidth => {
                let hz = self.number("value", self.value(), 0.1..=1000.0)?;
                self.actuator(ActuatorFault::Bandwidth(hz))
            }
            FaultKind::DeadTime => {
                let ms = self.number("value", self.value(), 0.0..=1000.0)?;
                let ticks = (ms * f64::from(self.run.rate_hz) / 1000.0).ceil() as u32;
                self.actuator(ActuatorFault::DeadTime { ticks })
            }
            FaultKind::Backlash => self.backlash(),
            FaultKind::Mass => self.leg(LegFault::Mass, FACTOR),
            FaultKind::Stiffness => self.leg(LegFault::Stiffness, FACTOR),
            FaultKind::Drag => self.leg(LegFault::Drag, 0.0..=10.0),
            FaultKind::Gravity => self.leg(LegFault::Gravity, 0.5..=2.0),
            FaultKind::Damping => self.leg(LegFault::Damping, 0.0..=Losses::MAX_DAMPING_N_S_M),
            FaultKind::FootMass => self.foot_mass(),
            FaultKind::Friction => {
                self.leg(LegFault::Friction, Losses::MIN_FRICTION..=Losses::MAX_FRICTION)
            }
            FaultKind::DriveForce => {
                self.leg(LegFault::DriveForce, 0.0..=Losses::MAX_DRIVE_FORCE_N)
            }
            FaultKind::Ground => self.ground(),
            FaultKind::Medium => self.medium(),
        }
    }

    fn value(&self) -> &str {
        &self.setting.value
    }

    fn key(&self, name: &str) -> Option<&str> {
        self.setting.keys.get(name).map(String::as_str)
    }

    fn bad(&self, key: &str, value: impl Display, limit: impl Display) -> FaultError {
        let key = if key == "value" { self.setting.kind.name() } else { key };
        FaultError(format!("{}: {key} is {value}; {limit}", self.setting))
    }

    fn number(&self, key: &str, text: &str, range: RangeInclusive<f64>) -> Result<f64, FaultError> {
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| {
            let limit = format!("it must be a number from {} to {}", range.start(), range.end());
            self.bad(key, text, limit)
        })
    }

    fn whole(&self, key: &str, text: &str, range: RangeInclusive<u32>) -> Result<u32, FaultError> {
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| {
            let (least, most) = (range.start(), range.end());
            self.bad(key, text, format!("it must be a whole number from {least} to {most}"))
        })
    }

    fn share(&self) -> Result<f64, FaultError> {
        self.number("value", self.value(), SHARE)
    }

    fn leg(
        &self,
        fault: fn(f64) -> LegFault,
        range: RangeInclusive<f64>,
    ) -> Result<FaultEffect, FaultError> {
        Ok(FaultEffect::Leg(fault(self.number("value", self.value(), range)?)))
    }

    fn saturate(&self) -> Result<FaultEffect, FaultError> {
        let limit = self.number("value", self.value(), 0.0..=1000.0)?;
        let limit = match self.key("field") {
            Some("angle") => Limit::Angle(limit),
            Some("angle-rate") => Limit::AngleRate(limit),
            Some("elongation-rate") => Limit::ElongationRate(limit),
            other => {
                let given = other.unwrap_or("missing");
                let what = "it must be angle, angle-rate or elongation-rate";
                return Err(self.bad("field", given, what));
            }
        };
        self.actuator(ActuatorFault::Saturate(limit))
    }

    fn backlash(&self) -> Result<FaultEffect, FaultError> {
        let gap = self.number("value", self.value(), 0.0..=1.0)?;
        let drive = match self.key("field") {
            None | Some("angle") => Drive::Angle,
            Some("elongation") => Drive::Elongation,
            Some(other) => return Err(self.bad("field", other, "it must be angle or elongation")),
        };
        self.actuator(ActuatorFault::Backlash(drive, gap))
    }

    fn foot_mass(&self) -> Result<FaultEffect, FaultError> {
        let (least, most) = (Losses::MIN_FOOT_MASS_KG, Losses::MAX_FOOT_MASS_KG);
        let allowed = |kg: &f64| *kg == 0.0 || (least..=most).contains(kg);
        let kg = self.value().parse().ok().filter(allowed).ok_or_else(|| {
            let limit = format!("it must be 0 or a number from {least} to {most}");
            self.bad("value", self.value(), limit)
        })?;
        Ok(FaultEffect::Leg(LegFault::FootMass(kg)))
    }

    fn chance(&self) -> Result<f64, FaultError> {
        self.key("chance").map_or(Ok(DEFAULT_CHANCE), |text| self.number("chance", text, SHARE))
    }

    fn window(&self) -> Result<Window, FaultError> {
        self.window_from("from")
    }

    /// Returns the window of a fault that is there from a time on, as a rule to the end.
    fn lasting(&self) -> Result<Window, FaultError> {
        self.window_from("at")
    }

    fn window_from(&self, from: &str) -> Result<Window, FaultError> {
        let tick = |key: &str| {
            let Some(text) = self.key(key) else { return Ok(None) };
            let seconds = text.strip_suffix('s').unwrap_or(text);
            let seconds = self.number(key, seconds, 0.0..=MAX_TIME_S)?;
            Ok(Some((seconds * f64::from(self.run.rate_hz)).ceil() as u64))
        };
        let window = Window {
            from: tick(from)?.unwrap_or(Window::ALWAYS.from),
            until: tick("until")?.unwrap_or(Window::ALWAYS.until),
        };
        if window.from >= window.until {
            return Err(FaultError(format!("{}: until must be later than {from}", self.setting)));
        }
        Ok(window)
    }

    fn message(&self, fault: MessageFault) -> Result<FaultEffect, FaultError> {
        let direction = match self.key("direction") {
            Some("samples") => Direction::Samples,
            Some("commands") => Direction::Commands,
            Some("both") | None => Direction::Both,
            Some(other) => {
                let what = "it must be samples, commands or both";
                return Err(self.bad("direction", other, what));
            }
        };
        Ok(FaultEffect::Message { direction, fault, window: self.window()? })
    }

    fn sensor(&self, fault: SensorFault) -> Result<FaultEffect, FaultError> {
        Ok(FaultEffect::Sensor { fault, window: self.window()? })
    }

    fn actuator(&self, fault: ActuatorFault) -> Result<FaultEffect, FaultError> {
        Ok(FaultEffect::Actuator { fault, window: self.window()? })
    }

    /// Returns the readings of the key `field`; without it those of the state and the leg's
    /// length.
    fn field(&self) -> Result<SensorTarget, FaultError> {
        match self.key("field") {
            None | Some("all") => Ok(SensorTarget::Readings(Reading::MOTION)),
            Some(name) => self.target("field", name),
        }
    }

    /// Returns the readings of a field of this name, which `key` has.
    fn target(&self, key: &str, name: &str) -> Result<SensorTarget, FaultError> {
        let Some((_, sensor, target)) = FIELDS.iter().find(|(field, ..)| *field == name) else {
            let names = FIELDS.map(|(field, ..)| field).join(", ");
            let all = if key == "field" { " or all" } else { "" };
            return Err(self.bad(key, name, format!("it must be {names}{all}")));
        };
        match sensor {
            Some(sensor) if !self.run.sensors.has(*sensor) => {
                let sensor = sensor.name();
                let what = format!("this run has no such sensor; {sensor}-rate above 0 adds it");
                Err(self.bad(key, name, what))
            }
            None if !self.run.density_is_measured => {
                let what = "this run has no density sensor; density = \"measured\" adds one";
                Err(self.bad(key, name, what))
            }
            _ => Ok(*target),
        }
    }

    fn readings(&self) -> Result<&'static [Reading], FaultError> {
        match self.field()? {
            SensorTarget::Readings(readings) => Ok(readings),
            SensorTarget::Contact => {
                let what = "the contact reading is true or false; only noise, stuck and dead apply \
                            to it";
                Err(self.bad("field", "contact", what))
            }
        }
    }

    fn not_a_number(&self) -> Result<FaultEffect, FaultError> {
        let fault = ReadingFault::NotANumber(self.share()?);
        let readings = self.readings()?;
        if readings == ACCELERATION {
            let what = "the sum of the accelerometer is a whole number and never NaN; dead=acceleration \
                        takes it away";
            return Err(self.bad("field", "acceleration", what));
        }
        self.sensor(SensorFault::Readings(readings, fault))
    }

    fn noise(&self) -> Result<FaultEffect, FaultError> {
        let correlation_s = match self.key("correlation") {
            None => 0.0,
            Some(text) => self.number("correlation", text.trim_end_matches('s'), 0.0..=10.0)?,
        };
        let is_uniform = match self.key("as") {
            None | Some("normal") => false,
            Some("uniform") => true,
            Some(other) => return Err(self.bad("as", other, "it must be normal or uniform")),
        };
        let readings = match self.field()? {
            SensorTarget::Contact if is_uniform || correlation_s > 0.0 => {
                let what = "noise of the contact reading is a share of inverted readings and has \
                            neither as nor correlation";
                return Err(FaultError(format!("{}: {what}", self.setting)));
            }
            SensorTarget::Contact => return self.sensor(SensorFault::ContactNoise(self.share()?)),
            SensorTarget::Readings(readings) => readings,
        };
        let size = self.number("value", self.value(), 0.0..=most(readings))?;
        let noise = if correlation_s > 0.0 {
            if is_uniform {
                let what = "uniform noise has no correlation; normal noise may";
                return Err(FaultError(format!("{}: {what}", self.setting)));
            }
            let ticks = correlation_s * f64::from(self.run.rate_hz);
            ReadingFault::Correlated { deviation: size, ticks }
        } else if is_uniform {
            ReadingFault::Uniform(size)
        } else {
            ReadingFault::Noise(size)
        };
        self.sensor(SensorFault::Readings(readings, noise))
    }

    fn ground(&self) -> Result<FaultEffect, FaultError> {
        let number = |key: &str, range, default| {
            self.key(key).map_or(Ok(default), |text| self.number(key, text, range))
        };
        let height_m = number("height", 0.0..=10.0, 0.05)?;
        let length_m = number("length", 0.01..=1000.0, 1.0)?;
        let grade = number("grade", -1.0..=1.0, 0.05)?;
        let is_slope = self.value() == "slope";
        let inapplicable: &[&str] = if is_slope { &["height", "length"] } else { &["grade"] };
        if let Some(key) = inapplicable.iter().find(|key| self.key(key).is_some()) {
            let what = format!("ground={} has no {key}", self.value());
            return Err(FaultError(format!("{}: {what}", self.setting)));
        }
        let random = RandomTerrain { height_m, length_m, seed: self.run.seed };
        Ok(FaultEffect::Ground(match self.value() {
            "steps" => Terrain::Steps(random),
            "slope" => Terrain::Slope(grade),
            "sine" => Terrain::Sine { height_m, length_m },
            "rough" => Terrain::Rough(random),
            other => {
                return Err(self.bad("value", other, "it must be steps, slope, sine or rough"));
            }
        }))
    }

    fn medium(&self) -> Result<FaultEffect, FaultError> {
        let density_ratio = self.number("value", self.value(), 0.0..=2.0)?;
        let trigger = |key: &str| {
            let Some(text) = self.key(key) else { return Ok(None) };
            if let Some(place) = text.strip_suffix('m') {
                return self
                    .number(key, place, -MAX_PLACE_M..=MAX_PLACE_M)
                    .map(Trigger::Place)
                    .map(Some);
            }
            let time = text.strip_suffix('s').unwrap_or(text);
            self.number(key, time, 0.0..=MAX_TIME_S).map(Trigger::Time).map(Some)
        };
        let from = trigger("at")?.unwrap_or(Trigger::Time(0.0));
        Ok(FaultEffect::Medium { density_ratio, from, until: trigger("until")? })
    }
}
