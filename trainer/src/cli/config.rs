//! The command `trainer config`.

use super::output::print;
use super::{Failure, input};
use crate::config::Config;
use crate::preset::Preset;
use anyhow::anyhow;
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Print a complete configuration as TOML, with a comment at every key
    Show(ConfigArguments),
    /// Check a configuration file; exit status 2 when it cannot be trained
    Check {
        /// Configuration file
        file: PathBuf,
    },
}

/// The configuration chosen by options: a preset or a file, with single parameters changed.
#[derive(Clone, Debug, Args)]
pub(super) struct ConfigArguments {
    /// Preset to train
    #[arg(long)]
    preset: Option<Preset>,
    /// TOML file with the configuration to train; `trainer config show` prints one
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Change a parameter, such as learning.batch=32 or stages.0.length.steps=1000; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl ConfigArguments {
    /// Returns the chosen configuration, unchecked. Without a preset or file, the changes apply
    /// to `otherwise`.
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

    /// Returns the file that was chosen.
    pub(super) fn file(&self) -> Option<&Path> {
        self.config.as_deref()
    }

    /// Whether a preset or a file was chosen.
    pub(super) fn is_given(&self) -> bool {
        self.preset.is_some() || self.config.is_some()
    }

    /// Returns the options as given, for messages.
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
