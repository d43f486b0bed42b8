//! The live view: the real program in a pseudo-terminal beside real runs.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::place::{PROGRAM, Place, wait_until};

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
        self.wait_for_any(&[text]);
    }

    /// Waits until one of these words is drawn: a word of which a part stood in its place
    /// before is not drawn in one piece.
    #[track_caller]
    fn wait_for_any(&self, words: &[&str]) {
        wait_until(|| {
            let mut screen = self.screen.lock().unwrap();
            if !words.iter().any(|word| screen.contains(word)) {
                let last: String = screen.chars().rev().take(2000).collect();
                let last: String = last.chars().rev().collect();
                return Err(format!("{words:?} is not drawn; the last that was: {last:?}"));
            }
            screen.clear();
            Ok(())
        });
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

/// Runs until a key ends it, so that there is no moment that the view could come too late for.
const ENDLESS: [&str; 3] = ["--spawn", "--duration", "80000"];

#[test]
fn watching_does_not_change_a_run_and_can_operate_it() {
    let place = Place::new();
    let run = |set_point: &str| {
        let own = ["--domain", place.domain(), "--set-point", set_point];
        place.alone(&[&ENDLESS[..], &own].concat())
    };
    let wait_until_clean = || {
        wait_until(|| {
            let left = place.root().exists();
            if left { Err("the view keeps the domain alive".to_owned()) } else { Ok(()) }
        });
        place.assert_clean();
    };

    let mut watch = Watch::begin(&place);
    watch.wait_for("waiting");
    assert!(!place.root().exists(), "it does not create a domain without processes");
    let watched = run("0.25");
    watch.wait_for_any(&["height", "+0.25"]);
    watch.press("Q");
    let watched = watched.end();
    let bare = place.alone_for(watched.ticks(), &["--set-point", "0.25"]);
    assert_eq!(watched.assert_ok().state_hash(), bare.state_hash());
    wait_until_clean();
    // After a run all is drawn anew.
    watch.wait_for("waiting");

    // The next run, by its keys: another set-point, a pause, the end.
    let endless = run("0.75");
    watch.wait_for_any(&["height", "+0.75"]);
    watch.press("\u{1b}[A");
    watch.wait_for("key");
    watch.press(" ");
    watch.wait_for("PAUSED");
    watch.press("Q");
    let ended = endless.end();
    assert!(ended.assert_ok().out.starts_with("stopped after"), "{}", ended.out);
    wait_until_clean();
    watch.leave();
    place.assert_clean();
}

/// Regression: the controller that a run had started took a pause for the silence of a stopped
/// leg, and ended.
#[test]
fn a_pause_longer_than_the_timeout_keeps_the_controller_that_was_started() {
    let place = Place::new();
    let own = ["--spawn", "--domain", place.domain(), "--timeout", "1"];
    let run = place.alone(&[&["--duration", "80000"], &own[..]].concat());
    place.wait_for_the_run(None);
    let ask = |request: &str| {
        let mut socket = UnixStream::connect(place.root().join("leg.sock")).expect("a leg");
        writeln!(socket, "{{\"request\":\"{request}\"}}").unwrap();
        let mut answer = String::new();
        BufReader::new(socket).read_line(&mut answer).unwrap();
        assert!(answer.starts_with("{\"Ok\""), "{answer}");
    };
    ask("pause");
    std::thread::sleep(Duration::from_millis(2500));
    ask("quit");
    let run = run.end();
    assert!(run.assert_ok().out.starts_with("stopped after"), "{}", run.out);
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
    // A zombie has no command line.
    let runs =
        || std::fs::read(format!("/proc/{}/cmdline", pid.trim())).is_ok_and(|c| !c.is_empty());
    wait_until(|| {
        if runs() { Err(format!("process {pid} continues without a terminal")) } else { Ok(()) }
    });
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

#[test]
fn refuses_a_terminal_that_prints_line_by_line() {
    let place = Place::new();
    for term in ["dumb", "unknown"] {
        let mut watch = Watch::begin_after(&place, &format!("export TERM={term};"));
        watch.wait_for(&format!("the terminal `{term}` (TERM) cannot; use another"));
        assert_eq!(watch.script.wait().expect("wait").code(), Some(2));
        assert!(!watch.screen.lock().unwrap().contains('\u{1b}'), "nothing is drawn");
    }
}
