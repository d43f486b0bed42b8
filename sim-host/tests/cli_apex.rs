//! `sim-host apex` from the outside.

#[path = "../plant/tests/common/mod.rs"]
mod common;

use std::io::Write;
use std::process::{Command, Output, Stdio};

use common::{Case, GOLDEN, for_each_row};
use leg_plant::Outcome;

fn apex(arguments: &[&str], input: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_sim-host"))
        .arg("apex")
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // A child that refuses its arguments reads nothing.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    child.wait_with_output().unwrap()
}

#[test]
fn reproduces_the_golden_cases_from_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(path("in.csv"), GOLDEN).unwrap();
    let arguments = ["--input", &path("in.csv"), "--output", &path("out.csv")];
    let output = apex(&arguments, "");
    assert!(output.status.success(), "{output:?}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);

    let hops = std::fs::read_to_string(path("out.csv")).unwrap();
    assert_eq!(hops.lines().next(), GOLDEN.lines().next());
    let mut golden = GOLDEN.lines().skip(1);
    for_each_row(&hops, |row| {
        // The input columns are repeated unchanged, and the numbers agree to the last bit.
        let expected: Vec<&str> = golden.next().unwrap().split(',').collect();
        assert_eq!(row.cells[..9], expected[..9], "line {}", row.line);
        let hop = Case::of(row).hop();
        assert_eq!(row.optional("t_touchdown"), hop.touchdown.map(|t| t.t_s));
        assert_eq!(row.optional("x_foot"), hop.touchdown.map(|t| t.foot_x_m));
        assert_eq!(row.optional("t_liftoff"), hop.liftoff_t_s);
        assert_eq!(row.number("hops"), f64::from(hop.stance_phases));
        match hop.outcome {
            Outcome::Apex(next) => {
                assert_eq!(row.number("t_apex"), next.t_s);
                assert_eq!(row.number("x_apex"), next.x_m);
                assert_eq!(row.number("vx_next"), next.vx_m_s);
                assert_eq!(row.number("y_next"), next.y_m);
            }
            Outcome::Fall => assert_eq!(row.optional("y_next"), None),
        }
    });
    assert_eq!(golden.next(), None);
}

#[test]
fn uses_defaults_for_absent_columns_and_ignores_unknown_ones() {
    let output = apex(&[], "note,rs,alpha,y,vx\nhello,0,1.5,2,0.5\n");
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    let row = text.lines().nth(1).unwrap();
    assert!(row.starts_with("80.0,20000.0,9.81,0.0,0.5,2,1.5,0,apex,1,"), "{row}");
}

#[test]
fn reports_a_bad_row_by_place_and_value_and_keeps_the_old_output() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.csv");
    std::fs::write(&out, "precious").unwrap();
    let rows = [
        (
            "x",
            r#"standard input, line 3, column y: "x"; it must be a finite number above 0 and at most 100000"#,
        ),
        (
            "-1",
            r#"standard input, line 3, column y: "-1"; it must be a finite number above 0 and at most 100000"#,
        ),
        (
            "",
            r#"standard input, line 3, column y: ""; it must be a finite number above 0 and at most 100000"#,
        ),
        (
            "inf",
            r#"standard input, line 3, column y: "inf"; it must be a finite number above 0 and at most 100000"#,
        ),
        ("1,1", "standard input, line 3: 5 cells where the header has 4"),
    ];
    for (cell, message) in rows {
        let input = format!("vx,y,alpha,rs\n1,2,1.5,0\n1,{cell},1.5,0\n");
        let output = apex(&["--output", out.to_str().unwrap()], &input);
        assert_eq!(output.status.code(), Some(2));
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(error, format!("sim-host: {message}\n"));
        assert_eq!(std::fs::read_to_string(&out).unwrap(), "precious");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

#[test]
fn rejects_values_out_of_range_with_the_limit() {
    let usual = [
        ("m", "80"),
        ("k", "2e4"),
        ("g", "9.81"),
        ("rho", "0"),
        ("vx", "1"),
        ("y", "2"),
        ("alpha", "1.5"),
        ("rs", "0"),
    ];
    for (column, bad, limit) in [
        ("m", "0", "above 0 and at most 1000000"),
        ("m", "1.1e6", "above 0 and at most 1000000"),
        ("k", "1e300", "above 0 and at most 1000000000"),
        ("g", "1e300", "from 0 to 1000"),
        ("rho", "1e300", "from 0 to 100"),
        ("vx", "-1e308", "from -1000 to 1000"),
        ("y", "1e6", "above 0 and at most 100000"),
        ("alpha", "-6.3", "from -2 pi to 2 pi"),
        ("alpha", "NaN", "from -2 pi to 2 pi"),
        ("rs", "inf", "from 0 to 1000"),
    ] {
        let header = usual.map(|(name, _)| name).join(",");
        let row = usual.map(|(name, value)| if name == column { bad } else { value }).join(",");
        let output = apex(&[], &format!("{header}\n{row}\n"));
        assert_eq!(output.status.code(), Some(2));
        let error = String::from_utf8(output.stderr).unwrap();
        let message =
            format!("line 2, column {column}: {bad:?}; it must be a finite number {limit}\n");
        assert!(error.ends_with(&message), "{error}");
    }
}

#[test]
fn exit_status_is_2_for_misuse_and_1_for_failure() {
    let status = |arguments: &[&str], input| apex(arguments, input).status.code();
    assert_eq!(status(&["--frobnicate"], ""), Some(2));
    assert_eq!(status(&["--input", "/no/such/file"], ""), Some(2));
    assert_eq!(status(&[], "vx,y,alpha\n1,2,1.5\n"), Some(2));
    assert_eq!(status(&[], "vx,vx,y,alpha,rs\n1,1,2,1.5,0\n"), Some(2));
    assert_eq!(status(&[], ""), Some(2));
    let good = "vx,y,alpha,rs\n1,2,1.5,0\n";
    assert_eq!(status(&["--output", "/no/such/folder/out.csv"], good), Some(2));
    assert_eq!(status(&["--output", "/dev/full"], good), Some(1));
    assert_eq!(status(&["--output", "/dev/null"], good), Some(0));
}
