//! `sim-host faults`.

use std::process::ExitCode;

use leg_process::stdout;

use crate::faults::help;

/// Prints all faults.
pub(super) fn main() -> anyhow::Result<ExitCode> {
    stdout::print_line(help())?;
    Ok(ExitCode::SUCCESS)
}

/// Returns whether the program was called with `--fault help`.
pub(super) fn is_requested() -> bool {
    let arguments: Vec<_> = std::env::args_os().collect();
    arguments.windows(2).any(|pair| pair[0] == "--fault" && pair[1] == "help")
        || arguments.iter().any(|argument| argument == "--fault=help")
}
