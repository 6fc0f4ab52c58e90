//! Order statistics.

/// The `p`-quantile, p from 0 to 1, linear between order statistics: definition 7 of Hyndman and Fan, Sample quantiles in
/// statistical packages (1996), which is the default of R and NumPy. `None` without values, or if one is NaN.
pub fn quantile(values: &[f64], p: f64) -> Option<f64> {
    if values.is_empty() || values.iter().any(|v| v.is_nan()) {
        return None;
    }
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let place = p.clamp(0.0, 1.0) * (sorted.len() - 1) as f64;
    let below = libm::floor(place) as usize;
    let (low, high) = (sorted[below], sorted[(below + 1).min(sorted.len() - 1)]);
    // Equal neighbours may be infinite: their difference is none.
    Some(if low == high { low } else { low + (high - low) * (place - below as f64) })
}

/// The middle value. `None` as for [`quantile`].
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_definition_7() {
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
