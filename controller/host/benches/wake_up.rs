//! Wake-up latency of this machine: a loop that only sleeps to the instants of its
//! ticks, without spinning. Without spinning, no real-time loop can be more punctual.
//!
//! `cargo bench -p leg-host --bench wake_up -- --seconds 60 --rt-priority 40`

use std::time::Duration;

use clap::Parser;
use leg_host::Role;
use leg_host::realtime::{
    Clock, LatestReport, LoopOptions, Privileges, Task, Tick, TickResult, run,
};
use leg_process::Stop;

/// Measure the wake-up latency of this machine.
#[derive(Parser)]
struct Args {
    /// Duration of the measurement, s.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=86_400))]
    seconds: u32,
    /// Tick rate, Hz.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=20_000))]
    rate: u32,
    /// Real-time priority.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=99))]
    rt_priority: Option<u8>,
    /// Run on this processor only.
    #[arg(long)]
    cpu: Option<usize>,
    /// Spin for this long before each tick, us.
    #[arg(long, default_value_t = 0)]
    spin: u64,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
    /// Added by `cargo bench`.
    #[arg(long, hide = true)]
    bench: bool,
}

/// A task without work, for the remaining number of ticks.
struct NoWork(u64);

impl Task for NoWork {
    type Error = std::convert::Infallible;

    fn tick(&mut self, at: &Tick, _clock: &impl Clock) -> Result<TickResult, Self::Error> {
        self.0 = self.0.saturating_sub(1 + at.missed);
        Ok(TickResult { over: self.0 == 0, ..TickResult::default() })
    }
}

fn main() {
    let args = Args::parse();
    let options = LoopOptions {
        role: Role::Leg,
        rate_hz: args.rate,
        stale_limit_ns: leg_control::guard::SAFE_AFTER_NS,
        spin: Duration::from_micros(args.spin),
        privileges: Privileges { priority: args.rt_priority, cpu: args.cpu },
        live: false,
        latest_report: LatestReport::default(),
        observer: None,
    };
    let mut task = NoWork(u64::from(args.seconds) * u64::from(args.rate));
    let (Ok(()), stats) = run(&options, &mut task, &Stop::default(), || ());
    if args.json {
        println!("{}", serde_json::json!(stats.report()));
    } else {
        println!("{}", stats.report());
    }
}
