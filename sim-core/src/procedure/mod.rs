//! Procedures: what a job does, round by round.
//!
//! A procedure has two sides. The coordinator's side, [`Procedure`], says which tasks a round has, takes their results and
//! moves on; it simulates nothing, its cost is bounded, and its state can be saved after every round. The worker's side,
//! [`Bench::run`], carries tasks out. Tasks and results are bytes to everything in between.
//!
//! Every job begins with round 0, its *preparation* ([`preparing`]): a worker settles the robot, and what it found is
//! handed to all tasks of later rounds as the bytes they share. So no coordinator ever simulates.

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
    /// Its number, from 0; round 0 is the preparation.
    pub number: u32,
    /// Tasks, at least 1.
    pub tasks: u32,
    /// Most tasks in one assignment, at least 1. 1 where each is long and no two take the same time.
    pub at_most: u32,
    /// Tasks that take as long together as one alone, at least 1: an engine's lanes.
    pub lanes: u32,
    /// Name of the work, one word: "preparing", "searching". A task's measured cost holds within a phase.
    pub phase: &'static str,
    /// Bytes that all tasks of the round share; sent to a worker once a session. Empty in round 0.
    pub shared: Arc<[u8]>,
    /// Results of the sealed round stay in the store: a restart takes them over.
    pub kept: bool,
}

/// A result that can't be one of its task. Costs the worker that sent it a mark; not retryable.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the result of {task} is refused: {reason}")]
pub struct Rejected {
    /// The task, for people.
    pub task: String,
    /// The fault, and the allowed values.
    pub reason: String,
}

/// A saved state that can't be used. Not retryable: submit the job again.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the stored state can't be used: {0}")]
pub struct BadState(pub String);

/// A batch that a procedure does not take.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the batch is refused: {0}")]
pub struct Refused(pub String);

/// A number with a name, for tables, bars and pages.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Value {
    /// Such as "best" or "rollouts".
    pub name: Cow<'static, str>,
    /// Such as "%"; empty for a pure number.
    pub unit: Cow<'static, str>,
    /// `None` where there is none, such as the best while every evaluation failed.
    pub value: Option<f64>,
}

impl PartialEq for Value {
    /// Equal when the bits are.
    fn eq(&self, other: &Self) -> bool {
        let bits = |value: Option<f64>| value.map(f64::to_bits);
        (&self.name, &self.unit, bits(self.value)) == (&other.name, &other.unit, bits(other.value))
    }
}

/// A row about a sealed round, in a series.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The series, such as "generations".
    pub series: Cow<'static, str>,
    /// The row's number in it, from 0.
    pub index: u32,
    /// Columns, the same in every row of a series.
    pub values: Vec<Value>,
}

/// Progress of a procedure.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// [`Round::phase`] of the round at hand.
    pub phase: Cow<'static, str>,
    /// Name of the units that it counts, in the plural: "generations".
    pub unit: Cow<'static, str>,
    /// Number of finished units …
    pub done: u32,
    /// … of so many.
    pub total: u32,
    /// Values for lists, bars and pages.
    pub values: Vec<Value>,
}

/// Something that a job made: a file of its result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Artefact {
    /// Its name, such as "report".
    pub name: String,
    /// Its format, such as "application/json".
    pub media_type: String,
    /// Its content.
    pub content: Vec<u8>,
}

/// The step after a round's results.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// The next round: [`Procedure::round`].
    Next,
    /// A client's batch has to come first: [`Procedure::offer`].
    Waiting,
    /// The job is done.
    Done(Vec<Artefact>),
    /// The job failed, for this reason.
    Failed(String),
}

/// Answer of a procedure to a round's results.
#[derive(Clone, Debug, PartialEq)]
pub struct Told {
    /// The row of the round's series, if it has one.
    pub row: Option<Row>,
    /// The next step.
    pub step: Step,
}

