//! The command `trainer compare`.

use super::eval::{MOST_STARTS, SEED};
use super::output::print;
use super::{Failure, failed, input};
use crate::config::{Parameter, Randomisation};
use crate::evaluate::compare::{AtDensity, Comparison, Paired, Verdict};
use crate::evaluate::intervals::{Estimate, FEWEST};
use crate::evaluate::tracking::Tracking;
use clap::Args;
use leg_control::policy::Policy;
use leg_process::policy_file::PolicyFile;
use leg_process::rounded;
use std::fmt::{self, Write};
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
#[command(after_help = "\
Every start runs with both policies. The intervals are at 95 %: Wilson's for a share,
Newcombe's (1998, method 10) for the difference of two shares, order statistics for a
median, and the normal interval for a mean. The p-values are those of McNemar's exact test,
of the sign test, and of the normal test of the mean difference. The verdicts are adjusted
for the eight density ratios (Holm), so that one table in twenty has a false alarm.

Number of starts: a survival of 0.998 against 0.997 is detected with probability 0.8 from
40,000 starts, or from 64,000 where only one density ratio differs; from fewer where both
fall from the same starts. 5,000 starts resolve 0.998 against 0.9946.")]
pub(super) struct Arguments {
    /// First policy file, A
    a: PathBuf,
    /// Second policy file, B
    b: PathBuf,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
    /// Number of random starts at each density ratio, from 100 to 1000000
    #[arg(
        long,
        default_value_t = 5000,
        value_parser = clap::value_parser!(u32).range(FEWEST as i64..=MOST_STARTS)
    )]
    starts: u32,
    /// Seed of the random starts
    #[arg(long, default_value_t = SEED)]
    seed: u64,
    /// Compare in worlds randomised as the table [randomisation] of this TOML file says: survival,
    /// stopping and reward. The file holds the table alone, or a configuration
    #[arg(long, value_name = "FILE")]
    randomisation: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let bytes = [&arguments.a, &arguments.b].map(|path| PolicyFile::read(path));
    let [a, b] = bytes;
    let (a, b) = (a.map_err(input)?, b.map_err(input)?);
    let (first, second) = (a.policy().map_err(input)?, b.policy().map_err(input)?);
    let starts = arguments.starts as usize;
    let randomisation = arguments.randomisation.as_deref().map(Randomisation::read).transpose();
    let randomisation = randomisation.map_err(input)?;
    let seed = arguments.seed;
    let comparison = Comparison::in_worlds(&first, &second, starts, seed, randomisation.as_ref());
    if arguments.json {
        return print(&comparison.to_json());
    }
    let who = description('A', &arguments.a, &first) + &description('B', &arguments.b, &second);
    print(&(who + &tables(&comparison).map_err(failed)?))
}

fn description(letter: char, path: &Path, policy: &Policy<'_>) -> String {
    let p = &policy.manifest().provenance;
    let (preset, seed, steps, crc) = (p.preset, p.seed, p.steps, policy.crc32());
    format!(
        "{letter}  {}: {preset}, seed {seed}, {steps} steps, CRC-32 {crc:08x}\n",
        path.display()
    )
}

/// A metric and how its table prints it.
struct MetricColumn {
    title: &'static str,
    digits: usize,
    of: fn(&AtDensity) -> Option<Paired>,
}

const METRICS: [MetricColumn; 3] = [
    MetricColumn {
        title: "Survival: share still hopping after 30 hops",
        digits: 4,
        of: |d| Some(d.survive30),
    },
    MetricColumn {
        title: "Stopping: median |v| after 30 hops, m/s; B - A: median of the differences, start by start",
        digits: 5,
        of: |d| d.abs_v_median,
    },
    MetricColumn { title: "Reward over 5 steps, mean", digits: 3, of: |d| Some(d.reward5) },
];

