//! An examination: a question about a candidate, and its answer.

use crate::base::random::{Purpose, Stream};
use crate::base::score::Counts;
use crate::evaluate::{Stopped, Trial, grow, search_streams};
use crate::problem::{Job, Unprepared};
use crate::report::{self, Traces};
use crate::search::Scored;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Kind of question about a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Question {
    /// The candidate's scores on fresh RRT seeds, on the search's setting.
    Fresh,
    /// The candidate's scores on fresh RRT seeds on the reference setting; the same seeds for all candidates.
    Reference,
    /// As [`Question::Reference`], with friction lower by the share [`FRICTION_STEP`].
    LessFriction,
    /// As [`Question::Reference`], with friction higher by the share [`FRICTION_STEP`].
    MoreFriction,
    /// The scores of the candidate's trees in the search, with every expansion simulated and none reused.
    WithoutReuse,
    /// The candidate's gaits, its tree and the tree's best path.
    Traces,
}

/// Relative change of friction that tests a winner's robustness.
pub const FRICTION_STEP: f64 = 0.1;

/// A question about a candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Examination {
    /// The kind of question.
    pub question: Question,
    /// The candidate.
    pub candidate: Scored,
}

/// Answer to an examination.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answer {
    /// Scores, one per tree; `None` for a failed evaluation. Evaluations fail if the trees together exceed the budget,
    /// the job has no reference, or the robot does not come to rest with the changed friction.
    pub scores: Vec<Option<f64>>,
    /// Effort of the examination.
    pub counts: Counts,
    /// Traces, for [`Question::Traces`].
    pub traces: Option<Traces>,
}

impl Examination {
    /// Makes an examination of a candidate.
    pub fn new(question: Question, candidate: &Scored) -> Self {
        Self { question, candidate: candidate.clone() }
    }

    /// Returns true if this is the examination of the candidate with this question.
    pub fn is(&self, question: Question, candidate: &Scored) -> bool {
        let place = |s: &Scored| (s.generation, s.candidate);
        self.question == question && place(&self.candidate) == place(candidate)
    }
}

impl fmt::Display for Examination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = match self.question {
            Question::Fresh => "the scores on fresh seeds",
            Question::Reference => "the scores on the reference setting",
            Question::LessFriction => "the scores with less friction",
            Question::MoreFriction => "the scores with more friction",
            Question::WithoutReuse => "the score without reuse",
            Question::Traces => "the traces",
        };
        write!(f, "{what} of candidate {} of generation {}", self.candidate.candidate, self.candidate.generation)
    }
}

/// Carries out an examination. If the job has no reference, friction is out of range, or the robot does not come to
/// rest with this friction, the answer consists of failed evaluations. Calls `stop` from time to time.
///
/// # Panics
/// If the genotype's length does not fit the job.
pub fn examine(job: &Job, examination: &Examination, stop: &dyn Fn() -> bool) -> Result<Answer, Stopped> {
    let candidate = &examination.candidate;
    let tolerance = job.spec().planner.reuse_tolerance;
    let search = || search_streams(job, candidate.generation, candidate.candidate);
    match examination.question {
        Question::Fresh => trees(job, candidate, tolerance, streams(job, Purpose::Rescore), stop),
        Question::Reference => on_reference(job, job.reference(), candidate, stop),
        Question::LessFriction => {
            on_reference(job, friction(job, 1.0 - FRICTION_STEP, stop)?.as_ref(), candidate, stop)
        }
        Question::MoreFriction => {
            on_reference(job, friction(job, 1.0 + FRICTION_STEP, stop)?.as_ref(), candidate, stop)
        }
        Question::WithoutReuse => trees(job, candidate, 0.0, search(), stop),
        Question::Traces => {
            let (traces, counts) = report::traces(job, &candidate.genotype, search(), stop)?;
            Ok(Answer { counts, traces: Some(traces), ..Answer::default() })
        }
    }
}

/// Returns scores on the job's reference, or on a variant of it.
fn on_reference(
    job: &Job,
    reference: Option<&Job>,
    candidate: &Scored,
    stop: &dyn Fn() -> bool,
) -> Result<Answer, Stopped> {
    match reference {
        Some(reference) => {
            let tolerance = job.spec().planner.reuse_tolerance;
            trees(reference, candidate, tolerance, streams(job, Purpose::Reference), stop)
        }
        None => Ok(Answer { scores: vec![None; job.fresh_seeds() as usize], ..Answer::default() }),
    }
}

/// Returns the reference with changed friction; `None` if it can't be used.
fn friction(job: &Job, factor: f64, stop: &dyn Fn() -> bool) -> Result<Option<Job>, Stopped> {
    let Some(reference) = job.reference() else { return Ok(None) };
    let Some(friction) = reference.spec().physics.friction else { return Ok(None) };
    let trembles = job.quiet().is_some() || reference.quiet().is_some();
    match reference.with_friction(friction * factor, trembles, stop) {
        Ok(other) => Ok(Some(other)),
        Err(Unprepared::Stopped) => Err(Stopped),
        Err(Unprepared::Refused(_)) => Ok(None),
    }
}

/// Returns the random streams of the trees for fresh scores. They are the same for all candidates of a job.
fn streams(job: &Job, purpose: Purpose) -> impl Iterator<Item = Stream> {
    let seed = job.spec().seed;
    (0..job.fresh_seeds()).map(move |repeat| Stream::new(seed, purpose, 0, 0, repeat))
}

fn trees(
    job: &Job,
    candidate: &Scored,
    tolerance: f64,
    streams: impl Iterator<Item = Stream>,
    stop: &dyn Fn() -> bool,
) -> Result<Answer, Stopped> {
    let mut trials = [Trial::new(job, &candidate.genotype, tolerance, streams)];
    grow(job, &mut trials, stop)?;
    let [trial] = trials;
    let told = |score| trial.failure.is_none().then_some(score);
    Ok(Answer { scores: trial.scores(job).into_iter().map(told).collect(), counts: trial.counts(), traces: None })
}
