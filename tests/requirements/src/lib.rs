//! Things that some tests need and that not every machine has: an emulator, a C
//! compiler, the authors' data.
//!
//! A test checks for what it needs and returns early where that is missing:
//!
//! ```
//! if !requirements::gcc() {
//!     return;
//! }
//! ```
//!
//! Two environment variables decide what a missing requirement means:
//!
//! - `LEG_REQUIRE=qemu,gcc` makes each requirement in the list mandatory: without it
//!   the test fails.
//! - `LEG_SKIPPED=FILE` collects the skipped tests: one line per test is appended.
//!
//! A skip is also printed on the standard error of the process, past the capture of
//! the test harness. `cargo xtask ci` sets both variables and prints the file at its end.

use std::ffi::OsStr;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A requirement of a test, by the name that it has in `LEG_REQUIRE`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Requirement {
    /// The emulator `qemu-system-arm`.
    Qemu,
    /// The C compiler `gcc`.
    Gcc,
    /// The C++ compiler `g++`.
    Gxx,
    /// The C compiler `clang`.
    Clang,
    /// The C compiler for Cortex-M, `arm-none-eabi-gcc`.
    ArmGcc,
    /// A Python with the packages of `tests/requirements.txt`, named by `LEG_PYTHON`.
    Python,
    /// Stable-Baselines3, with PyTorch, in the Python that `LEG_PYTHON` names.
    Sb3,
    /// The folder with the authors' published data (doi 10.5281/zenodo.4607469).
    Reference,
    /// The browser Chromium, under any of the names that distributions give it.
    Chromium,
    /// Permission to trace a child process.
    Ptrace,
    /// The rights of the superuser.
    Root,
    /// A mount namespace of its own, which needs the rights of the superuser and `unshare`.
    Mounts,
    /// The program `script`, which provides a terminal.
    Script,
    /// A SIGHUP that is not ignored, as it is under `nohup`.
    Sighup,
}

impl Requirement {
    /// Every requirement there is.
    pub const ALL: [Self; 14] = [
        Self::Qemu,
        Self::Gcc,
        Self::Gxx,
        Self::Clang,
        Self::ArmGcc,
        Self::Python,
        Self::Sb3,
        Self::Reference,
        Self::Chromium,
        Self::Ptrace,
        Self::Root,
        Self::Mounts,
        Self::Script,
        Self::Sighup,
    ];

    /// The name in `LEG_REQUIRE`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Qemu => "qemu",
            Self::Gcc => "gcc",
            Self::Gxx => "g++",
            Self::Clang => "clang",
            Self::ArmGcc => "arm-gcc",
            Self::Python => "python",
            Self::Sb3 => "sb3",
            Self::Reference => "reference",
            Self::Chromium => "chromium",
            Self::Ptrace => "ptrace",
            Self::Root => "root",
            Self::Mounts => "mounts",
            Self::Script => "script",
            Self::Sighup => "sighup",
        }
    }

    /// Returns what was found, or `None` after the skip has been reported.
    ///
    /// # Panics
    /// If the requirement is missing and `LEG_REQUIRE` lists it, and if `LEG_REQUIRE`
    /// lists a name that is no requirement.
    pub fn check<T>(self, found: Result<T, String>) -> Option<T> {
        let required = std::env::var("LEG_REQUIRE").unwrap_or_default();
        let log = std::env::var_os("LEG_SKIPPED");
        match (self.decide(&required, found), log) {
            (Ok(found), _) => Some(found),
            (Err(missing), log) => {
                report(&missing, log.as_deref());
                None
            }
        }
    }

    /// Returns what was found or the line that reports the skip.
    fn decide<T>(self, required: &str, found: Result<T, String>) -> Result<T, String> {
        let mut is_required = false;
        for name in required.split(',').map(str::trim).filter(|name| !name.is_empty()) {
            let known = Self::ALL.into_iter().find(|requirement| requirement.name() == name);
            let known = known.unwrap_or_else(|| {
                let names = Self::ALL.map(Self::name).join(", ");
                panic!("LEG_REQUIRE: no requirement is called `{name}`; there are {names}")
            });
            is_required |= known == self;
        }
        found.map_err(|reason| {
            let name = self.name();
            assert!(!is_required, "LEG_REQUIRE demands {name}, but {reason}");
            let thread = std::thread::current();
            format!("skipped: {}: {reason} ({name})", thread.name().unwrap_or("a test"))
        })
    }
}

/// Prints a skip past the capture of the test harness, and appends it to the log.
fn report(line: &str, log: Option<&OsStr>) {
    // The macro `eprintln!` would write into the harness' buffer.
    let _ = writeln!(io::stderr(), "{line}");
    if let Some(log) = log {
        let opened = OpenOptions::new().create(true).append(true).open(log);
        // In one write: other test processes append to the same file.
        let written = opened.and_then(|mut file| file.write_all(format!("{line}\n").as_bytes()));
        written.unwrap_or_else(|e| panic!("LEG_SKIPPED={}: {e}", log.display()));
    }
}

