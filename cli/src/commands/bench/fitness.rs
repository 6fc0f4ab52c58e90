//! `evogait bench fitness`: comparison of genotypes' scores and ranking between engine settings.

mod report;
mod view;

use super::{genotypes, subject};
use crate::arguments::{BenchFitness, JobFile, cores};
use crate::console;
use crate::error::Error;
use crate::inputs;
use crate::load;
use crate::output::Stored;
use crate::output::atomic::Batch;
use crate::progress::Pieces;
use sim_core::job::{JobSpec, Reference};
use sim_core::physics::EngineKind;
use sim_core::problem::Job;
use std::fs;
use std::path::Path;
use study::fitness::comparison::{self, Column, Found, Subject, study};
use study::genotypes::of_all_ages;
use study::setting::PhysicsSetting;
use view::View;

/// Names of the files in the output folder.
const FILES: [&str; 4] = ["fitness.md", "scatter.svg", "scatter.png", "fitness.json"];
/// Candidates of a generation if the genotypes are evolved by this command.
const POPULATION: u32 = 20;

/// Scores the genotypes with all settings and prints the result.
pub fn run(args: BenchFitness, quiet: bool) -> Result<(), Error> {
    if let Some(out) = &args.out {
        fs::create_dir_all(out).map_err(|e| Error::write(out, e))?;
    }
    let threads = args.threads.unwrap_or_else(cores) as usize;
    let runs = args.runs.iter().map(|folder| Stored::read(folder)).collect::<Result<Vec<Stored>, Error>>()?;
    let base = base(&args, &runs)?;
    if let Some(out) = &args.out {
        inputs::refuse_all(out, FILES)?;
    }
    let reference =
        args.reference.unwrap_or_else(|| PhysicsSetting::finest(EngineKind::Rapier, base.spec().physics.scale));
    let columns = columns(&base, reference, &settings(&args, &base))?;
    let subjects = match &runs[..] {
        [] => evolved(&args, &base, threads, quiet)?,
        runs => stored(runs, args.genomes as usize)?,
    };
    if subjects.is_empty() {
        return Err(Error::Usage {
            message:
                "--genomes is 0 without --runs, so there is nothing to score: set --genomes to at least 1 or name runs"
                    .to_owned(),
        });
    }
    let runs: Vec<String> = args.runs.iter().map(|folder| folder.display().to_string()).collect();
    let progress = Pieces::new("scored genomes", (columns.len() * subjects.len()) as u64, quiet);
    let found = study(&columns, &subjects, (args.seeds, threads), &runs, &|| progress.one_done());
    drop(progress);
    let view = view(&args, &base, found);
    if let Some(out) = &args.out {
        write(out, &view)?;
    }
    if args.json { console::say_json(&view) } else { console::say(&report::text(&view)) }
}

/// Returns the job of the scored genotypes, on its own setting.
fn base(args: &BenchFitness, runs: &[Stored]) -> Result<Job, Error> {
    let job = match runs {
        [] => load::evolving(&JobFile { job: args.job.clone(), seed: args.seed })?,
        [first, others @ ..] => {
            let but_seed = |job: &Job| JobSpec { seed: 0, ..job.spec().clone() };
            if let Some(other) = others.iter().find(|other| but_seed(&other.job) != but_seed(&first.job)) {
                let [first, other] = [first, other].map(|stored| stored.folder.display());
                let message = format!("--runs: the jobs of {other} and {first} differ: only their seeds may differ");
                return Err(Error::Usage { message });
            }
            first.job.clone()
        }
    };
    let mut spec = job.spec().clone();
    let mut file = spec.name.clone();
    if let Some(name) = &args.environment {
        let (environment, label) = load::environment(name)?;
        spec.environment = Reference::Inline(Box::new(environment));
        file = format!("{file} in {label}");
    }
    if let Some(robot) = &args.robot {
        spec.robot = Reference::Inline(Box::new(load::robot(robot, None)?.spec));
    }
    Job::new(spec.lasting(args.gait_seconds.unwrap_or(job.gaits().duration)))
        .map_err(|source| Error::Invalid { file, source })
}

