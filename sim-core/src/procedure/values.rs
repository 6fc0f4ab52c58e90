//! Values in the progress and rows of several procedures.

use super::Value;
use crate::base::score::Counts;

/// Returns the effort of evaluations, one value for each count.
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

/// Makes a named value of a whole number.
pub(super) fn number(name: &'static str, value: u64) -> Value {
    Value { name: name.into(), unit: "".into(), value: Some(value as f64) }
}
