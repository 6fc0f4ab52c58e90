//! Records of a candidate's motions, tree and path, for readers of a report.

mod record;

pub use record::{sample, stride};

use crate::base::random::Stream;
use crate::base::score::Counts;
use crate::evaluate::{Stopped, Trial, grow, search_streams};
use crate::genotype::Genotype;
use crate::model::Place;
use crate::model::environment::Environment;
use crate::plan::Tree;
use crate::problem::Job;
use crate::search::Scored;
use serde::{Deserialize, Serialize};

/// Record of a winner: the part of the report besides scores.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Traces {
    /// Each gait of the winner, executed from the start.
    pub gaits: Vec<GaitTrace>,
    /// Tree of the winner, as the search scored it; the first one if a candidate has several.
    pub tree: TreeRecord,
    /// Best path of the tree, executed in three ways.
    pub paths: Vec<PathTrace>,
}

/// Record of one gait from the settled start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GaitTrace {
    /// The gait's parameters, in the order of the genotype.
    pub parameters: Vec<f64>,
    /// Names of the moved joints, the columns of `targets` and `angles`.
    pub joints: Vec<String>,
    /// Samples over time, at equal steps, the first at 0. Long gaits have fewer samples per second: all gaits together
    /// have at most 8,000.
    pub samples: Vec<TraceSample>,
    /// `null` if the gait completed, else reason and time of its unstable end.
    pub unstable: Option<String>,
}

/// Sample of a gait.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TraceSample {
    /// Time since the gait's start, s.
    pub time: f64,
    /// Commanded joint angles, rad.
    pub targets: Vec<f32>,
    /// Joint angles, rad.
    pub angles: Vec<f32>,
    /// Pivot position x, y, z, mu, in the map.
    pub position: [f64; 3],
    /// Pivot rotation as a unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
    /// Heading, rad.
    pub yaw: f64,
}

/// Record of a planner's tree.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TreeRecord {
    /// Nodes; the first is the root.
    pub nodes: Vec<NodeRecord>,
    /// Indices of the nodes from the root to the path's end: the node nearest to the goal, or without a goal the
    /// farthest.
    pub best_path: Vec<usize>,
}

/// Node, and the edge that leads to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeRecord {
    /// x, mu.
    pub x: f64,
    /// y, mu.
    pub y: f64,
    /// Height of the pivot, mu.
    pub z: f64,
    /// Heading, rad.
    pub yaw: f64,
    /// Parent node; `null` for the root.
    pub parent: Option<usize>,
    /// Index of the gait from the parent, from 0; `null` for the root.
    pub gait: Option<usize>,
    /// The pivot's path from the parent, (x, y) on the map, sampled about once a second with both ends. In a tree with
    /// more than 50,000 points of paths it is sampled at longer intervals.
    pub way: Vec<[f64; 2]>,
}

/// Record of a path, executed in one of three ways.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathTrace {
    /// Mode of execution.
    pub mode: PathMode,
    /// The pivot's path, (x, y) in the map.
    pub way: Vec<[f64; 2]>,
    /// Planar distance of the path's end from the end in the tree, mu.
    pub end_error: f64,
}

/// Mode in which a path is executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PathMode {
    /// The path as the tree has it: transitions laid end to end.
    Tree,
    /// Every gait is simulated from the exact end of the one before, with zero velocities.
    Resimulated,
    /// One simulation without a stop; velocities are kept between gaits.
    Continuous,
}

/// Returns records of a candidate's gaits, tree and best path, with the counts of all its rollouts. Of the trees with
/// these streams the first is recorded. `stop` is checked from time to time.
///
/// # Panics
/// If the genotype's length does not fit the job.
pub fn traces(
    job: &Job,
    genotype: &Genotype,
    streams: impl IntoIterator<Item = Stream>,
    stop: &dyn Fn() -> bool,
) -> Result<(Traces, Counts), Stopped> {
    let trial = grown(job, genotype, streams, stop)?;
    let mut counts = trial.counts();
    let tree = record::tree(job, &trial);
    let paths = record::paths(job, &trial, &tree.best_path, &mut counts);
    let gaits = record::gaits(job, genotype, &trial.motions, &mut counts);
    Ok((Traces { gaits, tree, paths }, counts))
}

/// Returns the node at the end of a tree's plan: the nearest to the goal, or without a goal the farthest from the root.
pub fn end_of_plan(environment: &Environment, tree: &Tree) -> usize {
    match &environment.goal {
        Some(goal) => tree.least(|p| p.planar_distance(&Place { x: goal.x, y: goal.y, ..*p })),
        None => tree.least(|p| -p.planar_distance(tree.root())),
    }
}

/// Returns a record of each gait of a candidate, executed from the start, as in [`Traces::gaits`].
///
/// # Panics
/// If the genotype's length does not fit the job.
pub fn gaits(job: &Job, genotype: &Genotype) -> Vec<GaitTrace> {
    let trial = Trial::new(job, genotype, job.spec().planner.reuse_tolerance, []);
    record::gaits(job, genotype, &trial.motions, &mut Counts::default())
}

/// Returns records of a candidate's tree as the search scored it, and of its best path executed in three ways, as in
/// [`Traces::tree`] and [`Traces::paths`].
///
/// # Panics
/// If the genotype's length does not fit the job.
pub fn plan(job: &Job, candidate: &Scored, stop: &dyn Fn() -> bool) -> Result<(TreeRecord, Vec<PathTrace>), Stopped> {
    let streams = search_streams(job, candidate.generation, candidate.candidate);
    let trial = grown(job, &candidate.genotype, streams, stop)?;
    let tree = record::tree(job, &trial);
    let paths = record::paths(job, &trial, &tree.best_path, &mut Counts::default());
    Ok((tree, paths))
}

/// Grows a candidate's trees with these streams.
fn grown(
    job: &Job,
    genotype: &Genotype,
    streams: impl IntoIterator<Item = Stream>,
    stop: &dyn Fn() -> bool,
) -> Result<Trial, Stopped> {
    let mut trials = [Trial::new(job, genotype, job.spec().planner.reuse_tolerance, streams)];
    grow(job, &mut trials, stop)?;
    let [trial] = trials;
    Ok(trial)
}
