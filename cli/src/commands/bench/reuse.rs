//! `evogait bench reuse`: scores of the same genotypes with and without transition reuse.

mod report;

use crate::arguments::{BenchReuse, JobFile, cores};
use crate::commands::bench::genotypes;
use crate::console;
use crate::error::Error;
use crate::inputs;
use crate::load;
use crate::output::Stored;
use crate::output::atomic::Batch;
use crate::progress::Pieces;
use serde::Serialize;
use sim_core::genotype::Genotype;
use sim_core::job::Reference;
use sim_core::problem::Job;
use std::fs;
use std::path::Path;
use study::genotypes::{LEAST_POPULATION, first_and_last};
use study::reuse::{Found, Study};

/// Content of `reuse.json`.
#[derive(Debug, Serialize)]
struct View {
    job: String,
    robot: String,
    seed: u64,
    /// Duration of a gait, s.
    gait_seconds: f64,
    /// Number of gaits of a genotype, k.
    gaits: u32,
    /// Iterations of a tree, K.
    iterations: u32,
    /// The job's own tolerance and number of variants.
    own: (f64, u32),
    /// Source of the evolved genotypes, as a text.
    evolved: String,
    /// Name of the score.
    score: &'static str,
    /// Unit of the score.
    unit: &'static str,
    environments: Vec<Found>,
}

/// Scores the genotypes and prints the result.
pub fn run(args: BenchReuse, quiet: bool) -> Result<(), Error> {
    if let Some(out) = &args.out {
        fs::create_dir_all(out).map_err(|e| Error::write(out, e))?;
    }
    let threads = args.threads.unwrap_or_else(cores) as usize;
    let halves = |generations: &[Vec<Genotype>]| first_and_last(generations, args.genomes as usize);
    let population = args.genomes.div_ceil(2).max(LEAST_POPULATION);
    let (base, stored) = match &args.run {
        Some(folder) => (Stored::read(folder)?.job, Some(halves(&genotypes::stored(folder)?))),
        None => (load::evolving(&JobFile { job: args.job.clone(), seed: args.seed })?, None),
    };
    let jobs = args.environments.iter().map(|name| in_environment(&args, &base, name));
    let jobs = jobs.collect::<Result<Vec<Job>, Error>>()?;
    if let Some(out) = &args.out {
        let pictures = jobs.iter().flat_map(|job| [scatter(job, "svg"), scatter(job, "png")]);
        let names: Vec<String> = pictures.chain(["reuse.md", "reuse.json"].map(str::to_owned)).collect();
        inputs::refuse_all(out, names.iter().map(String::as_str))?;
    }
    let Some(first) = jobs.first() else {
        return Err(Error::Usage { message: "--environments is empty: name at least one environment".to_owned() });
    };
    let evolved = match &args.run {
        Some(_) => "the last generations of a stored run".to_owned(),
        None => format!("the last generations of a genetic algorithm over {} generations", args.generations),
    };
    let mut view = View {
        job: base.spec().name.clone(),
        robot: first.robot_spec().name.clone(),
        seed: first.spec().seed,
        gait_seconds: first.gaits().duration,
        gaits: first.gaits().count,
        iterations: first.spec().planner.iterations,
        own: (first.reuse().tolerance, first.reuse().variants),
        evolved,
        score: first.score_label().0,
        unit: first.score_label().1,
        environments: Vec::new(),
    };
    let study = Study {
        tolerances: args.tolerances.clone(),
        variants: args.variants.clone(),
        seeds: args.seeds,
        repeats: args.repeats.clone(),
    };
    for job in &jobs {
        let samples = match &stored {
            Some(samples) => samples.clone(),
            None => halves(&genotypes::evolved(job, population, args.generations, threads, quiet)?),
        };
        let progress = Pieces::new("genomes", samples.len() as u64, quiet);
        view.environments.push(study.measure(job, &samples, threads, &|| progress.one_done()));
    }
    if let Some(out) = &args.out {
        write(out, &view)?;
    }
    if args.json { console::say_json(&view) } else { console::say(&report::text(&view)) }
}

/// Returns the job in another environment, with the robot and the gait duration of the options if given.
fn in_environment(args: &BenchReuse, base: &Job, name: &str) -> Result<Job, Error> {
    let (environment, label) = load::environment(name)?;
    let mut spec = base.spec().clone();
    spec.environment = Reference::Inline(Box::new(environment));
    if let Some(robot) = &args.robot {
        spec.robot = Reference::Inline(Box::new(load::robot(robot, None)?.spec));
    }
    let file = format!("{} in {label}", base.spec().name);
    let spec = spec.lasting(args.gait_seconds.unwrap_or(base.gaits().duration));
    Job::new(spec).map_err(|source| Error::Invalid { file, source })
}

/// Returns the file name of an environment's picture.
fn scatter(job: &Job, ending: &str) -> String {
    format!("scatter-{}.{ending}", job.environment().name)
}

fn write(out: &Path, view: &View) -> Result<(), Error> {
    let mut batch = Batch::new(out);
    batch.add("reuse.md", report::markdown(view).as_bytes())?;
    for found in &view.environments {
        let name = format!("scatter-{}", found.environment);
        let picture = report::scatter(view, found);
        batch.add(&format!("{name}.svg"), picture.svg().as_bytes())?;
        batch.add(&format!("{name}.png"), &crate::output::png(&name, &picture)?)?;
    }
    batch.add("reuse.json", console::json(view)?.as_bytes())?;
    batch.commit()
}
