//! Tasks of a job that plans and their results, encoded as bytes.

use super::Tried;
use crate::base::encoding::encoded;
use crate::base::random::{Purpose, Stream};
use crate::base::score::Counts;
use crate::problem::Job;
use crate::report::Traces;
use serde::{Deserialize, Serialize};
use std::fmt;

/// First byte of an encoded task.
const TASK: u8 = 0xB2;
/// First byte of an encoded result.
const RESULT: u8 = 0xC2;

/// A task of a round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Task {
    /// Growth of a tree.
    Grow {
        /// Index of the tree, from 0.
        seed: u32,
    },
    /// Growth of a tree again, with a record of it.
    Trace {
        /// Index of the tree, from 0.
        seed: u32,
    },
}

/// Outcome of a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TaskResult {
    /// Result of [`Task::Grow`].
    Grown(Tried),
    /// Result of [`Task::Trace`].
    Traced {
        /// The gaits, the tree, and its plan executed in three ways.
        traces: Traces,
        /// Effort of the task.
        counts: Counts,
    },
}

/// Summary of a tree. Lengths in mu, angles in rad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grown {
    /// Score by the job's fitness.
    pub score: f64,
    /// True if a node is within the goal's radius; false without a goal.
    pub reached: bool,
    /// Least planar distance of a node to the goal; `None` without a goal.
    pub distance: Option<f64>,
    /// Share of the map's cells that hold a node, percent. Cells are those of the job's fitness, or of 2 mu. `None` if
    /// the map has too many of them.
    pub coverage: Option<f64>,
    /// The plan: gaits from the root to the node nearest to the goal, or without a goal to the node farthest from the
    /// root.
    pub plan: Vec<Step>,
}

/// A gait of a plan, and the place where it leads.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Index of the gait, from 0.
    pub gait: u32,
    /// x of the pivot's arrival, mu.
    pub x: f64,
    /// y of the pivot's arrival, mu.
    pub y: f64,
    /// Height of the pivot, mu.
    pub z: f64,
    /// Heading, rad, in (−π, π].
    pub yaw: f64,
}

/// Returns the random stream of a tree.
pub fn stream(job: &Job, seed: u32) -> Stream {
    Stream::new(job.spec().seed, Purpose::Plan, 0, 0, seed)
}

encoded!(Task = TASK, TaskResult = RESULT);

impl fmt::Display for TaskResult {
    /// Writes a summary such as "score 12.5 (bits 4029000000000000), a plan of 4 gaits", "failed" or "traces".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Grown(Tried { grown: Some(Grown { score, plan, .. }), .. }) => {
                write!(f, "score {score} (bits {:016x}), a plan of {} gaits", score.to_bits(), plan.len())
            }
            Self::Grown(Tried { grown: None, .. }) => f.write_str("failed"),
            Self::Traced { .. } => f.write_str("traces"),
        }
    }
}
