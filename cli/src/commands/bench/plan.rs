//! `evogait bench plan`: cost of the planner when all transitions are known.

use super::subject::Machine;
use crate::arguments::BenchPlan;
use crate::console::{self, count, table};
use crate::error::Error;
use crate::load;
use crate::progress::Pieces;
use serde::Serialize;
use sim_core::base::digest::Digest;
use study::planning::{self, PlanningRow};

#[derive(Serialize)]
struct View<'a> {
    job: &'a str,
    job_digest: Digest,
    /// Index of the candidate in generation 0 that supplied the gaits.
    candidate: u32,
    machine: Machine,
    trees: Vec<PlanningRow>,
}

/// Measures the trees and prints the result.
pub fn run(args: BenchPlan, quiet: bool) -> Result<(), Error> {
    let job = load::evolving(&args.file.into())?;
    if !job.environment().is_flat() {
        // Over terrain each node has transitions of its own, so none can be computed beforehand.
        let message = format!(
            "{} has terrain: `bench plan` needs an environment with flat ground, where transitions can be computed beforehand",
            job.environment().name
        );
        return Err(Error::Usage { message });
    }
    let progress =
        Pieces::new("candidates tried", u64::from(args.candidates.min(job.optimiser_spec().population())), quiet);
    let (candidate, genotype) = planning::farthest(&job, args.candidates, &|| progress.one_done());
    drop(progress);
    let trees = planning::measure(&job, candidate, &genotype, args.iterations);
    let view = View { job: &job.spec().name, job_digest: job.digest(), candidate, machine: Machine::here(), trees };
    if args.json { console::say_json(&view) } else { console::say(&text(&view)) }
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