fn tables(c: &Comparison) -> Result<String, fmt::Error> {
    let mut text =
        format!("\nThe same {} starts for both at each density; 95 % intervals.\n", c.starts);
    if let Some(randomisation) = &c.randomisation {
        let keys: Vec<&str> = randomisation.parameters().map(Parameter::key).collect();
        writeln!(
            text,
            "Survival, stopping and reward in randomised worlds, the same for both: {}.",
            keys.join(", ")
        )?;
    }
    for metric in &METRICS {
        table(&mut text, metric, &c.densities)?;
    }
    speeds(&mut text, &c.max_speed)?;
    tracking(&mut text, c)?;
    let count = |verdict| c.metrics().filter(|f| f.verdict == verdict).count();
    write!(
        text,
        "\nOf {} lines from random starts: A better in {}, B better in {}, no significant difference in {}.",
        c.metrics().count(),
        count(Verdict::ABetter),
        count(Verdict::BBetter),
        count(Verdict::NoDifferenceSeen),
    )?;
    Ok(text)
}

fn words(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::ABetter => "A better",
        Verdict::BBetter => "B better",
        Verdict::NoDifferenceSeen => "no significant difference",
    }
}

fn table(text: &mut String, metric: &MetricColumn, densities: &[AtDensity]) -> fmt::Result {
    let digits = metric.digits;
    let plain =
        |e: Estimate| format!("{:.digits$} [{:.digits$}, {:.digits$}]", e.value, e.low, e.high);
    // Adding 0 turns -0 into 0.
    let round = |x: f64| format!("{:+.digits$}", rounded(x, digits));
    let signed = |e: Estimate| format!("{} [{}, {}]", round(e.value), round(e.low), round(e.high));
    writeln!(
        text,
        "\n{}\n{:>6}  {:>26}  {:>26}  {:>30}  {:>7}  verdict",
        metric.title, "rho", "A", "B", "B - A", "p"
    )?;
    for d in densities {
        let Some(f) = (metric.of)(d) else {
            writeln!(text, "{:>6}  too few survivors", d.rho)?;
            continue;
        };
        let (a, b, difference) = (plain(f.a), plain(f.b), signed(f.difference));
        let p = if f.p < 0.0001 { "<0.0001".into() } else { format!("{:.4}", f.p) };
        let verdict = words(f.verdict);
        writeln!(text, "{:>6}  {a:>26}  {b:>26}  {difference:>30}  {p:>7}  {verdict}", d.rho)?;
    }
    Ok(())
}

/// Writes the highest speeds, which are deterministic: every difference is real.
fn speeds(text: &mut String, by_density: &[(f64, [f64; 2])]) -> fmt::Result {
    text.push_str("\nHighest speed, m/s (the same every time)\n   rho       A       B    B - A\n");
    for &(rho, [a, b]) in by_density {
        let difference = rounded(b - a, 2);
        let verdict = match difference {
            d if d > 0.0 => "B faster",
            d if d < 0.0 => "A faster",
            _ => "equally fast",
        };
        writeln!(text, "{rho:>6}  {a:>6.2}  {b:>6.2}  {difference:>+7.2}  {verdict}")?;
    }
    Ok(())
}

fn tracking(text: &mut String, c: &Comparison) -> fmt::Result {
    let [a, b] = c.tracked;
    writeln!(
        text,
        "\nSet-points tracked, of {} with a known steady gait (the same every time): A {} ({} fell), B {} ({} fell)",
        a.possible, a.tracked, a.fell, b.tracked, b.fell
    )?;
    let cell = |t: &Tracking| match (t.mean_v, t.oscillation) {
        (Some(mean), Some(o)) => {
            let verdict = if t.tracked() { "tracked" } else { "not tracked" };
            format!("{:.3}+-{o:.3} {verdict}", rounded(mean, 3))
        }
        _ => "fell".into(),
    };
    for d in &c.tracking_differs {
        let (rho, set_point) = (d.a.rho, d.a.set_point);
        writeln!(text, "{rho:>6}  {set_point:>4} m/s:  A {}, B {}", cell(&d.a), cell(&d.b))?;
    }
    if c.tracking_differs.is_empty() {
        text.push_str("They do not differ at any of them.\n");
    }
    Ok(())
}
