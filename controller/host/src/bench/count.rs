//! Counting instructions, by stepping a copy of this process one at a time.
//!
//! Hardware counters are closed to most virtual machines and containers; a
//! debugger's single step is not, and counts the same every time. The copy
//! stops itself before and after each piece of work; an empty piece tells what
//! the stops themselves take.

use std::io;
use std::process::{Child, Command, Stdio};

use nix::errno::Errno;
use nix::sys::ptrace;
use nix::sys::signal::{Signal, raise};
use nix::sys::wait::{WaitStatus, waitpid};
use nix::unistd::Pid;

use super::workload::{Kind, Ticks, infer};
use leg_control::policy::Policy;

/// Pieces of a kind that are counted, evenly spread over all there are.
const PIECES: usize = 5;
/// No piece of work takes as many: something else is being stepped.
const TOO_MANY: u64 = 10_000_000;

/// Instructions of each kind: of the median piece.
pub(super) type Counts = [u64; Kind::ALL.len()];

/// Why nothing was counted.
#[derive(Debug, thiserror::Error)]
pub(super) enum CountError {
    #[error("cannot start a copy of this program: {0}")]
    Start(#[from] io::Error),
    #[error(
        "the system does not let it be stepped ({0}); allow ptrace, as a container does with --cap-add SYS_PTRACE"
    )]
    Trace(#[from] Errno),
    #[error("the copy that was stepped ended early ({0:?})")]
    Ended(WaitStatus),
    #[error("a piece of work did not end within {TOO_MANY} instructions")]
    TooMany,
}

/// The copy's part: asks to be traced, then works, with a stop on either side
/// of each piece.
pub(super) fn be_counted(policy: &Policy<'_>) -> Result<(), CountError> {
    ptrace::traceme()?;
    raise(Signal::SIGSTOP)?;
    piece(|| ())?;
    let ticks = Ticks::of(policy);
    for kind in Kind::ALL {
        if kind == Kind::Inference {
            let actor = policy.actor();
            // Once before: the dynamic linker resolves a function at its first call.
            infer(actor);
            for _ in 0..PIECES {
                piece(|| infer(actor))?;
            }
        } else {
            let moments = ticks.of_kind(kind);
            for i in 0..PIECES {
                let mut moment = moments[i * moments.len() / PIECES].clone();
                piece(|| moment.pass())?;
            }
        }
    }
    Ok(())
}

fn piece(work: impl FnOnce()) -> Result<(), Errno> {
    raise(Signal::SIGSTOP)?;
    work();
    raise(Signal::SIGSTOP)
}

/// Starts `copy`, which must come to [`be_counted`], and counts.
pub(super) fn count(copy: &mut Command) -> Result<Counts, CountError> {
    let mut child =
        copy.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn()?;
    let counted = follow(&child);
    // Counted or not, it is not to be left behind.
    let _ = child.kill();
    let _ = child.wait();
    counted
}

fn follow(child: &Child) -> Result<Counts, CountError> {
    let pid = Pid::from_raw(child.id().cast_signed());
    until_stop(pid)?;
    let empty = next_piece(pid)?;
    let mut counts = Counts::default();
    for count in &mut counts {
        let mut pieces = [0; PIECES];
        for piece in &mut pieces {
            *piece = next_piece(pid)?.saturating_sub(empty);
        }
        pieces.sort_unstable();
        *count = pieces[PIECES / 2];
    }
    Ok(counts)
}

/// Instructions from the next stop to the one after.
fn next_piece(pid: Pid) -> Result<u64, CountError> {
    ptrace::cont(pid, None)?;
    until_stop(pid)?;
    for steps in 1..=TOO_MANY {
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
