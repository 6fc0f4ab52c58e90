//! Candidates in, scores out: what a worker does.

use crate::job::Job;
use crate::score::{Evaluation, Genome};

/// The caller asked to stop before the work was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped before the work was done")]
pub struct Stopped;

/// Scores candidates of one generation, given as (index in the generation, genome). What a candidate scores does not
/// depend on which others are in the batch. `stop` is asked now and then; once true, the work is given up.
///
/// # Panics
/// If a genome's length does not fit the job.
pub fn evaluate(
    _job: &Job,
    _generation: u32,
    _candidates: &[(u32, Genome)],
    _stop: &dyn Fn() -> bool,
) -> Result<Vec<Evaluation>, Stopped> {
    todo!()
}
