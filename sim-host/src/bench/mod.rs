//! Benchmark of a tick in lock-step between two processes, beside its transport:
//! bare atomics in shared memory, bare iceoryx2, and the whole tick (sample, guard,
//! gait, cascade, command, plant).
//!
//! The three are measured in turn, round by round, between the same two processes,
//! so that other load on the machine affects all alike. Every exchange carries the
//! 48 bytes of a sample in one direction and the 64 of a command in the other.
//!
//! It is a subcommand and not a bench target, because users compare their own
//! machine with it, without a checkout.

mod atomics;
mod bare;

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use leg_control::config::Config;
use leg_control::wire_controller::WireController;
use leg_host::Domain;
use leg_host::serve::serve;
use leg_host::shm::{ShmController, ShmLeg};
use leg_process::Stop;
use leg_process::policy_file::PolicyFile;
use serde::Serialize;

use crate::scenario::Scenario;
use crate::session::lock_step::{self, Options};
use crate::session::{RoundTripUs, RoundTrips};

/// Longest wait of either process for the other.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Exchanges before the first one that is measured.
const WARM_UP: u64 = 10_000;

/// As large as a sample and as a command.
type Ping = [u64; 6];
type Pong = [u64; 8];

/// Size of the measurement.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Size {
    /// Number of rounds; in each, the three are measured once.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// Exchanges of each of the two bare transports in a round.
    #[arg(long, value_name = "N", default_value_t = 80_000, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    pub exchanges: u64,
}

/// Result of the benchmark; its fields are the keys of the JSON output.
#[derive(Clone, Debug, Serialize)]
pub struct BenchReport {
    /// Round trip through atomics in shared memory, us.
    pub raw_shm_us: RoundTripUs,
    /// Round trip through bare iceoryx2, us.
    pub raw_iceoryx2_us: RoundTripUs,
    /// Time from one tick to the next, us.
    pub full_tick_us: RoundTripUs,
    /// Ticks per second of the median round.
    pub ticks_per_s: f64,
    /// Median full tick over median exchange of bare iceoryx2.
    pub full_tick_over_iceoryx2: f64,
    /// Number of rounds.
    pub rounds: u32,
    /// Number of ticks in all rounds.
    pub ticks: u64,
}

/// Measures, with [`echo`] running in another process of `domain`.
///
/// # Errors
/// If the other process does not connect or ends early.
pub fn measure(domain: &Arc<Domain>, size: Size) -> anyhow::Result<BenchReport> {
    let scenario = Scenario::shore();
    let mut atomics = atomics::Requester::create(domain)?;
    let mut bare = bare::Requester::open(domain)?;
    let mut leg = ShmLeg::connect(domain, scenario.session_params(), TIMEOUT, &Stop::default())?;

    let mut times = [(); 3].map(|()| RoundTrips::default());
    let [raw, iceoryx2, full] = &mut times;
    let (mut rates, mut ticks) = (Vec::new(), 0);
    exchange(WARM_UP, &mut RoundTrips::default(), |i| atomics.exchange(i))?;
    exchange(WARM_UP, &mut RoundTrips::default(), |i| bare.exchange(i))?;
    for round in 0..size.rounds {
        exchange(size.exchanges, raw, |i| atomics.exchange(i))?;
        exchange(size.exchanges, iceoryx2, |i| bare.exchange(i))?;
        let options = Options { run_id: round + 1, timeout: TIMEOUT };
        let mut last = Instant::now();
        let outcome = lock_step::run(&scenario, &mut leg, options, |_| {
            let now = Instant::now();
            full.record(now - last);
            last = now;
        })?;
        rates.push(outcome.ticks_per_s());
        ticks += outcome.ticks;
    }
    rates.sort_unstable_by(f64::total_cmp);
    let [raw_shm_us, raw_iceoryx2_us, full_tick_us] = times.map(|times| times.quantiles_us());
    Ok(BenchReport {
        raw_shm_us,
        raw_iceoryx2_us,
        full_tick_us,
        ticks_per_s: rates[rates.len() / 2],
        full_tick_over_iceoryx2: full_tick_us.p50 / raw_iceoryx2_us.p50,
        rounds: size.rounds,
        ticks,
    })
}

/// Runs the other process, which answers [`measure`].
///
/// # Errors
/// If the first process does not connect or ends early.
pub fn echo(domain: &Arc<Domain>, size: Size) -> anyhow::Result<()> {
    let scenario = Scenario::shore();
    let blob = PolicyFile::load(None)?;
    let config = Config::at_rate(scenario.rate_hz)?;
    let mut controller = WireController::new(blob.policy()?, config);

    let mut atomics = atomics::Responder::open(domain, TIMEOUT)?;
    let mut bare = bare::Responder::open(domain)?;
    let mut link =
        ShmController::connect(domain, scenario.session_params(), TIMEOUT, &Stop::default())?;
    atomics.respond(WARM_UP)?;
    bare.respond(WARM_UP)?;
    for _ in 0..size.rounds {
        atomics.respond(size.exchanges)?;
        bare.respond(size.exchanges)?;
        serve(&mut link, TIMEOUT, |sample| controller.tick(Some(sample)))?;
    }
    Ok(())
}

fn exchange(
    times: u64,
    taken: &mut RoundTrips,
    mut round_trip: impl FnMut(u64) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    for i in 1..=times {
        let start = Instant::now();
        round_trip(i)?;
        taken.record(start.elapsed());
    }
    Ok(())
}

/// Spins for an answer, which is the fastest wait while each process has its own
/// core, and yields the core if they share one.
fn spin_for<T>(mut poll: impl FnMut() -> anyhow::Result<Option<T>>) -> anyhow::Result<T> {
    const SPINS: u32 = 20_000;
    let start = Instant::now();
    loop {
        for _ in 0..SPINS {
            if let Some(found) = poll()? {
                return Ok(found);
            }
            std::hint::spin_loop();
        }
        std::thread::yield_now();
        anyhow::ensure!(start.elapsed() < TIMEOUT, "the other process has not answered for 10 s");
    }
}

impl fmt::Display for BenchReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "us, round trip{:>20}{:>9}{:>9}{:>10}", "p50", "p99", "p99.9", "max")?;
        for (name, us) in [
            ("bare shared memory", self.raw_shm_us),
            ("bare iceoryx2", self.raw_iceoryx2_us),
            ("full lock-step tick", self.full_tick_us),
        ] {
            writeln!(
                f,
                "  {name:<23}{:>9.2}{:>9.2}{:>9.2}{:>10.1}",
                us.p50, us.p99, us.p99_9, us.max
            )?;
        }
        write!(
            f,
            "\nthe full tick takes {:.2} times bare iceoryx2; {:.0} ticks/s ({} rounds, {} ticks)",
            self.full_tick_over_iceoryx2, self.ticks_per_s, self.rounds, self.ticks
        )
    }
}
