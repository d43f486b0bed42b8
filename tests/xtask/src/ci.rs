//! The whole check, in the order in which failures are cheapest to learn of.

use crate::{setup, step::Step};
use anyhow::Result;

const STEPS: [Step; 7] = [
    Step::new("format", "cargo", "fmt --all --check"),
    Step::new(
        "controller without std",
        "cargo",
        "clippy -p controller --target thumbv7em-none-eabihf -- -D warnings",
    ),
    Step::new("lints", "cargo", "clippy --workspace --all-targets --all-features -- -D warnings"),
    Step::new("docs", "cargo", "doc --workspace --no-deps --all-features")
        .with_env("RUSTDOCFLAGS", "-D warnings"),
    Step::new("tests", "cargo", "test --workspace --all-features"),
    Step::new("benches compile", "cargo", "bench --workspace --no-run"),
    Step::new("the main job", "cargo", "run --release -- --json"),
];

/// Runs every step and prints how long each took.
pub(crate) fn run() -> Result<()> {
    setup::run()?;
    let mut times = Vec::new();
    for step in &STEPS {
        times.push((step.name, step.run()?));
    }
    println!("\nall passed");
    for (name, time) in times {
        println!("{:>7.1} s  {name}", time.as_secs_f64());
    }
    Ok(())
}
