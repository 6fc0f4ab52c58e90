//! Procedures: the work of a job, round by round.
//!
//! A procedure has two sides. The coordinator's side, [`Procedure`], defines the tasks of a round, receives their
//! results and moves on to the next round. It simulates nothing, its cost is bounded, and its state can be saved after
//! every round. The worker's side, [`Bench::run`], carries out tasks. All other components treat tasks and results as
//! bytes.
//!
//! Every job begins with round 0, its *preparation* ([`preparing`]): a worker settles the robot. The result becomes the
//! bytes that all tasks of later rounds share. So a coordinator never simulates.

pub mod bench;
pub mod evolve;
pub mod kinds;
pub mod plan;
mod possible;
pub mod preparing;
pub mod simulate;
mod values;

pub use bench::Bench;

use crate::base::digest::Digest;
use crate::base::error::Invalid;
use crate::base::registry::Component;
use crate::problem::{Checked, Job};
use preparing::Preparing;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::sync::Arc;

/// A set of tasks that is complete before the next set begins.
#[derive(Clone, Debug)]
pub struct Round {
    /// Number of the round, from 0; round 0 is the preparation.
    pub number: u32,
    /// Number of tasks, at least 1.
    pub tasks: u32,
    /// Most tasks in one assignment, at least 1. It is 1 if tasks are long and differ in duration.
    pub at_most: u32,
    /// Number of tasks that together take as long as one, at least 1: an engine's lanes.
    pub lanes: u32,
    /// Name of the work in one word, such as "preparing" or "searching". A measured cost per task is valid within a
    /// phase.
    pub phase: &'static str,
    /// Bytes that all tasks of the round share; sent to a worker once per session. Empty in round 0.
    pub shared: Arc<[u8]>,
    /// True if the results of the sealed round stay in the store, where a restart uses them.
    pub kept: bool,
}

/// Error of a result that is impossible for its task. It adds a mark to the worker that sent it; not retryable.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the result of {task} is refused: {reason}")]
pub struct Rejected {
    /// Description of the task for people.
    pub task: String,
    /// The fault, and the allowed values.
    pub reason: String,
}

/// Error of a saved state that can't be used. Not retryable: submit the job again.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the stored state can't be used: {0}")]
pub struct BadState(pub String);

/// Error of a batch that a procedure does not accept.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the batch is refused: {0}")]
pub struct Refused(pub String);

/// A named number for tables, progress bars and pages.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Value {
    /// Name, such as "best" or "rollouts".
    pub name: Cow<'static, str>,
    /// Unit, such as "%"; empty for a pure number.
    pub unit: Cow<'static, str>,
    /// The value; `None` if it is not defined, such as the best while every evaluation failed.
    pub value: Option<f64>,
}

impl PartialEq for Value {
    /// Compares values by their bits.
    fn eq(&self, other: &Self) -> bool {
        let bits = |value: Option<f64>| value.map(f64::to_bits);
        (&self.name, &self.unit, bits(self.value)) == (&other.name, &other.unit, bits(other.value))
    }
}

/// A row about a sealed round, in a series.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeriesRow {
    /// Name of the series, such as "generations".
    pub series: Cow<'static, str>,
    /// Index of the row in its series, from 0.
    pub index: u32,
    /// Columns, the same in every row of a series.
    pub values: Vec<Value>,
}

/// Progress of a procedure.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// [`Round::phase`] of the current round.
    pub phase: Cow<'static, str>,
    /// Name of the counted units in the plural, such as "generations".
    pub unit: Cow<'static, str>,
    /// Number of finished units.
    pub done: u32,
    /// Number of all units.
    pub total: u32,
    /// Values for lists, progress bars and pages.
    pub values: Vec<Value>,
}

/// A file of a job's result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Artefact {
    /// Name, such as "report".
    pub name: String,
    /// Format, such as "application/json".
    pub media_type: String,
    /// Content of the file.
    pub content: Vec<u8>,
}

/// Next step after a round's results.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// The next round: [`Procedure::round`].
    Next,
    /// The job waits for a client's batch: [`Procedure::offer`].
    Waiting,
    /// The job succeeded with these files.
    Done(Vec<Artefact>),
    /// The job failed for this reason.
    Failed(String),
}

