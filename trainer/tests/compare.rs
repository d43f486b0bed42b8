//! The command `trainer compare`, from the user's side.

use std::path::Path;
use std::process::{Command, Output};

/// Returns the path of the shipped policy.
fn robust() -> String {
    requirements::checkout().join("controller/policies/robust.bin").display().to_string()
}

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
fn compares_a_policy_with_itself_and_with_one_that_falls() {
    let directory = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let output = trainer(arguments, directory.path());
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout)
    };
    let table = run(&["compare", &robust(), &robust(), "--starts", "100"]);
    assert!(
        table.contains("A better in 0, B better in 0, no significant difference in 24."),
        "{table}"
    );
    assert!(table.contains("They do not differ at any of them."), "{table}");
    assert_eq!(table.matches("equally fast").count(), 8, "{table}");

    // The angle is always 0.25 rad, at which the leg falls.
    std::fs::write(
        directory.path().join("lame.json"),
        r#"{"hidden_activation": "relu", "output": "clip(output_scale*tanh(z), low, high)",
            "output_scale": 0.25, "low": [0.25, 0.0], "high": [0.26, 2.0],
            "layers": [{"weights": [[0, 0, 0], [0, 0, 0]], "bias": [0, 0]}]}"#,
    )
    .unwrap();
    run(&["import", "--json", "lame.json", "--out", "lame.bin"]);
    let json = run(&["compare", "lame.bin", &robust(), "--starts", "100", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["starts"], 100);
    for density in json["densities"].as_array().unwrap() {
        let survive = &density["survive30"];
        assert_eq!(survive["verdict"], "b-better", "{density}");
        assert_eq!(survive["a"]["value"], 0.0, "{density}");
        assert!(survive["difference"]["low"].as_f64().unwrap() > 0.8, "{density}");
        assert!(density["abs_v_median"].is_null(), "{density}");
    }
    assert_eq!(json["tracked"][0]["tracked"], 0);
    let differing = json["tracking_differs"].as_array().unwrap().len();
    assert_eq!(differing, 42, "one falls everywhere, the other nowhere");
}

#[test]
fn input_errors_name_the_cause_with_status_2() {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("not.bin"), "0123456789012345678901").unwrap();
    for (arguments, message) in [
        (["compare", &robust(), "none.bin", "--seed=1"], "none.bin"),
        (["compare", "not.bin", &robust(), "--seed=1"], "not.bin is not a valid policy"),
        (["compare", &robust(), &robust(), "--starts=99"], "100..=1000000"),
    ] {
        let output = trainer(&arguments, directory.path());
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.contains(message), "{error}");
    }
}
