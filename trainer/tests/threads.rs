//! Where the system starts few threads, the results are the same, and where it starts none, a
//! sentence says so.

use std::path::Path;
use std::process::{Command, Output};

/// Stack of a thread, bytes.
const STACK: &str = "1073741824";
/// Address space, KiB, with room for two such stacks, and 300 MiB for all the rest.
const LITTLE: u32 = 2_400_000;
/// Stack of a thread, bytes, for which there is no room in it.
const HUGE_STACK: &str = "8000000000";

fn trainer(line: &str, at: &Path, limit: Option<u32>, variables: &[(&str, &str)]) -> Output {
    let limit = limit.map_or_else(|| "unlimited".to_owned(), |limit| limit.to_string());
    Command::new("sh")
        .args(["-c", &format!("ulimit -v {limit}; exec \"$0\" {line}")])
        .arg(env!("CARGO_BIN_EXE_trainer"))
        .envs(variables.iter().copied())
        .current_dir(at)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

const TRAIN: &str = "train --preset air --episodes 60 --eval-starts 20 --quiet --out p.bin";
const EVAL: &str = "eval --policy p.bin --starts 20";
const COMPARE: &str = "compare p.bin p.bin --starts 100";
const IMPORT: &str = "import --safetensors p.safetensors --out back.bin";
/// At least four threads are tried, however few CPUs there are.
const MANY: [(&str, &str); 2] = [("RAYON_NUM_THREADS", "300"), ("RUST_MIN_STACK", STACK)];
const STUDY: &str = "study --preset air --steps 100 --seeds 0..8 --jobs 8 --eval-starts 1 --out s";

/// Removes the times from the first line of `train`.
fn lasting(output: &Output) -> String {
    let all = text(&output.stdout);
    let (first, rest) = all.split_once('\n').unwrap_or_default();
    let first = first.split(" steps in ").next().unwrap_or_default();
    format!("{first}\n{rest}")
}

#[test]
fn fewer_threads_than_wanted_give_the_same_results() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for line in [TRAIN, EVAL, COMPARE, "export --policy p.bin --to safetensors p.safetensors"] {
        let usual = trainer(line, at, None, &[]);
        assert!(usual.status.success(), "{line}: {}", text(&usual.stderr));
        let little = trainer(line, at, Some(LITTLE), &MANY);
        let error = text(&little.stderr);
        assert!(little.status.success(), "{line}: {error}");
        assert_eq!(lasting(&little), lasting(&usual), "{line}");
        let computes = !line.starts_with("export");
        assert_eq!(error.contains(" threads; raise the limit"), computes, "{error}");
        // Without the limit there are no more than can be of use.
        let many = trainer(line, at, None, &[("RAYON_NUM_THREADS", "1000000")]);
        assert!(many.status.success(), "{line}: {}", text(&many.stderr));
        assert_eq!(lasting(&many), lasting(&usual), "{line}");
        let error = text(&many.stderr);
        assert_eq!(error.contains("instead of 1000000 threads"), computes, "{error}");
    }
    let imported = trainer(IMPORT, at, Some(LITTLE), &MANY);
    assert!(imported.status.success(), "{}", text(&imported.stderr));
}

#[test]
fn a_study_runs_with_fewer_jobs_than_wanted() {
    let folder = tempfile::tempdir().unwrap();
    let output = trainer(STUDY, folder.path(), Some(LITTLE), &[("RUST_MIN_STACK", STACK)]);
    let error = text(&output.stderr);
    assert!(output.status.success(), "{error}");
    assert!(error.contains("instead of 8 jobs can run; raise the limit"), "{error}");
}

#[test]
fn a_sentence_says_that_no_thread_can_be_started() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    assert!(trainer(TRAIN, at, None, &[]).status.success());
    for line in [TRAIN, EVAL, COMPARE, IMPORT, STUDY] {
        let output = trainer(line, at, Some(LITTLE), &[("RUST_MIN_STACK", HUGE_STACK)]);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{line}: {error}");
        assert!(error.starts_with("trainer: no "), "{line}: {error}");
        assert!(error.contains(" can be started"), "{line}: {error}");
        assert!(error.contains("raise the limit of processes and threads"), "{line}: {error}");
        assert_eq!(error.lines().count(), 1, "{line}: {error}");
    }
}