/// Returns whether a program starts and answers `--version`.
fn runs(program: &str) -> bool {
    let mut command = Command::new(program);
    command.arg("--version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

fn program(requirement: Requirement, name: &str) -> bool {
    let found = if runs(name) { Ok(()) } else { Err(format!("`{name}` is not installed")) };
    requirement.check(found).is_some()
}

/// Returns whether the emulator is installed.
#[must_use]
pub fn qemu() -> bool {
    program(Requirement::Qemu, "qemu-system-arm")
}

/// Returns whether the C compiler is installed.
#[must_use]
pub fn gcc() -> bool {
    program(Requirement::Gcc, "gcc")
}

/// Returns whether the C++ compiler is installed.
#[must_use]
pub fn gxx() -> bool {
    program(Requirement::Gxx, "g++")
}

/// Returns whether the C compiler Clang is installed.
#[must_use]
pub fn clang() -> bool {
    program(Requirement::Clang, "clang")
}

/// Returns whether the C compiler for Cortex-M is installed.
#[must_use]
pub fn arm_gcc() -> bool {
    program(Requirement::ArmGcc, "arm-none-eabi-gcc")
}

/// Returns whether the program `script` is installed.
#[must_use]
pub fn script() -> bool {
    program(Requirement::Script, "script")
}

/// Returns the Python that `LEG_PYTHON` names.
#[must_use]
pub fn python() -> Option<PathBuf> {
    let named = std::env::var_os("LEG_PYTHON").map(PathBuf::from);
    Requirement::Python.check(named.ok_or_else(|| {
        "LEG_PYTHON names no Python with the packages of tests/requirements.txt".into()
    }))
}

/// Returns whether this Python has Stable-Baselines3.
#[must_use]
pub fn sb3(python: &Path) -> bool {
    let mut command = Command::new(python);
    command.args(["-c", "import stable_baselines3"]);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let has = command.status().is_ok_and(|status| status.success());
    let found = if has { Ok(()) } else { Err("stable_baselines3 is not installed".to_owned()) };
    Requirement::Sb3.check(found).is_some()
}

/// Returns the name of the browser.
#[must_use]
pub fn chromium() -> Option<&'static str> {
    let name = CHROMIUM_NAMES.into_iter().find(|name| runs(name));
    Requirement::Chromium.check(name.ok_or_else(|| "Chromium is not installed".into()))
}

/// Names under which distributions install Chromium.
pub const CHROMIUM_NAMES: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

/// Returns the folder of the authors' published data: the folder that `LEG_REFERENCE_DATA`
/// names, or `../shared/reference` beside the checkout.
#[must_use]
pub fn reference_data() -> Option<PathBuf> {
    let folder = reference_folder();
    let found = if folder.is_dir() {
        Ok(folder)
    } else {
        let folder = folder.display();
        Err(format!("there is no folder {folder}; LEG_REFERENCE_DATA names another"))
    };
    Requirement::Reference.check(found)
}

/// Returns where [`reference_data`] looks.
#[must_use]
pub fn reference_folder() -> PathBuf {
    std::env::var_os("LEG_REFERENCE_DATA")
        .map_or_else(|| checkout().join("../shared/reference"), PathBuf::from)
}

/// Returns the root of the checkout that holds the current folder, which is a package's
/// under `cargo test`.
///
/// It is looked for when the program runs: a path from the time of compilation would lead
/// from a moved or copied checkout back to the old one.
///
/// # Panics
/// Panics when the current folder is in no checkout.
#[must_use]
pub fn checkout() -> PathBuf {
    let current = std::env::current_dir().expect("the current folder");
    checkout_of(&current).unwrap_or_else(|| {
        panic!("{} is not in a checkout of this repository; run this from one", current.display())
    })
}

fn checkout_of(folder: &Path) -> Option<PathBuf> {
    let is_root = |folder: &&Path| folder.join("tests/requirements/Cargo.toml").is_file();
    folder.ancestors().find(is_root).map(Path::to_owned)
}

/// Returns whether this process has the rights of the superuser.
#[must_use]
pub fn root() -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let user = status.lines().find_map(|line| line.strip_prefix("Uid:"));
    let effective = user.and_then(|ids| ids.split_whitespace().nth(1));
    let found = if effective == Some("0") { Ok(()) } else { Err("only root may do this".into()) };
    Requirement::Root.check(found).is_some()
}

