//! `trainer env`, the environment for other programs, and its bridge to Python.

use std::io::Write;
use std::process::{Command, Stdio};

/// Runs `trainer env`; returns its output, its errors and its exit status.
fn env(input: &str) -> (String, String, Option<i32>) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(["env", "--preset", "water", "--seed", "3"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (text(output.stdout), text(output.stderr), output.status.code())
}

#[test]
fn the_environment_answers_each_line_with_one_line() {
    let upright = "step 1.57 0\n".repeat(3);
    let (message, error, status) = env(&format!("reset\n{upright}reset\n"));
    assert_eq!((error.as_str(), status), ("", Some(0)));
    let lines: Vec<Vec<&str>> = message.lines().map(|l| l.split(' ').collect()).collect();
    assert_eq!(lines.iter().map(Vec::len).collect::<Vec<_>>(), [3, 5, 5, 5, 3]);
    assert!(lines[1..4].iter().all(|l| l[4] == "no" && l[2] == lines[0][2]), "{message}");
    assert_eq!(env(&format!("reset\n{upright}reset\n")).0, message);
    // A leg far behind the body falls, and the episode ends.
    let (message, error, status) = env(&format!("reset\n{}", "step 0 0\n".repeat(20)));
    let ended = message.lines().position(|l| l.ends_with(" 0 fall")).unwrap();
    let after: Vec<&str> = message.lines().skip(ended + 1).collect();
    assert!(!after.is_empty(), "{message}");
    assert!(after.iter().all(|l| *l == "error no episode has begun; reset first"), "{message}");
    assert!(error.contains(&format!("line {}: no episode has begun", ended + 2)), "{error}");
    assert_eq!(status, Some(2));
}

#[test]
fn an_error_is_an_answer_and_changes_nothing() {
    let plain = "reset\nstep 1.57 0\nstep 1.5 0.1\nreset\n";
    let (expected, _, status) = env(plain);
    assert_eq!(status, Some(0));
    for (bad, why) in [
        ("jump", "'jump' is neither reset nor step ALPHA RS"),
        ("step 1 x", "'x' is not a finite number"),
        ("step NaN 0", "'NaN' is not a finite number"),
        ("step 1", "'step 1' is neither reset nor step ALPHA RS"),
        ("", "'' is neither reset nor step ALPHA RS"),
    ] {
        let mut lines: Vec<&str> = plain.lines().collect();
        for at in [3, 2, 1] {
            lines.insert(at, bad);
        }
        let (message, error, status) = env(&format!("{}\n", lines.join("\n")));
        let answers: Vec<&str> = message.lines().collect();
        let wanted = format!("error {why}");
        assert_eq!([answers[1], answers[3], answers[5]], [wanted.as_str(); 3]);
        let rest: Vec<&str> = answers.iter().step_by(2).copied().collect();
        // Lines 0, 2, 4 and 6 are the answers to the good lines.
        assert_eq!(rest, expected.lines().collect::<Vec<_>>());
        assert!(error.contains(&format!("standard input, line 2: {why}")), "{error}");
        assert_eq!(status, Some(2));
    }
    let (message, _, _) = env("step 1 1\nreset\n");
    assert!(message.starts_with("error no episode has begun; reset first\n"), "{message}");
    assert_eq!(message.lines().nth(1), expected.lines().next());
}

#[test]
fn a_repeated_number_repeats_the_answer_only() {
    let (expected, ..) = env("reset\nstep 1.57 0\nstep 1.5 0.1\nreset\n");
    let numbered = "1 reset\n1 reset\n2 step 1.57 0\n2 step 1.57 0\n2 step 1.57 0\n\
                    7 step 1.5 0.1\n8 reset\n";
    let (message, error, status) = env(numbered);
    assert_eq!((error.as_str(), status), ("", Some(0)));
    let expected: Vec<&str> = expected.lines().collect();
    let wanted = [(1, 0), (1, 0), (2, 1), (2, 1), (2, 1), (7, 2), (8, 3)];
    let wanted: Vec<String> =
        wanted.iter().map(|&(number, at)| format!("{number} {}", expected[at])).collect();
    assert_eq!(message.lines().collect::<Vec<_>>(), wanted);
    // An error has a number and is repeated, too.
    let (message, ..) = env("5 step 1 1\n5 step 1 1\n");
    assert_eq!(message, "5 error no episode has begun; reset first\n".repeat(2));
}

/// Interrupts requests at random instants, and compares every answer with that of a plant that
/// was asked the same without interrupts.
const INTERRUPTED: &str = r#"
import random, signal, sys
sys.path.insert(0, sys.argv[2])
from plant import Plant

class Interrupt(Exception):
    pass

def interrupt(*_):
    raise Interrupt

plant = Plant(sys.argv[1], "water", 3)
draw = random.Random(1)
asked, interrupted, lost = [(("reset",), plant.reset())], 0, 0
signal.signal(signal.SIGALRM, interrupt)
while interrupted < 150:
    request = ("reset",) if draw.random() < 0.2 else ("step", draw.uniform(1, 2), draw.random())
    before, answer = plant.asked(), None
    try:
        signal.setitimer(signal.ITIMER_REAL, draw.uniform(1e-6, 2e-4))
        try:
            answer = plant.reset() if request[0] == "reset" else plant.step(*request[1:])
        except RuntimeError as error:
            answer = str(error)
        signal.setitimer(signal.ITIMER_REAL, 0)
    except Interrupt:
        interrupted += 1
        signal.setitimer(signal.ITIMER_REAL, 0)
    carried_out = plant.asked() > before
    assert carried_out or answer is None
    lost += carried_out and answer is None
    if carried_out:
        asked.append((request, answer))
plant.close()
assert lost > 20, f"only {lost} interrupts fell between a request and its answer"
other, compared = Plant(sys.argv[1], "water", 3), 0
for request, answer in asked:
    try:
        expected = other.reset() if request[0] == "reset" else other.step(*request[1:])
    except RuntimeError as error:
        expected = str(error)
    if answer is not None:
        assert answer == expected, (request, answer, expected)
        compared += 1
other.close()
assert compared > 100, compared
"#;

/// Bad actions, a step before a reset, and a plant that ends.
const MISUSED: &str = r#"
import sys
sys.path.insert(0, sys.argv[2])
from plant import Plant

plant, other = Plant(sys.argv[1], "water", 3), Plant(sys.argv[1], "water", 3)

def refused(call, kind, words):
    try:
        call()
    except kind as error:
        assert words in str(error), error
    else:
        raise AssertionError(words)

refused(lambda: plant.step(1.5, 0), RuntimeError, "no episode has begun; reset first")
assert plant.reset() == other.reset()
for bad in [float("nan"), float("inf")]:
    refused(lambda: plant.step(bad, 0), ValueError, "not a finite number")
refused(lambda: plant.step("x", 0), ValueError, "could not convert")
assert plant.step(1.57, 0.1) == other.step(1.57, 0.1)
plant.link.process.kill()
refused(lambda: plant.step(1.57, 0.1), RuntimeError, "ended")
refused(lambda: plant.step(1.57, 0.1), RuntimeError, "no episode has begun; reset first")
other.restart(3)
assert plant.reset() == other.reset()
plant.restart(4)
assert plant.reset() != other.reset()
plant.close()
plant.close()
other.close()
refused(lambda: Plant("/nowhere/trainer", "water", 3).reset(), OSError, "/nowhere/trainer")
"#;

fn python(script: &str) {
    let bridges = requirements::checkout().join("trainer/bridges");
    let output = Command::new("python3")
        .args(["-B", "-c", script, env!("CARGO_BIN_EXE_trainer")])
        .arg(bridges)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn the_bridge_to_python_stays_in_step_after_interrupts() {
    if requirements::python3() {
        python(INTERRUPTED);
    }
}

#[test]
fn the_bridge_to_python_works_on_after_misuse() {
    if requirements::python3() {
        python(MISUSED);
    }
}