/// The coordinator's side of a job.
pub trait Procedure: Send {
    /// The round at hand. The same until [`Procedure::tell`].
    fn round(&self) -> Round;

    /// A task of the round at hand, as a worker gets it. The same bytes whenever it is asked for.
    ///
    /// # Panics
    /// If there is no such task.
    fn task(&self, index: u32) -> Vec<u8>;

    /// A task of the round at hand, for people: "the evaluation of candidate 3 of generation 7".
    fn describe(&self, index: u32) -> String;

    /// Checks that bytes are a result of a task of the round at hand: whole, in range, and encoded as this side would.
    fn check(&self, index: u32, result: &[u8]) -> Result<(), Rejected>;

    /// Returns a result for people, which shows how two results differ: a score and its bits.
    fn show(&self, result: &[u8]) -> String;

    /// Returns the number of first tasks that settle the round, once their results are there; the others are then
    /// cancelled.
    fn decided(&self, _so_far: &[Option<Arc<[u8]>>]) -> Option<u32> {
        None
    }

    /// Takes the results of the round at hand, by index, all checked before, and moves on.
    fn tell(&mut self, results: &[Arc<[u8]>]) -> Told;

    /// Takes a client's batch, where it waits for one.
    fn offer(&mut self, _batch: &[u8]) -> Result<(), Refused> {
        Err(Refused("this job takes no batches".to_owned()))
    }

    /// The state between two rounds, to be stored.
    fn save(&self) -> Vec<u8>;

    /// Returns its progress.
    fn progress(&self) -> Progress;
}

/// Messages between a running task and its worker.
pub trait Hooks {
    /// Returns true if the work may be given up. Called before every batch of rollouts, so each call is also a sign of
    /// progress.
    fn stop(&self) -> bool;

    /// Receives a part of a task's result, for watchers.
    fn partial(&self, _index: u32, _part: &[u8]) {}
}

/// Why tasks were not carried out.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotRun {
    /// It was asked to stop.
    #[error("stopped before the work was done")]
    Stopped,
    /// The bytes are no tasks of this job: the coordinator is of another build.
    #[error("the task can't be carried out: {0}")]
    Task(String),
}

/// The digest of a result's bytes: two results of a task are the same when these are.
pub fn result_digest(result: &[u8]) -> Digest {
    Digest::of_bytes("evogait task result 1", result)
}

/// A kind of procedure: both its sides. Registered in [`kinds`]. Its revision covers all that it computes in the
/// coordinator: which tasks there are, what follows from their results, the report.
pub trait ProcedureKind: Component {
    /// The coordinator's side of a job before its first round. Nothing is simulated. Its rounds share no bytes.
    fn start(&self, problem: &Checked) -> Result<Box<dyn Procedure>, Invalid>;

    /// The coordinator's side of a job as it was saved.
    fn load(&self, problem: &Checked, saved: &[u8]) -> Result<Box<dyn Procedure>, BadState>;

    /// Carries out tasks of one round: (index, bytes). Results in their order.
    fn run(&self, problem: &Job, tasks: &[(u32, Vec<u8>)], hooks: &dyn Hooks) -> Result<Vec<Vec<u8>>, NotRun>;
}

/// A job's procedure before its first round. Nothing is simulated.
pub fn start(problem: &Checked) -> Result<Box<dyn Procedure>, Invalid> {
    Ok(Box::new(Preparing::start(kinds::of(problem.spec())?, problem)?))
}

/// The name of a job's procedure, such as "evolve"; an error if there is none of that name.
pub fn name(problem: &Checked) -> Result<&'static str, Invalid> {
    Ok(kinds::of(problem.spec())?.name())
}

/// A job's procedure as it was saved.
pub fn load(problem: &Checked, saved: &[u8]) -> Result<Box<dyn Procedure>, BadState> {
    let kind = kinds::of(problem.spec()).map_err(|e| BadState(e.to_string()))?;
    Ok(Box::new(Preparing::load(kind, problem, saved)?))
}
