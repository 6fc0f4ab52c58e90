//! Tasks of an evolution and their results, as bytes.

use crate::base::encoding::encoded;
use crate::base::score::Counts;
use crate::genotype::Genotype;
use crate::procedure::evolve::finish::Examination;
use crate::report::Traces;
use serde::{Deserialize, Serialize};
use std::fmt;

/// First byte of an encoded task.
const TASK: u8 = 0xB1;
/// First byte of an encoded result.
const RESULT: u8 = 0xC1;

/// One piece of work of a round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Task {
    /// A candidate of the search has to be scored.
    Evaluate {
        /// Generation, from 0.
        generation: u32,
        /// Index in its generation, from 0.
        candidate: u32,
        /// Its parameters.
        genotype: Genotype,
    },
    /// A question about a candidate has to be answered.
    Examine(Examination),
}

/// Outcome of a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TaskResult {
    /// That of [`Task::Evaluate`].
    Evaluated {
        /// The genotype that was scored, if it is not the one sent.
        genotype: Option<Genotype>,
        /// The score; `None` where the evaluation failed.
        score: Option<f64>,
        /// Descriptors of the candidate's behaviour, for searches that use them.
        descriptors: Vec<f64>,
        /// Its effort.
        counts: Counts,
    },
    /// That of [`Task::Examine`].
    Examined {
        /// One a tree; `None` where the evaluation failed.
        scores: Vec<Option<f64>>,
        /// Its effort.
        counts: Counts,
        /// Traces, for the question that needs them.
        traces: Option<Traces>,
    },
}

encoded!(Task = TASK, TaskResult = RESULT);

impl fmt::Display for TaskResult {
    /// Such as "score 12.5 (bits 4029000000000000)", "scores failed, failed" or "traces".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shown = |score: &Option<f64>| match score {
            Some(score) => format!("{score} (bits {:016x})", score.to_bits()),
            None => "failed".to_owned(),
        };
        match self {
            Self::Evaluated { score: None, .. } => f.write_str("failed"),
            Self::Evaluated { score, .. } => write!(f, "score {}", shown(score)),
            Self::Examined { traces: Some(_), .. } => f.write_str("traces"),
            Self::Examined { scores, .. } => {
                let scores: Vec<String> = scores.iter().map(shown).collect();
                write!(f, "scores {}", scores.join(", "))
            }
        }
    }
}
