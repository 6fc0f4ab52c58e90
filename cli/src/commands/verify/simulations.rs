//! Checks of a run that simulated.

use super::{Check, compare, each, same};
use crate::error::Error;
use crate::output::StoredSimulation;
use sim_core::problem::Job;
use sim_core::procedure::simulate::{self, Task, TaskResult};

/// Checks the motion with nothing varied and the first repeat; with `full` all repeats.
pub(super) fn checks(stored: &StoredSimulation, full: bool) -> Result<Vec<Check>, Error> {
    let StoredSimulation { job, result, report } = stored;
    let mut checks = Vec::new();
    if result.engine_digest == job.engine_digest() {
        checks.push(compare("job digest", &result.job_digest, &job.digest()));
    }
    if let TaskResult::Unvaried(recorded, _) = again(job, Task::Unvaried)? {
        checks.push(same("the motion with nothing varied", &report.unvaried, &recorded));
    }
    let repeats = if full { report.repeats.len() } else { report.repeats.len().min(1) };
    let made = each(repeats, |i| match again(job, Task::Repeat { repeat: i as u32 })? {
        TaskResult::Repeated(runs, _) => Ok(runs),
        TaskResult::Unvaried(..) => Ok(Vec::new()),
    })?;
    if repeats > 0 {
        let what = if full { "all repeats" } else { "the first repeat" };
        checks.push(same(what, &report.repeats[..repeats].to_vec(), &made));
    }
    Ok(checks)
}

/// Runs a task of the procedure again.
fn again(job: &Job, task: Task) -> Result<TaskResult, Error> {
    super::again(&simulate::SimulateProcedure, job, task.encode(), TaskResult::decode)
}
