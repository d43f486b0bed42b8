//! The `sim-host` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    sim_host::cli::main()
}
