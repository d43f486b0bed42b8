//! From what was said to what is done: every value checked.

use std::fmt::Display;
use std::ops::RangeInclusive;

use crate::faults::stage::Window;
use crate::faults::stage::actuator::Limit;
use crate::faults::stage::message::Ice;
use crate::faults::stage::sensor::{Ill, Reading, StuckAt};

use super::catalog::Kind;
use super::setting::{BadFault, FaultSetting};
use super::{
    ActuatorIll, Direction, Drawn, Fault, Faults, Mark, SensorIll, Terrain, Trouble, What,
};

const SHARE: RangeInclusive<f64> = 0.0..=1.0;
const DELAY_TICKS: RangeInclusive<u32> = 0..=1000;
const STRETCH_TICKS: RangeInclusive<u32> = 1..=1_000_000;
const USUAL_CHANCE: f64 = 0.001;
const LATEST_S: f64 = 86_400.0;
const FARTHEST_M: f64 = 1e6;

/// What the run is, as far as it matters here.
pub(crate) struct Run {
    pub(crate) seed: u64,
    pub(crate) rate_hz: u32,
    pub(crate) density_is_told: bool,
}

impl Faults {
    /// Checks them all.
    pub(crate) fn check(settings: &[FaultSetting], run: &Run) -> Result<Self, BadFault> {
        let mut all = Vec::with_capacity(settings.len());
        let mut grounds = 0;
        for setting in settings {
            let what = Reader { setting, run }.read()?;
            grounds += u32::from(matches!(what, What::Ground(_)));
            if grounds > 1 {
                return Err(BadFault(format!("{setting}: there can be only one ground")));
            }
            all.push(Fault { setting: setting.clone(), what });
        }
        Ok(Self { all, seed: run.seed, rate_hz: run.rate_hz })
    }
}

struct Reader<'a> {
    setting: &'a FaultSetting,
    run: &'a Run,
}

