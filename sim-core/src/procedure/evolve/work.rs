//! The worker's side of an evolution.

use super::task::{Task, TaskResult};
use crate::evaluate::{Stopped, evaluate};
use crate::genotype::Genotype;
use crate::problem::Job;
use crate::procedure::evolve::finish::{Answer, Examination, examine};
use crate::procedure::{Hooks, NotRun};
use std::collections::BTreeMap;

impl From<Stopped> for NotRun {
    fn from(Stopped: Stopped) -> Self {
        Self::Stopped
    }
}

/// Candidates of one generation.
#[derive(Default)]
struct Batch {
    /// Position of each candidate among the tasks.
    places: Vec<usize>,
    /// Index in the generation, and genotype.
    candidates: Vec<(u32, Genotype)>,
}

/// Carries out tasks: all evaluations of a generation in one batch, so that together they fill an engine's lanes.
pub(super) fn run(job: &Job, tasks: &[(u32, Vec<u8>)], hooks: &dyn Hooks) -> Result<Vec<Vec<u8>>, NotRun> {
    let stop = || hooks.stop();
    let mut generations: BTreeMap<u32, Batch> = BTreeMap::new();
    let mut examinations = Vec::new();
    for (place, (index, bytes)) in tasks.iter().enumerate() {
        let task = Task::decode(bytes).map_err(|e| NotRun::Task(format!("task {index}: {e}")))?;
        match task {
            Task::Evaluate { generation, candidate, genotype } => {
                fits(job, *index, &genotype)?;
                let batch = generations.entry(generation).or_default();
                batch.places.push(place);
                batch.candidates.push((candidate, genotype));
            }
            Task::Examine(examination) => {
                fits(job, *index, &examination.candidate.genotype)?;
                examinations.push((place, examination));
            }
        }
    }
    let mut results: Vec<Vec<u8>> = vec![Vec::new(); tasks.len()];
    for (generation, Batch { places, candidates }) in generations {
        for (place, evaluation) in places.into_iter().zip(evaluate(job, generation, &candidates, &stop)?) {
            let (score, counts) = (evaluation.score, evaluation.counts);
            let result = TaskResult::Evaluated { genotype: None, score, descriptors: Vec::new(), counts };
            results[place] = result.encode();
        }
    }
    for (place, examination) in examinations {
        results[place] = answer(job, &examination, &stop)?.encode();
    }
    Ok(results)
}

fn answer(job: &Job, examination: &Examination, stop: &dyn Fn() -> bool) -> Result<TaskResult, NotRun> {
    let Answer { scores, counts, traces } = examine(job, examination, stop)?;
    Ok(TaskResult::Examined { scores, counts, traces })
}

/// Rejects a candidate that is impossible for a search of the job.
fn fits(job: &Job, index: u32, genotype: &Genotype) -> Result<(), NotRun> {
    let refused = |misfit| NotRun::Task(format!("task {index}: its genome does not fit this job: {misfit}"));
    job.space().check(genotype).map_err(refused)
}
