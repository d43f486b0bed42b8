//! `trainer eval` and `trainer compare` in randomised worlds.

use std::path::Path;
use std::process::{Command, Output};
use trainer::config::{Distribution, Parameter, Randomisation};
use trainer::evaluate::randomised::{Subject, rollouts, table};
use trainer::evaluate::survival::draw_starts;

use leg_control::policy::{Policy, SHIPPED};
use rand::SeedableRng;
use rand_pcg::Pcg64;

const WORLDS: &str = r#"
[randomisation]
share = 0.5
mass = { kind = "uniform", low = 0.8, high = 1.2 }
friction = { kind = "uniform", low = 0.05, high = 0.1 }
"#;

fn trainer(line: &str, folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(line.split(' '))
        .current_dir(folder)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn uniform(low: f64, high: f64) -> Distribution {
    Distribution::Uniform { low, high }
}

#[test]
fn each_quantity_alone_and_all_together_have_a_row() {
    let policy = Policy::parse(SHIPPED).unwrap();
    let randomisation = Randomisation { share: 0.0, ..Randomisation::default() }
        .with(Parameter::Mass, uniform(0.9, 1.1))
        .with(Parameter::Friction, uniform(0.05, 0.1));
    let rows = table(policy.actor(), &randomisation, 60, 1);
    let subjects: Vec<Subject> = rows.iter().map(|row| row.subject).collect();
    let one = Subject::One;
    let expected =
        [Subject::Nothing, one(Parameter::Mass), one(Parameter::Friction), Subject::Everything];
    assert_eq!(subjects, expected);
    // On such ground nothing but an upright leg holds, whatever the share is.
    let on_land = |row: usize| rows[row].survival[0].1.survive30;
    assert!(on_land(0) > 0.95 && on_land(2) < 0.3 && on_land(3) < 0.3, "{rows:?}");
    // A quantity has the same values in every row, so a mass of 1 is nothing.
    let neutral = Randomisation::default().with(Parameter::Mass, uniform(1.0, 1.0));
    let neutral = table(policy.actor(), &neutral, 60, 1);
    assert_eq!(neutral[0].survival, neutral[1].survival);
    assert_eq!(neutral[0].survival, rows[0].survival);
}

#[test]
fn the_worlds_of_an_evaluation_do_not_depend_on_the_number_of_threads() {
    let policy = Policy::parse(SHIPPED).unwrap();
    let randomisation = Randomisation::default()
        .with(Parameter::Mass, uniform(0.8, 1.2))
        .with(Parameter::NoiseVx, uniform(-0.2, 0.2));
    let starts = draw_starts(100, &mut Pcg64::seed_from_u64(1));
    let run = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| rollouts(policy.actor(), &randomisation, 0.3, &starts, seed))
    };
    assert_eq!(run(1, 1), run(2, 1));
    assert!(run(1, 1) != run(1, 2));
}

#[test]
fn evaluates_and_compares_in_the_worlds_of_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| trainer(line, folder.path());
    let good = |line: &str| {
        let output = run(line);
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout)
    };
    std::fs::write(folder.path().join("worlds.toml"), WORLDS).unwrap();
    std::fs::write(folder.path().join("p.bin"), SHIPPED).unwrap();
    let plain = good("eval --policy p.bin --starts 20");
    let table = good("eval --policy p.bin --starts 20 --randomisation worlds.toml");
    assert!(!plain.contains("randomised"), "{plain}");
    for line in ["Survive30 in randomised worlds, from 20 starts", "\nmass ", "\nall together "] {
        assert!(table.contains(line), "{line}\n{table}");
    }
    let json = good("eval --policy p.bin --starts 20 --json --randomisation worlds.toml");
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["randomised"].as_array().unwrap().len(), 4);
    assert_eq!(json["randomised"][2]["randomised"], "friction");
    assert!(json["randomised"][2]["survive30"]["0"].as_f64().unwrap() < 0.5);

    let same = good("compare p.bin p.bin --starts 100 --randomisation worlds.toml");
    assert!(same.contains("the same for both: mass, friction."), "{same}");
    assert!(same.contains("no significant difference in 24."), "{same}");

    for command in ["eval --policy p.bin", "compare p.bin p.bin"] {
        let output = run(&format!("{command} --randomisation none.toml"));
        assert_eq!(output.status.code(), Some(2));
        assert!(text(&output.stderr).contains("none.toml"), "{}", text(&output.stderr));
    }
}
