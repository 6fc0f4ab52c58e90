//! The worker's side of a job that plans.

use super::{Grown, PlanStep, Task, TaskResult, Tried, stream};
use crate::base::registry::Component as _;
use crate::base::settings::{Configurable as _, Settings};
use crate::evaluate::{Trial, grow};
use crate::genotype::Genotype;
use crate::model::Place;
use crate::objective::{Coverage, Objective, ObjectiveKind as _};
use crate::problem::Job;
use crate::procedure::{Hooks, NotRun};
use crate::report::{end_of_plan, traces};

/// Carries out tasks: all trees in one batch, so that together they fill an engine's lanes. Each tree has its own table
/// of transitions, so it does not depend on the others.
pub(super) fn run(job: &Job, tasks: &[(u32, Vec<u8>)], hooks: &dyn Hooks) -> Result<Vec<Vec<u8>>, NotRun> {
    let gaits = job.given_gaits().ok_or_else(|| NotRun::Task("the job has no gaits".to_owned()))?;
    let stop = || hooks.stop();
    let mut results = vec![Vec::new(); tasks.len()];
    let (mut places, mut trials) = (Vec::new(), Vec::new());
    for (place, (index, bytes)) in tasks.iter().enumerate() {
        match Task::decode(bytes).map_err(|e| NotRun::Task(format!("task {index}: {e}")))? {
            Task::Grow { seed } => {
                places.push(place);
                trials.push(Trial::new(job, gaits, job.reuse().tolerance, [stream(job, seed)]));
            }
            Task::Trace { seed } => results[place] = traced(job, gaits, seed, &stop)?.encode(),
        }
    }
    grow(job, &mut trials, &stop)?;
    let coverage = coverage(job);
    for (place, trial) in places.into_iter().zip(&trials) {
        let grown = trial.failure.is_none().then(|| in_short(job, trial, coverage.as_deref()));
        results[place] = TaskResult::Grown(Tried { grown, counts: trial.counts() }).encode();
    }
    Ok(results)
}

fn traced(job: &Job, gaits: &Genotype, seed: u32, stop: &dyn Fn() -> bool) -> Result<TaskResult, NotRun> {
    let (traces, counts) = traces(job, gaits, [stream(job, seed)], stop)?;
    Ok(TaskResult::Traced { traces, counts })
}

/// Returns the objective of coverage with the cells of the job's fitness, or with default cells. `None` if it can't be
/// used on the job's map.
fn coverage(job: &Job) -> Option<Box<dyn Objective>> {
    let fitness = job.fitness_spec();
    let defaults = Settings::defaults(Coverage.settings());
    let settings = if fitness.kind.0.name() == Coverage.name() { &fitness.settings } else { &defaults };
    Coverage.prepare(settings, job.environment(), job.root().z).ok()
}

fn in_short(job: &Job, trial: &Trial, coverage: Option<&dyn Objective>) -> Grown {
    let tree = trial.tree();
    let path = tree.path(end_of_plan(job.environment(), tree));
    let end = tree.nodes[path[path.len() - 1]].place;
    let goal = job.environment().goal;
    let distance = goal.map(|goal| end.planar_distance(&Place { x: goal.x, y: goal.y, ..end }));
    let step = |&node: &usize| {
        let (Place { x, y, z, yaw }, (_, gait)) = (tree.nodes[node].place, tree.nodes[node].edge?);
        Some(PlanStep { gait: gait as u32, x, y, z, yaw })
    };
    Grown {
        score: trial.score_by(job, job.fitness(), 0),
        reached: goal.zip(distance).is_some_and(|(goal, distance)| distance <= goal.radius),
        distance,
        coverage: coverage.map(|coverage| trial.score_by(job, coverage, 0)),
        plan: path.iter().filter_map(step).collect(),
    }
}
