//! Rank correlation and bootstrap intervals.

use serde::{Deserialize, Serialize};
use sim_core::base::random::Stream;
use sim_core::base::statistics::quantile;

/// Resamples of a bootstrap interval.
pub const RESAMPLES: u32 = 2000;

/// Statistic of a sample, with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Statistic of the original sample.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

/// Returns ranks from 1. Equal values share the mean of their ranks.
pub fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    while first < order.len() {
        let tied = order[first..].iter().take_while(|&&i| values[i] == values[order[first]]).count().max(1);
        for &i in &order[first..first + tied] {
            ranks[i] = first as f64 + (tied + 1) as f64 / 2.0;
        }
        first += tied;
    }
    ranks
}

/// Returns Spearman's rank correlation, computed as Pearson's correlation of the ranks, which is correct with ties too.
/// `None` for fewer than two pairs, or if all values of `x` or of `y` are equal.
///
/// # Panics
/// If the two slices differ in length.
pub fn spearman(x: &[f64], y: &[f64]) -> Option<f64> {
    assert_eq!(x.len(), y.len(), "a correlation needs as many values of x as of y");
    if x.len() < 2 {
        return None;
    }
    let (x, y) = (ranks(x), ranks(y));
    let mean = (x.len() + 1) as f64 / 2.0;
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
    let scale = (product(&x, &x) * product(&y, &y)).sqrt();
    (scale > 0.0).then(|| (product(&x, &y) / scale).clamp(-1.0, 1.0))
}

/// Returns `statistic` of a sample of size `n`, with its 95 % percentile bootstrap interval (Efron 1979) from
/// [`RESAMPLES`] resamples. `statistic` gets the indexes of the members of a resample, in which a member may occur
/// several times. Resamples for which it returns `None` are left out. Returns `None` if the statistic of the original
/// sample is `None`.
pub fn bootstrap(n: u32, stream: &mut Stream, statistic: impl Fn(&[usize]) -> Option<f64>) -> Option<Estimate> {
    let mut members: Vec<usize> = (0..n as usize).collect();
    let value = statistic(&members)?;
    let mut found = Vec::new();
    for _ in 0..RESAMPLES {
        members.iter_mut().for_each(|m| *m = stream.below(n) as usize);
        found.extend(statistic(&members));
    }
    Some(Estimate { value, low: quantile(&found, 0.025)?, high: quantile(&found, 0.975)? })
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::base::random::Purpose;
    use sim_core::base::statistics::median;

    fn stream(seed: u64) -> Stream {
        Stream::new(seed, Purpose::Bootstrap, 0, 0, 0)
    }

    #[test]
    fn equal_values_share_the_mean_of_their_ranks() {
        assert_eq!(ranks(&[10.0, 20.0, 20.0, 5.0]), [2.0, 3.5, 3.5, 1.0]);
        assert_eq!(ranks(&[1.0, 1.0, 1.0]), [2.0, 2.0, 2.0]);
    }

    /// Textbook example of the coefficient: IQ and hours of television, ρ = −29/165.
    #[test]
    fn spearman_matches_the_textbook_example() {
        let iq = [106.0, 100.0, 86.0, 101.0, 99.0, 103.0, 97.0, 113.0, 112.0, 110.0];
        let hours = [7.0, 27.0, 2.0, 50.0, 28.0, 29.0, 20.0, 12.0, 6.0, 17.0];
        assert!((spearman(&iq, &hours).unwrap() + 29.0 / 165.0).abs() < 1e-12);
    }

    #[test]
    fn spearman_uses_ranks_only_and_accepts_ties() {
        let x = [1.0, 2.0, 3.0, 4.0];
        assert_eq!(spearman(&x, &x.map(|v| v * v * v)), Some(1.0));
        assert_eq!(spearman(&x, &x.map(|v: f64| -v)), Some(-1.0));
        // Ranks 1, 2.5, 2.5, 4 against 1, 2, 3, 4: 4.5 / √(4.5 · 5).
        assert!((spearman(&[1.0, 2.0, 2.0, 3.0], &x).unwrap() - 4.5 / 22.5f64.sqrt()).abs() < 1e-12);
        assert_eq!(spearman(&[1.0; 4], &x), None);
        assert_eq!(spearman(&[1.0], &[2.0]), None);
    }

    /// The mean of n values is normally distributed with standard deviation σ / √n, so its 95 % interval is ± 1.96 σ /
    /// √n.
    #[test]
    fn bootstrap_interval_of_a_mean_matches_theory() {
        let n = 400;
        let mut draws = stream(1);
        let sample: Vec<f64> = (0..n).map(|_| 5.0 + 2.0 * draws.normal()).collect();
        let mean = |members: &[usize]| Some(members.iter().map(|&i| sample[i]).sum::<f64>() / members.len() as f64);
        let found = bootstrap(n, &mut stream(2), mean).unwrap();
        let average = sample.iter().sum::<f64>() / f64::from(n);
        let variance = sample.iter().map(|v| (v - average) * (v - average)).sum::<f64>() / f64::from(n);
        let half = 1.96 * (variance / f64::from(n)).sqrt();
        assert!((found.low - (average - half)).abs() < 0.1 * half, "{found:?}, {average} ± {half}");
        assert!((found.high - (average + half)).abs() < 0.1 * half, "{found:?}, {average} ± {half}");
        assert_eq!(found, bootstrap(n, &mut stream(2), mean).unwrap(), "the same stream must give the same interval");
    }

    /// A 95 % interval must contain the true value in about 95 of 100 trials.
    #[test]
    fn intervals_have_their_stated_coverage() {
        let covered = (0..200).filter(|&trial| {
            let mut draws = Stream::new(trial, Purpose::Sample, 0, 0, 0);
            let sample: Vec<f64> = (0..60).map(|_| draws.normal()).collect();
            let of = |members: &[usize]| median(&members.iter().map(|&i| sample[i]).collect::<Vec<_>>());
            let found = bootstrap(60, &mut stream(trial), of).unwrap();
            found.low <= 0.0 && 0.0 <= found.high
        });
        let share = covered.count();
        assert!((180..=199).contains(&share), "{share} of 200 intervals contain the true value: must be 180 to 199");
    }

    #[test]
    fn sample_without_a_value_has_no_estimate() {
        assert_eq!(bootstrap(3, &mut stream(1), |_| None), None);
        assert_eq!(bootstrap(0, &mut stream(1), |members| median(&vec![0.0; members.len()])), None);
    }
}
