//! The evaluation of a policy, as data, as JSON and as tables.

use super::conditions::{Condition, ConditionResult, Extent};
use super::randomised::{Row, Table};
use super::survival::{Survival, draw_starts, survival};
use super::tracking::{
    RAMP_CAP_M_S, RAMP_LAG_LIMIT_M_S, SET_POINTS, Tracking, highest_speeds, tracking_table,
};
use super::{DENSITIES, hopper};
use leg_control::policy::Policy;
use leg_process::rounded;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::Serialize;
use serde_json::{Map, Value};
use std::fmt;

/// The evaluation of a policy.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Survival by density ratio, lowest first.
    pub survival: Vec<(f64, Survival)>,
    /// Tracking of every set-point at every density ratio.
    pub tracking: Vec<Tracking>,
    /// Highest speed by density ratio, m/s.
    pub max_speed: Vec<(f64, f64)>,
    /// Survival with other legs and other gravity.
    pub conditions: Vec<ConditionResult>,
    /// Survival in randomised worlds; empty where none was asked for.
    pub randomised: Vec<Row>,
}

/// The JSON form of a report, keyed by density ratio.
#[derive(Serialize)]
struct Json<'a> {
    survive30: Value,
    abs_v_median: Value,
    abs_v_p95: Value,
    reward5: Value,
    tracking: &'a [Tracking],
    max_speed: Value,
    conditions: &'a [ConditionResult],
    #[serde(skip_serializing_if = "Vec::is_empty")]
    randomised: Vec<Value>,
}

pub(super) fn keyed<T: Copy, V: Into<Value>>(by_density: &[(f64, T)], f: impl Fn(T) -> V) -> Value {
    let entries = by_density.iter().map(|&(rho, x)| (rho.to_string(), f(x).into()));
    Value::Object(entries.collect::<Map<_, _>>())
}

impl Report {
    /// Evaluates `policy` from the same `starts` random starts at each density ratio and
    /// in each condition of [`Extent::Land`]. `seed` is that of the starts.
    #[must_use]
    pub fn new(policy: &Policy<'_>, starts: usize, seed: u64) -> Self {
        Self::of(policy, starts, seed, Extent::default())
    }

    /// Evaluates `policy` as [`Self::new`] does, in the conditions of `extent`.
    #[must_use]
    pub fn of(policy: &Policy<'_>, starts: usize, seed: u64, extent: Extent) -> Self {
        let starts = draw_starts(starts, &mut Pcg64::seed_from_u64(seed));
        let (actor, gains) = (policy.actor(), &policy.manifest().gains);
        Self {
            survival: DENSITIES
                .map(|rho| (rho, survival(actor, &hopper(rho), rho, &starts)))
                .to_vec(),
            tracking: tracking_table(actor, gains),
            max_speed: highest_speeds(actor, gains),
            conditions: Condition::all(extent).into_iter().map(|c| c.run(actor, &starts)).collect(),
            randomised: Vec::new(),
        }
    }

    /// Returns the report as one JSON object.
    ///
    /// # Panics
    /// Never: every number has a JSON form.
    #[must_use]
    pub fn to_json(&self) -> String {
        let json = Json {
            survive30: keyed(&self.survival, |s| s.survive30),
            abs_v_median: keyed(&self.survival, |s| s.abs_v_median),
            abs_v_p95: keyed(&self.survival, |s| s.abs_v_p95),
            reward5: keyed(&self.survival, |s| s.reward5),
            tracking: &self.tracking,
            max_speed: keyed(&self.max_speed, |v| v),
            conditions: &self.conditions,
            randomised: self.randomised.iter().map(Row::to_json).collect(),
        };
        serde_json::to_string(&json).expect("numbers have a JSON form")
    }
}

