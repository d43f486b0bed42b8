//! The `sim-host` command line.

fn main() {}
