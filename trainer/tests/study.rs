//! Studies from the user's side: interrupted, sharded and merged, with the same result to the
//! last bit.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const SHORT: &str = "study --preset air --steps 900 --eval-starts 20 --seeds 0..4";

fn command(line: &str, directory: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trainer"));
    command.args(line.split(' ')).current_dir(directory);
    for name in ["SLURM_ARRAY_TASK_ID", "JOB_COMPLETION_INDEX"] {
        command.env_remove(name);
    }
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn run(line: &str, directory: &Path) -> String {
    let output = command(line, directory).output().unwrap();
    assert!(output.status.success(), "{line}: {}", text(&output.stderr));
    text(&output.stdout)
}

fn refused(output: &Output) -> String {
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    error
}

/// Reads every file below a folder, by its path from there.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    fn gather(root: &Path, folder: &Path, all: &mut BTreeMap<String, Vec<u8>>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                gather(root, &path, all);
            } else {
                let name = path.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
                all.insert(name, fs::read(&path).unwrap());
            }
        }
    }
    let mut all = BTreeMap::new();
    gather(folder, folder, &mut all);
    all
}

fn assert_same(a: &Path, b: &Path) {
    let (a, b) = (files(a), files(b));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    for (name, content) in &a {
        assert!(b[name] == *content, "{name} differs");
    }
}

#[test]
fn a_study_has_the_same_files_whole_killed_or_sharded() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let table = run(&format!("{SHORT} --out whole --jobs 2"), at);
    for message in ["air: seeds 0..4", "Worst seed: ", "still hopping", "whole: summary.csv"] {
        assert!(table.contains(message), "{message} is not in {table}");
    }
    let whole = files(&at.join("whole"));
    assert_eq!(whole.len(), 4 + 4 * 3, "{:?}", whole.keys());
    // A seed's policy is the same as that of `trainer train`.
    run("train --preset air --steps 900 --seed 3 --out p.bin --log l.csv --eval-starts 0", at);
    assert!(whole["seeds/0003/policy.bin"] == fs::read(at.join("p.bin")).unwrap());
    assert!(whole["seeds/0003/learning.csv"] == fs::read(at.join("l.csv")).unwrap());

    // Nothing is trained again.
    let modified = || fs::metadata(at.join("whole/seeds/0000/report.json")).unwrap().modified();
    let before = modified().unwrap();
    assert_eq!(run(&format!("{SHORT} --out whole"), at), table);
    assert_eq!(modified().unwrap(), before);

    killed(at);
    assert_same(&at.join("whole"), &at.join("killed"));
    shards(at, &table);
}

