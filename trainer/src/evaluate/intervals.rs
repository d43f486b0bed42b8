//! Confidence intervals and tests for the metrics of one policy from random starts, or of
//! two policies from the same starts.
//!
//! - A share: Wilson's score interval (Wilson 1927, JASA 22:209), which holds near 0
//!   and 1 too, where policies are.
//! - The difference of two shares from the same starts: Newcombe's interval
//!   (Newcombe 1998, Statistics in Medicine 17:2635, method 10), which puts Wilson's
//!   two together by the correlation of the pairs; tested exactly, after `McNemar`.
//! - A median: the interval between two order statistics, from the binomial
//!   distribution (David and Nagaraja 2003, Order Statistics, section 7.1); tested by
//!   the sign test. Neither supposes anything of the distribution.
//! - A mean: the normal interval of at least [`FEWEST`] values.
//! - Several tests at once: Holm's adjustment (Holm 1979, Scand. J. Statist. 6:65).

use serde::Serialize;

/// Confidence of every interval.
pub const CONFIDENCE: f64 = 0.95;
/// The standard normal's quantile at (1 + [`CONFIDENCE`]) / 2.
const Z: f64 = 1.959_963_984_540_054;
/// Fewest values for which the normal interval of a mean is used.
pub const FEWEST: usize = 100;

/// A value and its interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

/// Counts of paired yes-or-no outcomes: a two-by-two table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Pairs {
    /// Pairs with yes for both.
    pub both: u64,
    /// Pairs with yes for the first only.
    pub only_a: u64,
    /// Pairs with yes for the second only.
    pub only_b: u64,
    /// Pairs with yes for neither.
    pub neither: u64,
}

/// Returns Wilson's interval for a share of `yes` among `all`, which must not be 0.
#[must_use]
pub fn share(yes: u64, all: u64) -> Estimate {
    let (n, p) = (all as f64, yes as f64 / all as f64);
    let z2 = Z * Z;
    let middle = (p + z2 / (2.0 * n)) / (1.0 + z2 / n);
    let half = Z / (1.0 + z2 / n) * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt();
    // At 0 and 1 the ends are these exactly; rounding must not leave them out.
    Estimate { value: p, low: (middle - half).clamp(0.0, p), high: (middle + half).clamp(p, 1.0) }
}

impl Pairs {
    /// Returns the number of pairs.
    #[must_use]
    pub fn all(self) -> u64 {
        self.both + self.only_a + self.only_b + self.neither
    }

    /// Returns the share of yes of the first, with Wilson's interval.
    #[must_use]
    pub fn a(self) -> Estimate {
        share(self.both + self.only_a, self.all())
    }

    /// Returns the share of yes of the second, with Wilson's interval.
    #[must_use]
    pub fn b(self) -> Estimate {
        share(self.both + self.only_b, self.all())
    }

    /// Returns the second share minus the first, with Newcombe's interval.
    #[must_use]
    pub fn difference(self) -> Estimate {
        let (a, b, phi) = (self.a(), self.b(), self.correlation());
        let value = b.value - a.value;
        let together = |x: f64, y: f64| (x * x - 2.0 * phi * x * y + y * y).max(0.0).sqrt();
        Estimate {
            value,
            low: value - together(b.value - b.low, a.high - a.value),
            high: value + together(b.high - b.value, a.value - a.low),
        }
    }

    /// Of the pairs, corrected for continuity as Newcombe has it; 0 where it is not defined.
    fn correlation(self) -> f64 {
        let [e, f, g, h] = [self.both, self.only_a, self.only_b, self.neither].map(|n| n as f64);
        let product = (e + f) * (g + h) * (e + g) * (f + h);
        if product == 0.0 {
            return 0.0;
        }
        let cross = e * h - f * g;
        let corrected = if cross > 0.0 { (cross - (e + f + g + h) / 2.0).max(0.0) } else { cross };
        corrected / product.sqrt()
    }

    /// Returns the p-value of the exact test after `McNemar`, two-sided: the probability of
    /// pairs at least this unequal where both shares are equal.
    #[must_use]
    pub fn p(self) -> f64 {
        sign_test(self.only_a, self.only_b)
    }
}