/// Returns whether a test may mount file systems in a mount namespace of its own, as
/// `unshare --mount` provides it.
#[must_use]
pub fn mounts() -> bool {
    let mut command = Command::new("unshare");
    command.args(["--mount", "true"]).stdin(Stdio::null()).stderr(Stdio::null());
    let found = match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(_) => Err("this process may not create a mount namespace".into()),
        Err(error) => Err(format!("`unshare` cannot be run ({error})")),
    };
    Requirement::Mounts.check(found).is_some()
}

/// Runs the test of this name (with the path of its module) again, in a mount namespace of
/// its own, and returns true there. Returns false in the process that has waited for it.
///
/// # Panics
/// Panics when the test fails there, or when no test has this name.
#[must_use]
pub fn in_mount_namespace(test: &str) -> bool {
    const CHILD: &str = "LEG_TEST_IN_MOUNT_NAMESPACE";
    if std::env::var_os(CHILD).is_some_and(|name| name == test) {
        return true;
    }
    if mounts() {
        let mut again = Command::new("unshare");
        again.args(["--mount", "--"]).arg(std::env::current_exe().expect("the path of this test"));
        again.args(["--exact", test, "--nocapture"]).env(CHILD, test);
        let output = again.output().expect("`unshare` starts");
        let (out, err) = (output.stdout.escape_ascii(), output.stderr.escape_ascii());
        // The harness succeeds, too, when it finds no test of the name.
        let has_run = String::from_utf8_lossy(&output.stdout).contains("test result: ok. 1 passed");
        assert!(output.status.success() && has_run, "{test} in a mount namespace: {out} {err}");
    }
    false
}

/// Returns whether a SIGHUP reaches the programs that this test starts: they inherit
/// an ignored one.
#[must_use]
pub fn sighup() -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    let is_ignored = ignored.is_none_or(|mask| mask & 1 == 1);
    let found = if is_ignored { Err("SIGHUP is ignored, as under nohup".into()) } else { Ok(()) };
    Requirement::Sighup.check(found).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn missing() -> Result<(), String> {
        Err("`gcc` is not installed".into())
    }

    #[test]
    fn what_is_there_is_returned() {
        assert_eq!(Requirement::Gcc.decide("gcc", Ok(5)), Ok(5));
    }

    #[test]
    fn a_missing_requirement_is_a_skip_that_names_test_and_reason() {
        let line = Requirement::Gcc.decide("qemu,reference", missing()).unwrap_err();
        let test = "tests::a_missing_requirement_is_a_skip_that_names_test_and_reason";
        assert_eq!(line, format!("skipped: {test}: `gcc` is not installed (gcc)"));
    }

    #[test]
    #[should_panic(expected = "LEG_REQUIRE demands gcc, but `gcc` is not installed")]
    fn a_missing_requirement_that_is_mandatory_fails_the_test() {
        let _ = Requirement::Gcc.decide("qemu, gcc", missing());
    }

    #[test]
    #[should_panic(expected = "no requirement is called `qemo`")]
    fn a_misspelt_requirement_fails_the_test() {
        let _ = Requirement::Gcc.decide("qemo", Ok(()));
    }

    #[test]
    fn the_checkout_is_the_one_around_the_current_folder() {
        let moved = tempfile::tempdir().unwrap();
        let package = moved.path().join("sim-host/plant");
        fs::create_dir_all(&package).unwrap();
        assert_eq!(checkout_of(&package), None);
        fs::create_dir_all(moved.path().join("tests/requirements")).unwrap();
        fs::write(moved.path().join("tests/requirements/Cargo.toml"), "").unwrap();
        assert_eq!(checkout_of(&package).as_deref(), Some(moved.path()));
        let here = std::env::current_dir().unwrap();
        assert_eq!(checkout().join("tests/requirements"), here, "as `cargo test` starts it");
    }

    #[test]
    fn a_test_in_a_mount_namespace_runs_there() {
        if in_mount_namespace("tests::a_test_in_a_mount_namespace_runs_there") {
            let here = fs::read_link("/proc/self/ns/mnt").unwrap();
            assert_ne!(here, fs::read_link("/proc/1/ns/mnt").unwrap_or_default());
        }
    }

    #[test]
    #[should_panic(expected = "tests::of_no_test in a mount namespace")]
    fn a_name_of_no_test_is_not_a_success() {
        if mounts() {
            let _ = in_mount_namespace("tests::of_no_test");
        } else {
            panic!("tests::of_no_test in a mount namespace: not tried, as the skip above states");
        }
    }

    #[test]
    fn skips_are_appended_to_the_log() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("skipped.txt");
        report("skipped: one", Some(log.as_os_str()));
        report("skipped: two", Some(log.as_os_str()));
        assert_eq!(fs::read_to_string(&log).unwrap(), "skipped: one\nskipped: two\n");
    }
}
