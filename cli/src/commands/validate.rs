//! `evogait validate`: check of a job file and estimate of its cost.

use crate::arguments::{Validate, cores};
use crate::console::{self, count, duration};
use crate::error::Error;
use crate::first_generation::{self, Scores};
use crate::load;
use crate::plausibility;
use crate::summary;
use serde::Serialize;
use sim_core::base::digest::Digest;
use sim_core::problem::{Job, JobKind, JobSpec};
use sim_core::search::OptimiserSpec;
use std::time::Duration;
use study::cost::{self, Budget};
use study::setting::PhysicsSetting;

/// Measuring time for candidates of the first generation.
const MEASURE: Duration = Duration::from_secs(3);
/// Time limit of an evaluation: if the first one takes longer, it is stopped.
const GIVE_UP: Duration = Duration::from_secs(20);

#[derive(Serialize)]
struct View<'a> {
    valid: bool,
    name: &'a str,
    robot: &'a str,
    environment: &'a str,
    job_digest: Digest,
    /// Engine of the search, with its setting and the reason for its choice.
    engine: String,
    setting: PhysicsSetting,
    /// Engine and setting that choose the winner; `null` without a reference.
    reference: Option<PhysicsSetting>,
    /// Setting on which the robot was settled; `null` if it is the job's own.
    settled: Option<String>,
    engine_digest: Digest,
    seed: u64,
    gaits: u32,
    #[serde(rename = "genome_length")]
    genotype_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    population: Option<u32>,
    /// Candidates of a generation, as text.
    #[serde(skip)]
    candidates: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    generations: Option<u32>,
    /// Motion of a job that simulates.
    #[serde(skip_serializing_if = "Option::is_none")]
    motion: Option<String>,
    /// Number of candidates of a job that evolves, of trees of a job that plans, of runs of a job that simulates.
    evaluations: u64,
    most_rollouts_per_evaluation: u64,
    estimate: Option<Estimate>,
    /// Settings that are probably mistakes, and a warning if the timed evaluations show that the search would find
    /// nothing.
    warnings: Vec<String>,
    /// Resolved job as a file.
    job_toml: String,
}

/// Cost of the job on this machine.
#[derive(Serialize)]
struct Estimate {
    /// Number of timed evaluations, one after the other on one core.
    measured: u32,
    /// Mean time of an evaluation, s; a lower limit if `given_up`.
    seconds_per_evaluation: f64,
    /// True if the first evaluation exceeded the time limit and was stopped.
    given_up: bool,
    /// Time of the whole search on one core, s.
    core_seconds: f64,
    /// Cores of this machine.
    cores: usize,
    /// Time of the whole search on all cores of this machine, s.
    wall_seconds: f64,
    assumptions: &'static str,
}

const SAME_TREES: &str =
    "all trees cost as much as those timed; all cores are free; the time of the traces is not included";
const SAME_RUNS: &str = "all runs cost as much as those timed; all cores are free";
const ASSUMPTIONS: &str = "later generations cost as much as candidates of the first; all cores are free; a generation \
                           is shared evenly; the time of the finish is not included";

/// Checks the job and prints the result.
pub fn run(args: Validate) -> Result<(), Error> {
    let job = load::job(&args.file)?;
    let optimiser = job.spec().optimiser.as_ref();
    let JobSpec { plan, simulate, .. } = job.spec();
    let evaluations = match (optimiser, plan, simulate) {
        (Some(optimiser), ..) => optimiser.evaluations(optimiser.generations()),
        (None, Some(plan), _) => plan.seeds.into(),
        (None, None, simulate) => 1 + u64::from(simulate.as_ref().and_then(|simulate| simulate.repeats).unwrap_or(0)),
    };
    let (estimate, warning) = args.estimate.then(|| estimate(&job, evaluations)).unzip();
    let view = View {
        valid: true,
        name: &job.spec().name,
        robot: &job.robot_spec().name,
        environment: &job.environment().name,
        job_digest: job.digest(),
        engine: job.chosen().to_string(),
        setting: PhysicsSetting::of(&job),
        reference: job.on_reference().map(PhysicsSetting::of),
        settled: job.quiet().map(ToString::to_string),
        engine_digest: job.engine_digest(),
        seed: job.spec().seed,
        gaits: job.spec().gaits.as_ref().map_or(0, |gaits| gaits.count),
        genotype_length: job.spec().gaits.as_ref().map_or(0, |_| job.space().longest()),
        motion: simulate.as_ref().map(|simulate| summary::motion(&job, simulate)),
        population: optimiser.map(OptimiserSpec::population),
        candidates: optimiser.map(summary::candidates),
        generations: optimiser.map(OptimiserSpec::generations),
        evaluations,
        most_rollouts_per_evaluation: if simulate.is_some() { job.motion_rollouts() } else { job.most_rollouts() },
        estimate,
        warnings: plausibility::warnings(&job)
            .into_iter()
            .chain(plausibility::goal_warning(&job))
            .chain(warning.flatten())
            .collect(),
        job_toml: job.to_toml(),
    };
    if args.json { console::say_json(&view) } else { console::say(&text(&view)) }
}

