//! The files that a training and the other commands write: their names, and places where they
//! cannot be written as usual.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::{Command, Output};

const SHORT: &str = "train --preset air --episodes 300 --eval-starts 0 --quiet";
/// Ends only by a signal.
const LONG: &str = "train --preset air --steps 1000000000 --quiet --checkpoint-every 0.05";

fn trainer(line: &str, at: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trainer"));
    command.args(line.split_whitespace()).current_dir(at).env("TMPDIR", at).output().unwrap()
}

fn error(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn succeeds(line: &str, at: &Path) {
    let output = trainer(line, at);
    assert!(output.status.success(), "{line}: {}", error(&output));
}

/// Runs a command that must fail with a status and one line, which is returned.
fn fails(line: &str, at: &Path, status: i32) -> String {
    let output = trainer(line, at);
    let error = error(&output);
    assert_eq!(output.status.code(), Some(status), "{line}: {error}");
    assert_eq!(error.lines().count(), 1, "{line}: {error}");
    error
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> =
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Runs a training until a checkpoint has rows, and kills it.
fn interrupt(line: &str, checkpoint: &str, at: &Path) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trainer"));
    let mut child = command.args(line.split_whitespace()).current_dir(at).spawn().unwrap();
    let inode = || fs::metadata(at.join(checkpoint)).map_or(0, |m| m.ino());
    let (mut last, mut seen) = (inode(), 0);
    // The first checkpoint is that of step 0.
    while seen < 3 {
        assert!(child.try_wait().unwrap().is_none(), "it has ended");
        std::thread::sleep(std::time::Duration::from_millis(2));
        seen += usize::from(inode() != last);
        last = inode();
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn policies_with_dots_in_their_names_have_logs_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for (out, seed) in [("w-lr0.1", 1), ("w-lr0.2", 2), ("policy.v1", 3), ("policy.bin", 4)] {
        succeeds(&format!("{SHORT} --out {out} --seed {seed}"), at);
    }
    let logs = ["w-lr0.1.csv", "w-lr0.2.csv", "policy.v1.csv", "policy.csv"];
    let contents = logs.map(|log| fs::read(at.join(log)).unwrap());
    assert_eq!(names(at).len(), 8);
    // The one name that would share a log is refused before any work.
    let message = fails(&format!("{SHORT} --out policy --seed 5"), at, 2);
    assert!(message.contains("its log would be policy.csv, which is that of policy.bin"));
    assert!(logs.map(|log| fs::read(at.join(log)).unwrap()) == contents);
    succeeds(&format!("{SHORT} --out policy --seed 5 --log other.csv"), at);

    // The curves have names of their own, too.
    let output = trainer("plot w-lr0.1 w-lr0.2 policy.v1 --out curves.svg", at);
    let table = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(output.status.success(), "{}", error(&output));
    for name in ["w-lr0.1 ", "w-lr0.2 ", "policy.v1 "] {
        assert!(table.lines().any(|line| line.starts_with(name)), "{name}: {table}");
    }
}

#[test]
fn the_rows_of_an_interrupted_training_are_not_taken_by_another() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    interrupt(&format!("{LONG} --out a.bin --log l.csv"), "a.bin.checkpoint", at);
    let rows = fs::read(at.join("l.csv.part")).unwrap();
    assert!(!rows.is_empty());
    for more in ["", " --restart"] {
        let message = fails(&format!("{SHORT} --out b.bin --log l.csv{more}"), at, 2);
        assert!(message.contains("l.csv.part: these are the rows of another training"));
        assert!(message.contains("a.bin.checkpoint continues; resume that training first"));
    }
    assert!(fs::read(at.join("l.csv.part")).unwrap() == rows);
    // Rows without a checkpoint are discarded on demand only.
    fs::remove_file(at.join("a.bin.checkpoint")).unwrap();
    let message = fails(&format!("{SHORT} --out b.bin --log l.csv"), at, 2);
    assert!(message.contains("left no checkpoint; name another log with --log; --restart"));
    succeeds(&format!("{SHORT} --out b.bin --log l.csv --restart"), at);
    assert_eq!(names(at), ["b.bin", "l.csv"]);
}

#[test]
fn the_limit_of_file_sizes_is_reported_and_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let limited = |line: &str| {
        let script = format!("ulimit -f 20; exec \"$0\" {line}");
        let mut command = Command::new("sh");
        command.args(["-c", &script]).arg(env!("CARGO_BIN_EXE_trainer")).current_dir(at);
        let output = command.output().unwrap();
        let error = error(&output);
        assert_eq!(output.status.code(), Some(1), "{line}: {error}");
        assert!(error.contains("File too large (os error 27)"), "{line}: {error}");
        assert!(error.contains("raise the limit of file sizes (ulimit -f)"), "{line}: {error}");
    };
    let begin = "train --preset air --steps 3000 --eval-starts 0 --quiet";
    limited(&format!("{begin} --out p.bin"));
    assert!(names(at).iter().all(|name| !name.ends_with("checkpoint.part")), "{:?}", names(at));
    limited("study --preset air --steps 3000 --eval-starts 1 --seeds 0..1 --out s");
    assert_eq!(names(&at.join("s/seeds/0000")), [""; 0]);
    // The policy of a complete training is written; what it prints has no room.
    succeeds(&format!("{begin} --out p.bin --restart"), at);
    fs::write(at.join("full"), vec![0; 20 * 512]).unwrap();
    limited("inspect p.bin >> full");
}

