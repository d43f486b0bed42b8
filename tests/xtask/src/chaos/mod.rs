//! Chaos: real processes in real time, ended and stopped at random, and what
//! becomes of the ones that remain.
//!
//! A leg and a controller hop by the clock at 1 kHz. Again and again one of
//! them is killed, stopped, or loses its terminal, at a moment that a seed
//! chooses, some of them while it is still starting. Each time the other must
//! be in its safe state within 20 ticks, say so once, stay the process that it
//! is, and have its peer back within a second of its return.

mod actor;
mod plan;
mod report;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use rand_pcg::Pcg64Mcg;

use crate::programs::Programs;
use actor::{Actor, Part, Word, number_before};
use plan::{Blow, How};
use report::{Incident, Report};

/// Ticks, of 1 ms, within which the one that remains has to be safe.
const SAFE_WITHIN_TICKS: u64 = 20;
/// Within this time of its return the peer has to be taken back.
const BACK_WITHIN: Duration = Duration::from_secs(1);
/// By then a process has said what it has to say of a peer that came and went.
const SETTLED: Duration = Duration::from_millis(50);
/// Longer than anything here may take.
const PATIENCE: Duration = Duration::from_secs(10);

/// Kill and stop real processes in real time, and see the others stand.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// How often something is done to one of the two.
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..))]
    kills: u64,
    /// Chooses who, how and when.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The folder of the programs to run [default: they are built].
    #[arg(long, value_name = "DIR")]
    programs: Option<PathBuf>,
}

impl Args {
    /// A short run, for every check.
    pub(crate) fn short() -> Self {
        Self { kills: 20, seed: 1, programs: None }
    }
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let programs =
        args.programs.clone().map_or_else(Programs::build, |folder| Ok(Programs::of(folder)))?;
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let place = Place { programs, folder: folder.path().to_owned() };
    if actor::hang_up_is_ignored() {
        println!("SIGHUP is ignored here, as under nohup: SIGTERM is sent in its place");
    }
    let begun = Instant::now();
    let mut scene = Scene::begin(&place)?;
    let prefix = place.prefix()?;
    let mut random = Pcg64Mcg::new(0xcafe_f00d_d15e_a5e5 ^ u128::from(args.seed));
    let mut report = Report::default();
    for number in 1..=args.kills {
        let blow = Blow::choose(&mut random);
        let incident = scene
            .strike(&blow)
            .with_context(|| format!("blow {number} of seed {}: {blow}", args.seed))
            .with_context(|| scene.said())?;
        report.take(&incident);
        if number % 100 == 0 {
            println!("{number} of {}, {:.0} s", args.kills, begun.elapsed().as_secs_f64());
        }
    }
    let losses = (scene.leg.losses() + scene.controller.losses()) as u64;
    scene.end()?;
    place.assert_clean(&prefix)?;
    println!("\n{report}");
    println!(
        "{} blows in {:.0} s, none failed; {losses} losses said, each once; nothing is left",
        args.kills,
        begun.elapsed().as_secs_f64()
    );
    Ok(())
}

/// Where it happens.
struct Place {
    programs: Programs,
    folder: PathBuf,
}

impl Place {
    /// The program of a part, as it is started here.
    fn command(&self, part: Part) -> Command {
        let mut command = match part {
            Part::Leg => {
                let mut leg = self.programs.sim_host();
                leg.args(["run", "--on-fall", "restart", "--duration", "80000", "--timeout", "60"]);
                leg.args(["--set-point", "0.3"]);
                leg
            }
            Part::Controller => self.programs.controller(),
        };
        // So that what is seen is the processes and not the machine, where that is allowed.
        command.args(["--real-time", "--rt-priority", "20", "--domain", "chaos"]);
        command.env("TMPDIR", &self.folder);
        command
    }

    /// What the names of the domain's shared memory start with, as the names in
    /// its folder say.
    fn prefix(&self) -> Result<String> {
        let names = walk(&self.folder);
        let name = names
            .iter()
            .filter(|path| path.extension().is_some_and(|extension| extension == "service"))
            .find_map(|path| path.file_name()?.to_str()?.split_once('.'));
        let (prefix, _) = name.context("no service in the domain's folder")?;
        Ok(format!("{prefix}."))
    }

