//! A leg in C against the program `controller`, which this test is with the argument `controller`.

use std::process::{Command, ExitCode, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};
use std::{env, fs};

use clap::Parser;

const PACKAGE: &str = env!("CARGO_MANIFEST_DIR");
const LONG: Duration = Duration::from_mins(1);

/// The program `controller`.
#[derive(Parser)]
struct Program {
    #[command(flatten)]
    call: leg_host::cli::Call,
}

fn main() -> ExitCode {
    let arguments: Vec<_> = env::args_os().collect();
    if arguments.get(1).is_some_and(|first| first == "controller") {
        return leg_host::cli::main(&Program::parse_from(&arguments[1..]).call);
    }
    if requirements::gcc() {
        a_leg_in_c_hops_with_the_controller_as_with_the_law_that_is_linked_in();
        println!("a_leg_in_c_hops_with_the_controller_as_with_the_law_that_is_linked_in ... ok");
    }
    ExitCode::SUCCESS
}

fn a_leg_in_c_hops_with_the_controller_as_with_the_law_that_is_linked_in() {
    let test = env::current_exe().unwrap();
    let libraries = test.parent().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("leg");
    let built = Command::new("gcc")
        .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"])
        .arg(format!("-I{PACKAGE}/include"))
        .arg(format!("{PACKAGE}/examples/leg.c"))
        .arg(format!("-L{}", libraries.display()))
        .args(["-lleg", "-lm", "-o"])
        .arg(&program)
        .status()
        .unwrap();
    assert!(built.success());

    let domain = format!("c-{}", std::process::id());
    let leg = |domain: &str| {
        let mut leg = Command::new(&program);
        let output = leg.args([domain, "20"]).env("LD_LIBRARY_PATH", libraries).output().unwrap();
        let [out, err] =
            [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        assert!(output.status.success(), "{out}{err}");
        out
    };
    let controller = Command::new(&test)
        .args(["controller", "--once", "--domain", &domain])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let socket = leg_host::Domain::folder(&domain).unwrap().join("session.sock");
    let start = Instant::now();
    while !socket.exists() {
        assert!(start.elapsed() < LONG, "the controller does not listen");
        sleep(Duration::from_millis(5));
    }
    let with_the_controller = leg(&domain);
    let ended = controller.wait_with_output().unwrap();
    let out = String::from_utf8(ended.stdout).unwrap();
    assert!(
        ended.status.success() && out.contains("20000 ticks") && out.contains("0 samples rejected"),
        "{out}"
    );
    assert_eq!(with_the_controller, leg("-"), "the same bits");
    assert!(!fs::exists(socket.parent().unwrap()).unwrap(), "something is left");
}
