//! Evolution: scores generation after generation, then examines the archive, chooses the winner and reports it.
//!
//! Rounds are the search's generations, then one of *finishing* if the job has a reference setting, then one of
//! *reporting*. The examinations of the last two are in [`crate::procedure::evolve::finish`].

mod check;
pub mod finish;
pub mod report;
mod state;
mod statistics;
pub mod task;
mod work;

pub use check::Fault;
pub use task::{Task, TaskResult};

use super::{
    Artefact, BadState, Hooks, NotRun, Procedure, ProcedureKind, Progress, Rejected, Round, RoundEnd, Step, Value,
};
use crate::base::encoding::Unreadable;
use crate::base::error::Invalid;
use crate::base::limits::MAX_ASSIGNMENT_GENOTYPES;
use crate::base::registry::Component;
use crate::base::score::Counts;
use crate::genotype::Genotype;
use crate::problem::{Checked, Job};
use crate::procedure::evolve::finish::{Done, Examination, Found, Plan, total};
use crate::procedure::evolve::report::report;
use crate::procedure::values::{counted, number};
use crate::report::Traces;
use crate::search::archive::Archive;
use crate::search::{Ask, Batch, Evaluation, Scored, Search};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The procedure `evolve`, for the registry.
pub struct EvolveProcedure;

impl Component for EvolveProcedure {
    fn name(&self) -> &'static str {
        "evolve"
    }
}

impl ProcedureKind for EvolveProcedure {
    fn start(&self, problem: &Checked) -> Result<Box<dyn Procedure>, Invalid> {
        Ok(Box::new(Evolve::new(problem)))
    }

    fn load(&self, problem: &Checked, saved: &[u8]) -> Result<Box<dyn Procedure>, BadState> {
        Ok(Box::new(Evolve::load(problem, saved)?))
    }

    fn run(&self, problem: &Job, tasks: &[(u32, Vec<u8>)], hooks: &dyn Hooks) -> Result<Vec<Vec<u8>>, NotRun> {
        work::run(problem, tasks, hooks)
    }
}

/// The coordinator's side of an evolution.
pub struct Evolve {
    job: Checked,
    plan: Plan,
    optimiser: Box<dyn Search>,
    archive: Archive,
    /// Effort of all evaluations of the search.
    counts: Counts,
    /// Number of the search's evaluations that failed.
    failed: u64,
    /// Answers of the finishing round, once it is over; empty if there was no such round.
    examined: Option<Vec<Examined>>,
    work: Work,
}

/// An answer without its traces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Examined {
    scores: Vec<Option<f64>>,
    counts: Counts,
}

/// Tasks of the current round.
enum Work {
    /// Evaluations of a generation's candidates, by index.
    Searching { generation: u32, batch: Batch },
    /// Examinations of the archive's entries and the global bests.
    Finishing(Vec<Examination>),
    /// Examinations of the winner and of the first generation's best.
    Reporting(Vec<Examination>),
}

impl Evolve {
    /// Creates an evolution before generation 0.
    pub fn new(job: &Checked) -> Self {
        let (optimiser, plan) = (job.optimiser(), Plan::of(job));
        let work = Work::Searching { generation: 0, batch: optimiser.ask() };
        Self {
            job: job.clone(),
            plan,
            optimiser,
            archive: plan.new_archive(),
            counts: Counts::default(),
            failed: 0,
            examined: None,
            work,
        }
    }

    /// Returns the number of generations that are scored.
    fn generations(&self) -> u32 {
        self.job.optimiser_spec().generations()
    }

    /// Returns the number of the search's evaluations so far.
    fn evaluations(&self) -> u64 {
        self.job.optimiser_spec().evaluations(self.optimiser.generation())
    }

    /// Returns the best of the search so far: the newest global best.
    fn best(&self) -> Option<&Scored> {
        self.archive.bests().last()
    }

    /// Returns the result of the search, if any of its evaluations succeeded.
    fn found(&self) -> Option<Found> {
        Some(Found {
            first: self.archive.bests().first()?.clone(),
            best: self.best()?.clone(),
            archive: self.archive.entries().to_vec(),
            bests: self.archive.bests().to_vec(),
        })
    }

    /// Returns the finishing round's examinations with their answers.
    fn done(&self, found: &Found) -> Vec<Done> {
        let answers = self.examined.iter().flatten().map(|answer| answer.scores.clone());
        self.plan.finishing(found).into_iter().zip(answers).collect()
    }

