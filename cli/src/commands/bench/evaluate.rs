//! `evogait bench evaluate`: cost of an evaluation, and the shares of its time.

use super::subject::Machine;
use crate::arguments::{BenchEvaluate, cores};
use crate::console::{self, table};
use crate::error::Error;
use crate::load;
use crate::progress::Pieces;
use serde::Serialize;
use sim_core::base::digest::Digest;
use sim_core::base::score::Counts;
use std::time::Duration;
use study::cost::{self, Budget, Shares};
use study::setting::PhysicsSetting;

#[derive(Serialize)]
struct View<'a> {
    job: &'a str,
    job_digest: Digest,
    evaluations: u32,
    /// Engine and its setting.
    engine: PhysicsSetting,
    /// Candidates evaluated together.
    at_once: u32,
    machine: Machine,
    /// Evaluations per second of wall time, on one slot.
    evaluations_per_second: f64,
    /// CPU time of an evaluation, s.
    cpu_seconds_per_evaluation: f64,
    rollouts_per_evaluation: f64,
    /// Simulated seconds per CPU second of the engine.
    simulated_per_physics_cpu: f64,
    /// Share of the engine's lanes that simulated a requested rollout; `null` for an engine without lanes.
    useful_lanes: Option<f64>,
    /// Shares of the CPU time.
    shares: Shares,
    counts: Counts,
}

/// Measures the evaluations and prints the result.
pub fn run(args: BenchEvaluate, quiet: bool) -> Result<(), Error> {
    let job = load::evolving(&args.file.into())?;
    let budget = Budget { evaluations: args.evaluations, time: Duration::MAX, first: Duration::MAX };
    let progress = Pieces::new("evaluations", args.evaluations.into(), quiet);
    let at_once = cost::at_once(&job, cores());
    let cost = cost::measure(&job, at_once, budget, &|| progress.one_done());
    drop(progress);
    let n = f64::from(cost.evaluations);
    let view = View {
        job: &job.spec().name,
        job_digest: job.digest(),
        evaluations: cost.evaluations,
        engine: PhysicsSetting::of(&job),
        at_once,
        machine: Machine::here(),
        evaluations_per_second: n / cost.total.wall,
        cpu_seconds_per_evaluation: cost.total.cpu / n,
        rollouts_per_evaluation: cost.counts.rollouts as f64 / n,
        simulated_per_physics_cpu: cost.counts.simulated_ms as f64 / 1000.0 / cost.physics.cpu,
        useful_lanes: (job.engine().lanes() > 1).then(|| cost.lanes.useful as f64 / cost.lanes.all as f64),
        shares: cost.shares(),
        counts: cost.counts,
    };
    if args.json { console::say_json(&view) } else { console::say(&text(&view)) }
}

fn text(view: &View) -> String {
    let each = view.cpu_seconds_per_evaluation;
    let row = |what: &str, share: f64| {
        vec![what.to_owned(), format!("{:.2} %", 100.0 * share), format!("{:.3}", 1000.0 * share * each)]
    };
    let rows = [
        row("physics", view.shares.physics),
        row("target tables", view.shares.target_tables),
        row("planning", view.shares.planning),
        row("the rest", view.shares.rest),
    ];
    let lanes = view.useful_lanes.map_or_else(String::new, |useful| {
        format!("; {:.1} % of its lanes useful, {} candidates at once", 100.0 * useful, view.at_once)
    });
    format!(
        "{}: {} evaluations on {}, one slot ({})\n\
         {} evaluations a second, {:.4} CPU s each\n\
         {:.1} rollouts an evaluation, {:.0} simulated s a CPU s of physics{lanes}\n\n{}",
        view.job,
        view.evaluations,
        view.engine,
        view.machine.line(),
        console::score(view.evaluations_per_second),
        each,
        view.rollouts_per_evaluation,
        view.simulated_per_physics_cpu,
        table(&["an evaluation's time", "share", "CPU ms"], &rows)
    )
}