impl Reader<'_> {
    fn read(&self) -> Result<What, BadFault> {
        let what = match self.setting.kind {
            Kind::Drop => self.message(Trouble::Drop(self.share()?)),
            Kind::Delay => {
                let ticks = self.whole("value", self.value(), DELAY_TICKS)?;
                self.message(Trouble::Delay { ticks, jitter_ticks: 0 })
            }
            Kind::Jitter => {
                let jitter_ticks = self.whole("value", self.value(), DELAY_TICKS)?;
                self.message(Trouble::Delay { ticks: 0, jitter_ticks })
            }
            Kind::Duplicate => self.message(Trouble::Duplicate(self.share()?)),
            Kind::Reorder => self.message(Trouble::Reorder(self.share()?)),
            Kind::Corrupt => {
                let bits = match self.key("bits") {
                    Some(text) => self.whole("bits", text, 1..=64)?,
                    None => 1,
                };
                self.message(Trouble::Corrupt { share: self.share()?, bits })
            }
            Kind::Freeze => {
                let ice = match self.key("as") {
                    Some("last") | None => Ice::Last,
                    Some("nothing") => Ice::Nothing,
                    Some(other) => return Err(self.bad("as", other, "it must be last or nothing")),
                };
                let ticks = self.whole("value", self.value(), STRETCH_TICKS)?;
                self.message(Trouble::Freeze { ticks, chance: self.chance()?, ice })
            }
            Kind::Noise => match self.field()? {
                Field::Contact => self.sensor(SensorIll::ContactNoise(self.share()?)),
                Field::Readings(readings) => {
                    let deviation = self.number("value", self.value(), 0.0..=100.0)?;
                    self.sensor(SensorIll::Readings(readings, Ill::Noise(deviation)))
                }
            },
            Kind::Bias => {
                if self.key("field").is_none() {
                    let what = "field= must be said: each reading has its own unit";
                    return Err(BadFault(format!("{}: {what}", self.setting)));
                }
                let by = self.number("value", self.value(), -100.0..=100.0)?;
                self.sensor(SensorIll::Readings(self.figures()?, Ill::Bias(by)))
            }
            Kind::Nan => {
                let ill = Ill::NotANumber(self.share()?);
                self.sensor(SensorIll::Readings(self.figures()?, ill))
            }
            Kind::Stuck => {
                let at = match self.field()? {
                    Field::Contact => StuckAt::Contact,
                    Field::Readings(readings) => StuckAt::Readings(readings),
                };
                let ticks = self.whole("value", self.value(), STRETCH_TICKS)?;
                self.sensor(SensorIll::Stuck { at, ticks, chance: self.chance()? })
            }
            Kind::Lag => {
                self.actuator(ActuatorIll::Lag(self.number("value", self.value(), 0.0..=10.0)?))
            }
            Kind::Saturate => {
                let most = self.number("value", self.value(), 0.0..=1000.0)?;
                let limit = match self.key("field") {
                    Some("angle") => Limit::Angle(most),
                    Some("angle-rate") => Limit::AngleRate(most),
                    Some("elongation-rate") => Limit::ElongationRate(most),
                    other => {
                        let said = other.unwrap_or("nothing");
                        let what = "it must be angle, angle-rate or elongation-rate";
                        return Err(self.bad("field", said, what));
                    }
                };
                self.actuator(ActuatorIll::Saturate(limit))
            }
            Kind::Mass => Ok(What::Mass(self.factor()?)),
            Kind::Stiffness => Ok(What::Stiffness(self.factor()?)),
            Kind::Ground => self.ground(),
            Kind::Medium => self.medium(),
        }?;
        Ok(what)
    }

    fn value(&self) -> &str {
        &self.setting.value
    }

    fn key(&self, name: &str) -> Option<&str> {
        self.setting.keys.get(name).map(String::as_str)
    }

    fn bad(&self, key: &str, value: impl Display, limit: impl Display) -> BadFault {
        let key = if key == "value" { self.setting.kind.name() } else { key };
        BadFault(format!("{}: {key} is {value}; {limit}", self.setting))
    }

    fn number(&self, key: &str, text: &str, range: RangeInclusive<f64>) -> Result<f64, BadFault> {
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| {
            let limit = format!("it must be a number from {} to {}", range.start(), range.end());
            self.bad(key, text, limit)
        })
    }

    fn whole(&self, key: &str, text: &str, range: RangeInclusive<u32>) -> Result<u32, BadFault> {
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| {
            let (least, most) = (range.start(), range.end());
            self.bad(key, text, format!("it must be a whole number from {least} to {most}"))
        })
    }

    fn share(&self) -> Result<f64, BadFault> {
        self.number("value", self.value(), SHARE)
    }

    fn factor(&self) -> Result<f64, BadFault> {
        self.number("value", self.value(), 0.1..=10.0)
    }

    fn chance(&self) -> Result<f64, BadFault> {
        self.key("chance").map_or(Ok(USUAL_CHANCE), |text| self.number("chance", text, SHARE))
    }

    fn window(&self) -> Result<Window, BadFault> {
        let tick = |key: &str| {
            let Some(text) = self.key(key) else { return Ok(None) };
            let seconds = text.strip_suffix('s').unwrap_or(text);
            let seconds = self.number(key, seconds, 0.0..=LATEST_S)?;
            Ok(Some((seconds * f64::from(self.run.rate_hz)).ceil() as u64))
        };
        let window = Window {
            from: tick("from")?.unwrap_or(Window::ALWAYS.from),
            until: tick("until")?.unwrap_or(Window::ALWAYS.until),
        };
        if window.from >= window.until {
            return Err(BadFault(format!("{}: until must be later than from", self.setting)));
        }
        Ok(window)
    }

    fn message(&self, trouble: Trouble) -> Result<What, BadFault> {
        let direction = match self.key("direction") {
            Some("samples") => Direction::Samples,
            Some("commands") => Direction::Commands,
            Some("both") | None => Direction::Both,
            Some(other) => {
                let what = "it must be samples, commands or both";
                return Err(self.bad("direction", other, what));
            }
        };
        Ok(What::Message { direction, trouble, window: self.window()? })
    }

    fn sensor(&self, ill: SensorIll) -> Result<What, BadFault> {
        Ok(What::Sensor { ill, window: self.window()? })
    }

    fn actuator(&self, ill: ActuatorIll) -> Result<What, BadFault> {
        Ok(What::Actuator { ill, window: self.window()? })
    }

    fn field(&self) -> Result<Field, BadFault> {
        let readings: &'static [Reading] = match self.key("field") {
            None | Some("all") => Reading::MOTION,
            Some("vx") => &[Reading::Vx],
            Some("y") => &[Reading::Y],
            Some("vy") => &[Reading::Vy],
            Some("leg-length") => &[Reading::LegLength],
            Some("density") if self.run.density_is_told => &[Reading::Density],
            Some("density") => {
                let what = "no sensor tells it in this run; --density told adds one";
                return Err(self.bad("field", "density", what));
            }
            Some("contact") => return Ok(Field::Contact),
            Some(other) => {
                let what = "it must be vx, y, vy, leg-length, density, contact or all";
                return Err(self.bad("field", other, what));
            }
        };
        Ok(Field::Readings(readings))
    }

    fn figures(&self) -> Result<&'static [Reading], BadFault> {
        match self.field()? {
            Field::Readings(readings) => Ok(readings),
            Field::Contact => {
                let what = "it is yes or no: noise and stuck are what it can have";
                Err(self.bad("field", "contact", what))
            }
        }
    }

    fn ground(&self) -> Result<What, BadFault> {
        let number = |key: &str, range, usual| {
            self.key(key).map_or(Ok(usual), |text| self.number(key, text, range))
        };
        let height_m = number("height", 0.0..=10.0, 0.05)?;
        let length_m = number("length", 0.01..=1000.0, 1.0)?;
        let grade = number("grade", -1.0..=1.0, 0.05)?;
        let is_slope = self.value() == "slope";
        let strange: &[&str] = if is_slope { &["height", "length"] } else { &["grade"] };
        if let Some(key) = strange.iter().find(|key| self.key(key).is_some()) {
            let what = format!("ground={} has no {key}", self.value());
            return Err(BadFault(format!("{}: {what}", self.setting)));
        }
        let drawn = Drawn { height_m, length_m, seed: self.run.seed };
        Ok(What::Ground(match self.value() {
            "steps" => Terrain::Steps(drawn),
            "slope" => Terrain::Slope(grade),
            "sine" => Terrain::Sine { height_m, length_m },
            "rough" => Terrain::Rough(drawn),
            other => {
                return Err(self.bad("value", other, "it must be steps, slope, sine or rough"));
            }
        }))
    }

    fn medium(&self) -> Result<What, BadFault> {
        let density_ratio = self.number("value", self.value(), 0.0..=2.0)?;
        let mark = |key: &str| {
            let Some(text) = self.key(key) else { return Ok(None) };
            if let Some(place) = text.strip_suffix('m') {
                return self
                    .number(key, place, -FARTHEST_M..=FARTHEST_M)
                    .map(Mark::Place)
                    .map(Some);
            }
            let time = text.strip_suffix('s').unwrap_or(text);
            self.number(key, time, 0.0..=LATEST_S).map(Mark::Time).map(Some)
        };
        let from = mark("at")?.unwrap_or(Mark::Time(0.0));
        Ok(What::Medium { density_ratio, from, until: mark("until")? })
    }
}

enum Field {
    Readings(&'static [Reading]),
    Contact,
}
