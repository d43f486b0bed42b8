//! `cargo xtask chaos`: two real processes in real time, ended and stopped at random,
//! and how each recovers from the loss of the other.
//!
//! A leg and a controller run by the clock at 1 kHz. Again and again one of them is
//! killed, stopped or loses its terminal, at a moment drawn from a seed, sometimes while
//! it is still starting. Each time its peer must be in its safe state within 20 ticks,
//! report the loss once, keep running, and be connected again within a second of the
//! other's return.

mod injection;
mod process;
mod report;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use rand_pcg::Pcg64Mcg;

use crate::programs::Programs;
use injection::{Injection, Kind};
use process::{PeerReport, Process, Role};
use report::{Recovery, Report};

/// Ticks of 1 ms within which the peer has to be in its safe state.
const SAFE_WITHIN_TICKS: u64 = 20;
/// Time within which the peer has to be connected again.
const BACK_WITHIN: Duration = Duration::from_secs(1);
/// Time after which a process has reported a peer that came and went.
const SETTLED: Duration = Duration::from_millis(50);
/// Longer than any single wait takes, on a busy machine too.
const PATIENCE: Duration = Duration::from_secs(30);

/// Kill and stop real processes in real time, and check that their peers recover.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Number of failures to inject.
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..))]
    kills: u64,
    /// Seed that determines which process fails, how and when.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder with the programs to run [default: they are built].
    #[arg(long, value_name = "DIR")]
    programs: Option<PathBuf>,
}

impl Args {
    /// Returns the short run of `cargo xtask ci`.
    pub(crate) fn short() -> Self {
        Self { kills: 20, seed: 1, programs: None }
    }
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let programs =
        args.programs.clone().map_or_else(Programs::build, |folder| Ok(Programs::of(folder)))?;
    let domain = Domain { programs, name: format!("chaos-{}", std::process::id()) };
    if process::hang_up_is_ignored() {
        println!("SIGHUP is ignored here, as under nohup: SIGTERM is sent in its place");
    }
    let begun = Instant::now();
    let mut fixture = Fixture::start(&domain)?;
    let mut random = Pcg64Mcg::new(0xcafe_f00d_d15e_a5e5 ^ u128::from(args.seed));
    let mut report = Report::default();
    for number in 1..=args.kills {
        let injection = Injection::draw(&mut random);
        let recovery = fixture
            .inject(&injection)
            .with_context(|| format!("injection {number} of seed {}: {injection}", args.seed))
            .with_context(|| fixture.tail())?;
        report.push(recovery);
        if number % 100 == 0 {
            println!("{number} of {}, {:.0} s", args.kills, begun.elapsed().as_secs_f64());
        }
    }
    let losses = fixture.leg.losses() + fixture.controller.losses();
    fixture.end()?;
    domain.ensure_clean()?;
    println!("\n{report}");
    println!(
        "{} failures injected in {:.0} s, all survived; {losses} losses reported, each once; no \
         file is left",
        args.kills,
        begun.elapsed().as_secs_f64()
    );
    Ok(())
}

/// The programs, and the name of the domain in which they connect.
struct Domain {
    programs: Programs,
    name: String,
}

impl Domain {
    /// Returns the command that starts a process.
    fn command(&self, role: Role) -> Command {
        let mut command = match role {
            Role::Leg => {
                let mut leg = self.programs.sim_host();
                leg.args(["run", "--on-fall", "restart", "--duration", "80000", "--timeout", "60"]);
                leg.args(["--set-point", "0.3"]);
                leg
            }
            Role::Controller => self.programs.controller(),
        };
        // Where SCHED_FIFO is allowed, other load on the machine does not count.
        command.args(["--real-time", "--rt-priority", "20", "--domain", &self.name]);
        command
    }

    /// Checks that neither the folder of the domain nor any shared memory of it is left.
    fn ensure_clean(&self) -> Result<()> {
        let is_own = |path: &PathBuf| {
            let path = path.strip_prefix("/dev/shm").unwrap_or(path).to_string_lossy();
            path.starts_with("leg-") && path.contains(&format!("-{}-", self.name))
                || path.starts_with("spring-leg-") && path.contains(&self.name)
        };
        let left: Vec<_> = walk(Path::new("/dev/shm")).into_iter().filter(is_own).collect();
        ensure!(left.is_empty(), "left in shared memory: {left:?}");
        Ok(())
    }
}

