//! Values that several procedures tell.

use super::Value;
use crate::base::score::Counts;

/// Effort of evaluations, a value for each count.
pub(super) fn counted(counts: &Counts) -> [Value; 6] {
    let milliseconds = Value { unit: "ms".into(), ..number("simulated_ms", counts.simulated_ms) };
    [
        number("rollouts", counts.rollouts),
        number("unstable", counts.unstable),
        milliseconds,
        number("edges", counts.edges),
        number("rejected", counts.rejected),
        number("nodes", counts.nodes),
    ]
}

/// A whole number with a name.
pub(super) fn number(name: &'static str, value: u64) -> Value {
    Value { name: name.into(), unit: "".into(), value: Some(value as f64) }
}