impl Report {
    fn write_friction(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "\nFriction that these hops need of the ground: horizontal over vertical force of the foot"
        )?;
        writeln!(f, "   rho{}", SET_POINTS.map(|v| format!("  {v:>6}")).concat())?;
        for row in self.tracking.chunks(SET_POINTS.len()) {
            write!(f, "{:>6}", row[0].rho)?;
            for t in row {
                write!(f, "  {:>6}", number(t.friction, 2))?;
            }
            writeln!(f)?;
        }
        Ok(())
    }

    fn write_conditions(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "\nOther legs and gravity, from the same starts (80 kg, 20000 N/m, earth unless stated):"
        )?;
        writeln!(f, "                rho  survive30  median |v|    95 % |v|  reward, 5 steps")?;
        for ConditionResult { condition, survival: s } in &self.conditions {
            let (median, p95) = (number(s.abs_v_median, 5), number(s.abs_v_p95, 5));
            writeln!(
                f,
                "{:<13}  {:>4}  {:>9.4}  {median:>10}  {p95:>10}  {:>15.2}",
                condition.change.to_string(),
                condition.rho,
                s.survive30,
                s.reward5
            )?;
        }
        Ok(())
    }
}

/// Formats a value; `-` where there is none.
pub(super) fn number(x: Option<f64>, digits: usize) -> String {
    x.map_or_else(|| "-".into(), |x| format!("{x:.digits$}"))
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let starts = self.survival.first().map_or(0, |(_, s)| s.starts);
        writeln!(f, "From {starts} starts at each density, 30 hops, m/s:")?;
        writeln!(f, "   rho  survive30  median |v|    95 % |v|  reward, 5 steps  highest speed")?;
        for ((rho, s), (_, speed)) in self.survival.iter().zip(&self.max_speed) {
            let (median, p95) = (number(s.abs_v_median, 5), number(s.abs_v_p95, 5));
            writeln!(
                f,
                "{rho:>6}  {:>9.4}  {median:>10}  {p95:>10}  {:>15.2}  {speed:>13.2}",
                s.survive30, s.reward5
            )?;
        }
        writeln!(f, "Highest speed: target raised 0.05 m/s every 10 hops until the leg falls,")?;
        writeln!(
            f,
            "at most to {RAMP_CAP_M_S} m/s or {RAMP_LAG_LIMIT_M_S} m/s over the best mean of 10 whole hops,\n\
             which is the highest speed.\n"
        )?;
        writeln!(f, "Tracking, 100 hops from (0, 2 m): mean +- half range over the last 20, m/s")?;
        writeln!(f, "(* tracked: mean within 2 %, half range within 5 %; . no steady gait known)")?;
        write!(f, "   rho")?;
        for v in SET_POINTS {
            write!(f, "  {v:>15}")?;
        }
        writeln!(f)?;
        for row in self.tracking.chunks(SET_POINTS.len()) {
            write!(f, "{:>6}", row[0].rho)?;
            for t in row {
                let mark = match (t.tracked(), t.possible()) {
                    (true, _) => '*',
                    (false, true) => ' ',
                    (false, false) => '.',
                };
                let cell = match (t.mean_v, t.oscillation) {
                    (Some(mean), Some(o)) => format!("{:.3}+-{o:.3}{mark}", rounded(mean, 3)),
                    _ => format!("fell{mark}"),
                };
                write!(f, "  {cell:>15}")?;
            }
            writeln!(f)?;
        }
        let possible: Vec<&Tracking> = self.tracking.iter().filter(|t| t.possible()).collect();
        let tracked = possible.iter().filter(|t| t.tracked()).count();
        let fell = possible.iter().filter(|t| t.fell).count();
        writeln!(
            f,
            "Tracked: {tracked} of the {} set-points with a known steady gait; {fell} fell.",
            possible.len()
        )?;
        self.write_friction(f)?;
        self.write_conditions(f)?;
        if self.randomised.is_empty() { Ok(()) } else { write!(f, "\n{}", Table(&self.randomised)) }
    }
}
