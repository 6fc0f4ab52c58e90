//! Report of a job that plans. The coordinator assembles it and stores it with the job; the command line draws it.

use super::{Grown, Tried};
use crate::base::score::Counts;
use crate::report::{GaitTrace, PathTrace, Traces, TreeRecord};
use serde::{Deserialize, Serialize};

/// Report of a job that plans. Lengths in mu, angles in rad, times in s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanReport {
    /// Result of each tree, by seed; `null` for a failed evaluation.
    pub plans: Vec<Option<Grown>>,
    /// Seed of the tree with the best score, from 0.
    pub best: u32,
    /// Each gait, executed at the start.
    pub gaits: Vec<GaitTrace>,
    /// The best tree.
    pub tree: TreeRecord,
    /// The best tree's plan, executed in three ways.
    pub paths: Vec<PathTrace>,
    /// Effort of all trees.
    pub counts: Counts,
    /// Effort of the traces.
    pub trace_counts: Counts,
}

impl PlanReport {
    pub(super) fn new(tried: &[Tried], best: u32, Traces { gaits, tree, paths }: Traces, trace_counts: Counts) -> Self {
        let mut counts = Counts::default();
        tried.iter().for_each(|one| counts += one.counts);
        let plans = tried.iter().map(|one| one.grown.clone()).collect();
        Self { plans, best, gaits, tree, paths, counts, trace_counts }
    }
}
