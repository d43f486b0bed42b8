//! Command-line options of a real-time loop, shared by `controller` and `sim-host`.

use leg_control::guard::SAFE_AFTER_NS;
use std::ffi::OsString;
use std::time::Duration;

use super::privileges::{PRIORITIES, Privileges, allowed_cpus};
use super::run::LoopOptions;
use super::stats_thread::LatestReport;
use crate::link::Role;

/// Longest spin that can be given, us.
const MAX_SPIN_US: i64 = 10_000;

/// Options of a real-time loop.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Real time")]
pub struct RealTimeArgs {
    /// Tick by the machine's clock instead of in lock-step. Both sides need this option.
    ///
    /// Ticks whose whole period passes while the loop sleeps are missed: the leg
    /// simulates them at once under the command in force, and the controller skips them.
    /// A tick without a new message is stale. After 10 ms without a message, and at least
    /// three ticks, the safe command is in force until the other side sends again.
    #[arg(long)]
    pub real_time: bool,
    /// Real-time priority of the loop, 1 to 99 (scheduling policy FIFO). If the system
    /// refuses it, the program warns and runs without.
    #[arg(
        long, value_name = "N", requires = "real_time", allow_negative_numbers = true,
        value_parser = clap::value_parser!(u8).range(*PRIORITIES.start() as i64..=*PRIORITIES.end() as i64)
    )]
    pub rt_priority: Option<u8>,
    /// Run the loop on this processor only.
    #[arg(
        long, value_name = "N", requires = "real_time", allow_negative_numbers = true,
        value_parser = parse_cpu
    )]
    pub cpu: Option<usize>,
    /// Wake this long before each tick and spin for the rest, us; at most a quarter of a
    /// period.
    #[arg(
        long, value_name = "US", requires = "real_time", allow_negative_numbers = true,
        default_value_t = 100,
        value_parser = clap::value_parser!(u32).range(0..=MAX_SPIN_US)
    )]
    pub spin: u32,
    /// Print the loop's statistics on stderr every second.
    #[arg(long, requires = "real_time")]
    pub live: bool,
}

/// Parses the number of a processor on which this process may run.
///
/// # Errors
/// Returns a message with the processors on which it may run.
pub fn parse_cpu(text: &str) -> Result<usize, String> {
    let allowed = allowed_cpus();
    text.parse().ok().filter(|cpu| allowed.contains(cpu)).ok_or_else(|| {
        let allowed: Vec<_> = allowed.iter().map(ToString::to_string).collect();
        format!("this process may run on the processors {}", allowed.join(", "))
    })
}

impl RealTimeArgs {
    /// Returns the arguments that give the same options to another program, with its
    /// loop on the processor `cpu`.
    #[must_use]
    pub fn arguments(&self, cpu: Option<usize>) -> Vec<OsString> {
        if !self.real_time {
            return Vec::new();
        }
        let mut arguments =
            vec!["--real-time".into(), "--spin".into(), self.spin.to_string().into()];
        if let Some(priority) = self.rt_priority {
            arguments.extend(["--rt-priority".into(), priority.to_string().into()]);
        }
        if let Some(cpu) = cpu {
            arguments.extend(["--cpu".into(), cpu.to_string().into()]);
        }
        arguments
    }

    /// Returns the options of the loop of `role`, with the usual stale limit.
    #[must_use]
    pub fn options(&self, role: Role, rate_hz: u32, latest_report: LatestReport) -> LoopOptions {
        LoopOptions {
            role,
            rate_hz,
            stale_limit_ns: SAFE_AFTER_NS,
            spin: Duration::from_micros(self.spin.into()),
            privileges: Privileges { priority: self.rt_priority, cpu: self.cpu },
            live: self.live,
            latest_report,
            observer: None,
        }
    }
}
