//! `evogait bench plan`: what the planner costs, with nothing left to simulate.

use super::subject::Machine;
use crate::arguments::BenchPlan;
use crate::console::{self, count, table};
use crate::error::Error;
use crate::load;
use crate::progress::Pieces;
use serde::Serialize;
use sim_core::base::digest::Digest;
use sim_core::base::random::Stream;
use sim_core::evaluate::{Trial, grow, search_streams};
use sim_core::genotype::Genotype;
use sim_core::plan::{Growth, PlannerSettings, Transitions};
use sim_core::problem::Job;
use study::clock::{Spent, timed};

/// A tree is grown again and again until this much CPU time has passed, s.
const ENOUGH: f64 = 0.2;
/// Iterations of the smallest tree.
const FIRST: u32 = 100;

#[derive(Serialize)]
struct View<'a> {
    job: &'a str,
    job_digest: Digest,
    /// The candidate of generation 0 whose gaits were taken.
    candidate: u32,
    machine: Machine,
    trees: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    iterations: u32,
    nodes: usize,
    /// CPU s.
    seconds: f64,
    /// Over the whole growth.
    iterations_per_second: f64,
    /// Since the tree before, of half the iterations: at this size.
    marginal_iterations_per_second: Option<f64>,
}

/// Measures and tells.
pub fn run(args: BenchPlan, quiet: bool) -> Result<(), Error> {
    let job = load::job(&args.file.into())?;
    if !job.environment().is_flat() {
        // Over terrain a node's transitions are its own: there are none to be known before.
        let message =
            format!("{} has terrain: transitions are known beforehand on flat ground only", job.environment().name);
        return Err(Error::Usage { message });
    }
    let (candidate, genotype) = farthest(&job, args.candidates, quiet);
    let stream = search_streams(&job, 0, candidate).next().unwrap_or_else(|| unreachable!("repeats are at least 1"));
    let table = known(&job, &genotype, &stream, args.iterations);
    let mut trees: Vec<Row> = Vec::new();
    let sizes = std::iter::successors(Some(FIRST), |k| Some(2 * k)).take_while(|k| *k < args.iterations);
    for iterations in sizes.chain([args.iterations]) {
        let (nodes, seconds) = grown(&job, &table, &stream, iterations);
        let marginal =
            trees.last().map(|before| f64::from(iterations - before.iterations) / (seconds - before.seconds));
        trees.push(Row {
            iterations,
            nodes,
            seconds,
            iterations_per_second: f64::from(iterations) / seconds,
            // Two measured times that are nearly the same have no ratio worth telling.
            marginal_iterations_per_second: marginal.filter(|m| m.is_finite() && *m > 0.0),
        });
    }
    let view = View { job: &job.spec().name, job_digest: job.digest(), candidate, machine: Machine::here(), trees };
    if args.json { console::say_json(&view) } else { console::say(&text(&view)) }
}

/// Of the first candidates, the one with the largest tree: (index, genotype).
fn farthest(job: &Job, candidates: u32, quiet: bool) -> (u32, Genotype) {
    let genotypes = job.optimiser().ask().genotypes;
    let candidates: Vec<_> = (0..candidates).zip(&genotypes).collect();
    let progress = Pieces::new("candidates tried", candidates.len() as u64, quiet);
    let nodes = |&(index, genotype): &(u32, &Genotype)| {
        let mut trials = [Trial::new(job, genotype, tolerance(job), search_streams(job, 0, index))];
        // Nobody stops it.
        let _ = grow(job, &mut trials, &|| false);
        progress.one_done();
        trials[0].tree().nodes.len()
    };
    // The first of equals.
    let best = candidates.iter().rev().max_by_key(|candidate| nodes(candidate));
    best.map_or((0, Genotype::default()), |(index, genotype)| (*index, (*genotype).clone()))
}

/// All transitions that a tree of so many iterations asks for.
fn known(job: &Job, genotype: &Genotype, stream: &Stream, iterations: u32) -> Transitions {
    let mut trial = Trial::new(job, genotype, tolerance(job), []);
    trial.growths = vec![fresh(job, stream, iterations)];
    trial.budget = u64::MAX;
    let mut trials = [trial];
    // Nobody stops it.
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

/// Without reuse there is no end of transitions: then trees are grown with what reuse takes by default.
fn tolerance(job: &Job) -> f64 {
    match job.spec().planner.reuse_tolerance {
        0.0 => sim_core::plan::PlannerSpec::default().reuse_tolerance,
        given => given,
    }
}

fn text(view: &View) -> String {
    let rate = |rate: f64| count(rate.round() as u64);
    let rows: Vec<Vec<String>> = view
        .trees
        .iter()
        .map(|r| {
            vec![
                count(r.iterations.into()),
                count(r.nodes as u64),
                format!("{:.3}", 1000.0 * r.seconds),
                rate(r.iterations_per_second),
                r.marginal_iterations_per_second.map_or("–".to_owned(), rate),
            ]
        })
        .collect();
    let head = ["iterations", "nodes", "CPU ms", "iterations / s", "at this size"];
    format!(
        "{}: trees of candidate {} on known transitions, one thread ({})\n{}",
        view.job,
        view.candidate,
        view.machine.line(),
        table(&head, &rows)
    )
}
