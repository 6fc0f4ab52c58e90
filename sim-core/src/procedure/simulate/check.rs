//! Checks of a task's result before any of it is stored.

use super::{Drawn, Ended, Recorded, Run, Task, TaskResult};
use crate::base::encoding::Unreadable;
use crate::problem::{Checked, SimulateSpec, Way};
use crate::procedure::possible::{Most, Uncountable, counted, samples_of};

/// Longest reason of a run's end, in bytes.
const MAX_REASON: usize = 4096;
/// Most points of a path, without the ends of its steps.
const MAX_POINTS: usize = 256;

/// A fault of a result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// The bytes can't be read.
    #[error("{0}")]
    Unreadable(#[from] Unreadable),
    /// Samples for a repeat, a repeat instead of samples, or other ways than the job's.
    #[error("it is not of the kind that the task needs")]
    Kind,
    /// A count exceeds the job's budget.
    #[error(transparent)]
    Count(#[from] Uncountable),
    /// Numbers that are impossible for a run of the job.
    #[error("{0}")]
    Impossible(String),
}

/// Rejects a result that is impossible for the task.
pub(super) fn check(job: &Checked, task: Task, result: &[u8]) -> Result<(), Fault> {
    let result = TaskResult::decode(result)?;
    let (runs, counts) = result.runs();
    let simulate = job.spec().simulate.as_ref().ok_or(Fault::Kind)?;
    let ways: Vec<Way> = runs.iter().map(|run| run.way).collect();
    let repeat = match (task, &result) {
        (Task::Repeat { repeat }, TaskResult::Repeated(..)) => Some(repeat),
        (Task::Unvaried, TaskResult::Unvaried(..)) => None,
        _ => return Err(Fault::Kind),
    };
    if Some(&ways) != simulate.ways.as_ref() {
        return Err(Fault::Kind);
    }
    counted(counts, &Most::of_motion(job))?;
    let drawn = Drawn::of(job, repeat);
    for run in runs {
        one(job, simulate, run, &drawn).map_err(Fault::Impossible)?;
    }
    if let TaskResult::Unvaried(recorded, _) = &result {
        for one in recorded {
            samples(job, one).map_err(Fault::Impossible)?;
        }
    }
    Ok(())
}

fn one(job: &Checked, simulate: &SimulateSpec, run: &Run, drawn: &Drawn) -> Result<(), String> {
    if run.drawn != *drawn {
        return Err("its drawn values are not those of its random numbers".to_owned());
    }
    let finite = run.end.iter().chain(run.path.iter().flatten()).all(|v| v.is_finite());
    let numbers = [run.seconds, run.travelled, run.turnover, run.touched.unwrap_or(0.0)];
    if !finite || !run.work.is_finite() || numbers.iter().any(|v| !v.is_finite() || *v < 0.0) {
        return Err("one of its numbers is not finite, or a time, length or turnover is negative".to_owned());
    }
    // Both are sums of the same products, but may differ by rounding.
    if run.work.abs() > run.turnover * (1.0 + 1e-4) + 1e-6 {
        return Err(format!("its work {} is more than its turnover {}", run.work, run.turnover));
    }
    if run.contact.len() != job.robot().bodies.len() || run.contact.iter().any(|share| !(0.0..=1.0).contains(share)) {
        return Err("its contacts must be a share of 0 to 1 for each body of the robot".to_owned());
    }
    let gaits = job.gaits().count;
    let steps: Vec<u32> = simulate.steps.iter().flatten().map(|step| step - 1).collect();
    let most = job.motion_rollouts() as usize;
    let known = match &simulate.replan {
        Some(replan) => {
            run.gaits.len() <= most && run.gaits.iter().all(|gait| *gait < gaits) && run.replans <= replan.most
        }
        None => {
            let whole = run.gaits.len() == steps.len() || run.ended != Ended::Completed;
            run.replans == 0 && whole && steps.starts_with(&run.gaits)
        }
    };
    if !known {
        return Err("its gaits are not those of the motion".to_owned());
    }
    let longest = job.gaits().duration * most as f64;
    if run.seconds > longest + 1e-3 || run.touched.is_some_and(|at| at > longest + 1e-3) {
        return Err(format!("its times exceed the {longest} s of the motion"));
    }
    let points = MAX_POINTS + 2 * most + 1;
    if run.path.is_empty() || run.path.len() > points {
        return Err(format!("its path has {} points: 1 to {points} are allowed", run.path.len()));
    }
    match &run.ended {
        Ended::Broken(reason) | Ended::NoStart(reason) if reason.is_empty() || reason.len() > MAX_REASON => {
            Err(format!("its reason must have 1 to {MAX_REASON} bytes"))
        }
        _ => Ok(()),
    }
}

fn samples(job: &Checked, recorded: &Recorded) -> Result<(), String> {
    let bodies = job.robot().bodies.len();
    if recorded.touching.len() != recorded.samples.len() || recorded.touching.iter().any(|row| row.len() != bodies) {
        return Err("it must have the contacts of each body at each sample".to_owned());
    }
    if recorded.samples.is_empty() {
        let began = !matches!(recorded.run.ended, Ended::NoStart(_)) && recorded.run.seconds > 0.0;
        return if began { Err("it has no samples".to_owned()) } else { Ok(()) };
    }
    let longest = job.gaits().duration * job.motion_rollouts() as f64;
    samples_of(&recorded.samples, job.robot().hinges.len(), longest)
}
