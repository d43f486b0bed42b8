//! The header is that of the code, and programs in C and C++ build with it, run, and hop.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::{env, fs};

const PACKAGE: &str = env!("CARGO_MANIFEST_DIR");

/// `LEG_BLESS=1` writes it anew.
#[test]
fn the_committed_header_is_that_of_the_code() {
    let package = Path::new(PACKAGE);
    let config = cbindgen::Config::from_file(package.join("cbindgen.toml")).unwrap();
    let mut generated = Vec::new();
    cbindgen::generate_with_config(package, config).unwrap().write(&mut generated);
    let generated = String::from_utf8(generated).unwrap();
    let path = package.join("include/leg.h");
    if env::var_os("LEG_BLESS").is_some() {
        fs::write(&path, &generated).unwrap();
    }
    let committed = fs::read_to_string(&path).unwrap();
    assert!(
        committed == generated,
        "run `LEG_BLESS=1 cargo test -p leg-c`; it is now:\n{generated}"
    );
}

/// Returns the folder with the libraries that cargo has built for this test.
fn libraries() -> PathBuf {
    let test = env::current_exe().unwrap();
    test.parent().unwrap().to_owned()
}

fn run(command: &mut Command) -> Output {
    let output = command.output().unwrap();
    let [out, err] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text));
    assert!(output.status.success(), "{command:?}: {out}{err}");
    output
}

/// Builds the example and returns its output for a run of 20 s with the law that is linked in.
fn hops_by_the_linked_law(compiler: &str, language: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("leg");
    let mut command = Command::new(compiler);
    command.args(language).args(["-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]);
    command.arg(format!("-I{PACKAGE}/include")).arg(format!("{PACKAGE}/examples/leg.c"));
    command.arg(format!("-L{}", libraries().display())).args(["-lleg", "-lm", "-o"]).arg(&program);
    run(&mut command);
    let output = run(Command::new(&program).args(["-", "20"]).env("LD_LIBRARY_PATH", libraries()));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn a_leg_in_c_hops_by_the_law_that_is_linked_in() {
    let has = [requirements::gcc(), requirements::clang()];
    for compiler in
        ["gcc", "clang"].into_iter().zip(has).filter_map(|(name, has)| has.then_some(name))
    {
        let report = hops_by_the_linked_law(compiler, &["-std=c99"]);
        assert!(report.starts_with("17 apexes, "), "{compiler}: {report}");
        // The set-point is 1 m/s, and the run ends in flight.
        let vx: f64 =
            report.split(", ").nth(2).unwrap().trim_end_matches(" m/s\n").parse().unwrap();
        assert!((vx - 1.0).abs() < 1e-4, "{compiler}: {report}");
    }
}

#[test]
fn the_header_is_usable_from_cpp() {
    if !requirements::gxx() {
        return;
    }
    let report = hops_by_the_linked_law("g++", &["-x", "c++", "-std=c++11"]);
    assert!(report.starts_with("17 apexes, "), "{report}");
}
