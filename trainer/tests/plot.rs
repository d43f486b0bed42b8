//! The command `trainer plot`, from the user's side.

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};

fn plot(line: &str, directory: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trainer"))
        .arg("plot")
        .args(line.split(' '))
        .current_dir(directory)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Returns a log of `episodes` episodes in the columns of a training.
fn log(episodes: u32, reward: f64) -> String {
    let mut log = "episode,stage,total_steps,density_ratio,reward,steps,q0\n".to_owned();
    for n in 1..=episodes {
        writeln!(log, "{n},1,{},0,{reward},5,0", 5 * n).unwrap();
    }
    log
}

#[test]
fn draws_runs_given_by_file_policy_folder_and_pattern() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    for seed in ["study/seeds/0001", "study/seeds/0002"] {
        std::fs::create_dir_all(path(seed)).unwrap();
        std::fs::write(path(seed).join("p.csv"), log(300, 2.0)).unwrap();
    }
    // A CSV file that is no log must be ignored.
    std::fs::write(path("study/summary.csv"), "seed,survive30\n1,0.99\n").unwrap();
    for (name, reward) in [("air-1", 1.0), ("air-2", 3.0), ("air-3", 4.0), ("one", 0.5)] {
        std::fs::write(path(&format!("{name}.csv")), log(400, reward)).unwrap();
        std::fs::write(path(&format!("{name}.bin")), "a policy").unwrap();
    }
    let line = "study one.bin one.csv land=air-* --out curves.svg";
    let output = plot(line, directory.path());
    assert!(output.status.success(), "{}", text(&output.stderr));
    let message = text(&output.stdout);
    let row = |label: &str| {
        let line = message.lines().find(|l| l.starts_with(label)).unwrap_or_default();
        line.split_whitespace().take(4).map(str::to_owned).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(row("study"), "study 2 1,500 2.00", "{message}");
    assert_eq!(row("one"), "one 1 2,000 0.50", "{message}");
    assert_eq!(row("land"), "land 3 2,000 3.00", "{message}");
    let svg = std::fs::read_to_string(path("curves.svg")).unwrap();
    assert!(svg.contains("land (3 runs)") && svg.contains("one (1 run)"), "{svg}");
    assert!(plot(line, directory.path()).status.success());
    assert_eq!(std::fs::read_to_string(path("curves.svg")).unwrap(), svg);
}

#[test]
fn input_errors_name_the_cause_with_status_2() {
    let directory = tempfile::tempdir().unwrap();
    let write = |name: &str, content: &str| {
        std::fs::write(directory.path().join(name), content).unwrap();
    };
    write("good.csv", &log(100, 1.0));
    write("bad.csv", &(log(2, 1.0) + "3,1,15,0,NaN,5,0\n"));
    write("short.csv", &log(1, 1.0));
    write("table.csv", "a,b\n1,2\n");
    write("alone.bin", "a policy");
    std::fs::create_dir(directory.path().join("empty")).unwrap();
    let nine = (1..=9).map(|i| format!("{i}=good.csv")).collect::<Vec<_>>().join(" ");
    for (runs, message) in [
        ("none.csv", "none.csv: No such file"),
        ("table.csv", "table.csv, line 1: no column stage"),
        ("good.csv bad.csv", "bad.csv, line 4, column reward: 'NaN', expected a finite number"),
        ("alone.bin", "alone.bin: its log alone.csv does not exist"),
        ("empty", "empty: no log of a training in this folder"),
        ("x=none-*.csv", "none-*.csv: no file matches this pattern"),
        ("=good.csv", "'=good.csv': expected LABEL=RUN"),
        ("short.csv", "short: nothing to draw"),
        ("good.csv --window 0", "--window"),
        (nine.as_str(), "9 curves, at most 8"),
    ] {
        let output = plot(&format!("{runs} --out curves.svg"), directory.path());
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{runs}: {error}");
        assert!(error.contains(message), "{runs}: {error}");
    }
    assert!(!directory.path().join("curves.svg").exists());
    let output = plot("good.csv --out nowhere/curves.svg", directory.path());
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("nowhere/curves.svg: cannot be written"));
}