/// Kills a study after its first seed, and continues it. Until then the test holds the locks of
/// the other seeds, as other processes do that train them.
fn killed(at: &Path) {
    let line = format!("{SHORT} --out killed");
    let locks = ["0001", "0002", "0003"].map(|seed| {
        let folder = at.join("killed/seeds").join(seed);
        fs::create_dir_all(&folder).unwrap();
        let lock = fs::File::open(folder).unwrap();
        lock.try_lock().unwrap();
        lock
    });
    let mut child = command(&line, at).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let first = at.join("killed/seeds/0000/report.json");
    let began = Instant::now();
    while !first.exists() {
        assert!(began.elapsed() < Duration::from_mins(2), "no seed is done");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    drop(locks);
    assert!(!at.join("killed/summary.csv").exists());
    // Simulates a kill during a write.
    fs::write(at.join("killed/seeds/0003/.tmpAbCdEf"), "half").unwrap();
    let output = command(&line, at).output().unwrap();
    assert!(output.status.success());
    assert!(text(&output.stderr).contains("1 of 4 seeds are already complete"));
}

fn shards(at: &Path, table: &str) {
    let slurm = |id: &str| {
        command(&format!("{SHORT} --out part{id} --shard auto"), at)
            .envs([("SLURM_ARRAY_TASK_ID", id), ("SLURM_ARRAY_TASK_COUNT", "2")])
            .envs([("SLURM_ARRAY_TASK_MIN", "0"), ("SLURM_ARRAY_TASK_MAX", "1")])
            .output()
            .unwrap()
    };
    let output = slurm("0");
    assert!(output.status.success(), "{}", text(&output.stderr));
    let message = text(&output.stdout);
    assert!(
        message.contains("Shard 1/2 is done: 2 seeds") && message.contains("(1, 3)"),
        "{message}"
    );
    let merge = |line: &str| command(line, at).output().unwrap();
    let error = refused(&merge("study merge part0 --out joined"));
    assert!(error.contains("of the study's 4 seeds these are missing: 1, 3;"), "{error}");
    assert!(!at.join("joined").exists());
    assert!(slurm("1").status.success());
    let joined = run("study merge part0 part1 --out joined", at);
    assert_eq!(joined.replace("joined: ", "whole: "), table);
    assert_same(&at.join("whole"), &at.join("joined"));

    // A seed in two folders is reported, and must have the same files.
    let twice = merge("study merge part0 part1 joined --out joined");
    assert!(
        text(&twice.stderr).contains("with the same results: 0, 1, 2, 3."),
        "{}",
        text(&twice.stderr)
    );
    assert_same(&at.join("whole"), &at.join("joined"));
    fs::write(at.join("part1/seeds/0001/policy.bin"), "other").unwrap();
    let error = refused(&merge("study merge joined part1 --out again"));
    assert!(error.contains("seed 1 is in joined and in part1"), "{error}");
    assert!(!at.join("again").exists());

    // Kubernetes, with all pods in one folder: the last pod finds all seeds.
    for pod in ["1", "0"] {
        let line = format!("{SHORT} --out shared --shard auto/2");
        let output = command(&line, at).env("JOB_COMPLETION_INDEX", pod).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
    assert_same(&at.join("whole"), &at.join("shared"));
}

#[test]
fn input_errors_name_the_cause_with_status_2() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let short = "study --preset air --steps 50 --eval-starts 1";
    run(&format!("{short} --seeds 0..1 --out s"), at);
    fs::create_dir(at.join("empty")).unwrap();
    for (line, message) in [
        ("study", "--seeds"),
        ("study --seeds 0..4 --out n", "give --preset NAME or --config FILE"),
        ("study --preset air --seeds 0..0 --out n", "0..0 holds no seed"),
        ("study --preset air --seeds 4 --out n", "'4' is not FIRST..END"),
        ("study --preset air --seeds 0..4 --out n --jobs 0", "--jobs"),
        ("study --preset air --seeds 0..4 --out n --shard 0/4", "from 1, so that they are 1/4"),
        ("study --preset air --seeds 0..4 --out n --shard auto", "neither SLURM_ARRAY_TASK_ID"),
        (
            "study --preset air --steps 51 --eval-starts 1 --seeds 0..1 --out s",
            "s: holds another study: config.stages[0].length.steps is 50 there, but 51 here",
        ),
        (
            "study --preset air --steps 50 --eval-starts 2 --seeds 0..1 --out s",
            "eval_starts is 1 there, but 2 here",
        ),
        ("study merge empty --out n", "empty/study.toml: is not there: no study was begun here"),
        ("study merge --out n", "FOLDERS"),
    ] {
        let error = refused(&command(line, at).output().unwrap());
        assert!(error.contains(message), "{line}: {error}");
    }
    assert!(!at.join("n").exists());
    // A merge refuses another study, and a seed of another study.
    run(&format!("{short} --seeds 0..2 --out t"), at);
    let error = refused(&command("study merge s t --out n", at).output().unwrap());
    assert!(error.contains("t: holds another study: seeds is"), "{error}");
    fs::copy(at.join("t/seeds/0001/report.json"), at.join("t/seeds/0000/report.json")).unwrap();
    let error = refused(&command("study merge t --out n", at).output().unwrap());
    assert!(error.contains("t/seeds/0000/report.json: seed is 1, not this study's 0"), "{error}");
}

#[test]
fn workers_on_one_folder_share_the_seeds() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let line = "study --preset air --steps 300 --eval-starts 20 --seeds 0..6 --out";
    let table = run(&format!("{line} whole"), at);
    let worker = || {
        let mut command = command(&format!("{line} shared"), at);
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let workers: Vec<_> = (0..4).map(|_| worker()).collect();
    let outputs = workers.into_iter().map(|worker| worker.wait_with_output().unwrap());
    let mut trained = 0;
    for output in outputs {
        let error = text(&output.stderr);
        assert!(output.status.success(), "{error}");
        assert_eq!(text(&output.stdout).replace("shared: ", "whole: "), table);
        trained += error.matches(": survive30 ").count();
    }
    assert_eq!(trained, 6, "each seed is trained once");
    assert_same(&at.join("whole"), &at.join("shared"));
}

/// As where the job's log is on a full disk.
#[test]
fn messages_that_cannot_be_written_do_not_end_a_study() {
    let directory = tempfile::tempdir().unwrap();
    let full = fs::File::options().write(true).open("/dev/full").unwrap();
    let line = "study --preset air --steps 300 --eval-starts 20 --seeds 0..2 --out s";
    let output = command(line, directory.path()).stderr(full).output().unwrap();
    assert!(output.status.success());
    assert!(directory.path().join("s/seeds/0001/report.json").exists());
}

/// The test holds a seed's lock as a worker does that trains it, and drops it as one that is
/// killed.
#[test]
fn a_worker_waits_for_the_seed_of_another_and_takes_it_over() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let line = "study --preset air --steps 300 --eval-starts 20 --seeds 0..2 --out s";
    fs::create_dir_all(at.join("s/seeds/0000")).unwrap();
    let lock = fs::File::open(at.join("s/seeds/0000")).unwrap();
    lock.try_lock().unwrap();
    fs::write(at.join("s/seeds/0000/.tmp1-0"), "half").unwrap();
    let mut command_line = command(line, at);
    let mut worker = command_line.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(worker.stderr.take().unwrap()).lines();
    let mut seen = Vec::new();
    while !seen.iter().any(|line: &String| line.contains("waiting for other processes")) {
        seen.push(lines.next().expect("it waits").unwrap());
    }
    assert!(seen.iter().any(|line| line.starts_with("seed 1: survive30")), "{seen:?}");
    assert!(at.join("s/seeds/0000/.tmp1-0").exists(), "a temporary file of the living");
    // Another process may not merge into that folder, either.
    run("study --preset air --steps 300 --eval-starts 20 --seeds 0..2 --out t", at);
    let output = command("study merge t --out s", at).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("s: another process trains seed 0"));
    drop(lock);
    assert!(worker.wait().unwrap().success());
    assert_same(&at.join("s"), &at.join("t"));
}

