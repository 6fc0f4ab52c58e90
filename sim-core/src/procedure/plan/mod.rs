//! Planning with given gaits, as in section V-C of Vonásek and Faigl (2016). Grows several trees with their own random
//! numbers. The plan of a tree leads to the node nearest to the goal, or without a goal to the node farthest from the
//! root.
//!
//! There are two rounds. *Planning* has one task per tree. *Tracing* grows the best tree again and records it, with its
//! plan executed in three ways. The best tree has the best score by the job's fitness; ties go to the first.

mod check;
mod report;
mod task;
mod work;

pub use report::PlanReport;
pub use task::{Grown, Step as PlanStep, Task, TaskResult, stream};

use super::possible::Uncountable;
use super::values::{counted, number};
use super::{
    Artefact, BadState, Hooks, NotRun, Procedure, ProcedureKind, Progress, Rejected, Round, RoundEnd, Step, Value,
};
use crate::base::encoding::{self, Unreadable};
use crate::base::error::Invalid;
use crate::base::registry::Component;
use crate::base::score::Counts;
use crate::problem::{Checked, Job, PLAN};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// First byte of a saved state.
const FORMAT: u8 = 0xD2;

/// The procedure `plan`, for the registry.
pub struct PlanProcedure;

impl Component for PlanProcedure {
    fn name(&self) -> &'static str {
        PLAN
    }
}

impl ProcedureKind for PlanProcedure {
    fn start(&self, problem: &Checked) -> Result<Box<dyn Procedure>, Invalid> {
        Ok(Box::new(Planning { job: problem.clone(), grown: None }))
    }

    fn load(&self, problem: &Checked, saved: &[u8]) -> Result<Box<dyn Procedure>, BadState> {
        Ok(Box::new(Planning::load(problem, saved)?))
    }

    fn run(&self, problem: &Job, tasks: &[(u32, Vec<u8>)], hooks: &dyn Hooks) -> Result<Vec<Vec<u8>>, NotRun> {
        work::run(problem, tasks, hooks)
    }
}

/// The coordinator's side of a job that plans.
struct Planning {
    job: Checked,
    /// After planning, the result of each tree and the index of the best one.
    grown: Option<(Vec<Tried>, u32)>,
}

/// Result of a tree.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tried {
    /// The tree; `None` if the evaluation failed.
    pub grown: Option<Grown>,
    /// Effort of the tree.
    pub counts: Counts,
}

/// Saved state between two rounds.
#[derive(Serialize, Deserialize)]
struct Saved {
    tried: Option<Vec<Tried>>,
}

impl Planning {
    fn seeds(&self) -> u32 {
        self.job.spec().plan.as_ref().map_or(0, |plan| plan.seeds)
    }

    fn load(job: &Checked, saved: &[u8]) -> Result<Self, BadState> {
        let Saved { tried } = encoding::decode(FORMAT, saved).map_err(|e: Unreadable| BadState(e.to_string()))?;
        let mut planning = Self { job: job.clone(), grown: None };
        let Some(tried) = tried else { return Ok(planning) };
        if tried.len() != planning.seeds() as usize {
            return Err(BadState(format!("it has {} trees, but the job has {}", tried.len(), planning.seeds())));
        }
        for one in &tried {
            check::tried(job, one).map_err(|fault| BadState(fault.to_string()))?;
        }
        let best = planning.best(&tried).ok_or_else(|| BadState("all of its trees failed".to_owned()))?;
        planning.grown = Some((tried, best));
        Ok(planning)
    }

    /// Returns the tree with the best score; ties go to the first. `None` if all failed.
    fn best(&self, tried: &[Tried]) -> Option<u32> {
        let scores: Vec<Option<f64>> = tried.iter().map(|t| t.grown.as_ref().map(|grown| grown.score)).collect();
        self.job.direction().best(&scores).map(|(index, _)| index as u32)
    }

    fn at(&self, index: u32) -> Option<Task> {
        match &self.grown {
            None => (index < self.seeds()).then_some(Task::Grow { seed: index }),
            Some((_, best)) => (index == 0).then_some(Task::Trace { seed: *best }),
        }
    }

    fn phase(&self) -> &'static str {
        if self.grown.is_none() { "planning" } else { "tracing" }
    }

    fn planned(&mut self, results: Vec<TaskResult>) -> Step {
        let tried = results.into_iter().map(|result| match result {
            TaskResult::Grown(tried) => Some(tried),
            TaskResult::Traced { .. } => None,
        });
        let Some(tried) = tried.collect::<Option<Vec<Tried>>>() else {
            return Step::Failed("a result is unusable: traces instead of a tree".to_owned());
        };
        match self.best(&tried) {
            Some(best) => {
                self.grown = Some((tried, best));
                Step::Next
            }
            None => Step::Failed(format!(
                "all {} trees failed: each needs more rollouts than planner.max_rollouts allows, or a gait has no \
                 motion; raise planner.max_rollouts, or give other gaits",
                tried.len()
            )),
        }
    }
}

