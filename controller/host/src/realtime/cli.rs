//! The options of a loop in real time, the same for both programs.

use std::ffi::OsString;
use std::time::Duration;

use super::super::card::Role;
use super::clerk::Shared;
use super::drive::Options;
use super::privileges::{PRIORITIES, Privileges, allowed_cpus};

/// Longest spin that `--spin` accepts, us.
const MAX_SPIN_US: i64 = 10_000;

/// How to tick by the clock.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Real time")]
pub struct RealTimeArgs {
    /// Tick by the machine's clock instead of in lock-step; both sides must.
    ///
    /// Time does not wait. Ticks that are slept through are missed: the leg plays
    /// them at once under the command in force, the controller skips them. A tick
    /// without a new message is stale; after ten in a row the safe command holds,
    /// until the other side is heard again.
    #[arg(long)]
    pub real_time: bool,
    /// Real-time priority of the loop, 1 to 99 (scheduling policy FIFO); without
    /// leave of the system it runs without, and says so.
    #[arg(
        long, value_name = "N", requires = "real_time", allow_negative_numbers = true,
        value_parser = clap::value_parser!(u8).range(*PRIORITIES.start() as i64..=*PRIORITIES.end() as i64)
    )]
    pub rt_priority: Option<u8>,
    /// Keep the loop on this processor.
    #[arg(
        long, value_name = "N", requires = "real_time", allow_negative_numbers = true,
        value_parser = parse_cpu
    )]
    pub cpu: Option<usize>,
    /// Wake this long before each tick, and spin for the rest, us; at most a
    /// quarter of a tick is spun.
    #[arg(
        long, value_name = "US", requires = "real_time", allow_negative_numbers = true,
        default_value_t = 100,
        value_parser = clap::value_parser!(u32).range(0..=MAX_SPIN_US)
    )]
    pub spin: u32,
    /// Show the loop's figures on stderr while it runs, every second.
    #[arg(long, requires = "real_time")]
    pub live: bool,
}

/// Reads the number of a processor on which this process may run.
///
/// # Errors
/// A message with those it may run on.
pub fn parse_cpu(text: &str) -> Result<usize, String> {
    let allowed = allowed_cpus();
    text.parse().ok().filter(|cpu| allowed.contains(cpu)).ok_or_else(|| {
        let allowed: Vec<_> = allowed.iter().map(ToString::to_string).collect();
        format!("this process may run on the processors {}", allowed.join(", "))
    })
}

impl RealTimeArgs {
    /// The options that say the same to another program, for its loop on the
    /// processor `cpu`.
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

    /// How to run the loop of `role` by these options.
    #[must_use]
    pub fn options(&self, role: Role, rate_hz: u32, shared: Shared) -> Options {
        Options {
            role,
            rate_hz,
            spin: Duration::from_micros(self.spin.into()),
            privileges: Privileges { priority: self.rt_priority, cpu: self.cpu },
            live: self.live,
            shared,
            listener: None,
        }
    }
}
