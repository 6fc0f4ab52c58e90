//! `evogait bench fleet`: load that a coordinator can serve, and efficiency of its workers.
//!
//! The coordinator is the real one, with SQLite on disk, in a process of its own. The workers are sessions of this
//! process: they use the real protocol, but sleep instead of simulating.

mod chains;
mod host;
mod ideal;
mod light;
mod line;
mod scrape;
mod slots;
mod tally;
mod times;
mod usage;

use super::subject::Machine;
use crate::arguments::BenchFleet;
use crate::console::{self, table};
use crate::error::Error;
use crate::load;
use crate::progress::Pieces;
use line::{Line, Spread};
use serde::Serialize;

#[derive(Serialize)]
struct View {
    job: String,
    machine: Machine,
    slots_of_a_worker: u32,
    population: u32,
    /// Median time of an evaluation, s, and standard deviation of its logarithm.
    median: f64,
    sigma: f64,
    /// Evaluation time that workers report instead of the drawn one, s.
    claim: Option<f64>,
    /// Mean time between two crashes of a worker, s; 0 means that workers never crash.
    lifetime: f64,
    /// Share of ranges that workers report as failed.
    fail: f64,
    lines: Vec<Line>,
}

/// Measures all lines and prints them.
pub fn run(args: BenchFleet, quiet: bool) -> Result<(), Error> {
    if let Some(folder) = args.host {
        return super::super::with_runtime(host::serve(folder));
    }
    let job = load::checked(&args.file.clone().into())?;
    load::must_evolve(&job, &args.file.job)?;
    let planned: Vec<(u32, u32)> =
        args.workers.iter().flat_map(|workers| args.jobs.iter().map(move |jobs| (*workers, *jobs))).collect();
    let progress = Pieces::new("lines", planned.len() as u64, quiet);
    let mut lines = Vec::new();
    let prepared = line::prepared(&job)?;
    for size in planned {
        lines.push(super::super::with_runtime(line::measure(&args, &job, &prepared, size))?);
        progress.one_done();
    }
    drop(progress);
    let view = View {
        job: job.spec().name.clone(),
        machine: Machine::here(),
        slots_of_a_worker: args.slots,
        population: args.population,
        median: args.median,
        sigma: args.sigma,
        claim: args.claim,
        lifetime: args.lifetime,
        fail: args.fail,
        lines,
    };
    if args.json { console::say_json(&view) } else { console::say(&text(&view)) }
}

fn text(view: &View) -> String {
    let share = |share: f64| format!("{:.1} %", 100.0 * share);
    let none = || "–".to_owned();
    let of = |spread: &Option<Spread>, value: fn(&Spread) -> f64| {
        spread.as_ref().map_or_else(none, |s| format!("{:.1}", value(s)))
    };
    let row = |l: &Line| {
        vec![
            console::count(l.workers.into()),
            l.jobs.to_string(),
            format!("{:.0}", l.evaluations as f64 / l.seconds),
            share(l.efficiency),
            l.ideal.map_or_else(none, share),
            of(&l.generation_ms, |s| s.median),
            of(&l.overhead_ms, |s| s.median),
            of(&l.overhead_ms, |s| s.p95),
            format!("{:.0}", l.commits_per_s),
            format!("{:.0}", l.changes_per_s),
            l.commit_ms.map_or_else(none, |ms| format!("{ms:.2}")),
            format!("{:.3}", l.coordinator_cores),
            l.coordinator_us.map_or_else(none, |us| format!("{us:.0}")),
            format!("{:.3}", l.workers_cores),
            l.peak_mib.map_or_else(none, |m| format!("{m:.0}")),
            l.deaths.to_string(),
            l.leases_lost.to_string(),
        ]
    };
    let head = [
        "workers",
        "jobs",
        "evals / s",
        "efficiency",
        "ideal",
        "generation ms",
        "overhead ms",
        "95 %",
        "commits / s",
        "changes / s",
        "commit ms",
        "cores",
        "µs / eval",
        "workers' cores",
        "peak MiB",
        "deaths",
        "lost",
    ];
    format!(
        "{} ({}), {} candidates a generation, {} slots a worker, evaluations of {} s (sigma {})\n{}",
        view.job,
        view.machine.line(),
        console::count(view.population.into()),
        view.slots_of_a_worker,
        view.median,
        view.sigma,
        table(&head, &view.lines.iter().map(row).collect::<Vec<_>>())
    )
}
