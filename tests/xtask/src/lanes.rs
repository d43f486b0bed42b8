//! Steps at the same time: one lane in front, others beside it.
//!
//! The lane in front writes to the terminal. The others run at a low priority, with what it
//! leaves idle, so that its tests hardly notice them; the output of each of their steps is
//! printed in one piece, between two steps of the lane in front. The first failure ends all.

use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread;
use std::time::Duration;

use anyhow::{Result, anyhow};

use crate::step::{Ended, Step};

/// How long each step took, in the order in which they ended.
pub(crate) type Times = Vec<(&'static str, Duration)>;

/// A step beside, with what became of it.
type Report<'s> = (&'s Step, Ended);

/// Runs the steps of each lane one after the other, and the lanes at the same time.
///
/// # Errors
/// Returns the first failure. Steps that run by then are waited for; no other one begins.
pub(crate) fn run(in_front: &[Step], beside: &[Vec<Step>]) -> Result<Times> {
    let failed = AtomicBool::new(false);
    let (sender, receiver) = mpsc::channel();
    thread::scope(|scope| {
        for lane in beside {
            let (sender, failed) = (sender.clone(), &failed);
            scope.spawn(move || run_beside(lane, failed, &sender));
        }
        drop(sender);
        let mut times = Times::new();
        let mut result = run_in_front(in_front, &failed, &receiver, &mut times);
        if result.is_err() && !failed.swap(true, Ordering::Relaxed) && !beside.is_empty() {
            eprintln!("a step failed; waiting for the steps beside it");
        }
        for report in receiver {
            // Each failure is printed, and the first one returned.
            result = result.and(print(report, &mut times));
        }
        result.map(|()| times)
    })
}

fn run_in_front(
    steps: &[Step],
    failed: &AtomicBool,
    reports: &Receiver<Report<'_>>,
    times: &mut Times,
) -> Result<()> {
    for step in steps {
        reports.try_iter().try_for_each(|report| print(report, times))?;
        if failed.load(Ordering::Relaxed) {
            // Its report is on the way.
            return Ok(());
        }
        times.push((step.name, step.run()?));
    }
    Ok(())
}

fn run_beside<'s>(steps: &'s [Step], failed: &AtomicBool, reports: &Sender<Report<'s>>) {
    for step in steps {
        if failed.load(Ordering::Relaxed) {
            return;
        }
        let ended = step.run_beside();
        if ended.result.is_err() {
            failed.store(true, Ordering::Relaxed);
        }
        if reports.send((step, ended)).is_err() {
            return;
        }
    }
}

fn print((step, ended): Report<'_>, times: &mut Times) -> Result<()> {
    let Ended { time, output, result } = ended;
    let mut out = io::stdout().lock();
    writeln!(out, "\n{} (beside the others)\n{}", step.title(), output.trim_end())?;
    times.push((step.name, time));
    result.map_err(|error| anyhow!("{error:#}"))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;

    /// Returns a step that runs a script, in which `$1` is the folder of the test.
    fn shell(name: &'static str, script: &str, folder: &Path) -> Step {
        let path = folder.join(name);
        fs::write(&path, script).unwrap();
        Step::new(name, "sh", &format!("{} {}", path.display(), folder.display()))
    }

    fn names(times: &Times) -> Vec<&'static str> {
        let mut names: Vec<_> = times.iter().map(|(name, _)| *name).collect();
        names.sort_unstable();
        names
    }

    #[test]
    fn every_step_runs_and_the_lanes_run_at_the_same_time() {
        let folder = tempfile::tempdir().unwrap();
        // Each waits for the other; a limit ends the wait if they run one after the other.
        let meet = |mine: &str, other: &str| {
            format!(
                "touch $1/{mine}.there\nfor i in $(seq 600)\ndo [ -e $1/{other}.there ] && exit 0\n\
                 sleep 0.1\ndone\nexit 1\n"
            )
        };
        let in_front = [
            shell("front-1", &meet("front", "beside"), folder.path()),
            shell("front-2", "touch $1/front-2.there", folder.path()),
        ];
        let beside = [
            vec![shell("beside-1", &meet("beside", "front"), folder.path())],
            vec![
                shell("beside-2", "touch $1/first", folder.path()),
                shell("beside-3", "[ -e $1/first ] && touch $1/second", folder.path()),
            ],
        ];
        let times = run(&in_front, &beside).unwrap();
        assert_eq!(names(&times), ["beside-1", "beside-2", "beside-3", "front-1", "front-2"]);
        assert!(folder.path().join("front-2.there").exists());
        assert!(folder.path().join("second").exists());
    }

    #[test]
    fn a_failure_in_any_lane_is_returned_and_no_step_begins_after_it() {
        let folder = tempfile::tempdir().unwrap();
        let later = || shell("later", "touch $1/later.ran", folder.path());
        let failing = || shell("failing", "exit 3", folder.path());
        let error = run(&[failing(), later()], &[]).unwrap_err().to_string();
        assert!(error.contains("failing") && error.contains("exit status: 3"), "{error}");
        let error = run(&[], &[vec![failing(), later()]]).unwrap_err().to_string();
        assert!(error.contains("failing") && error.contains("exit status: 3"), "{error}");
        let waits = shell("waits", "until [ -e $1/failed ]; do sleep 0.1; done", folder.path());
        let fails = shell("fails", "touch $1/failed; exit 3", folder.path());
        let error = run(&[waits], &[vec![fails, later()]]).unwrap_err().to_string();
        assert!(error.contains("fails") && error.contains("exit status: 3"), "{error}");
        assert!(!folder.path().join("later.ran").exists());
    }

    #[test]
    fn the_output_of_a_step_beside_is_collected_whole_and_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let script = "echo one; echo two >&2; echo three; exit 1";
        let ended = shell("writes", script, folder.path()).run_beside();
        assert_eq!(ended.output, "one\ntwo\nthree\n");
        assert!(ended.result.is_err(), "a failure keeps its output");
    }
}
