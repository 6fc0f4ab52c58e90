//! Checks of a task's result before any of it is stored.

use super::task::{Task, TaskResult};
use crate::base::encoding::Unreadable;
use crate::problem::Checked;
use crate::procedure::evolve::finish::Question;
use crate::procedure::possible::{Most, Uncountable, counted, traces_of};

/// A fault of a result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// The bytes can't be read.
    #[error("{0}")]
    Unreadable(#[from] Unreadable),
    /// The result of an evaluation for an examination, or the other way round.
    #[error("it is the result of {found}, not of {wanted}")]
    Kind {
        /// Kind of task that the result belongs to.
        found: &'static str,
        /// Kind of the task.
        wanted: &'static str,
    },
    /// A genotype or descriptors that the search does not use.
    #[error("it has {0}, which this search does not use")]
    Uncalled(&'static str),
    /// A score outside the range of the fitness.
    #[error("score {score} is out of range: allowed is {min} to {max}")]
    Score {
        /// The score.
        score: f64,
        /// Least possible.
        min: f64,
        /// Greatest possible.
        max: f64,
    },
    /// The number of scores is not the number of trees.
    #[error("it has {found} scores; {wanted} are needed")]
    Scores {
        /// Number of scores in the result.
        found: usize,
        /// Number of scores needed.
        wanted: usize,
    },
    /// Some trees failed and others did not. They share a budget, so they fail together.
    #[error("some of its trees failed and others did not: they share a budget, so they fail together")]
    HalfFailed,
    /// A count exceeds the job's budget.
    #[error(transparent)]
    Count(#[from] Uncountable),
    /// Traces that were not requested, or requested traces that are missing.
    #[error("{}", if *.wanted { "its traces are missing" } else { "it has traces, which were not requested" })]
    TracesPresence {
        /// True if traces were requested.
        wanted: bool,
    },
    /// Traces that do not fit the job's robot and gaits.
    #[error("its traces are impossible: {0}")]
    Traces(String),
}

/// Rejects a result that is impossible for the task.
pub(super) fn check(job: &Checked, task: &Task, result: &[u8]) -> Result<(), Fault> {
    match (task, TaskResult::decode(result)?) {
        (Task::Evaluate { .. }, TaskResult::Evaluated { genotype, score, descriptors, counts }) => {
            if genotype.is_some() {
                return Err(Fault::Uncalled("a genotype other than the one sent"));
            }
            if !descriptors.is_empty() {
                return Err(Fault::Uncalled("descriptors"));
            }
            in_range(job, score)?;
            Ok(counted(&counts, &Most::of_trees(job, job, job.spec().planner.repeats, true))?)
        }
        (Task::Examine(examination), TaskResult::Examined { scores, counts, traces }) => {
            let question = examination.question;
            let wanted = scores_of(job, question);
            if scores.len() != wanted {
                return Err(Fault::Scores { found: scores.len(), wanted });
            }
            if scores.iter().any(Option::is_some) && scores.iter().any(Option::is_none) {
                return Err(Fault::HalfFailed);
            }
            scores.iter().try_for_each(|&score| in_range(job, score))?;
            counted(&counts, &of_question(job, question))?;
            match (question == Question::Traces, traces) {
                (true, Some(traces)) => traces_of(job, &examination.candidate.genotype, &traces).map_err(Fault::Traces),
                (false, None) => Ok(()),
                (wanted, _) => Err(Fault::TracesPresence { wanted }),
            }
        }
        (Task::Evaluate { .. }, TaskResult::Examined { .. }) => {
            Err(Fault::Kind { found: "an examination", wanted: "an evaluation" })
        }
        (Task::Examine(_), TaskResult::Evaluated { .. }) => {
            Err(Fault::Kind { found: "an evaluation", wanted: "an examination" })
        }
    }
}

/// Returns the number of scores that answer a question, one per tree.
pub(super) fn scores_of(job: &Checked, question: Question) -> usize {
    match question {
        Question::WithoutReuse => job.spec().planner.repeats as usize,
        Question::Traces => 0,
        Question::Fresh | Question::Reference | Question::LessFriction | Question::MoreFriction => {
            job.fresh_seeds() as usize
        }
    }
}

/// Rejects scores outside the range of the job's fitness, among them NaN and infinities.
pub(super) fn in_range(job: &Checked, score: Option<f64>) -> Result<(), Fault> {
    let (min, max) = job.score_range();
    match score {
        Some(score) if !(min..=max).contains(&score) => Err(Fault::Score { score, min, max }),
        _ => Ok(()),
    }
}

/// Returns the bounds on the counts of a question's answer.
fn of_question(job: &Checked, question: Question) -> Most {
    let planner = &job.spec().planner;
    match question {
        Question::Fresh => Most::of_trees(job, job, job.fresh_seeds(), true),
        Question::Reference | Question::LessFriction | Question::MoreFriction => {
            Most::of_trees(job, job.on_reference().unwrap_or(job), job.fresh_seeds(), true)
        }
        Question::WithoutReuse => Most::of_trees(job, job, planner.repeats, planner.reuse_tolerance == 0.0),
        Question::Traces => Most::of_trees(job, job, planner.repeats, true).with_traces(job),
    }
}
