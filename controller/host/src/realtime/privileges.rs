//! Privileges of a loop's thread: real-time priority, a fixed processor, locked memory.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{
    CapabilitySet, CpuSet, capabilities, sched_getaffinity, sched_setaffinity,
    set_current_timer_slack,
};
use thread_priority::unix::{
    RealtimeThreadSchedulePolicy, ThreadSchedulePolicy, set_thread_priority_and_policy,
    thread_native_id,
};
use thread_priority::{ThreadPriority, ThreadPriorityValue};

/// Range of the priorities of real-time threads.
pub const PRIORITIES: std::ops::RangeInclusive<u8> = 1..=99;

/// The privileges that a loop requests. Each is acquired if the system permits it;
/// without them the loop runs with later ticks, which its report shows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Privileges {
    /// Priority under `SCHED_FIFO`, within [`PRIORITIES`].
    pub priority: Option<u8>,
    /// The processor to run on.
    pub cpu: Option<usize>,
}

/// Returns the processors on which this process may run.
#[must_use]
pub fn allowed_cpus() -> Vec<usize> {
    let set = sched_getaffinity(None).unwrap_or_else(|_| CpuSet::new());
    (0..CpuSet::MAX_CPU).filter(|cpu| set.is_set(*cpu)).collect()
}

impl Privileges {
    /// Acquires the privileges for this thread, and locks the memory of the process in
    /// any case. Returns a warning about what the system refused, with the remedy.
    /// Threads that this thread starts later inherit the privileges.
    #[must_use]
    pub fn acquire(&self) -> Option<String> {
        let mut refused = Vec::new();
        // Needs no privilege. With the default slack, an ordinary thread sleeps up to 50 us too
        // long.
        let _ = set_current_timer_slack(std::num::NonZeroU64::new(1));
        if let Some(cpu) = self.cpu {
            let mut set = CpuSet::new();
            set.set(cpu);
            if let Err(cause) = sched_setaffinity(None, &set) {
                refused.push(format!("processor {cpu} ({cause})"));
            }
        }
        if let Err(cause) = lock_memory() {
            refused.push(format!("locked memory ({cause})"));
        }
        if let Some(priority) = self.priority
            && let Err(cause) = set_fifo(priority)
        {
            refused.push(format!("SCHED_FIFO priority {priority} ({cause})"));
        }
        warning(&refused)
    }
}

fn warning(refused: &[String]) -> Option<String> {
    (!refused.is_empty()).then(|| {
        let program = std::env::current_exe().unwrap_or_default();
        format!(
            "warning: the system refuses the loop {}; it runs without, with later ticks. Remedy: \
             `sudo setcap cap_sys_nice,cap_ipc_lock+ep {}`, or `rtprio` and `memlock` for your \
             user in /etc/security/limits.conf and a new login",
            refused.join(", "),
            program.display()
        )
    })
}

/// Locks the present memory and, if there is no limit, all future memory. (Under a
/// limit, a later allocation would fail instead.)
fn lock_memory() -> rustix::io::Result<()> {
    let unlimited = getrlimit(Resource::Memlock).current.is_none()
        || capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    let flags = if unlimited {
        MlockAllFlags::CURRENT | MlockAllFlags::FUTURE
    } else {
        MlockAllFlags::CURRENT
    };
    mlockall(flags)
}

fn set_fifo(priority: u8) -> Result<(), String> {
    let value = ThreadPriorityValue::try_from(priority)?;
    set_thread_priority_and_policy(
        thread_native_id(),
        ThreadPriority::Crossplatform(value),
        ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
    )
    .map_err(|cause| match cause {
        thread_priority::Error::OS(number) => std::io::Error::from_raw_os_error(number).to_string(),
        other => format!("{other:?}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_warning_names_all_refused_privileges_and_the_remedy() {
        assert_eq!(warning(&[]), None);
        let refused = ["locked memory (x)".to_owned(), "SCHED_FIFO priority 5 (y)".to_owned()];
        let warning = warning(&refused).unwrap();
        for part in ["locked memory (x), SCHED_FIFO priority 5 (y)", "setcap", "limits.conf"] {
            assert!(warning.contains(part), "{warning}");
        }
    }

    #[test]
    fn a_thread_runs_only_on_its_processor() {
        let last = *allowed_cpus().last().unwrap();
        std::thread::spawn(move || {
            let _ = Privileges { cpu: Some(last), priority: None }.acquire();
            assert_eq!(allowed_cpus(), [last]);
        })
        .join()
        .unwrap();
        assert!(allowed_cpus().contains(&last));
    }
}
