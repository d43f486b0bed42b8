//! The command `trainer import`.

mod arguments;
mod check;
mod evaluation;

use super::output::{Target, print};
use super::{Failure, failed, input};
use crate::bridge::ImportError;
use crate::bridge::imported::{CompleteActor, Subject};
use crate::environment::GRAVITY_M_S2;
use crate::evaluate::gains::search;
use crate::policy::{PackedActor, PolicyInfo, blob, blob_with_manifest};
use crate::run::paths::title;
use crate::threads::redraw;
use anyhow::{Context, anyhow};
use indicatif::{ProgressBar, ProgressStyle};
use leg_control::actor::{Activations, OutputActivation};
use leg_control::policy::{GainPoint, Policy};
use leg_process::policy_file::AlignedBytes;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::time::Duration;

pub(super) use arguments::Arguments;

/// Longest name of a policy, bytes, so that a printed name stays on one line.
const MOST_NAME_BYTES: usize = 64;
/// Largest file that is read, bytes. An actor has at most 1 MiB of weights, twice that in double
/// precision, and may come with its critics and optimisers.
const MOST_BYTES: u64 = 64 << 20;
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = arguments.path();
    let name = |stem: &str| check_name(arguments.name.as_deref().unwrap_or(stem));
    let stem = title(path);
    let stem = stem.to_string_lossy();
    let file = || path.display().to_string();
    let bytes = read(path)?;
    let imported =
        arguments.imported_actor(&bytes).and_then(|actor| actor.complete(&arguments.given()));
    let imported = imported.map_err(hinted).with_context(file).map_err(input)?;
    let checked = arguments.check.as_deref().map(|observations| {
        check::check(&imported.actor.actor(), observations, arguments.check_tolerance)
    });
    let checked = checked.transpose()?;
    let target = Target { path: &arguments.out, option: "--out" };
    // Before the search: the output must be writable, and the controller must accept the actor.
    target.check(arguments.inputs())?;
    let (policy, gains) = if let Some(mut card) = imported.card.clone() {
        card.name = name(&card.name)?;
        if let Some(gains) = arguments.gains() {
            card.gains = gains;
        }
        let manifest = card.manifest(&imported.actor);
        let gains = if arguments.gains().is_some() { "given" } else { "the policy's own" };
        (
            blob_with_manifest(&manifest, &imported.actor.weights)
                .with_context(file)
                .map_err(input)?,
            gains,
        )
    } else {
        let name = name(&stem)?;
        let given = arguments.gains();
        let any = given.clone().unwrap_or_else(|| vec![GainPoint::default()]);
        let accepted = foreign(&imported, &name, &any).with_context(file).map_err(input)?;
        if given.is_some() {
            (accepted, "given")
        } else {
            let gains = searched(&imported);
            (foreign(&imported, &name, &gains).map_err(failed)?, "found by search")
        }
    };
    target.write(policy.as_slice())?;
    let mut text = report(arguments, &imported, &policy, gains)?;
    for line in checked.into_iter().chain([evaluation::line(&imported.actor.actor())]) {
        text += "\n";
        text += &line;
    }
    print(&text)
}

/// Adds the options that help to an error.
fn hinted(error: ImportError) -> anyhow::Error {
    match &error {
        ImportError::Stated { name } => {
            let option = name.replace(' ', "-");
            anyhow!("{error}; leave --{option} out")
        }
        ImportError::NoActor { .. } => {
            anyhow!("{error}; name the layers in order, such as --layers fc1,fc2,mu")
        }
        ImportError::Ambiguous { .. } => anyhow!("{error}; choose one with --layers"),
        ImportError::Unused { .. } => anyhow!(
            "{error}; leave out by --ignore what does not change the actions, or what you give by \
             options, such as --observation-offset"
        ),
        ImportError::Gaussian { .. } => {
            anyhow!("{error}; state --output-activation tanh or linear")
        }
        ImportError::OtherOutput { other, .. } => anyhow!("{error}: --output {other}"),
        ImportError::Outputs { .. } => anyhow!("{error}; choose one with --output"),
        _ => error.into(),
    }
}

