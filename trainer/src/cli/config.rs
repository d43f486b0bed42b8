//! `trainer config`

use super::output::print;
use super::{Failure, input};
use crate::config::Config;
use crate::preset::Preset;
use anyhow::anyhow;
use clap::{Args, Subcommand};
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Print a complete configuration as TOML, with a comment at every key
    Show(Choice),
    /// Check a configuration file: exit status 2 when it cannot be trained
    Check {
        /// The file
        file: PathBuf,
    },
}

/// A configuration: a preset or a file, with single figures changed.
#[derive(Clone, Debug, Args)]
pub(super) struct Choice {
    /// What to train, by name
    #[arg(long)]
    preset: Option<Preset>,
    /// What to train, by a TOML file; `trainer config show` prints one
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Change a figure, such as learning.batch=32 or stages.0.length.steps=1000;
    /// can be given again
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl Choice {
    /// What was chosen, or else changes to `otherwise`; not yet checked.
    pub(super) fn config(&self, otherwise: Option<&Config>) -> Result<Config, Failure> {
        let config = match (&self.preset, &self.config, otherwise) {
            (Some(preset), ..) => preset.config(),
            (None, Some(path), _) => Config::read(path).map_err(input)?,
            (None, None, Some(config)) => config.clone(),
            (None, None, None) => {
                return Err(input(anyhow!("what to train: give --preset NAME or --config FILE")));
            }
        };
        let set = |config: Config, setting: &String| config.with(setting);
        self.set.iter().try_fold(config, set).map_err(|e| input(anyhow!("--set {e}")))
    }

    /// Whether there is a preset or a file.
    pub(super) fn is_made(&self) -> bool {
        self.preset.is_some() || self.config.is_some()
    }

    /// The options given, to be named in an error.
    pub(super) fn options(&self) -> String {
        let mut options = Vec::new();
        if let Some(preset) = self.preset {
            options.push(format!("--preset {}", preset.config().preset));
        }
        if let Some(path) = &self.config {
            options.push(format!("--config {}", path.display()));
        }
        options.extend(self.set.iter().map(|setting| format!("--set {setting}")));
        options.join(" ")
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    match &arguments.what {
        What::Show(choice) => {
            let config = choice.config(None)?;
            config.check().map_err(|e| input(anyhow!("{}: {e}", choice.options())))?;
            print(config.to_commented_toml().trim_end())
        }
        What::Check { file } => {
            let config = Config::read(file).map_err(input)?;
            print(&format!("{}: {} can be trained", file.display(), config.preset))
        }
    }
}
