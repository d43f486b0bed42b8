//! The live view: the real program in a pseudo-terminal beside real runs.

use std::io::{Read, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::place::{PROGRAM, Place};

const SOON: Duration = Duration::from_secs(30);

/// A `sim-host watch` in a pseudo-terminal of the tool `script`.
struct Watch {
    script: Child,
    keys: Option<ChildStdin>,
    screen: Arc<Mutex<String>>,
}

impl Watch {
    fn begin(place: &Place) -> Self {
        Self::begin_after(place, "")
    }

    /// Runs shell commands before the program starts.
    fn begin_after(place: &Place, commands: &str) -> Self {
        let domain = place.domain();
        let call =
            format!("stty rows 40 cols 120; {commands} exec {PROGRAM} watch --domain {domain}");
        let mut script = Command::new("script")
            .args(["-qec", &call])
            .arg("/dev/null")
            .env("TERM", "xterm-256color")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("`script`, of Debian's package bsdutils");
        let keys = script.stdin.take();
        let mut output = script.stdout.take().expect("piped");
        let screen = Arc::new(Mutex::new(String::new()));
        let seen = Arc::clone(&screen);
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(n @ 1..) = output.read(&mut bytes) {
                seen.lock().unwrap().push_str(&String::from_utf8_lossy(&bytes[..n]));
            }
        });
        Self { script, keys, screen }
    }

    /// Waits until the program draws this word, then clears the screen's text. Only
    /// changed cells are drawn, so the text has no blanks between words.
    #[track_caller]
    fn wait_for(&self, text: &str) {
        let start = Instant::now();
        while !self.screen.lock().unwrap().contains(text) {
            assert!(start.elapsed() < SOON, "`{text}` is not drawn");
            std::thread::sleep(Duration::from_millis(5));
        }
        self.screen.lock().unwrap().clear();
    }

    fn press(&mut self, key: &str) {
        let keys = self.keys.as_mut().expect("open");
        keys.write_all(key.as_bytes()).and_then(|()| keys.flush()).expect("press a key");
    }

    /// Leaves by `q`, and asserts a restored terminal and status 0.
    #[track_caller]
    fn leave(mut self) {
        self.press("q");
        self.wait_for("\u{1b}[?1049l");
        assert!(self.script.wait().expect("wait").success());
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.script.kill();
        let _ = self.script.wait();
    }
}

#[track_caller]
fn wait_until_clean(place: &Place) {
    let start = Instant::now();
    while place.root().exists() {
        assert!(start.elapsed() < SOON, "the view keeps the domain alive");
        std::thread::sleep(Duration::from_millis(5));
    }
    place.assert_clean();
}

#[test]
fn watching_does_not_change_a_run_and_can_operate_it() {
    let place = Place::new();
    let run = |duration: &str| {
        place.alone(&["--spawn", "--domain", place.domain(), "--duration", duration])
    };
    let bare = run("50").end().assert_ok().state_hash();

    let mut watch = Watch::begin(&place);
    watch.wait_for("waiting");
    assert!(!place.root().exists(), "it does not create a domain without processes");
    let watched = run("50");
    watch.wait_for("lock-step");
    assert_eq!(watched.end().assert_ok().state_hash(), bare);
    wait_until_clean(&place);

    // By its keys: another set-point, a pause, the end.
    let endless = run("80000");
    watch.wait_for("lock-step");
    watch.press("\u{1b}[A");
    watch.wait_for("key");
    watch.press(" ");
    watch.wait_for("PAUSED");
    watch.press("Q");
    let ended = endless.end();
    assert!(ended.assert_ok().out.starts_with("stopped after"), "{}", ended.out);
    wait_until_clean(&place);
    watch.leave();
    place.assert_clean();
}

/// Regression: the view read from a closed terminal for ever and used a whole core.
#[test]
fn a_closed_terminal_ends_the_view_even_if_sighup_is_ignored() {
    let place = Place::new();
    let pid_file = place.file("pid");
    let mut watch =
        Watch::begin_after(&place, &format!("trap '' HUP; echo $$ > {};", pid_file.display()));
    watch.wait_for("waiting");
    let pid = std::fs::read_to_string(&pid_file).expect("its process");
    watch.script.kill().expect("the terminal");
    let start = Instant::now();
    // A zombie has no command line.
    let runs =
        || std::fs::read(format!("/proc/{}/cmdline", pid.trim())).is_ok_and(|c| !c.is_empty());
    while runs() {
        assert!(start.elapsed() < SOON, "process {pid} continues without a terminal");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn rejects_a_missing_terminal_and_an_invalid_name() {
    let place = Place::new();
    place.start("watch", &[]).end().assert(2, &["needs a terminal"]);
    place
        .start("watch", &["--domain", "a/b"])
        .end()
        .assert(2, &["a/b", "is not a valid domain name"]);
}
