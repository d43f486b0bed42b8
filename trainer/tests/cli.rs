//! The command line, from the user's side.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

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
fn trains_inspects_evaluates_and_infers() {
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
    for message in [
        "format version     1",
        "3-50-50-2",
        "seed               3",
        "action-at-second-layer",
        "discount = 0.6",
        "test vectors       12, passed",
        "    11,   12.5,      1: ",
    ] {
        assert!(inspected.contains(message), "{message} is not in {inspected}");
    }

    let json: serde_json::Value =
        serde_json::from_str(&run("eval --policy p.bin --json --starts 20")).unwrap();
    for by_density in ["survive30", "abs_v_median", "abs_v_p95", "reward5", "max_speed"] {
        for rho in ["0", "0.05", "0.1", "0.3", "0.5", "0.7", "0.9", "1"] {
            assert!(json[by_density].get(rho).is_some(), "{by_density} at {rho}");
        }
    }
    assert_eq!(json["tracking"].as_array().unwrap().len(), 48);
    for key in ["rho", "set_point", "mean_v", "oscillation", "friction", "fell"] {
        assert!(json["tracking"][0].get(key).is_some(), "{key}");
    }
    let elsewhere = json["conditions"].as_array().unwrap();
    assert_eq!((elsewhere.len(), &elsewhere[10]["name"]), (12, &"moon".into()));
    for key in ["stiffness_n_m", "mass_kg", "gravity_m_s2", "rho", "survive30", "abs_v_median"] {
        assert!(elsewhere[0].get(key).is_some(), "{key}");
    }

    std::fs::write(directory.path().join("o.csv"), "y,vx,rho\n2,-1,0\n1.5,0.5,1\n").unwrap();
    let actions = run("infer --policy p.bin --input o.csv");
    let mut lines = actions.lines();
    assert_eq!(lines.next(), Some("vx,y,rho,alpha,rs"));
    assert!(lines.next().unwrap().starts_with("-1,2,0,"));
    assert_eq!(run("infer --policy p.bin --input o.csv --output -"), actions);
    run("infer --policy p.bin --input o.csv --output a.csv");
    assert_eq!(std::fs::read_to_string(directory.path().join("a.csv")).unwrap(), actions);

    // No temporary file is left.
    let mut files: Vec<_> = std::fs::read_dir(directory.path())
        .unwrap()
        .map(|f| f.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    assert_eq!(files, ["a.csv", "l.csv", "o.csv", "p.bin"]);
}

#[test]
fn input_errors_name_the_cause_with_status_2() {
    let directory = tempfile::tempdir().unwrap();
    let write = |name: &str, content: &str| {
        std::fs::write(directory.path().join(name), content).unwrap();
    };
    write("actor.json", r#"{"hidden_activation": "relu", "output": "linear"}"#);
    write("not.bin", "0123456789012345678901");
    write(
        "clip.json",
        r#"{"hidden_activation": "relu", "output": "clip(output_scale*tanh(z), low, high)",
            "output_scale": 1.0, "low": [0.5, 0.0], "high": [0.25, 2.0], "layers": []}"#,
    );
    write(
        "good.json",
        r#"{"hidden_activation": "relu", "output": "clip(output_scale*tanh(z), low, high)",
            "output_scale": 1.0, "low": [0.25, 0.0], "high": [0.5, 2.0],
            "layers": [{"weights": [[1, 0, 0], [0, 1, 0]], "bias": [0, 0]}]}"#,
    );
    let long_name = format!("import --json good.json --out p.bin --name {}", "n".repeat(65));
    let cases = [
        ("train --preset fire --out p.bin", "fire"),
        ("train --preset air --steps 0 --out p.bin", "--steps"),
        ("eval --policy none.bin", "none.bin"),
        ("train --preset robust --episodes 1 --out p.bin", "counted in steps; use --steps"),
        ("train --preset air --out p.bin --log p.bin", "--log p.bin: this is the policy file"),
        ("train --preset air --out p.bin --log ./p.bin", "--log ./p.bin: this is the policy file"),
        ("train --preset air --out p.csv", "name the log with --log"),
        ("train --preset air --out p.bin --eval-starts 1000001", "0..=1000000"),
        ("eval --policy p.bin --starts 4294967295", "1..=1000000"),
        (
            "eval --policy not.bin",
            "not.bin is not a valid policy: it does not start with \"LEGACTOR\"",
        ),
        ("import --json clip.json --out p.bin", "low[0]: 0.5, expected at most high[0], 0.25"),
        (long_name.as_str(), "has 65 bytes, at most 64"),
        ("import --json actor.json --out p.bin", "actor.json: output: \"linear\", expected"),
        ("inspect actor.json", "actor.json"),
    ];
    for (line, message) in cases {
        let arguments: Vec<&str> = line.split(' ').collect();
        let output = trainer(&arguments, directory.path());
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {error}");
        assert!(error.contains(message), "{line}: {error}");
    }
    for name in ["p.bin", "p.csv"] {
        assert!(!directory.path().join(name).exists(), "{name}");
    }
    // A name that is refused by default can be given.
    let output = trainer(&["import", "--json", "good.json", "--out", "p.bin"], directory.path());
    assert!(output.status.success(), "{}", text(&output.stderr));
    let help = text(&trainer(&["import", "--help"], directory.path()).stdout);
    assert!(help.contains("\"layers\": [{\"weights\""), "{help}");
}

