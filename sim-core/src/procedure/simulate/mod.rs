//! Simulation of a given motion: a gait, a plan, a table of joint targets or the neutral pose. In repeats, friction,
//! motors, joints, targets or the start vary.
//!
//! The only round is *simulating*. It has a task per repeat, and one more for the motion with nothing varied, which is
//! recorded with samples. Every repeat has its own random streams, so repeats do not depend on each other.

mod check;
mod replan;
mod report;
mod task;
mod vary;
mod work;

pub use report::SimulationReport;
pub use task::{Ended, Recorded, Run, Task, TaskResult};
pub use vary::Drawn;

use super::values::{counted, number};
use super::{Artefact, BadState, Hooks, NotRun, Procedure, ProcedureKind, Progress, Rejected, Round, RoundEnd, Step};
use crate::base::encoding::{self, Unreadable};
use crate::base::error::Invalid;
use crate::base::registry::Component;
use crate::base::score::Counts;
use crate::problem::{Checked, Job, SIMULATE};
use std::sync::Arc;

/// First byte of a saved state.
const FORMAT: u8 = 0xD4;
/// Name of the only phase.
const PHASE: &str = "simulating";

/// The procedure `simulate`, for the registry.
pub struct SimulateProcedure;

impl Component for SimulateProcedure {
    fn name(&self) -> &'static str {
        SIMULATE
    }
}

impl ProcedureKind for SimulateProcedure {
    fn start(&self, problem: &Checked) -> Result<Box<dyn Procedure>, Invalid> {
        Ok(Box::new(Simulating { job: problem.clone(), counts: None }))
    }

    fn load(&self, problem: &Checked, saved: &[u8]) -> Result<Box<dyn Procedure>, BadState> {
        let counts = encoding::decode(FORMAT, saved).map_err(|e: Unreadable| BadState(e.to_string()))?;
        Ok(Box::new(Simulating { job: problem.clone(), counts }))
    }

    fn run(&self, problem: &Job, tasks: &[(u32, Vec<u8>)], hooks: &dyn Hooks) -> Result<Vec<Vec<u8>>, NotRun> {
        work::run(problem, tasks, hooks)
    }
}

/// The coordinator's side of a job that simulates.
struct Simulating {
    job: Checked,
    /// Sum of the counts of all runs, once they are complete.
    counts: Option<Counts>,
}

impl Simulating {
    fn repeats(&self) -> u32 {
        self.job.spec().simulate.as_ref().and_then(|simulate| simulate.repeats).unwrap_or(0)
    }

    fn at(&self, index: u32) -> Option<Task> {
        match self.repeats() {
            repeats if index < repeats => Some(Task::Repeat { repeat: index }),
            repeats if index == repeats => Some(Task::Unvaried),
            _ => None,
        }
    }

    fn report(&mut self, results: &[Arc<[u8]>]) -> Result<Vec<u8>, String> {
        let mut report = SimulationReport {
            joints: self.job.robot().joint_names(),
            bodies: self.job.robot().bodies.iter().map(|body| body.name.clone()).collect(),
            unvaried: Vec::new(),
            repeats: Vec::new(),
            counts: Counts::default(),
        };
        for result in results {
            let counts = match TaskResult::decode(result).map_err(|e| format!("a result is unusable: {e}"))? {
                TaskResult::Repeated(runs, counts) => {
                    report.repeats.push(runs);
                    counts
                }
                TaskResult::Unvaried(recorded, counts) => {
                    report.unvaried.extend(recorded);
                    counts
                }
            };
            report.counts += counts;
        }
        self.counts = Some(report.counts);
        serde_json::to_vec(&report).map_err(|e| format!("the report can't be serialised: {e}"))
    }
}

impl Procedure for Simulating {
    fn round(&self) -> Round {
        Round {
            number: 0,
            tasks: self.repeats() + 1,
            at_most: 4,
            lanes: 1,
            phase: PHASE,
            shared: Arc::from([].as_slice()),
            kept: true,
        }
    }

    fn task(&self, index: u32) -> Vec<u8> {
        self.at(index).unwrap_or_else(|| panic!("the round has no task {index}")).encode()
    }

    fn describe(&self, index: u32) -> String {
        match self.at(index) {
            Some(Task::Repeat { repeat }) => format!("repeat {repeat}"),
            Some(Task::Unvaried) => "the motion with nothing varied".to_owned(),
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
        let step = if results.len() == wanted {
            match self.report(results) {
                Ok(content) => Step::Done(vec![Artefact {
                    name: "simulation".to_owned(),
                    media_type: "application/json".to_owned(),
                    content,
                }]),
                Err(reason) => Step::Failed(reason),
            }
        } else {
            Step::Failed(format!("the round has {wanted} tasks, but {} results", results.len()))
        };
        RoundEnd { row: None, step }
    }

    fn save(&self) -> Vec<u8> {
        encoding::encode(FORMAT, &self.counts)
    }

    fn progress(&self) -> Progress {
        let done = if self.counts.is_some() { self.round().tasks } else { 0 };
        let mut values = vec![number("evaluations", done.into())];
        values.extend(counted(&self.counts.unwrap_or_default()));
        Progress { phase: PHASE.into(), unit: "repeats".into(), done, total: self.round().tasks, values }
    }
}
