//! The command `trainer env`.

use super::{Failure, failed, input};
use crate::environment::{Environment, Start};
use crate::preset::Preset;
use anyhow::anyhow;
use clap::Args;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::io::{BufRead, Write};

const PROTOCOL: &str = "\
The program answers each line by one line of values, separated by blanks:
  reset            VX Y RHO                  a new episode's first apex
  step ALPHA RS    VX Y RHO REWARD ENDED     the next apex, after this action
VX is in m/s, Y in m, RHO the density ratio; ALPHA in rad and RS in m/s are clipped to
the leg's range. ENDED is `no`, `fall` when the episode ended with a fall (no next
apex, given as 0 0, or one below 1 m), or `time` after its largest number of steps.

Starts, densities and rewards are those of the preset's last stage. The same seed and
actions give the same lines. The program ends with its input; the exit status is 2 after
a line of another form. trainer/bridges/hopper_env.py makes a Gymnasium environment of it.";

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
    let medium = config.stages.last().map(|s| s.medium.clone()).expect("a preset has stages");
    let mut rng = Pcg64::seed_from_u64(arguments.seed);
    let mut output = std::io::stdout().lock();
    let mut episode = 0;
    let mut running: Option<(Environment<'_>, u32)> = None;
    for (number, line) in (1..).zip(std::io::stdin().lock().lines()) {
        let line = line.map_err(failed)?;
        let wrong = |what: &str| input(anyhow!("standard input, line {number}: {what}"));
        let words: Vec<&str> = line.split_whitespace().collect();
        let answer = match words[..] {
            ["reset"] => {
                let start = Start::draw(&config, &medium, episode, &mut rng);
                let environment = Environment::new(&config, start);
                episode += 1;
                let answer = apex(&environment);
                running = Some((environment, 0));
                answer
            }
            ["step", alpha, rs] => {
                let number = |text: &str| {
                    let finite = text.parse().ok().filter(|x: &f64| x.is_finite());
                    finite.ok_or_else(|| wrong(&format!("'{text}' is not a finite number")))
                };
                let action = [number(alpha)?, number(rs)?];
                let (environment, steps) =
                    running.as_mut().ok_or_else(|| wrong("no episode has begun; reset first"))?;
                let outcome = environment.act(action);
                *steps += 1;
                let ended = match outcome.ended {
                    true => "fall",
                    false if *steps >= config.episode.max_steps => "time",
                    false => "no",
                };
                let answer = format!("{} {} {ended}", apex(environment), outcome.reward);
                if ended != "no" {
                    running = None;
                }
                answer
            }
            _ => return Err(wrong(&format!("'{line}' is neither reset nor step ALPHA RS"))),
        };
        writeln!(output, "{answer}").and_then(|()| output.flush()).map_err(failed)?;
    }
    Ok(())
}

fn apex(environment: &Environment<'_>) -> String {
    let apex = environment.apex();
    format!("{} {} {}", apex.vx_m_s, apex.y_m, environment.density_ratio())
}