fn walk(folder: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        all.extend(walk(&entry.path()));
        all.push(entry.path());
    }
    all
}

/// The two running processes.
struct Fixture<'a> {
    domain: &'a Domain,
    leg: Process,
    controller: Process,
}

impl<'a> Fixture<'a> {
    fn start(domain: &'a Domain) -> Result<Self> {
        let controller = Process::start(domain.command(Role::Controller), Role::Controller)?;
        let leg = Process::start(domain.command(Role::Leg), Role::Leg)?;
        let fixture = Self { domain, leg, controller };
        let deadline = Instant::now() + PATIENCE;
        while fixture.status()?["activity"] != "running" {
            ensure!(Instant::now() < deadline, "the run does not begin");
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(fixture)
    }

    fn status(&self) -> Result<serde_json::Value> {
        let mut status = self.domain.programs.controller();
        status.args(["status", "--json", "--domain", &self.domain.name]);
        let output = status.output().context("cannot start `controller status`")?;
        Ok(serde_json::from_slice(&output.stdout).unwrap_or_default())
    }

    /// Returns the process with this role, and its peer.
    fn with_peer(&mut self, role: Role) -> (&mut Process, &mut Process) {
        match role {
            Role::Leg => (&mut self.leg, &mut self.controller),
            Role::Controller => (&mut self.controller, &mut self.leg),
        }
    }

    fn inject(&mut self, injection: &Injection) -> Result<Recovery> {
        let domain = self.domain;
        let (target, peer) = self.with_peer(injection.target);
        std::thread::sleep(injection.after);
        // A busy machine too may keep one of them from ticking.
        peer.wait_for_report(|report| !report.is_lost(), PATIENCE)?;
        target.inject(injection.kind, injection.ending)?;

        let lost = peer.wait_for_report(PeerReport::is_lost, PATIENCE)?;
        let ticks_until_safe = lost.ticks_until_safe().context("no ticks in the report")?;
        ensure!(
            ticks_until_safe <= SAFE_WITHIN_TICKS,
            "the {} was safe only after {ticks_until_safe} ticks: {lost}",
            peer.role()
        );
        std::thread::sleep(injection.gone);
        if let Some(after) = injection.killed_at_start.filter(|_| injection.kind.ends()) {
            // The peer may have met it by then, or not.
            target.restart(domain.command(injection.target))?;
            std::thread::sleep(after);
            target.inject(Kind::Kill, Duration::ZERO)?;
            std::thread::sleep(SETTLED);
            peer.wait_for_report(PeerReport::is_lost, PATIENCE)?;
        }
        let returned = match injection.kind {
            Kind::Stop => target.resume()?,
            Kind::Kill | Kind::HangUp | Kind::KillAtEnd => {
                target.restart(domain.command(injection.target))?
            }
        };
        let report = peer.wait_for_report(|report| !report.is_lost(), PATIENCE)?;
        let PeerReport::Present(Some(back)) = report else {
            bail!("the {} has reported nothing", peer.role());
        };
        let reconnected_after = back.at.saturating_duration_since(returned);
        ensure!(
            reconnected_after <= BACK_WITHIN,
            "the {} was connected again only after {reconnected_after:?}",
            peer.role()
        );
        peer.ensure_runs()?;
        Ok(Recovery { injection: *injection, ticks_until_safe, reconnected_after })
    }

    /// Returns the last messages of both.
    fn tail(&self) -> String {
        format!("{}\n{}", self.leg.tail(), self.controller.tail())
    }

    fn end(self) -> Result<()> {
        let Self { leg, controller, .. } = self;
        for process in [leg, controller] {
            let role = process.role();
            ensure!(process.end(PATIENCE)?, "the {role} does not end after SIGTERM");
        }
        Ok(())
    }
}
