//! Files of a job that planned: result.json, and tables of its plans.

use super::result::{Counts, Digests, Versions, deviation, wall_seconds};
use crate::values;
use proto::v1;
use serde::{Deserialize, Serialize};
use sim_core::base::digest::Digest;
use sim_core::base::score::mean;
use sim_core::model::Place;
use sim_core::problem::Checked;
use sim_core::procedure::plan::{Grown, PlanReport, PlanStep};
use std::fmt::Write as _;
use study::setting::PhysicsSetting;

/// Version of the layout of the file.
const FORMAT: u32 = 1;

/// Result of a job that planned. Lengths in mu, times in s. Numbers read back to the same bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFile {
    /// Version of the layout.
    pub format: u32,
    /// Always "plan".
    pub procedure: String,
    /// Name of the job.
    pub name: String,
    /// Seed of the job.
    pub seed: u64,
    /// Digest of the job.
    pub job_digest: Digest,
    /// Digest of the result, over the bits of all trees and of the traces.
    pub result_digest: Digest,
    /// Digest of the engine that computed the result.
    pub engine_digest: Digest,
    /// Engine and its setting, such as `200x2-lockstep`.
    pub engine: String,
    /// Name of the environment.
    pub environment: String,
    /// Name of the planner.
    pub algorithm: String,
    /// Largest number of iterations of a tree, K_max.
    pub iterations: u32,
    /// True if the growth of a tree ends at the goal.
    pub stop_at_goal: bool,
    /// Number of trees, each with its own random numbers.
    pub trees: u32,
    /// Number of trees with a node within the goal's radius; `null` without a goal.
    pub reached: Option<u32>,
    /// Least planar distance of a tree's nodes to the goal, mu; `null` without a goal.
    pub distance: Option<Spread>,
    /// Fraction of the map's cells with a node of the tree, %.
    pub coverage: Option<Spread>,
    /// Number of gaits of a plan.
    pub plan_gaits: Option<Spread>,
    /// Length of a plan, mu: sum of the planar distances between consecutive nodes.
    pub plan_length: Option<Spread>,
    /// Plan of the tree with the best score.
    pub best: Option<BestPlan>,
    /// Sums of the counts over the trees.
    pub counts: Counts,
    /// Time from the first lease of a task to the end, s; pauses included.
    pub wall_seconds: f64,
    /// Versions of the program and crates that wrote the file.
    pub versions: Versions,
}

/// Mean and spread over the trees that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Mean over the trees.
    pub mean: f64,
    /// Sample standard deviation; `null` for one tree.
    pub deviation: Option<f64>,
}

/// Plan of one tree.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BestPlan {
    /// Index of the tree, from 0.
    pub tree: u32,
    /// Score of the tree by the job's fitness.
    pub score: f64,
    /// True if the tree reached the goal.
    pub reached: bool,
    /// Distance from the end of the plan to the goal, mu; `null` without a goal.
    pub distance: Option<f64>,
    /// Gaits of the plan in order, counted from 1.
    pub gaits: Vec<u32>,
    /// Duration of each gait, s.
    pub gait_seconds: f64,
}

impl PlanFile {
    /// Creates the content of result.json from a coordinator's answer.
    pub(super) fn new(job: &Checked, status: &v1::Job, digests: &Digests, report: &PlanReport) -> Self {
        let over = |value: &dyn Fn(&Grown) -> Option<f64>| {
            let values: Vec<Option<f64>> = report.plans.iter().map(|grown| value(grown.as_ref()?)).collect();
            Some(Spread { mean: mean(&values)?, deviation: deviation(&values) })
        };
        let planner = &job.spec().planner;
        let goal = job.environment().goal.is_some();
        let reached = report.plans.iter().flatten().filter(|grown| grown.reached).count() as u32;
        let best = report.plans.get(report.best as usize).and_then(Option::as_ref).map(|grown| BestPlan {
            tree: report.best,
            score: grown.score,
            reached: grown.reached,
            distance: grown.distance,
            gaits: grown.plan.iter().map(|step| step.gait + 1).collect(),
            gait_seconds: job.gaits().duration,
        });
        Self {
            format: FORMAT,
            procedure: "plan".to_owned(),
            name: job.spec().name.clone(),
            seed: job.spec().seed,
            job_digest: digests.job,
            result_digest: digests.result,
            engine_digest: digests.engine,
            engine: PhysicsSetting::of(job).to_string(),
            environment: job.environment().name.clone(),
            algorithm: planner.algorithm.0.name().to_owned(),
            iterations: planner.iterations,
            stop_at_goal: planner.stop_at_goal == Some(true),
            trees: report.plans.len() as u32,
            reached: goal.then_some(reached),
            distance: over(&|grown| grown.distance),
            coverage: over(&|grown| grown.coverage),
            plan_gaits: over(&|grown| Some(grown.plan.len() as f64)),
            plan_length: over(&|grown| Some(length(job, &grown.plan))),
            best,
            counts: Counts::told(&values::progress(status).values),
            wall_seconds: wall_seconds(status),
            versions: Versions::here(),
        }
    }
}

/// Returns the length of a plan, mu: sum of the planar distances between consecutive nodes, from the start on.
fn length(job: &Checked, plan: &[PlanStep]) -> f64 {
    let start = &job.environment().start;
    let mut at = Place { x: start.x, y: start.y, ..Place::ORIGIN };
    let mut sum = 0.0;
    for step in plan {
        let next = Place { x: step.x, y: step.y, ..Place::ORIGIN };
        sum += at.planar_distance(&next);
        at = next;
    }
    sum
}

/// Formats plans.csv, with a row per tree. Cells are empty if the tree failed or has no such number.
pub(super) fn table(job: &Checked, report: &PlanReport) -> String {
    let mut out = "tree,score,reached,distance,coverage,gaits,seconds,length\n".to_owned();
    let cell = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
    for (tree, grown) in report.plans.iter().enumerate() {
        // Writing to a String can't fail.
        let _ = match grown {
            None => writeln!(out, "{tree},,,,,,,"),
            Some(grown) => writeln!(
                out,
                "{tree},{},{},{},{},{},{},{}",
                grown.score,
                grown.reached,
                cell(grown.distance),
                cell(grown.coverage),
                grown.plan.len(),
                grown.plan.len() as f64 * job.gaits().duration,
                length(job, &grown.plan)
            ),
        };
    }
    out
}

/// Formats plan.csv, with a row per gait of the best plan: number of the gait (from 1), start and end (s), and pose of
/// the pivot at its end (mu, rad).
pub(super) fn best(job: &Checked, report: &PlanReport) -> String {
    let mut out = "step,gait,start,end,x,y,z,yaw\n".to_owned();
    let each = job.gaits().duration;
    let plan = report.plans.get(report.best as usize).and_then(Option::as_ref).map(|grown| grown.plan.as_slice());
    for (i, PlanStep { gait, x, y, z, yaw }) in plan.unwrap_or_default().iter().enumerate() {
        let (start, end) = (i as f64 * each, (i + 1) as f64 * each);
        let _ = writeln!(out, "{},{},{start},{end},{x},{y},{z},{yaw}", i + 1, gait + 1);
    }
    out
}
