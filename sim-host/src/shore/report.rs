//! The report of the demonstration, as a text table and as JSON.

use std::fmt;

use clap::ValueEnum as _;
use serde::Serialize;

use super::estimates::{EstimateSummary, Quantities};
use super::track::{ApexMark, Track};
use crate::sensors::SensorProfile;
use crate::session::RoundTripUs;

/// Result of the demonstration; its fields are the keys of the JSON output.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Profile of the leg's sensors.
    pub sensors: SensorProfile,
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
    /// Largest error of the density that the controller decided by.
    pub rho_error_max: f64,
    /// How the estimates fit the truth; none where the controller takes its readings for the
    /// state.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimates: Option<EstimateSummary>,
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
    /// Largest error of the density that the controller decided by.
    pub rho_error_max: f64,
    /// Root mean square of the errors of what the controller decided by.
    pub decision_error_rms: Quantities<f64>,
}

impl Region {
    fn over(apexes: &[&ApexMark]) -> Self {
        let mean = |f: &dyn Fn(&ApexMark) -> f64| {
            apexes.iter().map(|a| f(a)).sum::<f64>() / apexes.len().max(1) as f64
        };
        let errors: Vec<[f64; 3]> = apexes.iter().filter_map(|a| a.estimate_errors()).collect();
        let rms = |i: usize| {
            let squares = errors.iter().map(|error| error[i] * error[i]);
            (squares.sum::<f64>() / errors.len().max(1) as f64).sqrt()
        };
        Self {
            hops: apexes.len(),
            mean_v: mean(&|a| a.vx_m_s),
            tracking_error: mean(&ApexMark::error_m_s),
            rho_error_max: errors.iter().map(|error| error[2].abs()).fold(0.0, f64::max),
            decision_error_rms: Quantities { velocity: rms(0), height: rms(1), density: rms(2) },
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
        writeln!(f, "  error of what the controller decided by, rms")?;
        let rms = [water, shore, land].map(|region| region.decision_error_rms);
        row(f, "  velocity", "m/s", rms.map(|rms| rms.velocity))?;
        row(f, "  height", "m", rms.map(|rms| rms.height))?;
        row(f, "  density ratio", "", rms.map(|rms| rms.density))?;
        writeln!(f)?;
        let sensors = self.sensors.to_possible_value();
        let sensors = sensors.as_ref().map_or("", |value| value.get_name());
        match &self.estimates {
            None => {
                writeln!(
                    f,
                    "  sensors {sensors}: the controller takes its readings for the state"
                )?;
            }
            Some(EstimateSummary { within_two_sigma: share, .. }) => {
                let [velocity, height, density] =
                    [share.velocity, share.height, share.density].map(|share| 100.0 * share);
                writeln!(
                    f,
                    "  sensors {sensors}: in flight the estimate is within two of its standard \
                     deviations for\n  {velocity:.0} % (velocity), {height:.0} % (height), \
                     {density:.0} % (density) of the time"
                )?;
            }
        }
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
    use super::super::track::Decision;
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
            decision: Some(Decision { vx_m_s, y_m: 1.5, density_ratio: density_ratio + 0.01 }),
        };
        let apexes = vec![apex(1.0, 0.5), apex(1.0, 1.5), apex(0.4, 0.9), apex(0.0, 1.0)];
        let regions = Regions::of(&Track { apexes, ..Track::default() });
        assert_eq!([regions.water.hops, regions.shore.hops, regions.land.hops], [2, 1, 1]);
        assert_eq!(regions.water.mean_v, 1.0);
        assert_eq!(regions.water.tracking_error, 0.5);
        assert!((regions.shore.rho_error_max - 0.01).abs() < 1e-12);
        assert_eq!(regions.land.tracking_error, 0.0);
        let rms = regions.water.decision_error_rms;
        assert_eq!((rms.velocity, rms.height), (0.0, 0.5));
    }
}
