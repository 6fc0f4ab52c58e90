//! What a finished job tells of its winner: computed by a worker as the job's last task, stored with the job, drawn by
//! the command line.

mod record;

use crate::evaluate::{Stopped, Trial, grow, search_streams};
use crate::job::Job;
use crate::random::{Purpose, Stream};
use crate::score::{Counts, Scored};
use serde::{Deserialize, Serialize};

/// How many fresh RRT seeds the winner and the best of the first generation are scored on again.
pub const FRESH_SEEDS: u32 = 20;

/// The report. Lengths in mu, angles in rad, times in s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The best of the whole search.
    pub winner: Scored,
    /// The best of generation 0.
    pub first: Scored,
    /// The winner's scores on fresh seeds; `null` where an evaluation failed.
    pub winner_fresh: Vec<Option<f64>>,
    /// The first generation's best on the same seeds.
    pub first_fresh: Vec<Option<f64>>,
    /// The score of the winner's recorded tree with every expansion simulated (no reuse), same random stream.
    pub winner_without_reuse: Option<f64>,
    /// Each of the winner's gaits, applied at the start.
    pub gaits: Vec<GaitTrace>,
    /// The winner's tree, as the search scored it (its first, where a candidate has several).
    pub tree: TreeRecord,
    /// The tree's best path, run three ways.
    pub paths: Vec<PathTrace>,
    /// What the report itself took.
    pub counts: Counts,
}

/// One gait from the settled start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GaitTrace {
    /// The gait's parameters, in the order of the genome.
    pub parameters: Vec<f64>,
    /// Names of the moved joints, the columns of `targets` and `angles`.
    pub joints: Vec<String>,
    /// Samples over time, at equal steps, the first at 0.
    pub samples: Vec<TraceSample>,
    /// `null` if it completed, else why and when it was found unstable.
    pub unstable: Option<String>,
}

/// A moment of a gait.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TraceSample {
    /// s since the gait's start.
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

/// A planner's tree.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TreeRecord {
    /// Nodes; the first is the root.
    pub nodes: Vec<NodeRecord>,
    /// Node indexes from the root to the path's end: the node nearest to the goal, or without a goal the farthest.
    pub best_path: Vec<usize>,
}

/// A node and the edge that leads to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeRecord {
    /// mu.
    pub x: f64,
    /// mu.
    pub y: f64,
    /// Height of the pivot, mu.
    pub z: f64,
    /// Heading, rad.
    pub yaw: f64,
    /// Parent node; `null` for the root.
    pub parent: Option<usize>,
    /// Gait from the parent, from 0; `null` for the root.
    pub gait: Option<usize>,
    /// The pivot's way from the parent, (x, y) in the map, sampled about once a second, ends included.
    pub way: Vec<[f64; 2]>,
}

/// A path, run in one of three ways.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathTrace {
    /// How.
    pub mode: PathMode,
    /// The pivot's way, (x, y) in the map.
    pub way: Vec<[f64; 2]>,
    /// Planar distance of its end from where the tree says it ends, mu.
    pub end_error: f64,
}

/// The three ways to run a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PathMode {
    /// As the tree has it: transitions laid end to end.
    Tree,
    /// Every gait simulated from the exact end of the one before, velocities zeroed.
    Resimulated,
    /// One simulation without a stop: velocities are kept between gaits.
    Continuous,
}

/// Makes the report of a job's winner. `stop` is asked now and then.
pub fn report(job: &Job, winner: &Scored, first: &Scored, stop: &dyn Fn() -> bool) -> Result<Report, Stopped> {
    let tolerance = job.spec().planner.reuse_tolerance;
    let streams = || search_streams(job, winner.generation, winner.candidate);
    let mut trials = [
        Trial::new(job, &winner.genome, tolerance, streams()),
        Trial::new(job, &winner.genome, tolerance, fresh_streams(job)),
        Trial::new(job, &first.genome, tolerance, fresh_streams(job)),
        Trial::new(job, &winner.genome, 0.0, streams()),
    ];
    grow(job, &mut trials, stop)?;
    let mut counts = Counts::default();
    trials.iter().for_each(|t| counts += t.counts());
    let [search, winner_fresh, first_fresh, literal] = &trials;
    let tree = record::tree(job, search);
    let paths = record::paths(job, search, &tree.best_path, &mut counts);
    let gaits = record::gaits(job, winner, &search.targets, &mut counts);
    Ok(Report {
        winner: winner.clone(),
        first: first.clone(),
        winner_fresh: winner_fresh.scores(job).into_iter().map(Some).collect(),
        first_fresh: first_fresh.scores(job).into_iter().map(Some).collect(),
        winner_without_reuse: Some(literal.score(job)),
        gaits,
        tree,
        paths,
        counts,
    })
}

/// Each gait of a candidate, applied at the start: what [`Report::gaits`] holds.
///
/// # Panics
/// If the genome's length does not fit the job.
pub fn gaits(job: &Job, candidate: &Scored) -> Vec<GaitTrace> {
    let trial = Trial::new(job, &candidate.genome, job.spec().planner.reuse_tolerance, []);
    record::gaits(job, candidate, &trial.targets, &mut Counts::default())
}

/// A candidate's tree as the search scored it, and its best path run three ways: what [`Report::tree`] and
/// [`Report::paths`] hold.
///
/// # Panics
/// If the genome's length does not fit the job.
pub fn plan(job: &Job, candidate: &Scored, stop: &dyn Fn() -> bool) -> Result<(TreeRecord, Vec<PathTrace>), Stopped> {
    let streams = search_streams(job, candidate.generation, candidate.candidate);
    let mut trials = [Trial::new(job, &candidate.genome, job.spec().planner.reuse_tolerance, streams)];
    grow(job, &mut trials, stop)?;
    let tree = record::tree(job, &trials[0]);
    let paths = record::paths(job, &trials[0], &tree.best_path, &mut Counts::default());
    Ok((tree, paths))
}

/// The random streams of the fresh trees that a finished job's candidates are scored on.
pub fn fresh_streams(job: &Job) -> impl Iterator<Item = Stream> {
    let seed = job.spec().seed;
    (0..FRESH_SEEDS).map(move |repeat| Stream::new(seed, Purpose::Rescore, 0, 0, repeat))
}
