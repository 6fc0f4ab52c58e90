//! Cost of the planner without simulation: trees are grown from known transitions.

use crate::clock::{Spent, timed};
use serde::Serialize;
use sim_core::base::random::Stream;
use sim_core::evaluate::{Trial, grow, search_streams};
use sim_core::genotype::Genotype;
use sim_core::plan::{Growth, PlannerSettings, PlannerSpec, Transitions};
use sim_core::problem::Job;

/// Least CPU time of a measurement, s. The growth of a tree is repeated until this time is spent.
const ENOUGH: f64 = 0.2;
/// Number of iterations of the smallest tree.
const FIRST: u32 = 100;

/// Cost of a tree of one size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlanningRow {
    /// Iterations of the planner.
    pub iterations: u32,
    /// Nodes of the tree.
    pub nodes: usize,
    /// CPU time of the growth, s.
    pub seconds: f64,
    /// Iterations per CPU s over the whole growth.
    pub iterations_per_second: f64,
    /// Iterations per CPU s beyond those of the previous, smaller tree. `None` for the first tree, and if this tree did
    /// not take longer than the previous one.
    pub marginal_iterations_per_second: Option<f64>,
}

/// Finds the candidate with the largest tree among the first `candidates` of generation 0. Returns its index and
/// genotype. `each` is called after every candidate.
pub fn farthest(job: &Job, candidates: u32, each: &dyn Fn()) -> (u32, Genotype) {
    let genotypes = job.optimiser().ask().genotypes;
    let candidates: Vec<_> = (0..candidates).zip(&genotypes).collect();
    let nodes = |&(index, genotype): &(u32, &Genotype)| {
        let mut trials = [Trial::new(job, genotype, tolerance(job), search_streams(job, 0, index))];
        // The stop callback always returns false.
        let _ = grow(job, &mut trials, &|| false);
        each();
        trials[0].tree().nodes.len()
    };
    // Reversed, because `max_by_key` returns the last of equal candidates and the first is wanted.
    let best = candidates.iter().rev().max_by_key(|candidate| nodes(candidate));
    best.map_or((0, Genotype::default()), |(index, genotype)| (*index, (*genotype).clone()))
}

/// Measures trees of 100, 200, 400, … and finally `iterations` iterations for a candidate of generation 0 of a job on
/// flat ground. A job without reuse is measured with the default reuse tolerance, because without reuse every node has
/// transitions of its own.
pub fn measure(job: &Job, candidate: u32, genotype: &Genotype, iterations: u32) -> Vec<PlanningRow> {
    let stream = search_streams(job, 0, candidate).next().unwrap_or_else(|| unreachable!("repeats are at least 1"));
    let table = known(job, genotype, &stream, iterations);
    let mut rows: Vec<PlanningRow> = Vec::new();
    let sizes = std::iter::successors(Some(FIRST), |k| Some(2 * k)).take_while(|k| *k < iterations);
    for iterations in sizes.chain([iterations]) {
        let (nodes, seconds) = grown(job, &table, &stream, iterations);
        let marginal = rows.last().map(|before| f64::from(iterations - before.iterations) / (seconds - before.seconds));
        rows.push(PlanningRow {
            iterations,
            nodes,
            seconds,
            iterations_per_second: f64::from(iterations) / seconds,
            // The difference of two measured times can be 0 or negative if they are nearly equal.
            marginal_iterations_per_second: marginal.filter(|m| m.is_finite() && *m > 0.0),
        });
    }
    rows
}

/// Returns all transitions that a tree of `iterations` iterations needs.
fn known(job: &Job, genotype: &Genotype, stream: &Stream, iterations: u32) -> Transitions {
    let mut trial = Trial::new(job, genotype, tolerance(job), []);
    trial.growths = vec![fresh(job, stream, iterations)];
    trial.budget = u64::MAX;
    let mut trials = [trial];
    // The stop callback always returns false.
    let _ = grow(job, &mut trials, &|| false);
    let [trial] = trials;
    trial.table
}

/// Grows a tree from known transitions. Returns the number of nodes and the mean CPU time in s.
fn grown(job: &Job, known: &Transitions, stream: &Stream, iterations: u32) -> (usize, f64) {
    let setting = job.setting();
    let mut spent = Spent::default();
    let mut times = 0;
    loop {
        let mut table = known.clone();
        let mut growth = fresh(job, stream, iterations);
        let (missing, time) = timed(|| growth.advance(&setting, &mut table));
        assert!(
            missing.is_empty(),
            "a smaller tree of the same stream must need no transitions besides those of the largest"
        );
        spent += time;
        times += 1;
        if spent.cpu >= ENOUGH {
            return (growth.tree().nodes.len(), spent.cpu / f64::from(times));
        }
    }
}

fn fresh(job: &Job, stream: &Stream, iterations: u32) -> Growth {
    Growth::new(PlannerSettings { iterations, ..job.planner() }, job.root(), stream.clone())
}

/// Returns the job's reuse tolerance, or the default one for a job without reuse.
fn tolerance(job: &Job) -> f64 {
    match job.spec().planner.reuse_tolerance {
        0.0 => PlannerSpec::default().reuse_tolerance,
        given => given,
    }
}
