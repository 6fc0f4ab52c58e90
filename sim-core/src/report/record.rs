//! Records of the winner's gaits, tree and best path.

use super::{GaitTrace, NodeRecord, PathMode, PathTrace, TraceSample, TreeRecord, end_of_plan};
use crate::base::math::heading;
use crate::base::score::Counts;
use crate::evaluate::{Executed, Stage, Standing, Trial, way};
use crate::genotype::Genotype;
use crate::model::Place;
use crate::physics::{Motion, Outcome};
use crate::problem::Job;

/// Time between two points of a recorded path, s, unless there are too many points.
const WAY_STEP: f32 = 1.0;
/// Greatest number of points of the pivot's paths in a tree together, or in a plan's path, without the ends of each.
/// With [`MAX_SAMPLES`] it keeps the largest report within the limit of what a worker may deliver.
const MAX_WAY_POINTS: usize = 50_000;
/// Greatest number of samples of all gaits together.
const MAX_SAMPLES: usize = 8000;

/// Returns the time between two points of each of `ways` paths of gaits that last `duration` s: the least multiple of
/// [`WAY_STEP`] that keeps to [`MAX_WAY_POINTS`].
fn way_step(ways: usize, duration: f64) -> f32 {
    let points = ways as f64 * duration / f64::from(WAY_STEP);
    WAY_STEP * (points / MAX_WAY_POINTS as f64).ceil().max(1.0) as f32
}

/// Records the trial's first tree.
pub(super) fn tree(job: &Job, trial: &Trial) -> TreeRecord {
    let growth = &trial.growths[0];
    let tree = growth.tree();
    let step = way_step(tree.nodes.len(), job.gaits().duration);
    let nodes = tree.nodes.iter().enumerate().map(|(i, node)| {
        let way = growth.transition_to(i).zip(node.edge).and_then(|(key, (parent, _))| {
            let transition = trial.table.get(key)?;
            Some(way(&transition.rollout, &growth.frame(&trial.table, parent, key), step))
        });
        let Place { x, y, z, yaw } = node.place;
        NodeRecord {
            x,
            y,
            z,
            yaw,
            parent: node.edge.map(|e| e.0),
            gait: node.edge.map(|e| e.1),
            way: way.unwrap_or_default(),
        }
    });
    TreeRecord { nodes: nodes.collect(), best_path: tree.path(end_of_plan(job.environment(), tree)) }
}

/// Records each gait from the start, in the map.
pub(super) fn gaits(job: &Job, genotype: &Genotype, motions: &[Motion], counts: &mut Counts) -> Vec<GaitTrace> {
    let (stage, start) = (Stage::of(job), Standing::at_start(job));
    let executed: Vec<Executed> = motions.iter().map(|motion| execute(&stage, &start, motion, counts)).collect();
    let stride = stride(&executed);
    let trace = |((parameters, motion), executed): ((&[f64], &Motion), &Executed)| {
        let rollout = &executed.rollout;
        GaitTrace {
            parameters: parameters.to_vec(),
            joints: job.robot().joint_names(),
            samples: (0..rollout.trace.len()).step_by(stride).map(|i| sample(executed, motion, i)).collect(),
            unstable: (rollout.outcome != Outcome::Completed).then(|| rollout.outcome.to_string()),
        }
    };
    genotype.gaits(motions.len()).zip(motions).zip(&executed).map(trace).collect()
}

/// Returns the number of samples of these motions per recorded sample, so that all recorded samples together keep to
/// the limit of a report.
pub fn stride<'a>(executed: impl IntoIterator<Item = &'a Executed>) -> usize {
    executed.into_iter().map(|one| one.rollout.trace.len()).sum::<usize>().div_ceil(MAX_SAMPLES).max(1)
}

/// Returns a sample of an executed motion, in the map.
pub fn sample(executed: &Executed, motion: &Motion, i: usize) -> TraceSample {
    let mut commanded = vec![0.0; motion.targets().joints()];
    let time = f64::from(executed.rollout.trace.time(i));
    motion.targets().at(time, &mut commanded);
    let state = executed.state(i);
    let (p, q) = (state.pivot.translation, state.pivot.rotation);
    TraceSample {
        time,
        targets: commanded,
        angles: state.joints,
        position: [p.x.into(), p.y.into(), p.z.into()],
        rotation: [q.x.into(), q.y.into(), q.z.into(), q.w.into()],
        yaw: heading(q),
    }
}

/// Records the path, executed in three ways.
pub(super) fn paths(job: &Job, trial: &Trial, path: &[usize], counts: &mut Counts) -> Vec<PathTrace> {
    let tree = trial.tree();
    let gaits: Vec<usize> = path.iter().filter_map(|&n| tree.nodes[n].edge.map(|e| e.1)).collect();
    let goal = tree.nodes[path[path.len() - 1]].place;
    let trace = |mode, way: Vec<[f64; 2]>| {
        let end_error = way.last().map_or(0.0, |&[x, y]| goal.planar_distance(&Place { x, y, ..goal }));
        PathTrace { mode, way, end_error }
    };

    let step = way_step(path.len(), job.gaits().duration);
    let root = job.root();
    let mut recorded = vec![[root.x, root.y]];
    for &node in path {
        if let (Some(key), Some((parent, _))) = (trial.growths[0].transition_to(node), tree.nodes[node].edge)
            && let Some(transition) = trial.table.get(key)
        {
            let frame = trial.growths[0].frame(&trial.table, parent, key);
            recorded.extend(way(&transition.rollout, &frame, step));
        }
    }

    let mut resimulated = vec![[root.x, root.y]];
    let stage = Stage::of(job);
    let mut at = Standing::at_start(job);
    for &gait in &gaits {
        let executed = execute(&stage, &at, &trial.motions[gait], counts);
        resimulated.extend(executed.way(step));
        at = executed.end();
    }

    let mut continuous = vec![[root.x, root.y]];
    if !gaits.is_empty() {
        let chain = Motion::chain(&gaits.iter().map(|&g| &trial.motions[g]).collect::<Vec<_>>());
        continuous.extend(execute(&stage, &Standing::at_start(job), &chain, counts).way(step));
    }
    vec![
        trace(PathMode::Tree, recorded),
        trace(PathMode::Resimulated, resimulated),
        trace(PathMode::Continuous, continuous),
    ]
}

/// Executes a motion and adds it to the counts.
fn execute(stage: &Stage<'_>, from: &Standing, motion: &Motion, counts: &mut Counts) -> Executed {
    let executed = stage.execute(from, motion);
    counts.rollouts += 1;
    counts.unstable += u64::from(executed.rollout.outcome != Outcome::Completed);
    counts.simulated_ms += executed.rollout.simulated_ms;
    executed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::limits::{MAX_DURATION, MAX_ITERATIONS};

    #[test]
    fn path_has_one_point_per_second_up_to_limit() {
        assert_eq!((way_step(1, 10.0), way_step(5000, 10.0)), (1.0, 1.0));
        for (ways, duration) in [(5001, 10.0), (20_000, 30.0), (MAX_ITERATIONS as usize + 1, MAX_DURATION)] {
            let step = way_step(ways, duration);
            assert!(step > 1.0 && step.fract() == 0.0, "{ways} paths of {duration} s: {step} s");
            let points = ways as f64 * (duration / f64::from(step));
            assert!(points <= MAX_WAY_POINTS as f64, "{ways} paths of {duration} s: {points}");
        }
    }
}
