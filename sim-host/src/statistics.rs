//! Confidence intervals of shares, and of the difference of two shares.

/// The standard normal's quantile at 97.5 %.
const Z: f64 = 1.959_963_984_540_054;

/// Returns Wilson's 95 % interval for a share of `yes` among `all` (Wilson, JASA 22, 1927).
#[must_use]
pub fn wilson(yes: u64, all: u64) -> [f64; 2] {
    let n = all.max(1) as f64;
    let share = yes as f64 / n;
    let scale = 1.0 / (1.0 + Z * Z / n);
    let middle = scale * (share + Z * Z / (2.0 * n));
    let half = scale * Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
    [(middle - half).max(0.0), (middle + half).min(1.0)]
}

/// Returns the bounds within which the mean of `n` squares of standard normal numbers lies in 95 %
/// of the cases: the quantiles of chi-square over its degrees of freedom, by the cube of Wilson and
/// Hilferty (PNAS 17:684, 1931), within 0.01 from 10 numbers on.
#[must_use]
pub fn mean_square_bounds(n: u64) -> [f64; 2] {
    let spread = 2.0 / (9.0 * n.max(1) as f64);
    [-Z, Z].map(|z| (1.0 - spread + z * spread.sqrt()).max(0.0).powi(3))
}

/// Counts of paired yes-or-no outcomes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pairs {
    /// Pairs with yes for both.
    pub both: u64,
    /// Pairs with yes for the first only.
    pub only_first: u64,
    /// Pairs with yes for the second only.
    pub only_second: u64,
    /// Pairs with yes for neither.
    pub neither: u64,
}

impl Pairs {
    /// Returns Newcombe's 95 % interval for the first share less the second (Statistics in Medicine
    /// 17:2635, 1998, method 10).
    #[must_use]
    pub fn difference(self) -> [f64; 2] {
        let all = self.both + self.only_first + self.only_second + self.neither;
        let (first, second) = (self.both + self.only_first, self.both + self.only_second);
        by_correlation([first, all], [second, all], self.correlation())
    }

    /// Returns the correlation of the pairs, corrected for continuity as Newcombe has it; 0 where
    /// it is not defined.
    fn correlation(self) -> f64 {
        let [e, f, g, h] =
            [self.both, self.only_first, self.only_second, self.neither].map(|n| n as f64);
        let product = (e + f) * (g + h) * (e + g) * (f + h);
        if product == 0.0 {
            return 0.0;
        }
        let cross = e * h - f * g;
        let corrected = if cross > 0.0 { (cross - (e + f + g + h) / 2.0).max(0.0) } else { cross };
        corrected / product.sqrt()
    }
}

/// Returns Newcombe's 95 % interval for the difference of two shares from unrelated runs, each
/// given as its counts of yes and of all (Statistics in Medicine 17:873, 1998, method 10).
#[must_use]
pub fn unpaired_difference(first: [u64; 2], second: [u64; 2]) -> [f64; 2] {
    by_correlation(first, second, 0.0)
}

fn by_correlation(first: [u64; 2], second: [u64; 2], phi: f64) -> [f64; 2] {
    let [a, b] = [first, second].map(|[yes, all]| yes as f64 / all.max(1) as f64);
    let [[a_low, a_high], [b_low, b_high]] = [first, second].map(|[yes, all]| wilson(yes, all));
    let together = |x: f64, y: f64| (x * x - 2.0 * phi * x * y + y * y).max(0.0).sqrt();
    [a - b - together(a - a_low, b_high - b), a - b + together(a_high - a, b - b_low)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near([low, high]: [f64; 2], expected: [f64; 2]) {
        assert!(
            (low - expected[0]).abs() < 5e-5 && (high - expected[1]).abs() < 5e-5,
            "{low} {high}"
        );
    }

    /// Values of Newcombe, Statistics in Medicine 17:857 (1998), table I, method 3.
    #[test]
    fn the_bounds_of_a_mean_square_are_those_of_chi_square() {
        // Quantiles of chi-square at 2.5 % and 97.5 % over the degrees of freedom, from tables.
        for (n, low, high) in [(10, 0.3247, 2.0483), (20, 0.4796, 1.7085), (200, 0.8136, 1.2053)] {
            let [from, to] = mean_square_bounds(n);
            assert!((from - low).abs() < 0.01 && (to - high).abs() < 0.01, "{n}: {from} to {to}");
        }
    }

    #[test]
    fn wilsons_interval_matches_published_values() {
        for (yes, all, low, high) in
            [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611)]
        {
            near(wilson(yes, all), [low, high]);
        }
    }

    /// Values of Newcombe, Statistics in Medicine 17:2635 (1998), table III, and 17:873 (1998),
    /// table II, method 10.
    #[test]
    fn newcombes_intervals_match_published_values() {
        let pairs = |both, only_first, only_second, neither| {
            Pairs { both, only_first, only_second, neither }.difference()
        };
        near(pairs(36, 12, 2, 0), [0.0569, 0.3404]);
        near(pairs(36, 2, 12, 0), [-0.3404, -0.0569]);
        near(pairs(53, 1, 0, 0), [-0.0496, 0.0977]);
        near(unpaired_difference([56, 70], [48, 80]), [0.0524, 0.3339]);
        near(unpaired_difference([9, 10], [3, 10]), [0.1705, 0.8090]);
        let same = pairs(100, 0, 0, 0);
        assert!(same[0] < 0.0 && same[1] > 0.0, "{same:?}");
    }
}
