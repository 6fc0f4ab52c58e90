//! Tasks of a job that simulates and their results, as bytes.

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

/// One piece of work.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Task {
    /// The motion, in all ways of the job.
    Repeat {
        /// Index of the repeat, from 0.
        repeat: u32,
    },
    /// The same with nothing varied, written down.
    Unvaried,
}

/// Outcome of a task: a run a way, in the order of the job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TaskResult {
    /// That of [`Task::Repeat`].
    Repeated(Vec<Run>, Counts),
    /// That of [`Task::Unvaried`].
    Unvaried(Vec<Recorded>, Counts),
}

/// A motion carried out once. Lengths in mu, angles in rad, times in s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Way in which its steps followed each other.
    pub way: Way,
    /// Values drawn for it.
    pub drawn: Drawn,
    /// End of the run.
    pub ended: Ended,
    /// Simulated time until it ended.
    pub seconds: f64,
    /// Place of the pivot at the end: x, y, z, yaw.
    pub end: [f64; 4],
    /// Length of the pivot's way in the plane, over samples 1/20 s apart.
    pub travelled: f64,
    /// When it first touched an obstacle. Obstacles are not simulated: what comes later goes through it.
    pub touched: Option<f64>,
    /// True if the pivot left the map.
    pub left_map: bool,
    /// Mechanical work of the motors, kg·mu²/s².
    pub work: f64,
    /// The same without signs.
    pub turnover: f64,
    /// Of each body, the share of samples at which it touched the ground or terrain.
    pub contact: Vec<f64>,
    /// The gaits that were carried out in turn, from 0; none of a motion that is not made of gaits.
    pub gaits: Vec<u32>,
    /// Plans that were made anew.
    pub replans: u32,
    /// The pivot's path, (x, y) in the map.
    pub path: Vec<[f64; 2]>,
}

/// End of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ended {
    /// After all of the motion; of one that is planned anew also once it has reached the goal, touched an obstacle or has no plan.
    Completed,
    /// The simulation broke; why.
    Broken(String),
    /// It did not begin: the robot can't stand where it would start; why.
    NoStart(String),
}

/// A run with all that is to be seen of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recorded {
    /// The run.
    pub run: Run,
    /// Samples over time, at equal steps.
    pub samples: Vec<TraceSample>,
    /// At each sample, of each body whether it touches the ground or terrain.
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

    /// Returns the displacement in the frame of its start: x ahead, y to the left, yaw turned in (−π, π].
    pub fn displacement(&self) -> Place {
        self.start().seen(&self.end())
    }

    /// Planar distance from the end to the goal; `None` without a goal.
    pub fn distance(&self, job: &Checked) -> Option<f64> {
        job.environment().goal.map(|goal| self.end().planar_distance(&Place { x: goal.x, y: goal.y, ..Place::ORIGIN }))
    }

    /// Returns the planar distance from its end to the end of the plan; `None` without places, or with replanning.
    pub fn deviation(&self, job: &Checked) -> Option<f64> {
        let simulate = job.spec().simulate.as_ref().filter(|simulate| simulate.replan.is_none())?;
        let &[x, y, ..] = simulate.places.as_ref()?.last()?;
        Some(self.end().planar_distance(&Place { x, y, ..Place::ORIGIN }))
    }

    /// Returns true if it ended soundly, on the map, without touching an obstacle, and within the goal's radius if
    /// there is a goal.
    pub fn succeeded(&self, job: &Checked) -> bool {
        let there =
            job.environment().goal.zip(self.distance(job)).is_none_or(|(goal, distance)| distance <= goal.radius);
        self.ended == Ended::Completed && self.touched.is_none() && !self.left_map && there
    }
}

encoded!(Task = TASK, TaskResult = RESULT);

impl TaskResult {
    /// The runs, and what they took.
    pub fn runs(&self) -> (Vec<&Run>, &Counts) {
        match self {
            Self::Repeated(runs, counts) => (runs.iter().collect(), counts),
            Self::Unvaried(recorded, counts) => (recorded.iter().map(|recorded| &recorded.run).collect(), counts),
        }
    }
}

impl fmt::Display for TaskResult {
    /// Such as "an end at (1.5, 2) (bits 3ff8000000000000, 4000000000000000)".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.runs().0.first() {
            Some(Run { end: [x, y, ..], .. }) => {
                write!(f, "an end at ({x}, {y}) (bits {:016x}, {:016x})", x.to_bits(), y.to_bits())
            }
            None => f.write_str("no run"),
        }
    }
}
