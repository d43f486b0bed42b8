//! Tests the Python package as `cargo test` builds it; `cargo xtask python` tests the wheel.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

/// The package in a folder of its own, and the Python to run it.
struct Package {
    python: PathBuf,
    home: TempDir,
}

impl Package {
    /// Puts the package together; `None` where there is no Python for it.
    fn assembled() -> Option<Self> {
        let python = requirements::python()?;
        let home = tempfile::tempdir().unwrap();
        let package = home.path().join("spring_leg");
        fs::create_dir(&package).unwrap();
        for file in fs::read_dir(source().join("python/spring_leg")).unwrap() {
            let file = file.unwrap();
            if file.file_type().unwrap().is_file() {
                fs::copy(file.path(), package.join(file.file_name())).unwrap();
            }
        }
        // Cargo has built the library for this test, beside it.
        let library = std::env::current_exe().unwrap().with_file_name("lib_leg.so");
        fs::copy(library, package.join("_leg.abi3.so")).unwrap();
        Some(Self { python, home })
    }

    /// Runs a module of Python with the package and returns its output; panics with it if it
    /// fails.
    fn run(&self, arguments: &[&str]) -> String {
        let sim_host = harness::program("sim-host");
        let output = Command::new(&self.python)
            .arg("-B")
            .arg("-m")
            .args(arguments)
            .current_dir(source())
            .env("PYTHONPATH", self.home.path())
            .env("MYPYPATH", self.home.path())
            .env("LEG_SIM_HOST", sim_host.get_program())
            .output()
            .unwrap_or_else(|error| panic!("{}: {error}", self.python.display()));
        let [out, err] =
            [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
        assert!(output.status.success(), "{arguments:?}: {}\n{out}\n{err}", output.status);
        println!("{out}");
        out
    }

    /// Returns the options by which mypy keeps its cache in the folder of the package.
    fn cache(&self) -> String {
        self.home.path().join("cache").display().to_string()
    }
}

/// Returns the folder of the package's sources.
fn source() -> PathBuf {
    Path::new(&requirements::checkout()).join("sim-host/python")
}

#[test]
fn the_tests_in_python_pass() {
    let Some(package) = Package::assembled() else { return };
    let mut arguments = vec!["pytest", "--quiet", "-rs", "-p", "no:cacheprovider", "tests"];
    if !requirements::sb3(&package.python) {
        arguments.push("--ignore=tests/test_sb3.py");
    }
    // What is skipped is stated above, and nothing else is.
    let report = package.run(&arguments);
    assert!(report.contains(" passed") && !report.contains("SKIPPED"), "{report}");
}

#[test]
fn the_types_are_consistent_and_those_of_the_library() {
    if let Some(package) = Package::assembled() {
        let cache = package.cache();
        package.run(&["mypy", "--strict", "--cache-dir", &cache, "--package", "spring_leg"]);
        package.run(&["mypy.stubtest", "spring_leg._leg"]);
    }
}
