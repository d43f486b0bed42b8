//! The live view, the real program in a pseudo-terminal, beside real runs.

use std::io::{Read, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::place::{PROGRAM, Place};

const SOON: Duration = Duration::from_secs(30);

/// A `sim-host watch` in a terminal that the tool `script` plays.
struct Watch {
    script: Child,
    keys: Option<ChildStdin>,
    screen: Arc<Mutex<String>>,
}

impl Watch {
    fn begin(place: &Place) -> Self {
        Self::begin_after(place, "")
    }

    /// With some words to the shell that starts it.
    fn begin_after(place: &Place, words: &str) -> Self {
        let folder = place.base();
        let call = format!("stty rows 40 cols 120; {words} exec {PROGRAM} watch --domain test");
        let mut script = Command::new("script")
            .args(["-qec", &call])
            .arg("/dev/null")
            .env("TMPDIR", folder.parent().expect("a folder in a folder"))
            .env("TERM", "xterm-256color")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("`script`, of Debian's package bsdutils");
        let keys = script.stdin.take();
        let mut output = script.stdout.take().expect("asked for");
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

    /// Waits until it draws this word, and forgets all that it has drawn. (Only
    /// what changes is drawn: blanks between words are not.)
    #[track_caller]
    fn wait_for(&self, text: &str) {
        let begun = Instant::now();
        while !self.screen.lock().unwrap().contains(text) {
            assert!(begun.elapsed() < SOON, "`{text}` is not drawn");
            std::thread::sleep(Duration::from_millis(5));
        }
        self.screen.lock().unwrap().clear();
    }

    fn press(&mut self, key: &str) {
        let keys = self.keys.as_mut().expect("open");
        keys.write_all(key.as_bytes()).and_then(|()| keys.flush()).expect("press a key");
    }

    /// Leaves by `q`; the terminal is as it was, and the status 0.
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
    let begun = Instant::now();
    while place.base().exists() {
        assert!(begun.elapsed() < SOON, "who watches keeps the domain");
        std::thread::sleep(Duration::from_millis(5));
    }
    place.assert_clean();
}

#[test]
fn a_run_that_is_watched_is_the_same_run_and_can_be_operated() {
    let place = Place::new();
    let run =
        |duration: &str| place.alone(&["--spawn", "--domain", "test", "--duration", duration]);
    let bare = run("50").end().assert_ok().state_hash();

    let mut watch = Watch::begin(&place);
    watch.wait_for("nobody");
    assert!(!place.base().exists(), "it waits outside of a domain that nobody plays in");
    let watched = run("50");
    watch.wait_for("lock-step");
    assert_eq!(watched.end().assert_ok().state_hash(), bare);
    wait_until_clean(&place);

    // By its keys: another set-point, a pause, the end.
    let endless = run("80000");
    watch.wait_for("lock-step");
    watch.press("\u{1b}[A");
    watch.wait_for("hand");
    watch.press(" ");
    watch.wait_for("PAUSED");
    watch.press("Q");
    let ended = endless.end();
    assert!(ended.assert_ok().out.starts_with("stopped after"), "{}", ended.out);
    wait_until_clean(&place);
    watch.leave();
    place.assert_clean();
}

/// It used to read from a terminal that was gone, for ever, with a core to itself.
#[test]
fn a_closed_terminal_ends_it_also_where_a_hang_up_is_ignored() {
    let place = Place::new();
    let pid_file = place.base().with_extension("pid");
    let mut watch =
        Watch::begin_after(&place, &format!("trap '' HUP; echo $$ > {};", pid_file.display()));
    watch.wait_for("nobody");
    let pid = std::fs::read_to_string(&pid_file).expect("its process");
    watch.script.kill().expect("the terminal");
    let begun = Instant::now();
    // A zombie has no command line.
    let runs =
        || std::fs::read(format!("/proc/{}/cmdline", pid.trim())).is_ok_and(|c| !c.is_empty());
    while runs() {
        assert!(begun.elapsed() < SOON, "process {pid} goes on without a terminal");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn without_a_terminal_or_a_name_it_is_refused() {
    let place = Place::new();
    place.start("watch", &[]).end().assert(2, &["needs a terminal"]);
    place.start("watch", &["--domain", "a/b"]).end().assert(2, &["a/b", "is not a name"]);
}
