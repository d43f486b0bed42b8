//! The command line as a user sees it.

use std::path::Path;
use std::process::{Command, Output};

fn trainer(arguments: &[&str], directory: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(arguments)
        .current_dir(directory)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
fn from_training_to_actions() {
    let directory = tempfile::tempdir().unwrap();
    let run = |line: &str| {
        let arguments: Vec<&str> = line.split(' ').collect();
        let output = trainer(&arguments, directory.path());
        assert!(output.status.success(), "{line}: {}", text(&output.stderr));
        text(&output.stdout)
    };
    run("train --preset water --seed 3 --episodes 300 --out p.bin --log l.csv --eval-starts 0");
    let log = std::fs::read_to_string(directory.path().join("l.csv")).unwrap();
    assert!(log.starts_with("episode,stage,total_steps,density_ratio,reward,steps,q0\n1,1,"));
    assert_eq!(log.lines().count(), 301);

    let inspected = run("inspect p.bin");
    for said in ["3-50-50-2", "seed               3", "action-at-second-layer", "discount = 0.6"] {
        assert!(inspected.contains(said), "{said} is not in {inspected}");
    }

    let json: serde_json::Value =
        serde_json::from_str(&run("eval --policy p.bin --json --starts 20")).unwrap();
    for by_density in ["survive30", "abs_v_median", "abs_v_p95", "reward5", "max_speed"] {
        for rho in ["0", "0.05", "0.1", "0.3", "0.5", "0.7", "0.9", "1"] {
            assert!(json[by_density].get(rho).is_some(), "{by_density} at {rho}");
        }
    }
    assert_eq!(json["tracking"].as_array().unwrap().len(), 48);
    for key in ["rho", "set_point", "mean_v", "oscillation", "fell"] {
        assert!(json["tracking"][0].get(key).is_some(), "{key}");
    }

    std::fs::write(directory.path().join("o.csv"), "y,vx,rho\n2,-1,0\n1.5,0.5,1\n").unwrap();
    let actions = run("infer --policy p.bin --input o.csv");
    let mut lines = actions.lines();
    assert_eq!(lines.next(), Some("vx,y,rho,alpha,rs"));
    assert!(lines.next().unwrap().starts_with("-1,2,0,"));
    run("infer --policy p.bin --input o.csv --output a.csv");
    assert_eq!(std::fs::read_to_string(directory.path().join("a.csv")).unwrap(), actions);

    // Nothing is left behind under another name.
    let mut files: Vec<_> = std::fs::read_dir(directory.path())
        .unwrap()
        .map(|f| f.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    assert_eq!(files, ["a.csv", "l.csv", "o.csv", "p.bin"]);
}

#[test]
fn what_cannot_be_used_is_named_with_status_2() {
    let directory = tempfile::tempdir().unwrap();
    let write = |name: &str, content: &str| {
        std::fs::write(directory.path().join(name), content).unwrap();
    };
    write("actor.json", r#"{"hidden_activation": "relu", "output": "linear"}"#);
    write("not.bin", "0123456789012345678901");
    let cases = [
        ("train --preset fire --out p.bin", "fire"),
        ("train --preset air --steps 0 --out p.bin", "--steps"),
        ("eval --policy none.bin", "none.bin"),
        ("eval --policy not.bin", "not.bin: it starts with"),
        ("import --json actor.json --out p.bin", "actor.json: output: \"linear\", expected"),
        ("inspect actor.json", "actor.json"),
    ];
    for (line, said) in cases {
        let arguments: Vec<&str> = line.split(' ').collect();
        let output = trainer(&arguments, directory.path());
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {error}");
        assert!(error.contains(said), "{line}: {error}");
    }
    assert!(!directory.path().join("p.bin").exists());
}

#[test]
fn a_bad_observation_is_named_with_line_and_column() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let train = "train --preset air --episodes 5 --out p.bin --eval-starts 0";
    let arguments: Vec<&str> = train.split(' ').collect();
    assert!(trainer(&arguments, directory.path()).status.success());
    for (content, said) in [
        ("vx,y,rho\n1,2,0\n1,two,0\n", "o.csv, line 3, column y: 'two' is not a finite number"),
        ("vx,y\n1,2\n", "o.csv: no column rho"),
    ] {
        std::fs::write(path("o.csv"), content).unwrap();
        let output = trainer(
            &["infer", "--policy", "p.bin", "--input", "o.csv", "--output", "a.csv"],
            directory.path(),
        );
        assert_eq!(output.status.code(), Some(2));
        assert!(text(&output.stderr).contains(said), "{}", text(&output.stderr));
        assert!(!path("a.csv").exists());
    }
    // A directory that is not there is found out before the training.
    let output =
        trainer(&["train", "--preset", "robust", "--out", "nowhere/p.bin"], directory.path());
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("nowhere/p.bin"));
}