    fn at(&self, index: u32) -> Option<Task> {
        match &self.work {
            Work::Searching { generation, batch } => {
                let genotype = batch.genotypes.get(index as usize)?.clone();
                match batch.ask {
                    Ask::Set => Some(Task::Evaluate { generation: *generation, candidate: index, genotype }),
                    // Checked jobs have no search that needs this.
                    Ask::Motion => None,
                }
            }
            Work::Finishing(all) | Work::Reporting(all) => all.get(index as usize).cloned().map(Task::Examine),
        }
    }

    /// Returns the tasks of the next round; `None` if there is no best.
    fn next_work(&self) -> Option<Work> {
        let generation = self.optimiser.generation();
        if generation < self.generations() {
            return Some(Work::Searching { generation, batch: self.optimiser.ask() });
        }
        let found = self.found()?;
        if self.examined.is_none() {
            return Some(Work::Finishing(self.plan.finishing(&found)));
        }
        let done = self.done(&found);
        let winner = self.plan.winner(&found, &done);
        Some(Work::Reporting(self.plan.reporting(&found, &winner, &done)))
    }

    /// Moves on to the next round.
    fn next(&mut self) -> Step {
        if self.optimiser.generation() >= self.generations()
            && self.examined.is_none()
            && self.found().is_some_and(|found| self.plan.finishing(&found).is_empty())
        {
            self.examined = Some(Vec::new());
        }
        match self.next_work() {
            Some(work) => {
                self.work = work;
                Step::Next
            }
            None => Step::Failed(format!(
                "all {} evaluations failed, so there is no winner: each needs more rollouts than planner.max_rollouts \
                 allows, or a gait has no motion; raise planner.max_rollouts, or change gaits.bounds",
                self.evaluations()
            )),
        }
    }

    fn seal_generation(&mut self, generation: u32, sent: Vec<Genotype>, results: Vec<TaskResult>) -> RoundEnd {
        let (mut evaluations, mut counts) = (Vec::with_capacity(results.len()), Counts::default());
        for (sent, result) in sent.into_iter().zip(results) {
            let TaskResult::Evaluated { genotype, score, descriptors, counts: took } = result else {
                return unusable("an examination's result for an evaluation");
            };
            counts += took;
            evaluations.push(Evaluation { genotype: genotype.unwrap_or(sent), score, descriptors });
        }
        let scores: Vec<Option<f64>> = evaluations.iter().map(|evaluation| evaluation.score).collect();
        let succeeded = evaluations.iter().zip(0..).filter_map(|(evaluation, candidate)| {
            Some(Scored { generation, candidate, score: evaluation.score?, genotype: evaluation.genotype.clone() })
        });
        self.counts += counts;
        self.failed += scores.iter().filter(|s| s.is_none()).count() as u64;
        self.archive.generation(succeeded);
        self.optimiser.tell(&evaluations);
        let best = self.best().map(|best| best.score);
        let row = statistics::row(generation, &scores, counts, best, self.job.score_label().1);
        RoundEnd { row: Some(row), step: self.next() }
    }

    /// Makes the report, once all examinations are complete.
    fn report(&self, examinations: &[Examination], results: Vec<TaskResult>) -> Step {
        let Some(found) = self.found() else { return Step::Failed("the search is over without a best".to_owned()) };
        let mut done = self.done(&found);
        let mut counts = total(self.examined.iter().flatten().map(|answer| &answer.counts));
        let winner = self.plan.winner(&found, &done);
        let mut traces: Option<Traces> = None;
        for (examination, result) in examinations.iter().zip(results) {
            let TaskResult::Examined { scores, counts: took, traces: recorded } = result else {
                return Step::Failed("an evaluation's result for an examination".to_owned());
            };
            counts += took;
            traces = traces.or(recorded);
            done.push((examination.clone(), scores));
        }
        let report = report(&self.plan, found, winner, &done, traces.unwrap_or_default(), counts);
        match serde_json::to_vec(&report) {
            Ok(content) => Step::Done(vec![Artefact {
                name: "report".to_owned(),
                media_type: "application/json".to_owned(),
                content,
            }]),
            Err(e) => Step::Failed(format!("the report can't be serialised: {e}")),
        }
    }
}

/// Fails a job because results do not fit their tasks although they were checked.
fn unusable(reason: &str) -> RoundEnd {
    RoundEnd { row: None, step: Step::Failed(format!("a result is unusable: {reason}")) }
}

