//! Bounds on the counts and records in a task's result, which follow from the job alone.

use crate::base::score::Counts;
use crate::genotype::Genotype;
use crate::problem::Checked;
use crate::report::{GaitTrace, PathMode, PathTrace, TraceSample, Traces, TreeRecord};

/// Longest reason of a gait's instability, in bytes.
const MAX_UNSTABLE: usize = 1024;
/// Greatest rounding error of a time, s.
const ROUNDING: f64 = 1e-3;

/// Error of a count that exceeds the job's budget.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("its count of {what}, {found}, is impossible: at most {most} is allowed")]
pub struct Uncountable {
    /// Name of the counted quantity.
    pub what: &'static str,
    /// The count.
    pub found: u64,
    /// Greatest possible count.
    pub most: u64,
}

/// Bounds on the counts of a task.
pub(super) struct Most {
    rollouts: u64,
    /// Longest simulated time, ms.
    simulated_ms: u64,
    edges: u64,
    nodes: u64,
}

impl Most {
    /// Returns the bounds for this number of trees, grown on the setting of `on`: the job's own, or that of its
    /// reference.
    pub(super) fn of_trees(job: &Checked, on: &Checked, trees: u32, as_in_search: bool) -> Self {
        let planner = &job.spec().planner;
        let rollouts = on.rollout_budget(trees, as_in_search);
        let edges = u64::from(planner.iterations) * u64::from(job.gaits().count) * u64::from(trees);
        let nodes = edges + u64::from(trees);
        Self { rollouts, simulated_ms: simulated(job, rollouts), edges, nodes }
    }

    /// Returns the bounds for a given motion in all of its ways, with the plans that are made during it.
    pub(super) fn of_motion(job: &Checked) -> Self {
        let own = job.motion_rollouts();
        let mut most = Self { rollouts: own, simulated_ms: simulated(job, own), edges: 0, nodes: 0 };
        let replans =
            job.spec().simulate.as_ref().and_then(|simulate| simulate.replan.as_ref()).map(|replan| replan.most);
        if let (Some(planning), Some(replans)) = (job.on_reference(), replans) {
            let plan = Self::of_trees(planning, planning, 1, true);
            let replans = u64::from(replans);
            most.rollouts += replans * plan.rollouts;
            most.simulated_ms += replans * plan.simulated_ms;
            (most.edges, most.nodes) = (replans * plan.edges, replans * plan.nodes);
        }
        most
    }

    /// Adds the rollouts of a task that also records its first tree: the tree's path executed twice (once as a single
    /// rollout), and each gait.
    pub(super) fn with_traces(self, job: &Checked) -> Self {
        let gaits = u64::from(job.gaits().count);
        let path = u64::from(job.spec().planner.iterations) * gaits;
        Self {
            rollouts: self.rollouts + path + 1 + gaits,
            simulated_ms: simulated(job, self.rollouts + 2 * path + gaits),
            ..self
        }
    }
}

/// Returns the simulated time of this number of rollouts, ms.
fn simulated(job: &Checked, rollouts: u64) -> u64 {
    rollouts.saturating_mul(libm::ceil(job.gaits().duration * 1000.0) as u64)
}

/// Rejects counts that exceed the bounds.
pub(super) fn counted(counts: &Counts, most: &Most) -> Result<(), Uncountable> {
    for (what, found, most) in [
        ("rollouts", counts.rollouts, most.rollouts),
        ("unstable rollouts", counts.unstable, counts.rollouts),
        ("simulated milliseconds", counts.simulated_ms, most.simulated_ms),
        ("edges", counts.edges, most.edges),
        ("rejected edges", counts.rejected, counts.edges),
        ("nodes", counts.nodes, most.nodes),
    ] {
        if found > most {
            return Err(Uncountable { what, found, most });
        }
    }
    Ok(())
}

