//! The `paper-figures` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    paper_figures::cli::main()
}
