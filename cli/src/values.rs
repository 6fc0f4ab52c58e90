//! Named numbers that a coordinator sends with a job and with its sealed rounds.

use proto::v1;
use proto::v1::job_event::Event;
use sim_core::base::score::Counts;

/// Returns the number with a name; `None` if it is missing.
pub fn number(values: &[v1::Value], name: &str) -> Option<f64> {
    values.iter().find(|value| value.name == name)?.value
}

/// Returns the whole number with a name; 0 if it is missing.
pub fn count(values: &[v1::Value], name: &str) -> u64 {
    number(values, name).map_or(0, |value| value as u64)
}

/// Returns the counts of evaluations.
pub fn counts(values: &[v1::Value]) -> Counts {
    let of = |name| count(values, name);
    Counts {
        rollouts: of("rollouts"),
        unstable: of("unstable"),
        simulated_ms: of("simulated_ms"),
        edges: of("edges"),
        rejected: of("rejected"),
        nodes: of("nodes"),
    }
}

/// Returns the progress of a job; all zero if it has none.
pub fn progress(job: &v1::Job) -> v1::Progress {
    job.progress.clone().unwrap_or_default()
}

/// Sealed generation of a search. Its statistics are NaN if all its evaluations failed.
#[derive(Clone, Debug, PartialEq)]
pub struct Generation {
    /// Index of the generation, from 0.
    pub generation: u32,
    /// Least score.
    pub min: f64,
    /// First quartile.
    pub lower_quartile: f64,
    /// Median of the scores.
    pub median: f64,
    /// Third quartile.
    pub upper_quartile: f64,
    /// Greatest score.
    pub max: f64,
    /// Mean of the scores.
    pub mean: f64,
    /// Best score of this and all earlier generations; `None` while all evaluations have failed.
    pub best_so_far: Option<f64>,
    /// Number of failed evaluations.
    pub failed: u32,
    /// Sums of the counts of its evaluations.
    pub counts: Counts,
}

impl Generation {
    /// Converts a row; `None` for a row of another series.
    pub fn of(row: &v1::Row) -> Option<Self> {
        let score = |name| number(&row.values, name).unwrap_or(f64::NAN);
        (row.series == "generations").then(|| Self {
            generation: row.index,
            min: score("min"),
            lower_quartile: score("lower_quartile"),
            median: score("median"),
            upper_quartile: score("upper_quartile"),
            max: score("max"),
            mean: score("mean"),
            best_so_far: number(&row.values, "best_so_far"),
            failed: count(&row.values, "failed") as u32,
            counts: counts(&row.values),
        })
    }

    /// Returns the generation that an event seals, if any.
    pub fn sealed(event: &v1::JobEvent) -> Option<Self> {
        match &event.event {
            Some(Event::RoundSealed(sealed)) => sealed.row.as_ref().and_then(Self::of),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(name: &str, value: Option<f64>) -> v1::Value {
        v1::Value { name: name.to_owned(), unit: String::new(), value }
    }

    #[test]
    fn row_of_other_series_is_not_a_generation() {
        let row = |series: &str| v1::Row { series: series.to_owned(), index: 3, values: Vec::new() };
        assert_eq!(Generation::of(&row("plans")), None);
        assert_eq!(Generation::of(&row("generations")).map(|g| g.generation), Some(3));
    }

    #[test]
    fn missing_numbers_are_nan_or_none() {
        let values = vec![value("min", None), value("max", Some(-0.0)), value("failed", Some(4.0))];
        let row = v1::Row { series: "generations".to_owned(), index: 0, values };
        let generation = Generation::of(&row).expect("a generation");
        assert!(generation.min.is_nan() && generation.mean.is_nan() && generation.best_so_far.is_none());
        assert_eq!((generation.max.to_bits(), generation.failed), ((-0.0f64).to_bits(), 4));
    }
}
