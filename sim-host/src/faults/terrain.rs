//! Uneven ground.

use std::f64::consts::TAU;

use crate::faults::stage::FaultRng;

use leg_plant::Ground;

/// The shape of the ground; height 0 at x = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Terrain {
    /// Level steps of equal length at random heights.
    Steps(RandomTerrain),
    /// A constant grade, m/m.
    Slope(f64),
    /// A sine wave.
    Sine {
        /// From trough to crest, m.
        height_m: f64,
        /// From crest to crest, m.
        length_m: f64,
    },
    /// Linear interpolation between random heights.
    Rough(RandomTerrain),
}

/// Random heights at equal distances, determined by a seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RandomTerrain {
    /// Largest difference between two heights, m.
    pub height_m: f64,
    /// Distance between two heights, m.
    pub length_m: f64,
    /// Seed of the run.
    pub seed: u64,
}

impl RandomTerrain {
    /// Returns height number `i`, m; number 0 has height 0.
    fn height_m(&self, i: f64) -> f64 {
        if i == 0.0 {
            return 0.0;
        }
        // Each place has a sequence of its own, so a leg that returns finds the same ground. The
        // inverted seed keeps these sequences apart from those of the other faults.
        self.height_m * (FaultRng::new(!self.seed, (i as i64).cast_unsigned()).uniform() - 0.5)
    }
}

impl Ground for Terrain {
    fn height_m(&self, x_m: f64) -> f64 {
        match self {
            Self::Steps(random) => random.height_m((x_m / random.length_m).floor()),
            Self::Slope(grade) => grade * x_m,
            Self::Sine { height_m, length_m } => 0.5 * height_m * libm::sin(TAU * x_m / length_m),
            Self::Rough(random) => {
                let place = x_m / random.length_m;
                let i = place.floor();
                let [here_m, next_m] = [i, i + 1.0].map(|i| random.height_m(i));
                here_m + (next_m - here_m) * (place - i)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn random(seed: u64) -> RandomTerrain {
        RandomTerrain { height_m: 0.1, length_m: 0.5, seed }
    }

    #[test]
    fn slope_sine_and_steps_have_their_shapes() {
        assert_eq!(Terrain::Slope(0.25).height_m(-3.0), -0.75);
        let sine = Terrain::Sine { height_m: 0.2, length_m: 4.0 };
        assert!((sine.height_m(1.0) - 0.1).abs() < 1e-12 && sine.height_m(0.0) == 0.0);
        let steps = Terrain::Steps(random(1));
        assert_eq!(steps.height_m(0.51), steps.height_m(0.99));
        assert_ne!(steps.height_m(0.99), steps.height_m(1.01));
    }

    proptest! {
        #[test]
        fn random_ground_is_reproducible_bounded_and_zero_at_the_origin(
            seed in any::<u64>(), x_m in -1e3_f64..1e3
        ) {
            for terrain in [Terrain::Rough(random(seed)), Terrain::Steps(random(seed))] {
                prop_assert_eq!(terrain.height_m(x_m), terrain.height_m(x_m));
                prop_assert!(terrain.height_m(x_m).abs() <= 0.05);
                prop_assert_eq!(terrain.height_m(0.0), 0.0);
            }
            // The slope of a segment is at most the height over the length.
            let rough = Terrain::Rough(random(seed));
            let step_m = (rough.height_m(x_m + 1e-4) - rough.height_m(x_m)).abs();
            prop_assert!(step_m <= 0.1 / 0.5 * 1e-4 + 1e-12, "{}", step_m);
        }
    }
}
