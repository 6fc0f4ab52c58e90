//! What a generation's scores look like, in seven numbers.

use proto::v1::GenerationSealed;
use sim_core::base::score::Counts;

/// Statistics over the evaluations that did not fail; NaN if all did. Quartiles are interpolated linearly between the
/// sorted scores (Hyndman and Fan's type 7, the default of NumPy and R).
pub(super) fn statistics(
    generation: u32,
    scores: &[Option<f64>],
    counts: Counts,
    best_so_far: Option<f64>,
) -> GenerationSealed {
    let mut sorted: Vec<f64> = scores.iter().flatten().copied().filter(|s| !s.is_nan()).collect();
    let mean = sorted.iter().sum::<f64>() / sorted.len() as f64;
    sorted.sort_by(f64::total_cmp);
    GenerationSealed {
        generation,
        min: quantile(&sorted, 0.0),
        lower_quartile: quantile(&sorted, 0.25),
        median: quantile(&sorted, 0.5),
        upper_quartile: quantile(&sorted, 0.75),
        max: quantile(&sorted, 1.0),
        mean,
        best_so_far,
        failed: scores.iter().filter(|s| s.is_none()).count() as u32,
        counts: Some(counts.into()),
    }
}

fn quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let at = q * last as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    low + (high - low) * at.fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_are_those_of_numpy() {
        let s = statistics(3, &[Some(4.0), None, Some(1.0), Some(2.0), Some(3.0)], Counts::default(), Some(9.0));
        assert_eq!((s.min, s.lower_quartile, s.median, s.upper_quartile, s.max), (1.0, 1.75, 2.5, 3.25, 4.0));
        assert_eq!((s.mean, s.failed, s.generation, s.best_so_far), (2.5, 1, 3, Some(9.0)));
    }

    #[test]
    fn without_a_success_there_is_no_number() {
        let s = statistics(0, &[None, None], Counts::default(), None);
        assert!([s.min, s.lower_quartile, s.median, s.upper_quartile, s.max, s.mean].iter().all(|v| v.is_nan()));
        assert_eq!((s.failed, s.best_so_far), (2, None));
    }
}
