//! The list of all profiles and figures, for users.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;

use super::catalog::{Figures, Row, TABLE};
use super::figure::Sensor;
use super::profile::SensorProfile;

/// Longest line of the text, characters.
const WIDTH: usize = 100;

/// A profile.
#[derive(Debug, Serialize)]
pub(super) struct ProfileItem {
    name: &'static str,
    about: &'static str,
    /// The sensors that it has.
    sensors: Vec<&'static str>,
    /// Its figures: those of the sensors that it has.
    figures: BTreeMap<String, FigureItem>,
}

/// A figure in a profile.
#[derive(Debug, Serialize)]
pub(super) struct FigureItem {
    value: f64,
    unit: String,
    source: &'static str,
}

/// A figure that users can set.
#[derive(Debug, Serialize)]
pub(super) struct RangeItem {
    name: String,
    unit: String,
    least: f64,
    most: f64,
    /// The value of a sensor that a profile does not have, once its rate is set.
    value: f64,
    source: &'static str,
}

/// All profiles and figures.
#[derive(Debug, Serialize)]
pub struct Listing {
    profiles: Vec<ProfileItem>,
    figures: Vec<RangeItem>,
}

impl Listing {
    /// Returns the list of everything.
    #[must_use]
    pub fn new() -> Self {
        let range = |row: &Row| RangeItem {
            name: row.figure.to_string(),
            unit: row.figure.unit(),
            least: 0.0,
            most: row.most,
            value: row.value,
            source: row.source,
        };
        Self {
            profiles: SensorProfile::ALL.map(profile).into(),
            figures: TABLE.iter().map(range).collect(),
        }
    }
}

impl Default for Listing {
    fn default() -> Self {
        Self::new()
    }
}

fn profile(profile: SensorProfile) -> ProfileItem {
    let figures = Figures::of_profile(profile);
    let item = |row: &Row| {
        let own = profile.own_figures().iter().find(|own| own.figure == row.figure);
        FigureItem {
            value: figures.of(row.figure.sensor, row.figure.quantity),
            unit: row.figure.unit(),
            source: own.map_or(row.source, |own| own.source),
        }
    };
    let of_profile = TABLE.iter().filter(|row| figures.has(row.figure.sensor));
    ProfileItem {
        name: profile.name(),
        about: profile.about(),
        sensors: sensors(&figures),
        figures: of_profile.map(|row| (row.figure.to_string(), item(row))).collect(),
    }
}

fn sensors(figures: &Figures) -> Vec<&'static str> {
    let is_sensor = |sensor: &Sensor| *sensor != Sensor::Sample && figures.has(*sensor);
    Sensor::ALL.into_iter().filter(is_sensor).map(Sensor::name).collect()
}

/// Returns the list as help text.
#[must_use]
pub fn help() -> String {
    let mut text = String::from(
        "Usage: --sensors PROFILE, and --sensor FIGURE=VALUE for each figure that is to differ. In a\n\
         scenario file, write sensors = \"PROFILE\" and the figures as keys of a table [sensor]. All\n\
         values are 0 or above; signs are random. A sensor has its figures as soon as its rate is\n\
         above 0; at a rate above that of the run it reads at every tick. The figures are listed with\n\
         range, value, and source of the value; below, those in which a profile differs.\n\n\
         Profiles:\n",
    );
    for profile in SensorProfile::ALL {
        let _ = writeln!(text, "  {:<13} {}", profile.name(), profile.about());
        let has = sensors(&Figures::of_profile(profile)).join(", ");
        let _ = writeln!(text, "  {:<13} {has}", "");
    }
    for sensor in Sensor::ALL {
        let _ = writeln!(text, "\n{}: {}", sensor.name(), sensor.about());
        for row in TABLE.iter().filter(|row| row.figure.sensor == sensor) {
            push_row(&mut text, row);
        }
    }
    text
}

fn push_row(text: &mut String, row: &Row) {
    let range = format!("0 to {} {}", significant(row.most), row.figure.unit());
    let value = significant(row.value);
    let line = format!("  {:<24} {range:<28} {value:<9}", row.figure.to_string());
    push_source(text, &line, row.source);
    for profile in SensorProfile::ALL {
        if let Some(own) = profile.own_figures().iter().find(|own| own.figure == row.figure) {
            let line = format!("  {:>52}  {:<9}", profile.name(), significant(own.value));
            push_source(text, &line, own.source);
        }
    }
}

/// Appends a line and its source, below it if both are too long for one.
fn push_source(text: &mut String, line: &str, source: &str) {
    if line.len() + 1 + source.len() <= WIDTH {
        let _ = writeln!(text, "{line} {source}");
    } else {
        let _ = writeln!(text, "{}\n      {source}", line.trim_end());
    }
}

/// Formats a value with at most four significant digits.
fn significant(value: f64) -> String {
    if value == 0.0 || value.abs() >= 1000.0 {
        return value.to_string();
    }
    let digits = (3 - libm::floor(libm::log10(value.abs())) as i32).max(0) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}