/// Returns the p-value of the sign test, two-sided: the probability of counts at least this
/// unequal of two equally likely outcomes.
#[must_use]
pub fn sign_test(a: u64, b: u64) -> f64 {
    (2.0 * binomial_cdf(a.min(b), a + b)).min(1.0)
}

/// Returns the probability of at most `k` heads in `n` tosses of a fair coin.
fn binomial_cdf(k: u64, n: u64) -> f64 {
    let count = n as f64;
    // Terms more than 40 standard deviations below the mean are 0 in f64.
    let first = (count / 2.0 - 20.0 * count.sqrt()).max(0.0) as u64;
    let log_factorial = |n: u64| libm::lgamma(n as f64 + 1.0);
    let log_all = log_factorial(n) - count * std::f64::consts::LN_2;
    let probability = |k: u64| libm::exp(log_all - log_factorial(k) - log_factorial(n - k));
    (first..=k.min(n)).map(probability).sum()
}

/// Returns the median of ascending numbers, between the order statistics that bound it with
/// at least [`CONFIDENCE`]; `None` for fewer than six numbers, which cannot bound it.
#[must_use]
pub fn median(sorted: &[f64]) -> Option<Estimate> {
    let rank = rank(sorted.len() as u64)? as usize;
    Some(Estimate {
        value: super::survival::quantile(sorted, 0.5)?,
        low: sorted[rank - 1],
        high: sorted[sorted.len() - rank],
    })
}

/// Returns the rank, from 1, at which the values of this rank from either end bound the
/// median of the distribution of `n` values with [`CONFIDENCE`].
fn rank(n: u64) -> Option<u64> {
    let tail = (1.0 - CONFIDENCE) / 2.0;
    // Bisects for the largest count of values below the median within the tail.
    let (mut holds, mut fails) = (None, n / 2 + 1);
    let mut from = 0;
    while from < fails {
        let k = u64::midpoint(from, fails);
        if binomial_cdf(k, n) <= tail {
            holds = Some(k);
            from = k + 1;
        } else {
            fails = k;
        }
    }
    holds.map(|k| k + 1)
}

/// Returns the mean of at least [`FEWEST`] values with its normal interval, and the two-sided
/// p-value of a true mean of 0.
#[must_use]
pub fn mean(values: &[f64]) -> (Estimate, f64) {
    let n = values.len() as f64;
    let value = values.iter().sum::<f64>() / n;
    let squares = values.iter().map(|x| (x - value) * (x - value)).sum::<f64>();
    let error = (squares / (n - 1.0) / n).sqrt();
    let estimate = Estimate { value, low: value - Z * error, high: value + Z * error };
    let p = match (value == 0.0, error == 0.0) {
        (true, _) => 1.0,
        (false, true) => 0.0,
        (false, false) => libm::erfc((value / error).abs() / std::f64::consts::SQRT_2),
    };
    (estimate, p)
}