/// `figures` and `kept_steps` are `metrics` and `best_steps` since the names were revised.
#[test]
fn continues_and_merges_a_folder_with_the_former_names() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let line = "study --preset air --steps 300 --eval-starts 20 --seeds 0..2 --out";
    let table = run(&format!("{line} new"), at);
    run(&format!("{line} old"), at);
    for seed in ["0000", "0001"] {
        let report = at.join("old/seeds").join(seed).join("report.json");
        let json = fs::read_to_string(&report).unwrap();
        let former = json.replace("\"metrics\"", "\"figures\"");
        let former = former.replace("\"best_steps\"", "\"kept_steps\"");
        assert_ne!(json, former);
        fs::write(&report, former.replace("\"conditions\"", "\"elsewhere\"")).unwrap();
    }
    let output = command(&format!("{line} old"), at).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("2 of 2 seeds are already complete"));
    assert_eq!(text(&output.stdout).replace("old: ", "new: "), table);
    let output = command("study merge old new --out joined", at).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(text(&output.stdout).replace("joined: ", "new: "), table);
}

#[test]
fn a_signal_stops_a_study_between_files() {
    for signal in ["-INT", "-USR1", "-USR2", "-XCPU"] {
        is_stopped_by(signal);
    }
}

fn is_stopped_by(signal: &str) {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let line = "study --preset air --steps 1000000000 --seeds 0..2 --out s";
    let child = command(line, at).stderr(Stdio::piped()).spawn().unwrap();
    let began = Instant::now();
    // The signal handlers are installed before the folder is created.
    while !at.join("s/study.toml").exists() {
        assert!(began.elapsed() < Duration::from_mins(1), "no folder");
        std::thread::sleep(Duration::from_millis(2));
    }
    let kill = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let output = child.wait_with_output().unwrap();
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.contains("stopped by a signal after 0 of 2 seeds"), "{signal}: {error}");
    assert_eq!(files(&at.join("s")).keys().collect::<Vec<_>>(), ["study.toml"]);
}
