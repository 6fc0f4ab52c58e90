//! Cost of the planner: trees grown from known transitions, so that nothing is left to simulate.

use crate::clock::{Spent, timed};
use serde::Serialize;
use sim_core::base::random::Stream;
use sim_core::evaluate::{Trial, grow, search_streams};
use sim_core::genotype::Genotype;
use sim_core::plan::{Growth, PlannerSettings, PlannerSpec, Transitions};
use sim_core::problem::Job;

/// A tree is grown again and again until this much CPU time has passed, s.
const ENOUGH: f64 = 0.2;
/// Iterations of the smallest tree.
const FIRST: u32 = 100;

/// Cost of a tree of one size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Iterations of the planner.
    pub iterations: u32,
    /// Nodes of the tree.
    pub nodes: usize,
    /// CPU s.
    pub seconds: f64,
    /// Over the whole growth.
    pub iterations_per_second: f64,
    /// At this size: since the tree before, which has half the iterations. `None` for the first tree, and if the two
    /// times are too near to each other.
    pub marginal_iterations_per_second: Option<f64>,
}

/// Finds the candidate with the largest tree among the first `candidates` of generation 0: (index, genotype). `each` is
/// called after every candidate.
pub fn farthest(job: &Job, candidates: u32, each: &dyn Fn()) -> (u32, Genotype) {
    let genotypes = job.optimiser().ask().genotypes;
    let candidates: Vec<_> = (0..candidates).zip(&genotypes).collect();
    let nodes = |&(index, genotype): &(u32, &Genotype)| {
        let mut trials = [Trial::new(job, genotype, tolerance(job), search_streams(job, 0, index))];
        // It is never stopped.
        let _ = grow(job, &mut trials, &|| false);
        each();
        trials[0].tree().nodes.len()
    };
    // The first of equals.
    let best = candidates.iter().rev().max_by_key(|candidate| nodes(candidate));
    best.map_or((0, Genotype::default()), |(index, genotype)| (*index, (*genotype).clone()))
}

/// Grows trees of 100 iterations, twice as many, and so on up to `iterations`, for a candidate of generation 0 on flat
/// ground. A job without reuse is measured with the default reuse: without it every node has transitions of its own.
pub fn measure(job: &Job, candidate: u32, genotype: &Genotype, iterations: u32) -> Vec<Row> {
    let stream = search_streams(job, 0, candidate).next().unwrap_or_else(|| unreachable!("repeats are at least 1"));
    let table = known(job, genotype, &stream, iterations);
    let mut rows: Vec<Row> = Vec::new();
    let sizes = std::iter::successors(Some(FIRST), |k| Some(2 * k)).take_while(|k| *k < iterations);
    for iterations in sizes.chain([iterations]) {
        let (nodes, seconds) = grown(job, &table, &stream, iterations);
        let marginal = rows.last().map(|before| f64::from(iterations - before.iterations) / (seconds - before.seconds));
        rows.push(Row {
            iterations,
            nodes,
            seconds,
            iterations_per_second: f64::from(iterations) / seconds,
            // Two measured times that are nearly the same have no meaningful ratio.
            marginal_iterations_per_second: marginal.filter(|m| m.is_finite() && *m > 0.0),
        });
    }
    rows
}

/// All transitions that a tree of so many iterations asks for.
fn known(job: &Job, genotype: &Genotype, stream: &Stream, iterations: u32) -> Transitions {
    let mut trial = Trial::new(job, genotype, tolerance(job), []);
    trial.growths = vec![fresh(job, stream, iterations)];
    trial.budget = u64::MAX;
    let mut trials = [trial];
    // It is never stopped.
    let _ = grow(job, &mut trials, &|| false);
    let [trial] = trials;
    trial.table
}

/// Nodes of a tree grown from known transitions, and the CPU s it took.
fn grown(job: &Job, known: &Transitions, stream: &Stream, iterations: u32) -> (usize, f64) {
    let setting = job.setting();
    let mut spent = Spent::default();
    let mut times = 0;
    loop {
        let mut table = known.clone();
        let mut growth = fresh(job, stream, iterations);
        let (missing, time) = timed(|| growth.advance(&setting, &mut table));
        assert!(missing.is_empty(), "a smaller tree of the same stream is a part of the larger one");
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

/// The job's reuse tolerance, or the default one for a job without reuse.
fn tolerance(job: &Job) -> f64 {
    match job.spec().planner.reuse_tolerance {
        0.0 => PlannerSpec::default().reuse_tolerance,
        given => given,
    }
}