/// Returns the cost, and a warning if all timed candidates of the first generation have the same score.
fn estimate(job: &Job, evaluations: u64) -> (Estimate, Option<String>) {
    let population = job.spec().optimiser.as_ref().map_or(evaluations as u32, OptimiserSpec::population);
    let budget = Budget { evaluations: population, time: MEASURE, first: GIVE_UP };
    let cost = match job.kind() {
        JobKind::Simulate => cost::measure_runs(job, budget),
        JobKind::Evolve | JobKind::Plan => cost::measure(job, cost::at_once(job, cores()), budget, &|| ()),
    };
    let measured = cost.evaluations.max(1);
    let seconds_per_evaluation = cost.total.wall / f64::from(measured);
    let core_seconds = seconds_per_evaluation * evaluations as f64;
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let scores = Scores::of_measured(&cost.scores, cost.counts);
    let evolves = job.kind() == JobKind::Evolve;
    let warning = evolves.then(|| first_generation::warning(Some(job), &scores)).flatten();
    let estimate = Estimate {
        measured,
        seconds_per_evaluation,
        given_up: cost.given_up,
        core_seconds,
        cores,
        wall_seconds: core_seconds / cores as f64,
        assumptions: match job.kind() {
            JobKind::Evolve => ASSUMPTIONS,
            JobKind::Plan => SAME_TREES,
            JobKind::Simulate => SAME_RUNS,
        },
    };
    (estimate, warning)
}

fn text(view: &View) -> String {
    let mut lines = vec![
        format!("{} is valid", view.name),
        format!("  robot          {}", view.robot),
        format!("  environment    {}", view.environment),
        match &view.motion {
            Some(motion) => format!("  motion         {motion}"),
            None => format!(
                "  {:<13}  {} gaits, {} parameters",
                if view.population.is_some() { "candidate" } else { "given" },
                view.gaits,
                view.genotype_length
            ),
        },
        match view.generations.zip(view.candidates.as_ref()) {
            None if view.motion.is_some() => {
                format!("  runs           {}, seed {}", count(view.evaluations), view.seed)
            }
            Some((generations, candidates)) => format!(
                "  search         {} generations of {candidates}: {} evaluations, seed {}",
                count(generations.into()),
                count(view.evaluations),
                view.seed
            ),
            None => format!("  plan           {} trees, seed {}", count(view.evaluations), view.seed),
        },
        format!("  engine         {} ({})", view.setting, view.engine),
        match &view.motion {
            Some(_) => format!("  a run          at most {} rollouts", count(view.most_rollouts_per_evaluation)),
            None => {
                format!(
                    "  evaluation     at most {} rollouts, with reuse far fewer",
                    count(view.most_rollouts_per_evaluation)
                )
            }
        },
        format!("  job digest     {}", view.job_digest),
        format!("  engine digest  {}", view.engine_digest),
    ];
    if let Some(settled) = &view.settled {
        lines.push(format!("  settled        {settled}; rollouts use the job's own setting"));
    }
    if let Some(e) = &view.estimate {
        let least = if e.given_up { "more than " } else { "" };
        let each = duration(Duration::from_secs_f64(e.seconds_per_evaluation));
        let how = if e.given_up { "stopped".to_owned() } else { format!("mean of {} timed here", e.measured) };
        let what = if view.motion.is_some() { "a run" } else { "an evaluation" };
        lines.push(format!("  cost           {least}{each} {what} ({how})"));
        lines.push(format!(
            "                 {least}{} of one core, {least}{} on this machine's {} cores",
            console::seconds(e.core_seconds),
            console::seconds(e.wall_seconds),
            e.cores
        ));
        lines.push(format!("                 assumed: {}", e.assumptions));
    }
    lines.extend(view.warnings.iter().map(|warning| format!("  warning        {warning}")));
    lines.join("\n")
}
