//! Uneven ground.

use std::f64::consts::TAU;

use crate::faults::stage::Dice;

use leg_plant::Ground;

/// The shape of the ground; height 0 at x = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Terrain {
    /// Levels of one length, each at a height of its own.
    Steps(Drawn),
    /// Rising, or falling, at the same grade everywhere, m/m.
    Slope(f64),
    /// Waves.
    Sine {
        /// From trough to crest, m.
        height_m: f64,
        /// From crest to crest, m.
        length_m: f64,
    },
    /// Straight from one drawn height to the next.
    Rough(Drawn),
}

/// Heights drawn by seed, one every so many metres; as many as anybody walks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// From the lowest that may be to the highest, m.
    pub height_m: f64,
    /// From one to the next, m.
    pub length_m: f64,
    /// Of the run.
    pub seed: u64,
}

impl Drawn {
    /// The height number `i`; that of 0 is 0.
    fn height_m(&self, i: f64) -> f64 {
        if i == 0.0 {
            return 0.0;
        }
        // A sequence of its own for each place: walking back finds the same ground. Of
        // another seed than the other faults, whose sequences have numbers, too.
        self.height_m * (Dice::new(!self.seed, (i as i64).cast_unsigned()).unit() - 0.5)
    }
}

impl Ground for Terrain {
    fn height_m(&self, x_m: f64) -> f64 {
        match self {
            Self::Steps(drawn) => drawn.height_m((x_m / drawn.length_m).floor()),
            Self::Slope(grade) => grade * x_m,
            Self::Sine { height_m, length_m } => 0.5 * height_m * libm::sin(TAU * x_m / length_m),
            Self::Rough(drawn) => {
                let place = x_m / drawn.length_m;
                let i = place.floor();
                let [here_m, next_m] = [i, i + 1.0].map(|i| drawn.height_m(i));
                here_m + (next_m - here_m) * (place - i)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn drawn(seed: u64) -> Drawn {
        Drawn { height_m: 0.1, length_m: 0.5, seed }
    }

    #[test]
    fn the_ground_has_its_shape() {
        assert_eq!(Terrain::Slope(0.25).height_m(-3.0), -0.75);
        let sine = Terrain::Sine { height_m: 0.2, length_m: 4.0 };
        assert!((sine.height_m(1.0) - 0.1).abs() < 1e-12 && sine.height_m(0.0) == 0.0);
        let steps = Terrain::Steps(drawn(1));
        assert_eq!(steps.height_m(0.51), steps.height_m(0.99));
        assert_ne!(steps.height_m(0.99), steps.height_m(1.01));
    }

    proptest! {
        #[test]
        fn drawn_ground_is_the_same_again_within_its_height_and_starts_level(
            seed in any::<u64>(), x_m in -1e3_f64..1e3
        ) {
            for terrain in [Terrain::Rough(drawn(seed)), Terrain::Steps(drawn(seed))] {
                prop_assert_eq!(terrain.height_m(x_m), terrain.height_m(x_m));
                prop_assert!(terrain.height_m(x_m).abs() <= 0.05);
                prop_assert_eq!(terrain.height_m(0.0), 0.0);
            }
            // Straight pieces do not jump: at most the height over the length.
            let rough = Terrain::Rough(drawn(seed));
            let step_m = (rough.height_m(x_m + 1e-4) - rough.height_m(x_m)).abs();
            prop_assert!(step_m <= 0.1 / 0.5 * 1e-4 + 1e-12, "{}", step_m);
        }
    }
}
