//! Round-trip time of the shared-memory link between two processes: a sample out and a
//! command back, without any computation.
//!
//! `cargo bench -p leg-host --bench round_trip`
//!
//! Under `taskset -c 0` both processes share one core, which is the worst case.

use std::process::{Command as Process, Stdio};
use std::time::{Duration, Instant};

use leg_control::wire::{Command, Sample};
use leg_host::shm::{ShmController, ShmLeg};
use leg_host::{Domain, Link, LinkError, SessionParams};
use leg_process::Stop;

const ECHO: &str = "--echo-in";
const TIMEOUT: Duration = Duration::from_secs(10);
const WARM_UP: u64 = 10_000;
const TICKS: u64 = 500_000;
/// Time limit. Long enough for a p99 even if each round trip takes a time slice.
const TIME_LIMIT: Duration = Duration::from_secs(10);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    if args.next().as_deref() == Some(ECHO) {
        return echo(&args.next().ok_or("no domain given")?);
    }
    let name = format!("bench-{}", std::process::id());
    let mut child =
        Process::new(std::env::current_exe()?).args([ECHO, &name]).stdin(Stdio::null()).spawn()?;
    let measured = measure(&name);
    child.wait()?;
    let mut times = measured?;
    times.sort_unstable();
    let us = |share: f64| times[((times.len() - 1) as f64 * share) as usize] as f64 / 1000.0;
    println!(
        "round trips {}: p50 {:.2} us, p99 {:.2} us, p99.9 {:.2} us, max {:.1} us",
        times.len(),
        us(0.5),
        us(0.99),
        us(0.999),
        us(1.0)
    );
    Ok(())
}

fn measure(domain: &str) -> Result<Vec<u64>, Box<dyn std::error::Error>> {
    let domain = Domain::join(domain)?;
    let mut leg = ShmLeg::connect(&domain, SessionParams::at(1000), TIMEOUT, &Stop::default())?;
    let mut times = Vec::with_capacity(TICKS as usize);
    let mut sample = Sample::default();
    let start = Instant::now();
    for seq in 0..WARM_UP + TICKS {
        sample.header.seq = seq;
        let sent = Instant::now();
        leg.send(&sample)?;
        let reply = leg.receive(TIMEOUT)?.ok_or("no reply")?;
        assert_eq!(reply.header.seq, seq);
        if seq >= WARM_UP {
            times.push(sent.elapsed().as_nanos() as u64);
        }
        if start.elapsed() > TIME_LIMIT && !times.is_empty() {
            break;
        }
    }
    Ok(times)
}

fn echo(domain: &str) -> Result<(), Box<dyn std::error::Error>> {
    let domain = Domain::join(domain)?;
    let mut link =
        ShmController::connect(&domain, SessionParams::at(1000), TIMEOUT, &Stop::default())?;
    loop {
        match link.receive(TIMEOUT) {
            Ok(Some(sample)) => {
                link.send(&Command { header: sample.header, ..Command::default() })?;
            }
            Ok(None) => return Err("no sample".into()),
            Err(LinkError::PeerLeft { .. }) => return Ok(()),
            Err(cause) => return Err(cause.into()),
        }
    }
}
