//! Order statistics, and confidence intervals of shares.

/// Returns the `p`-quantile, p from 0 to 1, linear between order statistics: definition 7 of Hyndman and Fan, Sample
/// quantiles in statistical packages (1996), which is the default of R and NumPy. `None` without values, or if one is
/// NaN.
pub fn quantile(values: &[f64], p: f64) -> Option<f64> {
    if values.is_empty() || values.iter().any(|v| v.is_nan()) {
        return None;
    }
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let place = p.clamp(0.0, 1.0) * (sorted.len() - 1) as f64;
    let below = libm::floor(place) as usize;
    let (low, high) = (sorted[below], sorted[(below + 1).min(sorted.len() - 1)]);
    // Equal neighbours may be infinite, and their difference would be NaN.
    Some(if low == high { low } else { low + (high - low) * (place - below as f64) })
}

/// Returns the median. `None` as for [`quantile`].
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// Returns the 95 % score interval of a share, of which `successes` of `n` were seen: Wilson, Probable inference, the
/// law of succession, and statistical inference (1927). Its ends are within 0 and 1; for n = 0 they are 0 and 1.
pub fn share_interval(successes: u32, n: u32) -> (f64, f64) {
    /// The 97.5 % quantile of the standard normal distribution.
    const Z: f64 = 1.959963984540054;
    if n == 0 {
        return (0.0, 1.0);
    }
    let (n, share) = (f64::from(n), f64::from(successes) / f64::from(n));
    let middle = share + Z * Z / (2.0 * n);
    let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
    let scale = 1.0 + Z * Z / n;
    // At the ends the bounds are exact, without rounding.
    let low = if successes == 0 { 0.0 } else { (middle - half) / scale };
    let high = if f64::from(successes) == n { 1.0 } else { (middle + half) / scale };
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn share_intervals_match_published_values() {
        // Newcombe, Interval estimation for the difference between independent proportions (1998), Table I of its
        // companion "Two-sided confidence intervals for the single proportion": 81/263, 15/148, 0/20, 1/29, by the
        // score method.
        for (successes, n, low, high) in
            [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)]
        {
            let (below, above) = share_interval(successes, n);
            assert!((below - low).abs() < 5e-5 && (above - high).abs() < 5e-5, "{successes}/{n}: {below} to {above}");
        }
        assert_eq!((share_interval(0, 0), share_interval(5, 5).1, share_interval(0, 50).0), ((0.0, 1.0), 1.0, 0.0));
    }

    #[test]
    fn quantiles_match_definition_7() {
        let values = [15.0, 20.0, 35.0, 40.0, 50.0];
        // R: quantile(c(15, 20, 35, 40, 50), c(.05, .25, .4, .5, .95, 1), type = 7)
        for (p, expected) in [(0.05, 16.0), (0.25, 20.0), (0.4, 29.0), (0.5, 35.0), (0.95, 48.0), (1.0, 50.0)] {
            let found = quantile(&values, p).unwrap();
            assert!((found - expected).abs() < 1e-12, "{p}: {found}");
        }
        assert_eq!(median(&[4.0, 1.0, 3.0, 2.0]), Some(2.5));
        assert_eq!(median(&[7.0]), Some(7.0));
        assert_eq!(median(&[1.0, f64::INFINITY, f64::INFINITY]), Some(f64::INFINITY));
        assert_eq!((median(&[]), median(&[1.0, f64::NAN])), (None, None));
    }
}