impl Procedure for Evolve {
    fn round(&self) -> Round {
        let shared = Arc::from([].as_slice());
        let examinations = |number, all: &[Examination], phase| Round {
            number,
            tasks: all.len() as u32,
            at_most: 1,
            lanes: 1,
            phase,
            shared: Arc::from([].as_slice()),
            kept: false,
        };
        match &self.work {
            Work::Searching { generation, batch } => Round {
                number: *generation,
                tasks: batch.genotypes.len() as u32,
                at_most: (MAX_ASSIGNMENT_GENOTYPES / (8 * self.job.space().longest().max(1))).max(1) as u32,
                lanes: self.job.candidates_at_once(),
                phase: self.phase(),
                shared,
                kept: true,
            },
            Work::Finishing(all) => examinations(self.generations(), all, self.phase()),
            Work::Reporting(all) => {
                let finishing = u32::from(self.examined.as_ref().is_some_and(|answers| !answers.is_empty()));
                examinations(self.generations() + finishing, all, self.phase())
            }
        }
    }

    fn task(&self, index: u32) -> Vec<u8> {
        self.at(index).unwrap_or_else(|| panic!("the round has no task {index}")).encode()
    }

    fn describe(&self, index: u32) -> String {
        match self.at(index) {
            Some(Task::Evaluate { generation, candidate, .. }) => {
                format!("the evaluation of candidate {candidate} of generation {generation}")
            }
            Some(Task::Examine(examination)) => format!("the examination of {examination}"),
            None => format!("task {index}, which the round does not have"),
        }
    }

    fn check(&self, index: u32, result: &[u8]) -> Result<(), Rejected> {
        let reject = |reason| Rejected { task: self.describe(index), reason };
        let task = self.at(index).ok_or_else(|| reject("there is no such task".to_owned()))?;
        check::check(&self.job, &task, result).map_err(|fault| reject(fault.to_string()))
    }

    fn show(&self, result: &[u8]) -> String {
        TaskResult::decode(result).map_or_else(|e| format!("an unreadable result: {e}"), |result| result.to_string())
    }

    fn tell(&mut self, results: &[Arc<[u8]>]) -> RoundEnd {
        let wanted = self.round().tasks as usize;
        if results.len() != wanted {
            return unusable(&format!("the round has {wanted} tasks, but {} results", results.len()));
        }
        let read: Result<Vec<TaskResult>, Unreadable> = results.iter().map(|r| TaskResult::decode(r)).collect();
        let results = match read {
            Ok(results) => results,
            Err(unreadable) => return unusable(&unreadable.to_string()),
        };
        match &mut self.work {
            Work::Searching { generation, batch } => {
                let (generation, sent) = (*generation, std::mem::take(&mut batch.genotypes));
                self.seal_generation(generation, sent, results)
            }
            Work::Finishing(_) => {
                let answers = results.into_iter().map(|result| match result {
                    TaskResult::Examined { scores, counts, .. } => Some(Examined { scores, counts }),
                    TaskResult::Evaluated { .. } => None,
                });
                match answers.collect() {
                    Some(answers) => self.examined = Some(answers),
                    None => return unusable("an evaluation's result for an examination"),
                }
                RoundEnd { row: None, step: self.next() }
            }
            Work::Reporting(examinations) => {
                let examinations = examinations.clone();
                RoundEnd { row: None, step: self.report(&examinations, results) }
            }
        }
    }

    fn save(&self) -> Vec<u8> {
        self.state()
    }

    fn progress(&self) -> Progress {
        let unit = self.job.score_label().1;
        let best = self.best();
        let of_best = |name: &'static str, unit: &'static str, value: fn(&Scored) -> f64| Value {
            name: name.into(),
            unit: unit.into(),
            value: best.map(value),
        };
        let mut values = vec![
            of_best("best", unit, |best| best.score),
            of_best("best_generation", "", |best| f64::from(best.generation)),
            of_best("best_candidate", "", |best| f64::from(best.candidate)),
            number("evaluations", self.evaluations()),
            number("failed", self.failed),
        ];
        values.extend(counted(&self.counts));
        Progress {
            phase: self.phase().into(),
            unit: "generations".into(),
            done: self.optimiser.generation(),
            total: self.generations(),
            values,
        }
    }
}

impl Evolve {
    fn phase(&self) -> &'static str {
        match self.work {
            Work::Searching { .. } => "searching",
            Work::Finishing(_) => "finishing",
            Work::Reporting(_) => "reporting",
        }
    }
}
