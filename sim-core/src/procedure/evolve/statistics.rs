//! Statistics of a generation's scores.

use crate::base::score::Counts;
use crate::base::statistics::quantile;
use crate::procedure::values::{counted, number};
use crate::procedure::{SeriesRow, Value};

/// Name of the series.
pub(super) const SERIES: &str = "generations";

/// Returns a generation's row: statistics of the evaluations that succeeded (without values if all failed), and the
/// effort of all. Quartiles are defined as in [`quantile`].
pub(super) fn row(
    generation: u32,
    scores: &[Option<f64>],
    counts: Counts,
    best_so_far: Option<f64>,
    unit: &'static str,
) -> SeriesRow {
    let scored: Vec<f64> = scores.iter().flatten().copied().filter(|s| !s.is_nan()).collect();
    let mean = scored.iter().sum::<f64>() / scored.len() as f64;
    let of = |p: f64| quantile(&scored, p);
    let score = |name: &'static str, value: Option<f64>| Value { name: name.into(), unit: unit.into(), value };
    let mut values = vec![
        score("min", of(0.0)),
        score("lower_quartile", of(0.25)),
        score("median", of(0.5)),
        score("upper_quartile", of(0.75)),
        score("max", of(1.0)),
        score("mean", (!scored.is_empty()).then_some(mean)),
        score("best_so_far", best_so_far),
        number("failed", scores.iter().filter(|s| s.is_none()).count() as u64),
    ];
    values.extend(counted(&counts));
    SeriesRow { series: SERIES.into(), index: generation, values }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(row: &SeriesRow) -> Vec<Option<f64>> {
        row.values.iter().map(|value| value.value).collect()
    }

    #[test]
    fn quartiles_match_numpy() {
        let row = row(3, &[Some(4.0), None, Some(1.0), Some(2.0), Some(3.0)], Counts::default(), Some(9.0), "%");
        assert_eq!(values(&row)[..5], [1.0, 1.75, 2.5, 3.25, 4.0].map(Some));
        assert_eq!(
            (values(&row)[5], values(&row)[6], values(&row)[7], row.index),
            (Some(2.5), Some(9.0), Some(1.0), 3)
        );
        assert!(row.values[..7].iter().all(|value| value.unit == "%"));
    }

    #[test]
    fn statistics_without_success_have_no_values() {
        let row = row(0, &[None, None], Counts::default(), None, "%");
        assert_eq!(values(&row)[..7], [None; 7]);
        assert_eq!(values(&row)[7], Some(2.0));
    }
}
