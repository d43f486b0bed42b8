//! `controller estimate`.

use std::io;
use std::path::{Path, PathBuf};

use leg_charts::Sheet;
use leg_process::atomic_file::{self, AtomicFile};
use leg_process::{check_apart, remedy, stdout};

use super::log;
use crate::estimate::chart::Builder;
use crate::estimate::{self, Choices, EstimateError, Held, LogError, Report};
use crate::law::{EstimatorKind, LawSettings};

/// Columns of `--output`.
const OUTPUT: [&str; 11] = [
    "time_s",
    "in_stance",
    "vx_m_s",
    "vx_sd_m_s",
    "y_m",
    "y_sd_m",
    "vy_m_s",
    "vy_sd_m_s",
    "density_ratio",
    "density_ratio_sd",
    "innovation",
];

/// Estimates the state of a leg over a log of its sensors, as the controller would: prints the
/// estimate at each apex and what was rejected. A log is CSV; MCAP with messages in JSON on a
/// channel; or a recording of `sim-host run --record`.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = help(),
    mut_arg("estimator", |arg| arg.help(
        "What the log is for: readings of velocity and height, or raw sensors [default: by the \
         columns of the log; that of a recording]"
    ).value_parser(clap::builder::EnumValueParser::<EstimatorKind>::new()))
)]
pub struct Args {
    /// The log.
    #[arg(long, value_name = "LOG")]
    input: PathBuf,
    /// The topic of the messages in an MCAP file [default: the only one in JSON].
    #[arg(long, value_name = "TOPIC")]
    channel: Option<String>,
    /// Policy, for the model of the leg and for what it does [default: the shipped one; those of a
    /// recording].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Ticks a second [default: by the median time between the rows; that of a recording].
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    rate: Option<u32>,
    /// Gravity where the leg is, m/s2 [default: 9.81; that of a recording].
    #[arg(long, value_name = "M_S2", allow_negative_numbers = true)]
    gravity: Option<f32>,
    /// Velocity set-point until the log has one, m/s: what the leg does depends on it.
    #[arg(long, value_name = "M_S", default_value_t = 0.0, allow_negative_numbers = true)]
    set_point: f32,
    /// Estimator, its noise, and how old a sample may be.
    #[command(flatten)]
    law: LawSettings,
    /// CSV file for the estimate after each row, with standard deviations.
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// SVG file for a picture of the estimate with two standard deviations, and of the truth.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Returns the text after the options.
fn help() -> String {
    format!(
        "Columns of a log, in any order, or fields of its messages; a cell that is empty stands for \
         what was not sensed then:\n{}\
         Rows that are missing are played as ticks without a sample; a row whose time does not \
         rise is rejected. Exit status: 2 for bad input, 1 for another failure.",
        estimate::columns()
    )
}

/// The estimation failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CommandError {
    /// The log cannot be estimated.
    #[error(transparent)]
    Estimate(#[from] EstimateError),
    /// A file cannot be written.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        cause: io::Error,
    },
    /// The picture cannot be drawn.
    #[error("cannot draw the picture: {0}")]
    Draw(#[from] leg_charts::DrawError),
    /// The result cannot be printed.
    #[error("cannot print the result: {0}")]
    Print(#[from] io::Error),
    /// The result cannot be represented.
    #[error("cannot print the result: {0}")]
    Json(#[from] serde_json::Error),
}

impl CommandError {
    /// Returns whether the user must change the arguments or the input.
    pub(super) fn is_misuse(&self) -> bool {
        match self {
            Self::Estimate(_) => true,
            Self::Write { cause, .. } => remedy::is_wrong_path(cause),
            Self::Draw(_) | Self::Print(_) | Self::Json(_) => false,
        }
    }

    /// Returns what the user can do about the error.
    pub(super) fn hint(&self) -> Option<String> {
        Some(match self {
            Self::Estimate(EstimateError::Log(LogError::Channel { channels, .. }))
                if !channels.is_empty() =>
            {
                "--channel names one".to_owned()
            }
            Self::Estimate(EstimateError::Rate { .. }) => "--rate sets that of the law".to_owned(),
            Self::Estimate(EstimateError::Recorded(crate::recorded::RecordedError::NoPolicy(
                _,
            ))) => "--policy FILE names it".to_owned(),
            Self::Estimate(EstimateError::Law(error)) => {
                format!("{} sets it", super::hint::law_option(error.key))
            }
            Self::Estimate(EstimateError::SetPoint { .. }) => "--set-point sets it".to_owned(),
            Self::Estimate(EstimateError::Readings) => "--estimator names it".to_owned(),
            _ => return None,
        })
    }
}

/// The files of a call, while the log is read.
struct Files<'a> {
    table: Option<(&'a Path, csv::Writer<AtomicFile>)>,
    picture: Option<Builder>,
    last_s: f64,
    tick_s: f64,
}

/// Runs the command.
pub(super) fn run(args: &Args) -> Result<(), CommandError> {
    let Args { input, channel, policy, rate, gravity, set_point, law, output, plot, json } = args;
    let choices = Choices {
        channel: channel.clone(),
        rate_hz: *rate,
        gravity_m_s2: *gravity,
        set_point_m_s: *set_point,
        law: law.clone(),
        policy: policy.clone(),
    };
    let writing = |path: &Path| {
        let path = path.to_owned();
        move |cause| CommandError::Write { path, cause }
    };
    // A long log is not read for files that cannot be written.
    let others = || policy.iter().chain([input]).map(PathBuf::as_path);
    if let Some(path) = output {
        check_apart(path, others()).map_err(writing(path))?;
    }
    if let Some(path) = plot {
        check_apart(path, others().chain(output.as_deref())).map_err(writing(path))?;
        atomic_file::check(path).map_err(writing(path))?;
    }
    let table = match output {
        None => None,
        Some(path) => {
            let mut table =
                csv::Writer::from_writer(AtomicFile::create(path).map_err(writing(path))?);
            table.write_record(OUTPUT).map_err(io::Error::from).map_err(writing(path))?;
            Some((path.as_path(), table))
        }
    };
    let picture = plot.is_some().then(Builder::default);
    let mut files = Files { table, picture, last_s: 0.0, tick_s: 0.0 };
    let report = estimate::estimate(input, &choices, |held| files.add(held))?;
    for warning in &report.warnings {
        log(format_args!("warning: {warning}"));
    }
    if report.different > 0 {
        log("warning: the recorded controller received other samples than the recording has, as \
             where a fault was on its link, or it ran by other settings");
    } else if report.is_real_time {
        log("warning: in real time the controller may have missed samples; here it misses none");
    }
    let Files { table, picture, last_s, .. } = files;
    if let (Some(path), Some(picture)) = (plot, picture) {
        let svg = draw(&report, picture, last_s)?;
        atomic_file::write(path, svg.as_bytes()).map_err(writing(path))?;
    }
    if let Some((path, table)) = table {
        let file = table.into_inner().map_err(csv::IntoInnerError::into_error);
        file.and_then(AtomicFile::finish).map_err(writing(path))?;
    }
    if *json {
        stdout::print_line(serde_json::to_string(&report)?)?;
    } else {
        stdout::print_line(&report)?;
    }
    Ok(())
}

impl Files<'_> {
    fn add(&mut self, held: &Held) -> Result<(), CommandError> {
        if let Some((path, table)) = &mut self.table {
            let cause = |error| CommandError::Write { path: path.to_path_buf(), cause: error };
            table.write_record(cells(held)).map_err(io::Error::from).map_err(cause)?;
        }
        if let Some(picture) = &mut self.picture {
            let span = 0.0..f64::INFINITY;
            if held.t_s > self.last_s {
                self.tick_s = held.t_s - self.last_s;
            }
            if let Some(truth) = &held.truth {
                picture.truth(held.t_s, truth, &span);
            }
            if let Some(estimate) = &held.estimate {
                picture.estimate(held.measured_s, estimate, self.tick_s, &span);
            }
        }
        self.last_s = held.t_s;
        Ok(())
    }
}

/// Returns the cells of [`OUTPUT`] after a row.
fn cells(held: &Held) -> [String; 11] {
    let mut cells: [String; 11] = Default::default();
    cells[0] = format!("{:.9}", held.measured_s);
    if let Some(e) = &held.estimate {
        let deviation = |variance: f32| f64::from(variance).sqrt().to_string();
        cells[1] = u8::from(e.in_stance).to_string();
        let all = [
            (e.vx_m_s, e.vx_variance),
            (e.y_m, e.y_variance),
            (e.vy_m_s, e.vy_variance),
            (e.density_ratio, e.density_variance),
        ];
        for (pair, (value, variance)) in cells[2..].chunks_mut(2).zip(all) {
            pair[0] = value.to_string();
            pair[1] = deviation(variance);
        }
        cells[10] = e.innovation.to_string();
    }
    cells
}

fn draw(report: &Report, picture: Builder, end_s: f64) -> Result<String, CommandError> {
    let name = report.input.file_name().unwrap_or_default().to_string_lossy();
    let kind = report.estimator.split(' ').next().unwrap_or_default();
    let title = format!("{name}: estimator {kind} at {} Hz", report.rate_hz);
    let rows = picture.finish().rows(&(0.0..end_s.max(1e-3)));
    Ok(Sheet::new(title, "").width_px(1_400).rows(150, rows).draw()?)
}
