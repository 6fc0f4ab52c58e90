//! Checks of a run that planned.

use super::{Check, compare, compare_score, each, same};
use crate::error::Error;
use crate::output::StoredPlans;
use sim_core::problem::Job;
use sim_core::procedure::plan::{self, Task, TaskResult};

/// Checks the best tree and its traces; with `full` all trees.
pub(super) fn checks(stored: &StoredPlans, full: bool) -> Result<Vec<Check>, Error> {
    let StoredPlans { job, result, report } = stored;
    let mut checks = Vec::new();
    if result.engine_digest == job.engine_digest() {
        checks.push(compare("job digest", &result.job_digest, &job.digest()));
    }
    let trees: Vec<u32> = if full { (0..report.plans.len() as u32).collect() } else { vec![report.best] };
    let kept: Vec<_> = trees.iter().map(|&tree| report.plans.get(tree as usize).cloned().flatten()).collect();
    let made = each(trees.len(), |i| match again(job, Task::Grow { seed: trees[i] })? {
        TaskResult::Grown(tried) => Ok(tried.grown),
        TaskResult::Traced { .. } => Ok(None),
    })?;
    checks.push(same(if full { "all trees and plans" } else { "the best tree's plan and scores" }, &kept, &made));
    if let TaskResult::Traced { traces, .. } = again(job, Task::Trace { seed: report.best })? {
        checks.push(same("the gaits' trajectories", &report.gaits, &traces.gaits));
        checks.push(same("the tree", &report.tree, &traces.tree));
        checks.push(same("the paths", &report.paths, &traces.paths));
    }
    let place = trees.iter().position(|tree| *tree == report.best);
    let score = place.and_then(|place| Some(made[place].as_ref()?.score));
    checks.push(compare_score("the best score in result.json", result.best.as_ref().map(|best| best.score), score));
    Ok(checks)
}

/// Runs a task of the procedure again.
fn again(job: &Job, task: Task) -> Result<TaskResult, Error> {
    super::again(&plan::PlanProcedure, job, task.encode(), TaskResult::decode)
}