    fn assert_clean(&self, prefix: &str) -> Result<()> {
        let left = walk(&self.folder);
        ensure!(left.is_empty(), "left in the temporary folder: {left:?}");
        let left: Vec<_> = walk(Path::new("/dev/shm"))
            .into_iter()
            .filter(|path| {
                path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(prefix))
            })
            .collect();
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

/// The two, hopping.
struct Scene<'a> {
    place: &'a Place,
    leg: Actor,
    controller: Actor,
}

impl<'a> Scene<'a> {
    fn begin(place: &'a Place) -> Result<Self> {
        let controller = Actor::start(place.command(Part::Controller), Part::Controller)?;
        let leg = Actor::start(place.command(Part::Leg), Part::Leg)?;
        let scene = Self { place, leg, controller };
        // Both are there when the controller is told of a leg.
        let deadline = Instant::now() + PATIENCE;
        while scene.status()?["activity"] != "running" {
            ensure!(Instant::now() < deadline, "they do not begin to hop");
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(scene)
    }

    fn status(&self) -> Result<serde_json::Value> {
        let mut ask = self.place.programs.controller();
        ask.args(["status", "--json", "--domain", "chaos"]).env("TMPDIR", &self.place.folder);
        let output = ask.output().context("cannot start `controller status`")?;
        Ok(serde_json::from_slice(&output.stdout).unwrap_or_default())
    }

    /// The one that is struck, and the one that has to stand.
    fn parts(&mut self, victim: Part) -> (&mut Actor, &mut Actor) {
        match victim {
            Part::Leg => (&mut self.leg, &mut self.controller),
            Part::Controller => (&mut self.controller, &mut self.leg),
        }
    }

    fn strike(&mut self, blow: &Blow) -> Result<Incident> {
        let place = self.place;
        let (victim, witness) = self.parts(blow.victim);
        std::thread::sleep(blow.after);
        // The machine too may keep one of them from ticking.
        witness.wait_until(|word| !word.is_lost(), PATIENCE)?;
        victim.strike(blow.how)?;

        // The witness says so, once, and after how many ticks it was safe.
        let lost = witness.wait_until(Word::is_lost, PATIENCE)?.to_string();
        // One that is told that the run is over is safe in that very tick.
        let ticks = if lost.contains("is over") {
            0
        } else {
            number_before(&lost, " ticks").context("no ticks in its message")?
        };
        ensure!(
            ticks <= SAFE_WITHIN_TICKS,
            "the {} was safe after {ticks} ticks only: {lost}",
            witness.part()
        );
        std::thread::sleep(blow.gone);
        if let Some(after) = blow.killed_at_start.filter(|_| blow.how.ends()) {
            // Killed again while it starts; it may just have been heard, or not.
            victim.restart(place.command(blow.victim))?;
            std::thread::sleep(after);
            victim.strike(How::Kill)?;
            std::thread::sleep(SETTLED);
            witness.wait_until(Word::is_lost, PATIENCE)?;
        }
        let returned = match blow.how {
            How::Stop => victim.go_on()?,
            How::Kill | How::HangUp => victim.restart(place.command(blow.victim))?,
        };
        let Word::Heard(Some(back)) = witness.wait_until(|word| !word.is_lost(), PATIENCE)? else {
            bail!("the {} said nothing", witness.part());
        };
        let took = back.at.saturating_duration_since(returned);
        ensure!(took <= BACK_WITHIN, "it took the {} {took:?} to take it back", witness.part());
        witness.assert_same()?;
        Ok(Incident { blow: *blow, ticks, took })
    }

    /// What both have said last.
    fn said(&self) -> String {
        format!("{}\n{}", self.leg.tail(), self.controller.tail())
    }

    fn end(self) -> Result<()> {
        let Self { leg, controller, .. } = self;
        for actor in [leg, controller] {
            let part = actor.part();
            if !actor.end(PATIENCE)? {
                bail!("the {part} does not end when it is told to");
            }
        }
        Ok(())
    }
}
