//! What a tick in lock-step costs between two processes, beside what its
//! transport costs: bare atomics in shared memory, bare iceoryx2, and the whole
//! tick (sample, guard, gait, cascade, command, plant).
//!
//! The three are measured in turn, round by round, between the same two
//! processes, so that whatever else the machine does hits all alike. Every
//! exchange carries a sample's 48 bytes one way and a command's 64 the other.

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

/// Patience of either process with the other.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Exchanges before the first that counts.
const WARM_UP: u64 = 10_000;

/// A sample's words, and a command's.
type Ping = [u64; 6];
type Pong = [u64; 8];

/// How much is measured.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Size {
    /// Rounds; in each, the three are measured once.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// Exchanges of each of the two bare transports in a round.
    #[arg(long, value_name = "N", default_value_t = 80_000, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    pub exchanges: u64,
}

/// What was measured, by the names that scripts read.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// There and back through two atomics in shared memory.
    pub raw_shm_us: RoundTripUs,
    /// There and back through bare iceoryx2.
    pub raw_iceoryx2_us: RoundTripUs,
    /// From one tick to the next, everything in it.
    pub full_tick_us: RoundTripUs,
    /// Ticks a second, over a whole run; of the median round.
    pub ticks_per_s: f64,
    /// Median full tick over median exchange of bare iceoryx2.
    pub full_tick_over_iceoryx2: f64,
    /// Rounds.
    pub rounds: u32,
    /// Ticks in all.
    pub ticks: u64,
}

/// Measures, with [`echo`] running in another process of `domain`.
///
/// # Errors
/// When the other process does not come, or goes.
pub fn measure(domain: &Arc<Domain>, size: Size) -> anyhow::Result<Report> {
    let scenario = Scenario::shore();
    let mut atomics = atomics::Asker::create(domain)?;
    let mut bare = bare::Asker::open(domain)?;
    let mut leg = ShmLeg::connect(domain, scenario.session_params(), TIMEOUT, &Stop::default())?;

    let mut times = [(); 3].map(|()| RoundTrips::default());
    let [raw, iceoryx2, full] = &mut times;
    let (mut rates, mut ticks) = (Vec::new(), 0);
    exchange(WARM_UP, &mut RoundTrips::default(), |i| atomics.ask(i))?;
    exchange(WARM_UP, &mut RoundTrips::default(), |i| bare.ask(i))?;
    for round in 0..size.rounds {
        exchange(size.exchanges, raw, |i| atomics.ask(i))?;
        exchange(size.exchanges, iceoryx2, |i| bare.ask(i))?;
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
    Ok(Report {
        raw_shm_us,
        raw_iceoryx2_us,
        full_tick_us,
        ticks_per_s: rates[rates.len() / 2],
        full_tick_over_iceoryx2: full_tick_us.p50 / raw_iceoryx2_us.p50,
        rounds: size.rounds,
        ticks,
    })
}

/// The other process: answers whatever [`measure`] asks.
///
/// # Errors
/// When the first process does not come, or goes.
pub fn echo(domain: &Arc<Domain>, size: Size) -> anyhow::Result<()> {
    let scenario = Scenario::shore();
    let blob = PolicyFile::load(None)?;
    let config = Config::at_rate(scenario.rate_hz)?;
    let mut controller = WireController::new(blob.policy()?, config);

    let mut atomics = atomics::Answerer::open(domain, TIMEOUT)?;
    let mut bare = bare::Answerer::open(domain)?;
    let mut link =
        ShmController::connect(domain, scenario.session_params(), TIMEOUT, &Stop::default())?;
    atomics.answer(WARM_UP)?;
    bare.answer(WARM_UP)?;
    for _ in 0..size.rounds {
        atomics.answer(size.exchanges)?;
        bare.answer(size.exchanges)?;
        serve(&mut link, TIMEOUT, |sample| controller.tick(Some(sample)))?;
    }
    Ok(())
}

fn exchange(
    times: u64,
    taken: &mut RoundTrips,
    mut ask: impl FnMut(u64) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    for i in 1..=times {
        let start = Instant::now();
        ask(i)?;
        taken.record(start.elapsed());
    }
    Ok(())
}

/// Spins for an answer: the fastest wait there is while both have a core of
/// their own, and it lets go of the core when they share one.
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

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "us, there and back{:>16}{:>9}{:>9}{:>10}", "p50", "p99", "p99.9", "max")?;
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