fn mount(arguments: &[&str], at: &Path) {
    let status = Command::new("mount").args(arguments).current_dir(at).status().unwrap();
    assert!(status.success(), "{arguments:?}");
}

#[test]
fn writes_to_mounted_files_and_refuses_read_only_ones_before_the_work() {
    if !requirements::in_mount_namespace(
        "writes_to_mounted_files_and_refuses_read_only_ones_before_the_work",
    ) {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    succeeds(&format!("{SHORT} --out usual.bin"), at);
    succeeds("export --policy usual.bin --to safetensors usual.safetensors", at);
    fs::create_dir(at.join("volume")).unwrap();
    for name in ["p.bin", "p.csv", "file"] {
        fs::write(at.join("volume").join(name), "old").unwrap();
        fs::write(at.join(name), "").unwrap();
        mount(&["--bind", &format!("volume/{name}"), name], at);
    }
    let read = |name: &str| fs::read(at.join(name)).unwrap();
    succeeds(&format!("{SHORT} --out p.bin"), at);
    assert!(read("volume/p.bin") == read("usual.bin"));
    assert!(read("volume/p.csv") == read("usual.csv"));
    fs::write(at.join("o.csv"), "vx,y,rho\n0,2,0\n").unwrap();
    let others = [
        "export --policy usual.bin --to onnx file",
        "export --policy usual.bin --to c file",
        "plot usual.csv --out file",
        "infer --policy usual.bin --input o.csv --output file",
        "import --safetensors usual.safetensors --out file",
    ];
    let mut before = read("volume/file");
    for line in others {
        succeeds(line, at);
        assert!(read("volume/file") != before, "{line}");
        before = read("volume/file");
    }
    let left = names(at);
    for name in ["p.bin", "p.csv", "file"] {
        mount(&["-o", "remount,ro,bind", name], at);
    }
    let refused = |line: &str, name: &str| {
        let message = fails(line, at, 1);
        let expected = format!("trainer: {name}: cannot be written: Read-only file system");
        assert!(message.starts_with(&expected), "{line}: {message}");
        assert_eq!(names(at), left, "{line}");
    };
    refused(&format!("{LONG} --out p.bin --log l.csv"), "p.bin");
    refused(&format!("{LONG} --out q.bin --log p.csv"), "p.csv");
    for line in others {
        refused(line, "file");
    }
}

#[test]
fn a_result_that_cannot_be_written_at_the_end_is_saved_elsewhere() {
    let test = "a_result_that_cannot_be_written_at_the_end_is_saved_elsewhere";
    if !requirements::in_mount_namespace(test) {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    succeeds(&format!("{SHORT} --out usual.bin"), at);
    fs::create_dir(at.join("disk")).unwrap();
    mount(&["-t", "tmpfs", "-o", "size=8k", "tmpfs", "disk"], at);
    let line = format!("{SHORT} --out disk/p.bin --log l.csv --checkpoint-every 0");
    let message = fails(&line, at, 1);
    assert!(message.contains("disk/p.bin: cannot be written: No space left"), "{message}");
    let saved = names(at).into_iter().find(|name| name.ends_with("-p.bin")).expect(&message);
    assert!(message.contains(&format!("{saved} instead")), "{message}");
    assert!(fs::read(at.join(&saved)).unwrap() == fs::read(at.join("usual.bin")).unwrap());
    assert_eq!(names(&at.join("disk")), [""; 0]);
}

#[test]
fn a_path_that_cannot_be_that_of_a_file_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    succeeds(&format!("{SHORT} --out p.bin"), at);
    succeeds("export --policy p.bin --to safetensors a.safetensors", at);
    fs::create_dir(at.join("folder")).unwrap();
    let before = names(at);
    let long = "x".repeat(300);
    for line in [
        &format!("{SHORT} --out none/q.bin"),
        &format!("{SHORT} --out p.bin/q.bin"),
        &format!("{SHORT} --out folder"),
        &format!("{SHORT} --out {long}"),
        &format!("{SHORT} --out q.bin --log none/q.csv"),
        &format!("{SHORT} --out q.bin --tensorboard p.bin/board"),
        "study --preset air --steps 100 --seeds 0..1 --out p.bin/study",
        "plot p.csv --out none/curves.svg",
        "export --policy p.bin --to safetensors none/q.safetensors",
        "import --safetensors a.safetensors --out none/q.bin",
    ] {
        fails(line, at, 2);
    }
    assert_eq!(names(at), before, "nothing is written");
    // A system that refuses a good path is a failure.
    let full = format!("{SHORT} --out /dev/full --log q.csv --checkpoint-every 0");
    assert!(fails(&full, at, 1).contains("No space left on device"));
}

#[test]
fn a_finished_training_is_replaced_by_itself_only() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let line = format!("{SHORT} --out p.bin --seed 1");
    succeeds(&line, at);
    let files = || ["p.bin", "p.csv"].map(|name| fs::read(at.join(name)).unwrap());
    let first = files();
    // The same again gives the same files.
    succeeds(&line, at);
    assert!(files() == first);
    let other = format!("{SHORT} --out p.bin --seed 2");
    for (more, what) in [
        ("", "its seed is 1, not 2"),
        (" --resume", "its seed is 1, not 2"),
        (" --seed 1 --set learning.batch=64", "learning.batch is 32 in one and 64"),
    ] {
        let line = if more.contains("--seed") {
            format!("{SHORT} --out p.bin{more}")
        } else {
            format!("{other}{more}")
        };
        let message = fails(&line, at, 2);
        assert!(message.contains("--out p.bin: this is another policy"), "{message}");
        assert!(message.contains(what), "{message}");
        assert!(message.contains("name another file with --out, or replace it with --restart"));
    }
    assert!(files() == first);
    // There is nothing to resume, and nothing is trained again.
    for line in ["train --resume --out p.bin", &format!("{line} --resume")] {
        let output = trainer(line, at);
        assert!(output.status.success(), "{line}: {}", error(&output));
        let out = String::from_utf8(output.stdout).unwrap();
        assert_eq!(out, "p.bin: this training is complete, nothing is left to resume\n");
    }
    assert!(files() == first);
    succeeds(&format!("{other} --restart"), at);
    assert!(files() != first);
    assert_eq!(names(at), ["p.bin", "p.csv"]);
    // What is no policy is an output like any other.
    fs::write(at.join("q.bin"), "a note").unwrap();
    succeeds(&format!("{SHORT} --out q.bin"), at);
}

