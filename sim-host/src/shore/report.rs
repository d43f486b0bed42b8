//! The report of the demonstration, as a text table and as JSON.

use super::track::{ApexMark, Track};
use crate::session::RoundTripUs;
use serde::Serialize;
use std::fmt;

/// Result of the demonstration; its fields are the keys of the JSON output.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Falls, 0 or 1: the run ends at a fall.
    pub falls: u32,
    /// Number of apexes.
    pub hops: usize,
    /// Distance from start to end, m.
    pub distance_m: f64,
    /// Density ratio where the run ended.
    pub end_rho: f64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Ticks played.
    pub ticks: u64,
    /// Ticks per second of wall time.
    pub ticks_per_s: f64,
    /// From sending a sample to receiving its command, us.
    pub round_trip_us: RoundTripUs,
    /// Mean absolute error of the apex velocity, m/s.
    pub tracking: Regions<f64>,
    /// Results in each region.
    pub regions: Regions<Region>,
    /// Largest error of the density estimate at an apex.
    pub rho_error_max: f64,
    /// Hash of all states and commands of the run.
    pub state_hash: String,
}

/// A value for each region: water, shore and land.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Regions<T> {
    /// Where the density ratio is 1.
    pub water: T,
    /// Where it is between 0 and 1.
    pub shore: T,
    /// Where it is 0.
    pub land: T,
}

/// Results in a region.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Region {
    /// Number of apexes.
    pub hops: usize,
    /// Mean velocity at the apexes, m/s.
    pub mean_v: f64,
    /// Mean absolute error of the velocity, m/s.
    pub tracking_error: f64,
    /// Largest error of the density estimate.
    pub rho_error_max: f64,
}

impl Region {
    fn over(apexes: &[&ApexMark]) -> Self {
        let mean = |f: &dyn Fn(&ApexMark) -> f64| {
            apexes.iter().map(|a| f(a)).sum::<f64>() / apexes.len().max(1) as f64
        };
        Self {
            hops: apexes.len(),
            mean_v: mean(&|a| a.vx_m_s),
            tracking_error: mean(&ApexMark::error_m_s),
            rho_error_max: apexes.iter().map(|a| a.density_error()).fold(0.0, f64::max),
        }
    }
}

impl Regions<Region> {
    /// Returns the tracking error in each region, m/s.
    #[must_use]
    pub fn tracking(&self) -> Regions<f64> {
        Regions {
            water: self.water.tracking_error,
            shore: self.shore.tracking_error,
            land: self.land.tracking_error,
        }
    }

    /// Assigns each apex of a run to the region of its density.
    #[must_use]
    pub fn of(track: &Track) -> Self {
        let within = |is_there: fn(f64) -> bool| {
            let there: Vec<_> = track.apexes.iter().filter(|a| is_there(a.density_ratio)).collect();
            Region::over(&there)
        };
        Self {
            water: within(|rho| rho >= 1.0),
            shore: within(|rho| 0.0 < rho && rho < 1.0),
            land: within(|rho| rho <= 0.0),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Regions { water, shore, land } = &self.regions;
        let row = |f: &mut fmt::Formatter<'_>, name: &str, unit: &str, values: [f64; 3]| {
            let [w, s, l] = values;
            writeln!(f, "  {name:<26}{w:>9.4}{s:>9.4}{l:>9.4}  {unit}")
        };
        writeln!(f, "  {:<26}{:>9}{:>9}{:>9}", "", "water", "shore", "land")?;
        writeln!(f, "  {:<26}{:>9}{:>9}{:>9}", "hops", water.hops, shore.hops, land.hops)?;
        row(f, "mean velocity", "m/s", [water.mean_v, shore.mean_v, land.mean_v])?;
        let errors = [water.tracking_error, shore.tracking_error, land.tracking_error];
        row(f, "mean |v - set-point|", "m/s", errors)?;
        let rho_errors = [water.rho_error_max, shore.rho_error_max, land.rho_error_max];
        row(f, "density estimate, max error", "", rho_errors)?;
        writeln!(f)?;
        let RoundTripUs { p50, p99, max, .. } = self.round_trip_us;
        let Self { falls, hops, distance_m, sim_time_s, ticks, ticks_per_s, state_hash, .. } = self;
        writeln!(f, "  {hops} hops, {falls} falls, {distance_m:.2} m in {sim_time_s:.1} s")?;
        writeln!(f, "  {ticks} ticks, {ticks_per_s:.0} a second")?;
        writeln!(f, "  tick round trip: p50 {p50:.1} us, p99 {p99:.1} us, max {max:.0} us")?;
        write!(f, "  state hash {state_hash}: the same in every run")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn assigns_each_apex_to_the_region_of_its_density() {
        let apex = |density_ratio, vx_m_s| ApexMark {
            t_s: 0.0,
            x_m: 0.0,
            y_m: 2.0,
            vx_m_s,
            set_point_m_s: 1.0,
            density_ratio,
            density_estimate: density_ratio + 0.01,
        };
        let apexes = vec![apex(1.0, 0.5), apex(1.0, 1.5), apex(0.4, 0.9), apex(0.0, 1.0)];
        let regions = Regions::of(&Track { apexes, ..Track::default() });
        assert_eq!([regions.water.hops, regions.shore.hops, regions.land.hops], [2, 1, 1]);
        assert_eq!(regions.water.mean_v, 1.0);
        assert_eq!(regions.water.tracking_error, 0.5);
        assert!((regions.shore.rho_error_max - 0.01).abs() < 1e-12);
        assert_eq!(regions.land.tracking_error, 0.0);
    }
}
