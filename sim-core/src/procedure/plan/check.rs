//! Checks of a task's result before any of it is stored.

use super::{Fault, Grown, Task, TaskResult, Tried};
use crate::model::Place;
use crate::problem::Checked;
use crate::procedure::possible::{Most, counted, traces_of};

/// Rejects a result that is impossible for the task.
pub(super) fn check(job: &Checked, task: Task, result: &[u8]) -> Result<(), Fault> {
    match (task, TaskResult::decode(result)?) {
        (Task::Grow { .. }, TaskResult::Grown(one)) => tried(job, &one),
        (Task::Trace { .. }, TaskResult::Traced { traces, counts }) => {
            counted(&counts, &Most::of_trees(job, job, 1, true).with_traces(job))?;
            let gaits = job.given_gaits().ok_or(Fault::Kind)?;
            traces_of(job, gaits, &traces)
                .map_err(|reason| Fault::Impossible(format!("its traces are impossible: {reason}")))
        }
        _ => Err(Fault::Kind),
    }
}

/// Rejects a tree that is impossible for the job.
pub(super) fn tried(job: &Checked, Tried { grown, counts }: &Tried) -> Result<(), Fault> {
    counted(counts, &Most::of_trees(job, job, 1, true))?;
    grown.as_ref().map_or(Ok(()), |grown| in_short(job, grown).map_err(Fault::Impossible))
}

fn in_short(job: &Checked, grown: &Grown) -> Result<(), String> {
    let (min, max) = job.score_range();
    if !(min..=max).contains(&grown.score) {
        return Err(format!("score {} is out of range: allowed is {min} to {max}", grown.score));
    }
    if grown.coverage.is_some_and(|coverage| !(0.0..=100.0).contains(&coverage)) {
        return Err("its coverage is out of range: allowed is 0 to 100 %".to_owned());
    }
    let (gaits, most) = (job.gaits().count, job.spec().planner.iterations as usize);
    if grown.plan.len() > most {
        return Err(format!("its plan has {} gaits: at most {most} are allowed", grown.plan.len()));
    }
    for (i, step) in grown.plan.iter().enumerate() {
        let finite = [step.x, step.y, step.z, step.yaw].iter().all(|v| v.is_finite());
        if step.gait >= gaits || !finite || !job.environment().contains(step.x, step.y) {
            return Err(format!("step {i} of its plan has an unknown gait, or leads outside the map"));
        }
    }
    let start = job.environment().start;
    let end = grown.plan.last().map_or((start.x, start.y), |step| (step.x, step.y));
    let (distance, reached) = match job.environment().goal {
        None => (None, false),
        Some(goal) => {
            let place = |(x, y): (f64, f64)| Place { x, y, ..Place::ORIGIN };
            let distance = place(end).planar_distance(&place((goal.x, goal.y)));
            (Some(distance), distance <= goal.radius)
        }
    };
    let bits = |distance: Option<f64>| distance.map(f64::to_bits);
    if bits(grown.distance) != bits(distance) || grown.reached != reached {
        return Err("its distance to the goal is not that of its plan's end".to_owned());
    }
    Ok(())
}