/// Returns the settings of `--settings`, or else the job's own, rapier's default at its scale, and that of its finish.
fn settings(args: &BenchFitness, base: &Job) -> Vec<PhysicsSetting> {
    if !args.settings.is_empty() {
        return args.settings.clone();
    }
    let mut settings =
        vec![PhysicsSetting::of(base), PhysicsSetting::own(EngineKind::Rapier, base.spec().physics.scale)];
    settings.extend(base.on_reference().map(PhysicsSetting::of));
    (1..settings.len()).rev().for_each(|i| {
        if settings[..i].contains(&settings[i]) {
            settings.remove(i);
        }
    });
    settings
}

fn columns(base: &Job, reference: PhysicsSetting, settings: &[PhysicsSetting]) -> Result<Vec<Column>, Error> {
    let duration = base.gaits().duration;
    subject::check(&[&[reference], settings].concat(), duration)?;
    comparison::columns(base, reference, settings).map_err(|(setting, source)| {
        let file = format!("{} on {setting}", base.spec().name);
        Error::Invalid { file, source }
    })
}

/// Evolves genotypes and samples them from all generations.
fn evolved(args: &BenchFitness, base: &Job, threads: usize, quiet: bool) -> Result<Vec<Subject>, Error> {
    if args.genomes == 0 {
        return Ok(Vec::new());
    }
    let generations = genotypes::evolved(base, POPULATION, args.generations, threads, quiet)?;
    let samples = of_all_ages(&generations, args.genomes as usize).into_iter();
    Ok(samples.map(|s| Subject { genotype: s.genotype, generation: s.generation, run: None, role: None }).collect())
}

/// Samples genotypes from all generations of stored runs, and adds the winner and the search's best of each run.
fn stored(runs: &[Stored], count: usize) -> Result<Vec<Subject>, Error> {
    let mut subjects = Vec::new();
    for (i, run) in runs.iter().enumerate() {
        // All runs give the same number; the first runs give one more if there is a remainder.
        let of_this = count / runs.len() + usize::from(i < count % runs.len());
        if of_this > 0 {
            let samples = of_all_ages(&genotypes::stored(&run.folder)?, of_this).into_iter();
            let subject = |s: study::genotypes::Sample| Subject {
                genotype: s.genotype,
                generation: s.generation,
                run: Some(i),
                role: None,
            };
            subjects.extend(samples.map(subject));
        }
    }
    for (i, run) in runs.iter().enumerate() {
        let report = run.report()?;
        for (role, found) in [("winner", report.winner), ("search's best", report.best)] {
            let role = Some((role, found.score));
            subjects.push(Subject { genotype: found.genotype, generation: found.generation, run: Some(i), role });
        }
    }
    Ok(subjects)
}

fn view(args: &BenchFitness, base: &Job, found: Found) -> View {
    View {
        job: base.spec().name.clone(),
        robot: base.robot_spec().name.clone(),
        environment: base.environment().name.clone(),
        seed: base.spec().seed,
        gait_seconds: base.gaits().duration,
        gaits: base.gaits().count,
        iterations: base.spec().planner.iterations,
        trees: args.seeds,
        from: match args.runs.len() {
            0 => format!("a genetic algorithm of {POPULATION} candidates over {} generations", args.generations),
            n => format!("{n} stored run{}", if n == 1 { "" } else { "s" }),
        },
        score: base.score_label().0,
        unit: base.score_label().1,
        found,
    }
}

fn write(out: &Path, view: &View) -> Result<(), Error> {
    let mut batch = Batch::new(out);
    batch.add("fitness.md", report::markdown(view).as_bytes())?;
    if !view.found.genotypes.is_empty() {
        let picture = report::scatter(view);
        batch.add("scatter.svg", picture.svg().as_bytes())?;
        batch.add("scatter.png", &crate::output::png("scatter", &picture)?)?;
    }
    batch.add("fitness.json", console::json(view)?.as_bytes())?;
    batch.commit()
}
