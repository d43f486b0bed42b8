//! How late this machine wakes a thread that does nothing else: a bare loop of
//! `clock_nanosleep` to the instants of a tick, without any spin. What it shows,
//! no loop in real time can better without spinning.
//!
//! `cargo bench -p leg-host --bench wake_up -- --seconds 60 --rt-priority 40`

use std::time::Duration;

use clap::Parser;
use leg_host::Role;
use leg_host::realtime::drive::Options;
use leg_host::realtime::{Clock, Done, Privileges, Shared, Task, Tick, run};
use leg_process::Stop;

/// How late a bare loop wakes.
#[derive(Parser)]
struct Args {
    /// How long, s.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=86_400))]
    seconds: u32,
    /// Ticks a second.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=20_000))]
    rate: u32,
    /// Real-time priority.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=99))]
    rt_priority: Option<u8>,
    /// The processor to stay on.
    #[arg(long)]
    cpu: Option<usize>,
    /// Spin so long before each tick, us.
    #[arg(long, default_value_t = 0)]
    spin: u64,
    /// The figures as JSON.
    #[arg(long)]
    json: bool,
    /// What `cargo bench` adds.
    #[arg(long, hide = true)]
    bench: bool,
}

/// Ticks left.
struct Nothing(u64);

impl Task for Nothing {
    type Error = std::convert::Infallible;

    fn tick(&mut self, at: &Tick, _clock: &impl Clock) -> Result<Done, Self::Error> {
        self.0 = self.0.saturating_sub(1 + at.missed);
        Ok(Done { over: self.0 == 0, ..Done::default() })
    }
}

fn main() {
    let args = Args::parse();
    let options = Options {
        role: Role::Leg,
        rate_hz: args.rate,
        spin: Duration::from_micros(args.spin),
        privileges: Privileges { priority: args.rt_priority, cpu: args.cpu },
        live: false,
        shared: Shared::default(),
        listener: None,
    };
    let mut task = Nothing(u64::from(args.seconds) * u64::from(args.rate));
    let (Ok(()), tally) = run(&options, &mut task, &Stop::default(), || ());
    if args.json {
        println!("{}", serde_json::json!(tally.report()));
    } else {
        println!("{}", tally.report());
    }
}