#[test]
fn a_signal_stops_a_training_with_a_checkpoint() {
    for signal in ["-INT", "-USR1", "-USR2", "-XCPU"] {
        is_stopped_by(signal);
    }
}

fn is_stopped_by(signal: &str) {
    let directory = tempfile::tempdir().unwrap();
    let child = Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(["train", "--preset", "air", "--steps", "1000000000", "--out", "p.bin"])
        .current_dir(directory.path())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The signal handlers are installed before any file exists.
    let began = Instant::now();
    while !directory.path().join("p.bin.checkpoint").exists() {
        assert!(began.elapsed() < Duration::from_mins(1), "no checkpoint");
        std::thread::sleep(Duration::from_millis(2));
    }
    let kill = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let output = child.wait_with_output().unwrap();
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.starts_with("trainer: stopped by a signal after "), "{error}");
    assert!(
        error.contains("no policy written; resume with: trainer train --resume --out p.bin"),
        "{error}"
    );
    let mut files: Vec<_> =
        std::fs::read_dir(directory.path()).unwrap().map(|f| f.unwrap().file_name()).collect();
    files.sort();
    assert_eq!(files, ["p.bin.checkpoint", "p.csv.part"]);
}

#[test]
fn a_printed_configuration_trains_the_policy_of_its_preset() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let run = |line: &str| {
        let arguments: Vec<&str> = line.split(' ').collect();
        trainer(&arguments, directory.path())
    };
    let shown = run("config show --preset water --set stages.0.length.episodes=20");
    std::fs::write(path("c.toml"), &shown.stdout).unwrap();
    assert!(run("config check c.toml").status.success());
    for line in ["--config c.toml --out c.bin", "--preset water --episodes 20 --out p.bin"] {
        let output = run(&format!("train --seed 3 --eval-starts 0 {line}"));
        assert!(output.status.success(), "{line}: {}", text(&output.stderr));
    }
    assert!(std::fs::read(path("c.bin")).unwrap() == std::fs::read(path("p.bin")).unwrap());
    std::fs::write(path("bad.toml"), text(&shown.stdout).replace("= 32", "= 33")).unwrap();
    for (line, message) in [
        ("config check bad.toml", "bad.toml: learning.batch is 33, but must be 32 or 64"),
        ("train --config bad.toml --out x.bin", "bad.toml: learning.batch is 33"),
        ("train --config c.toml --preset air --out x.bin", "cannot be used with"),
        ("train --out x.bin", "give --preset NAME or --config FILE"),
        ("train --preset air --out x.bin --set learning.bach=1", "--set learning.bach=1: no key"),
        ("train --preset air --out x.bin --set reward.cap=0", "reward.cap is 0, but must be"),
        (
            "train --preset air --out x.bin --set learning.batch=abc",
            "--set learning.batch=abc: string \"abc\", expected a whole number from 0\n",
        ),
        (
            "train --preset air --out x.bin --set gains=[1]",
            "--set gains=[1]: integer `1`, expected a table in { }\n",
        ),
        ("import --onnx bad.toml --out x.bin", "write it with torch.onnx.export\n"),
        ("train --preset air --out x.bin --checkpoint-every=-1", "from 0 to 1000000"),
    ] {
        let output = run(line);
        assert_eq!(output.status.code(), Some(2), "{line}: {}", text(&output.stderr));
        assert!(text(&output.stderr).contains(message), "{line}: {}", text(&output.stderr));
    }
}

#[test]
fn infer_names_line_and_column_of_a_bad_observation() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let train = "train --preset air --episodes 5 --out p.bin --eval-starts 0";
    let arguments: Vec<&str> = train.split(' ').collect();
    assert!(trainer(&arguments, directory.path()).status.success());
    for (content, message) in [
        ("vx,y,rho\n1,2,0\n1,two,0\n", "o.csv, line 3, column y: 'two' is not a finite number"),
        ("vx,y\n1,2\n", "o.csv: no column rho"),
        ("vx,y,rho\r\n1,2,0\r\n1,2\r\n", "o.csv, line 3, column rho: the value is missing"),
        ("vx,y,rho\n1,,0\n", "o.csv, line 2, column y: the value is missing"),
        ("vx,y,rho\n\n1,2,NaN\n", "o.csv, line 3, column rho: 'NaN' is not a finite number"),
        ("vx,y,rho\n1e39,2,1\n", "o.csv, line 2, column vx: '1e39' is not a finite number"),
        ("vx,y,rho,vx\n1,2,0,1\n", "o.csv: more than one column vx"),
        ("vx,y,rho\n1,2,0,5\n", "o.csv, line 2: 4 values, but the first line names 3"),
    ] {
        std::fs::write(path("o.csv"), content).unwrap();
        let output = trainer(
            &["infer", "--policy", "p.bin", "--input", "o.csv", "--output", "a.csv"],
            directory.path(),
        );
        assert_eq!(output.status.code(), Some(2));
        assert!(text(&output.stderr).contains(message), "{}", text(&output.stderr));
        assert!(!path("a.csv").exists());
        let output = trainer(&["infer", "--policy", "p.bin", "--input", "o.csv"], directory.path());
        assert_eq!((output.status.code(), text(&output.stdout).as_str()), (Some(2), ""));
    }
    // A folder that does not exist is found before the training.
    let output =
        trainer(&["train", "--preset", "robust", "--out", "nowhere/p.bin"], directory.path());
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(
        text(&output.stderr),
        "trainer: nowhere/p.bin: cannot be written: No such file or directory (os error 2); \
         name another place with --out\n"
    );
}
