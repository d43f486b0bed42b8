//! `cargo xtask python`: installs the Python package into an environment of its own as a user
//! does, with the pinned packages, and tests it there. `cargo test` runs the same tests on the
//! library of its own build, without a wheel.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use crate::Misuse;
use crate::programs::target_folder;
use crate::step::{Step, output_of};

/// The package, in the repository.
const FOLDER: &str = "sim-host/python";
/// Oldest Python that the package runs on.
const OLDEST: [u32; 2] = [3, 11];

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Test it with Stable-Baselines3, too, whose torch takes about 6 GB of disk
    #[arg(long)]
    sb3: bool,
    /// The Python to test it with, 3.11 or newer
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    python: String,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    check_version(&args.python)?;
    let folder = target_folder().join("python-package");
    let python = environment(&args.python, &folder)?;
    // To compare with. By the name that the rustup of this repository's toolchain gives it.
    Step::new("sim-host", "cargo", "build --release --package sim-host --bin sim-host").run()?;
    let sim_host = target_folder().join("release/sim-host").display().to_string();

    let python = python.to_str().context("the path of this repository is not UTF-8")?;
    let step = |name, args: &str| Step::new(name, python, args).within(FOLDER);
    let pip = "-m pip --disable-pip-version-check install --quiet";
    step("packages", &format!("{pip} --requirement requirements.txt")).run()?;
    if args.sb3 {
        step("packages for SB3", &format!("{pip} --requirement requirements-sb3.txt")).run()?;
    }
    // As a user installs it, but by the maturin that is there.
    step("package", &format!("{pip} --no-build-isolation --no-deps --force-reinstall ."))
        .with_env("PATH", search_path(&folder)?)
        .run()?;
    step("tests", "-m pytest --quiet -p no:cacheprovider tests")
        .with_env("LEG_SIM_HOST", sim_host)
        .run()?;
    let cache = format!("--cache-dir {}", folder.join("mypy").display());
    step("types", "-m mypy --strict --package spring_leg").with(&cache).run()?;
    step("stubs", "-m mypy.stubtest spring_leg._leg").run()?;
    Ok(())
}

/// Returns the folders of programs, those of the environment first: pip starts `maturin` by its
/// name.
fn search_path(folder: &Path) -> Result<String> {
    let usual = std::env::var_os("PATH").unwrap_or_default();
    let own = folder.join("venv/bin");
    let all = std::iter::once(own).chain(std::env::split_paths(&usual));
    let joined = std::env::join_paths(all).context("a folder of PATH has a colon in its name")?;
    joined.into_string().ok().context("PATH is not UTF-8")
}

/// Returns an error unless the program is a Python that the package runs on.
fn check_version(python: &str) -> Result<()> {
    let [major, minor] = OLDEST;
    let code = "import sys; print(*sys.version_info[:2])";
    let Some(found) = output_of(python, &["-c", code]) else {
        let what = format!("`{python}` does not run; install Python {major}.{minor} or newer");
        return Err(Misuse::of(what));
    };
    let numbers: Vec<u32> = found.split_whitespace().filter_map(|n| n.parse().ok()).collect();
    if numbers.as_slice() >= OLDEST.as_slice() {
        return Ok(());
    }
    Err(Misuse::of(format!(
        "`{python}` is Python {}; the package needs {major}.{minor} or newer: name one with --python",
        found.trim().replace(' ', ".")
    )))
}

/// Returns the Python of the virtual environment in a folder, which is made if it is missing or
/// of another Python.
fn environment(base: &str, folder: &Path) -> Result<PathBuf> {
    let home = folder.join("venv");
    let python = home.join("bin/python");
    let version = |python: &str| output_of(python, &["-c", "import sys; print(sys.version)"]);
    let found = python.to_str().and_then(version);
    if found.is_none() || found != version(base) {
        fs::create_dir_all(folder).with_context(|| format!("no folder {}", folder.display()))?;
        let home = home.to_str().context("the path of this repository is not UTF-8")?;
        Step::new("environment", base, "-m venv --clear")
            .with(home)
            .run()
            .context("without `ensurepip` a Debian needs the package python3-venv")?;
    }
    Ok(python)
}
