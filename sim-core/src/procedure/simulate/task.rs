//! Tasks of a job that simulates and their results, encoded as bytes.

use super::Drawn;
use crate::base::encoding::encoded;
use crate::base::score::Counts;
use crate::model::Place;
use crate::problem::{Checked, Way};
use crate::report::TraceSample;
use serde::{Deserialize, Serialize};
use std::fmt;

/// First byte of an encoded task.
const TASK: u8 = 0xB4;
/// First byte of an encoded result.
const RESULT: u8 = 0xC4;

/// A task of the round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Task {
    /// A repeat: the motion in all ways of the job, with the repeat's draws.
    Repeat {
        /// Index of the repeat, from 0.
        repeat: u32,
    },
    /// The motion in all ways with nothing varied, recorded with samples.
    Unvaried,
}

/// Result of a task: one run for each way, in the job's order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TaskResult {
    /// Result of [`Task::Repeat`].
    Repeated(Vec<Run>, Counts),
    /// Result of [`Task::Unvaried`].
    Unvaried(Vec<Recorded>, Counts),
}

/// A motion carried out once. Lengths in mu, angles in rad, times in s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Way in which the steps followed each other.
    pub way: Way,
    /// Values drawn for the run.
    pub drawn: Drawn,
    /// Reason of the run's end.
    pub ended: Ended,
    /// Simulated time until the end.
    pub seconds: f64,
    /// Place of the pivot at the end: x, y, z, yaw.
    pub end: [f64; 4],
    /// Length of the pivot's path in the plane, over samples 1/20 s apart.
    pub travelled: f64,
    /// Time of the first touch of an obstacle. Obstacles are not simulated, so the motion after it passes through the
    /// obstacle.
    pub touched: Option<f64>,
    /// True if the pivot left the map.
    pub left_map: bool,
    /// Mechanical work of the motors, kg·mu²/s².
    pub work: f64,
    /// Sum of the absolute values of that work.
    pub turnover: f64,
    /// For each body, the share of samples at which it touched the ground or terrain.
    pub contact: Vec<f64>,
    /// Indexes of the executed gaits in order, from 0; empty for a motion without gaits.
    pub gaits: Vec<u32>,
    /// Number of new plans.
    pub replans: u32,
    /// The pivot's path, (x, y) in the map.
    pub path: Vec<[f64; 2]>,
}

/// Reason of a run's end.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ended {
    /// The whole motion was executed. With replanning also: the robot reached the goal, touched an obstacle, or no plan
    /// was left.
    Completed,
    /// The simulation broke, for this reason.
    Broken(String),
    /// The run did not begin, since the robot can't stand at its start, for this reason.
    NoStart(String),
}

/// A run with its samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recorded {
    /// The run.
    pub run: Run,
    /// Samples at equal time steps.
    pub samples: Vec<TraceSample>,
    /// For each sample and body, true if the body touches the ground or terrain.
    pub touching: Vec<Vec<bool>>,
}

impl Run {
    /// Returns the pivot's place at the start, without its height.
    pub fn start(&self) -> Place {
        let [x, y, yaw] = self.drawn.start;
        Place { x, y, z: 0.0, yaw }
    }

    /// Returns the pivot's place at the end.
    pub fn end(&self) -> Place {
        let [x, y, z, yaw] = self.end;
        Place { x, y, z, yaw }
    }

    /// Returns the displacement in the frame of the start: x ahead, y to the left, yaw in (−π, π].
    pub fn displacement(&self) -> Place {
        self.start().seen(&self.end())
    }

    /// Returns the planar distance from the end to the goal; `None` without a goal.
    pub fn distance(&self, job: &Checked) -> Option<f64> {
        job.environment().goal.map(|goal| self.end().planar_distance(&Place { x: goal.x, y: goal.y, ..Place::ORIGIN }))
    }

    /// Returns the planar distance from the end to the planned end; `None` if the job gives no places, or replans.
    pub fn deviation(&self, job: &Checked) -> Option<f64> {
        let simulate = job.spec().simulate.as_ref().filter(|simulate| simulate.replan.is_none())?;
        let &[x, y, ..] = simulate.places.as_ref()?.last()?;
        Some(self.end().planar_distance(&Place { x, y, ..Place::ORIGIN }))
    }

    /// Returns true if the motion completed inside the map, without touching an obstacle, and within the goal's radius
    /// if there is a goal.
    pub fn succeeded(&self, job: &Checked) -> bool {
        let there =
            job.environment().goal.zip(self.distance(job)).is_none_or(|(goal, distance)| distance <= goal.radius);
        self.ended == Ended::Completed && self.touched.is_none() && !self.left_map && there
    }
}

encoded!(Task = TASK, TaskResult = RESULT);

impl TaskResult {
    /// Returns the runs, and their effort.
    pub fn runs(&self) -> (Vec<&Run>, &Counts) {
        match self {
            Self::Repeated(runs, counts) => (runs.iter().collect(), counts),
            Self::Unvaried(recorded, counts) => (recorded.iter().map(|recorded| &recorded.run).collect(), counts),
        }
    }
}

impl fmt::Display for TaskResult {
    /// Writes a summary such as "an end at (1.5, 2) (bits 3ff8000000000000, 4000000000000000)".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.runs().0.first() {
            Some(Run { end: [x, y, ..], .. }) => {
                write!(f, "an end at ({x}, {y}) (bits {:016x}, {:016x})", x.to_bits(), y.to_bits())
            }
            None => f.write_str("no run"),
        }
    }
}