#[test]
fn an_output_never_replaces_an_input() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    succeeds(&format!("{SHORT} --out policy.bin"), at);
    succeeds("export --policy policy.bin --to safetensors actor.st", at);
    let config = trainer("config show --preset air", at).stdout;
    fs::write(at.join("air.toml"), config).unwrap();
    fs::write(at.join("obs.csv"), "vx,y,rho\n0,1.5,0\n").unwrap();
    let inputs = ["policy.bin", "policy.csv", "actor.st", "air.toml", "obs.csv"];
    let contents = || inputs.map(|name| fs::read(at.join(name)).unwrap());
    let (before, names_before) = (contents(), names(at));
    for (line, file) in [
        ("infer --policy policy.bin --input obs.csv --output ", "obs.csv"),
        ("infer --policy policy.bin --input obs.csv --output ", "policy.bin"),
        ("export --policy policy.bin --to safetensors ", "policy.bin"),
        ("import --safetensors actor.st --out ", "actor.st"),
        ("plot policy.bin --out ", "policy.csv"),
        ("plot a=policy.bin --out ", "policy.bin"),
        ("train --config air.toml --out ", "air.toml"),
        ("train --config air.toml --out new.bin --log ", "air.toml"),
    ] {
        let error = fails(&format!("{line}{file}"), at, 2);
        assert!(error.contains(&format!("{file}: cannot be written: it is the same")), "{error}");
    }
    assert!(contents() == before);
    assert_eq!(names(at), names_before);
}
