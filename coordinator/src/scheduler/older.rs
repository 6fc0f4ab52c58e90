//! Late results of generations before the one sealed last. Of these nothing is kept here: the store has the scores, and
//! the genomes follow from the scores before. Whoever drives the scheduler looks them up.

use super::results::{Completed, Delivery, Verdict};
use super::round::Range;
use super::{Now, Scheduler};
use sim_core::genotype::Genome;
use std::collections::BTreeMap;

/// What was sealed of candidates of which a late result says something else, by index.
pub type Contradicted = BTreeMap<u32, Committed>;

/// What was sealed of a candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct Committed {
    /// Its score; `None` where the evaluation failed.
    pub score: Option<f64>,
    /// Its genome, to be scored again.
    pub genome: Genome,
}

impl Scheduler {
    /// A result that was [`Verdict::Older`], and where it differs from what was sealed.
    pub fn compare(&mut self, now: Now, completed: Completed, contradicted: &Contradicted) -> Verdict {
        let verdict = self.take_older(now, completed, contradicted);
        self.dispatch(now);
        verdict
    }

    fn take_older(&mut self, now: Now, completed: Completed, contradicted: &Contradicted) -> Verdict {
        let Completed { worker, job: id, delivery, .. } = completed;
        // Either may have come to pass while it was looked up.
        if self.quarantined.contains_key(&worker) {
            return Verdict::Quarantined;
        }
        if !self.jobs.contains_key(&id) {
            return Verdict::Obsolete;
        }
        let Delivery::Evaluations { generation, first, outcomes } = delivery else { return Verdict::Unknown };
        let range = Range { round: generation, first, count: outcomes.len() as u32 };
        let outcomes = (first..).zip(outcomes).filter(|(index, _)| contradicted.contains_key(index));
        if self.weigh(now, &id, &range, outcomes, &worker, contradicted) {
            Verdict::Conflict
        } else {
            Verdict::Duplicate
        }
    }
}
