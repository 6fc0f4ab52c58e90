//! Tasks of an evolution and their results, encoded as bytes.

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

/// A task of a round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Task {
    /// Scoring of a candidate of the search.
    Evaluate {
        /// Generation, from 0.
        generation: u32,
        /// Index in its generation, from 0.
        candidate: u32,
        /// Its parameters.
        genotype: Genotype,
    },
    /// Examination of a candidate.
    Examine(Examination),
}

/// Outcome of a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TaskResult {
    /// Result of [`Task::Evaluate`].
    Evaluated {
        /// The genotype that was scored, if it is not the one sent.
        genotype: Option<Genotype>,
        /// The score; `None` if the evaluation failed.
        score: Option<f64>,
        /// Descriptors of the candidate's behaviour, for searches that use them.
        descriptors: Vec<f64>,
        /// Effort of the evaluation.
        counts: Counts,
    },
    /// Result of [`Task::Examine`].
    Examined {
        /// Scores, one per tree; `None` for a failed evaluation.
        scores: Vec<Option<f64>>,
        /// Effort of the examination.
        counts: Counts,
        /// Traces, for the question that needs them.
        traces: Option<Traces>,
    },
}

encoded!(Task = TASK, TaskResult = RESULT);

impl fmt::Display for TaskResult {
    /// Writes a summary such as "score 12.5 (bits 4029000000000000)", "scores failed, failed" or "traces".
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