/// Answer of a procedure to a round's results.
#[derive(Clone, Debug, PartialEq)]
pub struct RoundEnd {
    /// The row of the round's series, if it has one.
    pub row: Option<SeriesRow>,
    /// The next step.
    pub step: Step,
}

/// The coordinator's side of a job.
pub trait Procedure: Send {
    /// Returns the current round. It stays the same until [`Procedure::tell`].
    fn round(&self) -> Round;

    /// Returns a task of the current round as it is sent to a worker. Every call returns the same bytes.
    ///
    /// # Panics
    /// If there is no such task.
    fn task(&self, index: u32) -> Vec<u8>;

    /// Describes a task of the current round for people, such as "the evaluation of candidate 3 of generation 7".
    fn describe(&self, index: u32) -> String;

    /// Checks that bytes are a result of a task of the current round: complete, in range, and encoded as this side
    /// encodes.
    fn check(&self, index: u32, result: &[u8]) -> Result<(), Rejected>;

    /// Describes a result for people so that different results are distinguishable: a score and its bits.
    fn show(&self, result: &[u8]) -> String;

    /// Returns `n` once the results of the first `n` tasks decide the round; the other tasks are then cancelled.
    fn decided(&self, _so_far: &[Option<Arc<[u8]>>]) -> Option<u32> {
        None
    }

    /// Receives the results of the current round by index, all of them checked, and moves on.
    fn tell(&mut self, results: &[Arc<[u8]>]) -> RoundEnd;

    /// Receives a client's batch, if the procedure waits for one.
    fn offer(&mut self, _batch: &[u8]) -> Result<(), Refused> {
        Err(Refused("this job takes no batches".to_owned()))
    }

    /// Returns the state between two rounds, to be stored.
    fn save(&self) -> Vec<u8>;

    /// Returns the progress of the job.
    fn progress(&self) -> Progress;
}

/// Callbacks of a running task to its worker.
pub trait Hooks {
    /// Returns true if the work may be given up. It is called before every batch of rollouts, so each call is also a
    /// sign of progress.
    fn stop(&self) -> bool;

    /// Receives a part of a task's result, for clients that watch the job.
    fn partial(&self, _index: u32, _part: &[u8]) {}
}

/// Reason for which tasks were not carried out.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotRun {
    /// A hook requested the stop.
    #[error("stopped before the work was done")]
    Stopped,
    /// The bytes are not tasks of this job: the coordinator is of another build.
    #[error("the task can't be carried out: {0}")]
    Task(String),
}

/// Returns the digest of a result's bytes. Two results of a task are equal if their digests are.
pub fn result_digest(result: &[u8]) -> Digest {
    Digest::of_bytes("evogait task result 1", result)
}

/// A kind of procedure with both its sides, registered in [`kinds`]. Its revision covers all that it computes in the
/// coordinator: the tasks, the steps after their results, and the report.
pub trait ProcedureKind: Component {
    /// Creates the coordinator's side of a job before its first round. Simulates nothing. Its rounds share no bytes.
    fn start(&self, problem: &Checked) -> Result<Box<dyn Procedure>, Invalid>;

    /// Restores the coordinator's side of a job from a saved state.
    fn load(&self, problem: &Checked, saved: &[u8]) -> Result<Box<dyn Procedure>, BadState>;

    /// Carries out tasks of one round, given as (index, bytes), and returns their results in the same order.
    fn run(&self, problem: &Job, tasks: &[(u32, Vec<u8>)], hooks: &dyn Hooks) -> Result<Vec<Vec<u8>>, NotRun>;
}

/// Creates a job's procedure before its first round. Simulates nothing.
pub fn start(problem: &Checked) -> Result<Box<dyn Procedure>, Invalid> {
    Ok(Box::new(Preparing::start(kinds::of(problem.spec())?, problem)?))
}

/// Returns the name of a job's procedure, such as "evolve".
///
/// # Errors
/// If there is no procedure of that name.
pub fn name(problem: &Checked) -> Result<&'static str, Invalid> {
    Ok(kinds::of(problem.spec())?.name())
}

/// Restores a job's procedure from a saved state.
pub fn load(problem: &Checked, saved: &[u8]) -> Result<Box<dyn Procedure>, BadState> {
    let kind = kinds::of(problem.spec()).map_err(|e| BadState(e.to_string()))?;
    Ok(Box::new(Preparing::load(kind, problem, saved)?))
}