/// Rejects records that do not fit the job's robot and these gaits.
pub(super) fn traces_of(job: &Checked, genotype: &Genotype, traces: &Traces) -> Result<(), String> {
    let gaits = job.gaits().count as usize;
    if traces.gaits.len() != gaits {
        return Err(format!("{} gaits instead of {gaits}", traces.gaits.len()));
    }
    let joints = job.robot().joint_names();
    for (i, (gait, parameters)) in traces.gaits.iter().zip(genotype.gaits(gaits)).enumerate() {
        gait_of(job, gait, parameters, &joints).map_err(|reason| format!("gait {i}: {reason}"))?;
    }
    tree_of(job, &traces.tree)?;
    let modes: Vec<PathMode> = traces.paths.iter().map(|path| path.mode).collect();
    if modes != [PathMode::Tree, PathMode::Resimulated, PathMode::Continuous] {
        return Err(format!("paths {modes:?} instead of the three modes in order"));
    }
    let sound = |path: &&PathTrace| path.end_error >= 0.0 && path.end_error.is_finite() && is_way(&path.way);
    match traces.paths.iter().find(|path| !sound(path)) {
        Some(path) => Err(format!("path {:?} needs at least one point, and all its numbers finite", path.mode)),
        None => Ok(()),
    }
}

fn gait_of(job: &Checked, gait: &GaitTrace, parameters: &[f64], joints: &[String]) -> Result<(), String> {
    let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    if bits(&gait.parameters) != bits(parameters) {
        return Err("its parameters are not those of the genome".to_owned());
    }
    if gait.joints != joints {
        return Err(format!("its joints are not the robot's {} joints", joints.len()));
    }
    if gait.unstable.as_ref().is_some_and(|reason| reason.is_empty() || reason.len() > MAX_UNSTABLE) {
        return Err(format!("the reason of its instability must have 1 to {MAX_UNSTABLE} bytes"));
    }
    if gait.samples.is_empty() {
        return Err("it has no samples".to_owned());
    }
    samples_of(&gait.samples, joints.len(), job.gaits().duration)
}

/// Rejects samples that are impossible for a motion of this number of joints and this duration, s.
pub(super) fn samples_of(samples: &[TraceSample], joints: usize, duration: f64) -> Result<(), String> {
    let mut before = None;
    for (i, sample) in samples.iter().enumerate() {
        let lengths = [sample.targets.len(), sample.angles.len()];
        if lengths != [joints; 2] {
            return Err(format!("sample {i} has {lengths:?} targets and angles instead of {joints} each"));
        }
        let angles = sample.targets.iter().chain(&sample.angles).all(|v| v.is_finite());
        let pose = sample.position.iter().chain(&sample.rotation).chain([&sample.yaw]).all(|v| v.is_finite());
        if !angles || !pose {
            return Err(format!("sample {i} has a number that is not finite"));
        }
        let later = before.map_or(sample.time == 0.0, |before| sample.time > before);
        if !later || sample.time > duration + ROUNDING {
            return Err(format!(
                "sample {i} is at {} s: times must begin at 0, increase and stay within the motion",
                sample.time
            ));
        }
        before = Some(sample.time);
    }
    Ok(())
}

fn tree_of(job: &Checked, tree: &TreeRecord) -> Result<(), String> {
    let gaits = job.gaits().count as usize;
    let most = job.spec().planner.iterations as usize * gaits + 1;
    if tree.nodes.is_empty() || tree.nodes.len() > most {
        return Err(format!("its tree has {} nodes: 1 to {most} are allowed", tree.nodes.len()));
    }
    for (i, node) in tree.nodes.iter().enumerate() {
        let hangs = match (node.parent, node.gait) {
            (None, None) => i == 0,
            (Some(parent), Some(gait)) => parent < i && gait < gaits,
            _ => false,
        };
        let finite = [node.x, node.y, node.z, node.yaw].iter().all(|v| v.is_finite());
        if !hangs || !finite || !node.way.iter().flatten().all(|v| v.is_finite()) {
            return Err(format!(
                "node {i} of its tree has an impossible parent or gait, or a number that is not finite"
            ));
        }
    }
    let on_path = |pair: &[usize]| tree.nodes.get(pair[1]).is_some_and(|node| node.parent == Some(pair[0]));
    if tree.best_path.first() != Some(&0) || !tree.best_path.windows(2).all(on_path) {
        return Err("its best path does not lead from the root along the tree's edges".to_owned());
    }
    Ok(())
}

fn is_way(way: &[[f64; 2]]) -> bool {
    !way.is_empty() && way.iter().flatten().all(|v| v.is_finite())
}