/// Adjusts the p-values of several tests after Holm, so that the probability of any false
/// alarm is no greater than that of a single test.
#[must_use]
pub fn holm(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).collect();
    order.sort_by(|&i, &j| p[i].total_cmp(&p[j]));
    let mut adjusted = vec![0.0; p.len()];
    let mut least: f64 = 0.0;
    for (done, &i) in order.iter().enumerate() {
        least = least.max((p.len() - done) as f64 * p[i]).min(1.0);
        adjusted[i] = least;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(estimate: Estimate, [value, low, high]: [f64; 3], within: f64) {
        let differences =
            [estimate.value - value, estimate.low - low, estimate.high - high].map(f64::abs);
        assert!(differences.iter().all(|&d| d <= within), "{estimate:?}");
    }

    #[test]
    fn wilsons_interval_matches_published_values() {
        // Newcombe 1998, Statistics in Medicine 17:857, table I, method 3.
        near(share(81, 263), [0.3080, 0.2553, 0.3662], 5e-5);
        near(share(15, 148), [0.1014, 0.0624, 0.1605], 5e-5);
        near(share(0, 20), [0.0, 0.0, 0.1611], 5e-5);
        near(share(1, 29), [0.0345, 0.0061, 0.1718], 5e-5);
        near(share(5000, 5000), [1.0, 5000.0 / (5000.0 + Z * Z), 1.0], 1e-12);
    }

    #[test]
    fn newcombes_interval_matches_published_values() {
        let pairs = |both, only_a, only_b, neither| Pairs { both, only_a, only_b, neither };
        // Newcombe 1998, Statistics in Medicine 17:2635, table III (there: A less B).
        near(pairs(36, 12, 2, 0).difference(), [-0.2, -0.3404, -0.0569], 5e-5);
        near(pairs(36, 2, 12, 0).difference(), [0.2, 0.0569, 0.3404], 5e-5);
        near(pairs(53, 0, 1, 0).difference(), [0.0185, -0.0496, 0.0977], 5e-5);
        // Computed once more, in Python, from the roots of the score equation.
        let shipped = [0.0016, -0.000_068_369_309_558, 0.003_493_425_671_496];
        near(pairs(4_970, 4, 12, 14).difference(), shipped, 1e-12);
        // Nothing differs.
        let same = pairs(100, 0, 0, 0).difference();
        assert!(same.value == 0.0 && same.low < 0.0 && same.high > 0.0, "{same:?}");
    }

    #[test]
    fn the_binomial_distribution_matches_exact_counts() {
        // C(14, 0) + C(14, 1) + C(14, 2) of 2^14.
        assert!((binomial_cdf(2, 14) - 106.0 / 16_384.0).abs() < 1e-14);
        assert!((sign_test(12, 2) - 212.0 / 16_384.0).abs() < 1e-14);
        assert_eq!((sign_test(0, 0), sign_test(3, 3)), (1.0, 1.0));
        // Of 10,001 coins, at most 5,000 heads.
        assert!((binomial_cdf(5_000, 10_001) - 0.5).abs() < 1e-8);
        assert!(sign_test(0, 1_000_000) < 1e-300);
    }

    #[test]
    fn the_ranks_of_the_median_match_published_tables() {
        // The usual table of 95 % intervals, such as Conover 1999, table A3.
        let tabled = [(6, 1), (8, 1), (9, 2), (10, 2), (15, 4), (20, 6), (25, 8), (100, 40)];
        for (n, k) in tabled {
            assert_eq!(rank(n), Some(k), "of {n}");
        }
        assert_eq!((rank(0), rank(5)), (None, None));
        let values: Vec<f64> = (1..=20).map(f64::from).collect();
        near(median(&values).unwrap(), [10.5, 6.0, 15.0], 0.0);
    }

    #[test]
    fn holms_adjustment_matches_a_worked_example() {
        let adjusted = holm(&[0.01, 0.04, 0.03, 0.005]);
        for (got, wanted) in adjusted.iter().zip([0.03, 0.06, 0.06, 0.02]) {
            assert!((got - wanted).abs() < 1e-12, "{adjusted:?}");
        }
        assert_eq!(holm(&[0.9, 1.0]), [1.0, 1.0]);
    }

    #[test]
    fn a_mean_has_its_normal_interval_and_p_value() {
        // Half of them 1, half 3: deviation sqrt(n / (n - 1)), error that by sqrt(n).
        let values: Vec<f64> = (0..100).map(|i| f64::from(1 + 2 * (i % 2))).collect();
        let error = 1.0 / 99.0_f64.sqrt();
        let (estimate, p) = mean(&values);
        near(estimate, [2.0, 2.0 - Z * error, 2.0 + Z * error], 1e-12);
        assert!(p < 1e-80);
        assert_eq!(mean(&[0.0; 100]).1, 1.0);
        // 1.96 errors off: one in twenty.
        let shifted: Vec<f64> = values.iter().map(|x| x - 2.0 + Z * error).collect();
        assert!((mean(&shifted).1 - 0.05).abs() < 1e-9);
    }
}