/// Writes a policy of unknown origin.
fn foreign(
    imported: &CompleteActor,
    name: &str,
    gains: &[GainPoint],
) -> Result<AlignedBytes, ImportError> {
    let info = PolicyInfo {
        name,
        preset: "import",
        seed: 0,
        steps: 0,
        density_ratio: [0.0, 1.0],
        gravity_m_s2: GRAVITY_M_S2,
        config: "",
        gains,
    };
    Ok(blob(&imported.actor, &info)?)
}

/// Searches the gains, with a spinner on a terminal.
fn searched(imported: &CompleteActor) -> Vec<GainPoint> {
    let style = ProgressStyle::with_template("{spinner} {msg}  {elapsed}").expect("a template");
    let spinner = ProgressBar::new_spinner().with_style(style);
    spinner.set_message("searching the cascade's gains…");
    redraw(&spinner, Duration::from_millis(200));
    let gains = search(&imported.actor.actor());
    spinner.finish_and_clear();
    gains
}

fn report(
    arguments: &Arguments,
    imported: &CompleteActor,
    policy: &AlignedBytes,
    gains: &str,
) -> Result<String, Failure> {
    let crc32 = Policy::parse(policy.as_slice()).map_err(failed)?.crc32();
    let widths: Vec<String> = imported.actor.widths.iter().map(ToString::to_string).collect();
    let mut text = format!(
        "{}: {} from {}, {} bytes, CRC-32 {crc32:08x}; gains {gains}",
        arguments.out.display(),
        widths.join("-"),
        arguments.path().display(),
        policy.as_slice().len()
    );
    if !imported.taken.is_empty() {
        text += "\nTaken: ";
        text += &imported.taken.join("; ");
    }
    if !imported.assumed.is_empty() {
        let assumed = imported.assumed.iter();
        let each: Vec<String> =
            assumed.map(|a| format!("{} ({})", a.text, options_about(a.about))).collect();
        text += "\nAssumed: ";
        text += &each.join("; ");
    }
    text += "\n";
    text += &formula(&imported.actor);
    Ok(text)
}

/// Returns the actor's scalings and bounds in words.
fn formula(actor: &PackedActor) -> String {
    let (o, a) = (&actor.observation, &actor.action);
    let Activations { hidden, output } = actor.activations;
    let is_tanh = output == OutputActivation::Tanh;
    let list = |x: [f32; 3]| x.map(|x| x.to_string()).join(", ");
    let action = |i: usize, name: &str, unit: &str| {
        let (offset, scale, low, high) = (a.offset[i], a.scale[i], a.low[i], a.high[i]);
        let z = if is_tanh { "tanh" } else { "z" };
        format!("{name} = {offset} + {scale} {z}, from {low} to {high} {unit}")
    };
    format!(
        "Actor: (vx, y, rho) less ({}), times ({}); {hidden}; {}; {}",
        list(o.offset),
        list(o.scale),
        action(0, "alpha", "rad"),
        action(1, "rs", "m/s")
    )
}

/// Returns the options that replace an assumption.
fn options_about(subject: Subject) -> &'static str {
    match subject {
        Subject::HiddenActivation => "--hidden-activation",
        Subject::OutputActivation => "--output-activation",
        Subject::Observation => "--observation-offset, --observation-scale",
        Subject::ActionBounds => "--action-low, --action-high",
        Subject::ActionScaling => "--action-offset, --action-scale",
        Subject::Output => "--output",
    }
}

fn check_name(name: &str) -> Result<String, Failure> {
    if name.len() > MOST_NAME_BYTES {
        return Err(input(anyhow!(
            "--name: '{name}' has {} bytes, at most {MOST_NAME_BYTES} may be; shorten it",
            name.len()
        )));
    }
    Ok(name.to_owned())
}

fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    let file = || path.display().to_string();
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MOST_BYTES + 1).read_to_end(&mut bytes))
        .with_context(file)
        .map_err(input)?;
    if bytes.len() as u64 > MOST_BYTES {
        let error = anyhow!("more than {MOST_BYTES} bytes, which no actor needs; save it alone");
        return Err(input(error.context(file())));
    }
    Ok(bytes)
}
