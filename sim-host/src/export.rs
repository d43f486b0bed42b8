//! Writes a recording as a log for `controller estimate`: CSV.

use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use leg_control::measurement::SpecificImpulse;
use leg_control::serial::message::Estimator;
use leg_control::serial::node::SessionParams;
use leg_control::wire::{Sample, flags};
use leg_host::estimate::{Column, Truth};
use leg_host::recorded::{self, RecordedError, SetPoints};
use leg_plant::Ground;

use crate::faults::Terrain;
use crate::record::contents::Contents;
use crate::record::read::ReadError;
use crate::record::schema::AnyMessage;
use crate::scenario::{Scenario, Settings};

/// Why a recording cannot be exported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Its configuration cannot be used.
    #[error(transparent)]
    Recorded(#[from] RecordedError),
    /// The recording has several runs, whose times each begin with 0.
    #[error("{}: the leg was put back to its start {restarts} times; a log is of one run", path.display())]
    Runs {
        /// The recording.
        path: PathBuf,
        /// Number of runs less one.
        restarts: usize,
    },
    /// The output cannot be written.
    #[error("cannot write the rows: {0}")]
    Write(#[from] io::Error),
}

/// What was exported.
#[derive(Clone, Debug)]
pub struct Exported {
    /// Rows.
    pub rows: u64,
    /// Estimator of the recorded law.
    pub estimator: Estimator,
    /// Its stale limit, ns.
    pub stale_limit_ns: u64,
    /// What was wrong with the file.
    pub warning: Option<String>,
}

/// Writes the readings and the truth of the recording at `path` to `out`, a row for each sample
/// and a column for what was ever sensed.
///
/// # Errors
/// [`ExportError`] if the recording cannot be read, has several runs, or `out` fails.
pub fn export(path: &Path, out: impl Write) -> Result<Exported, ExportError> {
    let contents = Contents::of(path)?;
    let session = recorded::session(path, &contents)?;
    let sensed = sensed(path, &contents)?;
    let terrain = terrain(&contents)?;
    let set_points = SetPoints::of(&contents.set_points);
    let mut csv = csv::Writer::from_writer(out);
    let columns: Vec<Column> = Column::all().filter(|column| is_written(*column, sensed)).collect();
    csv.write_record(columns.iter().map(|column| column.name())).map_err(io::Error::from)?;
    let mut rows = 0;
    let mut write = |(mut sample, truth): (Sample, Option<Truth>)| {
        rows += 1;
        sample.set_point_m_s = set_points.at(&sample.header).unwrap_or(sample.set_point_m_s);
        let cells = columns.iter().map(|column| cell(*column, &sample, truth.as_ref()));
        csv.write_record(cells.map(Option::unwrap_or_default)).map_err(io::Error::from)
    };
    let mut pending: Option<(Sample, Option<Truth>)> = None;
    let mut messages = contents.messages()?;
    while let Some(message) = messages.next_message()? {
        match message {
            AnyMessage::Sample(sample) => {
                if let Some(before) = pending.replace(((&sample).into(), None)) {
                    write(before)?;
                }
            }
            AnyMessage::State(state) => {
                let ground_m = terrain.map_or(0.0, |terrain| terrain.height_m(state.x_m));
                if let Some((_, truth)) = &mut pending {
                    *truth = Some(Truth::from(&state).over(ground_m));
                }
            }
            _ => (),
        }
    }
    pending.map_or(Ok(()), &mut write)?;
    csv.flush()?;
    let SessionParams { estimator, stale_limit_ns, .. } = session;
    let stale_limit_ns = stale_limit_ns.into();
    Ok(Exported { rows, estimator, stale_limit_ns, warning: contents.warning() })
}

/// Returns the flags that any sample of a recording has.
fn sensed(path: &Path, contents: &Contents) -> Result<u16, ExportError> {
    let mut all = 0;
    let mut runs = BTreeSet::new();
    let mut messages = contents.messages()?;
    while let Some(message) = messages.next_message()? {
        if let AnyMessage::Sample(sample) = message {
            all |= Sample::from(&sample).header.flags;
            runs.insert(sample.run_id);
        }
    }
    contents.first()?;
    match runs.len().saturating_sub(1) {
        0 => Ok(all),
        restarts => Err(ExportError::Runs { path: path.to_owned(), restarts }),
    }
}

/// Returns the uneven ground of a run, of which heights count.
fn terrain(contents: &Contents) -> Result<Option<Terrain>, ExportError> {
    let settings = Settings::from_toml(&contents.config()?.scenario_toml).ok();
    let scenario = settings.and_then(|settings| Scenario::from_settings(&settings).ok());
    Ok(scenario.and_then(|scenario| scenario.faults.terrain()))
}

/// Returns the flag of the reading in a column; none of what is no reading.
fn flag(column: Column) -> Option<u16> {
    Some(match column {
        Column::Vx => flags::VX_SENSED,
        Column::Y => flags::Y_SENSED,
        Column::Vy => flags::VY_SENSED,
        Column::Contact => flags::CONTACT_SENSED,
        Column::LegLength => flags::LEG_LENGTH_SENSED,
        Column::LegAngle => flags::LEG_ANGLE_SENSED,
        Column::ImpulseX | Column::ImpulseY => flags::IMPULSE_SENSED,
        Column::Pitch => flags::PITCH_SENSED,
        Column::PitchRate => flags::PITCH_RATE_SENSED,
        Column::VelocityX | Column::VelocityY | Column::VelocityAge => flags::VELOCITY_SENSED,
        Column::Height | Column::HeightAge => flags::HEIGHT_SENSED,
        Column::Pressure | Column::PressureAge => flags::PRESSURE_SENSED,
        Column::Density => flags::DENSITY_SENSED,
        _ => return None,
    })
}

/// Returns whether a column is written where any of `sensed` is. What the leg did is not: the
/// law finds that out by itself, to the last bit.
fn is_written(column: Column, sensed: u16) -> bool {
    let is_other = |column| {
        matches!(column, Column::ForceX | Column::ForceY | Column::HeldAngle | Column::Elongation)
    };
    flag(column).map_or(!is_other(column), |flag| sensed & flag != 0)
}

/// Returns the text of a cell, from which the same bits are read back; none of what was not
/// sensed.
fn cell(column: Column, sample: &Sample, truth: Option<&Truth>) -> Option<String> {
    if flag(column).is_some_and(|flag| sample.header.flags & flag == 0) {
        return None;
    }
    let seconds = |ns: u64| format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000);
    let sum = |count: i32| (f64::from(count) * f64::from(SpecificImpulse::UNIT_M_S)).to_string();
    let yes = |is_true: bool| u8::from(is_true).to_string();
    let sensors = &sample.sensors;
    Some(match column {
        Column::Time => seconds(sample.header.t_ns),
        Column::SetPoint => sample.set_point_m_s.to_string(),
        Column::Vx => sample.vx_m_s.to_string(),
        Column::Y => sample.y_m.to_string(),
        Column::Vy => sample.vy_m_s.to_string(),
        Column::Contact => yes(sample.is_in_contact()),
        Column::LegLength => sample.leg_length_m.to_string(),
        Column::LegAngle => sensors.leg_angle_rad.to_string(),
        Column::ImpulseX => sum(sensors.impulse[0]),
        Column::ImpulseY => sum(sensors.impulse[1]),
        Column::Pitch => sensors.pitch_rad.to_string(),
        Column::PitchRate => sensors.pitch_rate_rad_s.to_string(),
        Column::VelocityX => sensors.velocity_m_s[0].to_string(),
        Column::VelocityY => sensors.velocity_m_s[1].to_string(),
        Column::VelocityAge => seconds(sensors.velocity_age_ns.into()),
        Column::Height => sensors.height_m.to_string(),
        Column::HeightAge => seconds(sensors.height_age_ns.into()),
        Column::Pressure => sensors.pressure_pa.to_string(),
        Column::PressureAge => seconds(sensors.pressure_age_ns.into()),
        Column::Density => sample.density_ratio.to_string(),
        Column::TrueVx => truth?.values[0].to_string(),
        Column::TrueY => truth?.values[1].to_string(),
        Column::TrueVy => truth?.values[2].to_string(),
        Column::TrueDensity => truth?.values[3].to_string(),
        Column::TrueContact => yes(!truth?.in_flight?),
        Column::ForceX | Column::ForceY | Column::HeldAngle | Column::Elongation => return None,
    })
}
