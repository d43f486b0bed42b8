//! The models against their declared figures.

mod channels;
mod runs;
mod settings;

use super::*;

/// Returns the figures of a profile with settings as users write them.
fn figures(profile: SensorProfile, settings: &[&str]) -> Figures {
    let settings: Vec<SensorSetting> = settings.iter().map(|s| s.parse().unwrap()).collect();
    Figures::check(profile, &settings).unwrap()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn deviation(values: &[f64]) -> f64 {
    let middle = mean(values);
    mean(&values.iter().map(|value| (value - middle).powi(2)).collect::<Vec<_>>()).sqrt()
}
