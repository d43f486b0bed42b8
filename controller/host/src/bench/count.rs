//! Counting instructions by single-stepping a copy of this process with ptrace.
//!
//! Most virtual machines and containers hide the hardware counters. Single-stepping
//! works there too and gives the same count every time. The copy stops itself before and
//! after each work item; the count of an empty item is the cost of the stops and is
//! subtracted.

use std::io;
use std::process::{Child, Command, Stdio};

use nix::errno::Errno;
use nix::sys::ptrace;
use nix::sys::signal::{Signal, raise};
use nix::sys::wait::{WaitStatus, waitpid};
use nix::unistd::Pid;

use super::workload::{TickSamples, WorkKind, infer};
use leg_control::policy::Policy;

/// Counted work items of each kind, evenly spread over all of that kind.
const ITEMS: usize = 5;
/// Limit for one work item. More instructions mean that something else is being stepped.
const MAX_INSTRUCTIONS: u64 = 10_000_000;

/// Instructions of the median work item of each kind.
pub(super) type Counts = [u64; WorkKind::ALL.len()];

/// The instructions could not be counted.
#[derive(Debug, thiserror::Error)]
pub(super) enum CountError {
    #[error("cannot start a copy of this program: {0}")]
    Start(#[from] io::Error),
    #[error(
        "the system does not permit ptrace ({0}); a container permits it with --cap-add SYS_PTRACE"
    )]
    Trace(#[from] Errno),
    #[error("the traced copy ended early ({0:?})")]
    Ended(WaitStatus),
    #[error("a work item did not end within {MAX_INSTRUCTIONS} instructions")]
    TooMany,
}

/// Runs in the copy: requests to be traced, then performs the work items, with a stop
/// before and after each.
pub(super) fn run_traced(policy: &Policy<'_>) -> Result<(), CountError> {
    ptrace::traceme()?;
    raise(Signal::SIGSTOP)?;
    item(|| ())?;
    let ticks = TickSamples::of(policy);
    for kind in WorkKind::ALL {
        if kind == WorkKind::Inference {
            let actor = policy.actor();
            // The dynamic linker resolves functions in the first call, so that is not counted.
            infer(actor);
            for _ in 0..ITEMS {
                item(|| infer(actor))?;
            }
        } else {
            let prepared = ticks.of_kind(kind);
            for i in 0..ITEMS {
                let mut tick = prepared[i * prepared.len() / ITEMS].clone();
                item(|| tick.run())?;
            }
        }
    }
    Ok(())
}

/// Performs a work item between two stops.
fn item(work: impl FnOnce()) -> Result<(), Errno> {
    raise(Signal::SIGSTOP)?;
    work();
    raise(Signal::SIGSTOP)
}

/// Starts `copy`, which must call [`run_traced`], and counts its instructions.
pub(super) fn count(copy: &mut Command) -> Result<Counts, CountError> {
    let mut child =
        copy.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn()?;
    let counted = trace(&child);
    // End the copy also after an error.
    let _ = child.kill();
    let _ = child.wait();
    counted
}

fn trace(child: &Child) -> Result<Counts, CountError> {
    let pid = Pid::from_raw(child.id().cast_signed());
    until_stop(pid)?;
    let empty = count_item(pid)?;
    let mut counts = Counts::default();
    for count in &mut counts {
        let mut items = [0; ITEMS];
        for item in &mut items {
            *item = count_item(pid)?.saturating_sub(empty);
        }
        items.sort_unstable();
        *count = items[ITEMS / 2];
    }
    Ok(counts)
}

/// Counts the instructions from the next stop to the one after it.
fn count_item(pid: Pid) -> Result<u64, CountError> {
    ptrace::cont(pid, None)?;
    until_stop(pid)?;
    for steps in 1..=MAX_INSTRUCTIONS {
        ptrace::step(pid, None)?;
        match waitpid(pid, None)? {
            WaitStatus::Stopped(_, Signal::SIGTRAP) => (),
            WaitStatus::Stopped(_, Signal::SIGSTOP) => return Ok(steps),
            ended => return Err(CountError::Ended(ended)),
        }
    }
    Err(CountError::TooMany)
}

fn until_stop(pid: Pid) -> Result<(), CountError> {
    match waitpid(pid, None)? {
        WaitStatus::Stopped(_, Signal::SIGSTOP) => Ok(()),
        ended => Err(CountError::Ended(ended)),
    }
}
