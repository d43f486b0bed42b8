//! The command `trainer env`.

use super::{Failure, failed, input};
use crate::config::{Config, MediumDraw};
use crate::environment::{Environment, Start};
use crate::preset::Preset;
use anyhow::anyhow;
use clap::Args;
use leg_plant::Apex;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::io::{BufRead, Write};

const PROTOCOL: &str = "\
The program answers each line by one line of values, separated by blanks:
  reset            VX Y RHO                  a new episode's first apex
  step ALPHA RS    VX Y RHO REWARD ENDED     the next apex, after this action
VX is in m/s, Y in m, RHO the density ratio; ALPHA in rad and RS in m/s are clipped to
the leg's range. VX, Y and RHO are what the actor observes, with the errors that the
preset randomises. ENDED is `no`, `fall` when the episode ended with a fall (no next
apex, given as 0 0, or one below 1 m), or `time` after its largest number of steps.

The answer to any other line, and to a step outside an episode, is `error` and the
reason; it changes nothing. A line may begin with a number, which its answer then begins
with, too. A line with the number of the one before is not carried out again: its answer
is repeated, so that a program that was interrupted can ask again.

Starts, densities and rewards are those of the preset's last stage. The same seed and
actions give the same lines. The program ends with its input; the exit status is 2 if
there was an error. trainer/bridges/hopper_env.py makes a Gymnasium environment of it.";

#[derive(Debug, Args)]
#[command(after_help = PROTOCOL)]
pub(super) struct Arguments {
    /// Preset whose starts, density ratios and rewards to use
    #[arg(long, default_value = "robust")]
    preset: Preset,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let config = arguments.preset.config();
    let mut server = Server::new(&config, arguments.seed);
    let mut output = std::io::stdout().lock();
    let mut first_error = None;
    let mut last: Option<(u64, String)> = None;
    for (line_number, line) in (1..).zip(std::io::stdin().lock().split(b'\n')) {
        let line = line.map_err(failed)?;
        let line = String::from_utf8_lossy(&line);
        let mut words: Vec<&str> = line.split_whitespace().collect();
        let number = words.first().and_then(|word| word.parse::<u64>().ok());
        if number.is_some() {
            words.remove(0);
        }
        let answer = match (&last, number) {
            (Some((before, answer)), Some(number)) if *before == number => answer.clone(),
            _ => server.answer(&words).unwrap_or_else(|why| {
                first_error.get_or_insert_with(|| format!("line {line_number}: {why}"));
                format!("error {why}")
            }),
        };
        let prefix = number.map_or_else(String::new, |number| format!("{number} "));
        let text = format!("{prefix}{answer}\n");
        output.write_all(text.as_bytes()).and_then(|()| output.flush()).map_err(failed)?;
        last = number.map(|number| (number, answer));
    }
    match first_error {
        None => Ok(()),
        Some(error) => Err(input(anyhow!("standard input, {error}"))),
    }
}

/// The environment behind the protocol.
struct Server<'a> {
    config: &'a Config,
    medium: &'a MediumDraw,
    seed: u64,
    rng: Pcg64,
    episode: u64,
    /// The episode that runs, and its steps until now.
    running: Option<(Environment<'a>, u32)>,
}

impl<'a> Server<'a> {
    fn new(config: &'a Config, seed: u64) -> Self {
        let medium = config.stages.last().map(|s| &s.medium).expect("a preset has stages");
        let rng = Pcg64::seed_from_u64(seed);
        Self { config, medium, seed, rng, episode: 0, running: None }
    }

    /// Answers a request; an error changes nothing.
    fn answer(&mut self, words: &[&str]) -> Result<String, String> {
        match words[..] {
            ["reset"] => {
                let start = Start::draw(self.config, self.medium, self.episode, &mut self.rng);
                let environment =
                    Environment::new(self.config, start).with_random_world(self.seed, self.episode);
                self.episode += 1;
                let answer = apex(&environment);
                self.running = Some((environment, 0));
                Ok(answer)
            }
            ["step", alpha, rs] => self.step([number(alpha)?, number(rs)?]),
            _ => Err(format!("'{}' is neither reset nor step ALPHA RS", words.join(" "))),
        }
    }

    fn step(&mut self, action: [f64; 2]) -> Result<String, String> {
        let Some((environment, steps)) = &mut self.running else {
            return Err("no episode has begun; reset first".into());
        };
        let outcome = environment.act(action);
        *steps += 1;
        let ended = match outcome.ended {
            true => "fall",
            false if *steps >= self.config.episode.max_steps => "time",
            false => "no",
        };
        let answer = format!("{} {} {ended}", apex(environment), outcome.reward);
        if ended != "no" {
            self.running = None;
        }
        Ok(answer)
    }
}

fn number(text: &str) -> Result<f64, String> {
    let finite = text.parse().ok().filter(|x: &f64| x.is_finite());
    finite.ok_or_else(|| format!("'{text}' is not a finite number"))
}

fn apex(environment: &Environment<'_>) -> String {
    let [vx_m_s, y_m, density_ratio] = match environment.apex() {
        // After a fall there is nothing to observe.
        Apex { vx_m_s, y_m: 0.0 } => [vx_m_s, 0.0, environment.density_ratio()],
        _ => environment.shown(),
    };
    format!("{vx_m_s} {y_m} {density_ratio}")
}