impl Procedure for Planning {
    fn round(&self) -> Round {
        let (number, tasks) = if self.grown.is_none() { (0, self.seeds()) } else { (1, 1) };
        let lanes = if self.grown.is_none() { self.job.candidates_at_once() } else { 1 };
        Round {
            number,
            tasks,
            at_most: lanes,
            lanes,
            phase: self.phase(),
            shared: Arc::from([].as_slice()),
            kept: true,
        }
    }

    fn task(&self, index: u32) -> Vec<u8> {
        self.at(index).unwrap_or_else(|| panic!("the round has no task {index}")).encode()
    }

    fn describe(&self, index: u32) -> String {
        match self.at(index) {
            Some(Task::Grow { seed }) => format!("tree {seed}"),
            Some(Task::Trace { seed }) => format!("the traces of tree {seed}"),
            None => format!("task {index}, which the round does not have"),
        }
    }

    fn check(&self, index: u32, result: &[u8]) -> Result<(), Rejected> {
        let reject = |reason| Rejected { task: self.describe(index), reason };
        let task = self.at(index).ok_or_else(|| reject("there is no such task".to_owned()))?;
        check::check(&self.job, task, result).map_err(|fault| reject(fault.to_string()))
    }

    fn show(&self, result: &[u8]) -> String {
        TaskResult::decode(result).map_or_else(|e| format!("an unreadable result: {e}"), |result| result.to_string())
    }

    fn tell(&mut self, results: &[Arc<[u8]>]) -> RoundEnd {
        let wanted = self.round().tasks as usize;
        let read: Result<Vec<TaskResult>, Unreadable> = results.iter().map(|r| TaskResult::decode(r)).collect();
        let step = match (read, &self.grown) {
            (Err(unreadable), _) => Step::Failed(format!("a result is unusable: {unreadable}")),
            (Ok(read), _) if read.len() != wanted => {
                Step::Failed(format!("the round has {wanted} tasks, but {} results", read.len()))
            }
            (Ok(read), None) => self.planned(read),
            (Ok(mut read), Some((tried, best))) => match read.pop() {
                Some(TaskResult::Traced { traces, counts }) => {
                    match serde_json::to_vec(&PlanReport::new(tried, *best, traces, counts)) {
                        Ok(content) => Step::Done(vec![Artefact {
                            name: "plans".to_owned(),
                            media_type: "application/json".to_owned(),
                            content,
                        }]),
                        Err(e) => Step::Failed(format!("the report can't be serialised: {e}")),
                    }
                }
                _ => Step::Failed("a result is unusable: a tree instead of traces".to_owned()),
            },
        };
        RoundEnd { row: None, step }
    }

    fn save(&self) -> Vec<u8> {
        encoding::encode(FORMAT, &Saved { tried: self.grown.as_ref().map(|(tried, _)| tried.clone()) })
    }

    fn progress(&self) -> Progress {
        let tried = self.grown.as_ref().map(|(tried, _)| tried.as_slice()).unwrap_or_default();
        let of_best = self.grown.as_ref().and_then(|(tried, best)| tried.get(*best as usize)?.grown.as_ref());
        let mut counts = Counts::default();
        tried.iter().for_each(|one| counts += one.counts);
        let grown = |wanted: fn(&Grown) -> bool| tried.iter().filter(|t| t.grown.as_ref().is_some_and(wanted)).count();
        let unit = self.job.score_label().1;
        let mut values = vec![
            Value { name: "best".into(), unit: unit.into(), value: of_best.map(|grown| grown.score) },
            number("evaluations", tried.len() as u64),
            number("failed", (tried.len() - grown(|_| true)) as u64),
            number("reached", grown(|grown| grown.reached) as u64),
        ];
        values.extend(counted(&counts));
        Progress {
            phase: self.phase().into(),
            unit: "trees".into(),
            done: tried.len() as u32,
            total: self.seeds(),
            values,
        }
    }
}

/// A fault of a result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// The bytes can't be read.
    #[error("{0}")]
    Unreadable(#[from] Unreadable),
    /// Traces instead of a tree, or the other way round.
    #[error("it is not of the kind that the task needs")]
    Kind,
    /// A count exceeds the job's budget.
    #[error(transparent)]
    Count(#[from] Uncountable),
    /// Numbers that are impossible for a tree of the job, or traces that do not fit the job.
    #[error("{0}")]
    Impossible(String),
}
