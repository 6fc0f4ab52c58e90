//! `evogait bench fidelity`: engine settings against a converged reference, on random and evolved gaits.

mod report;
mod row;
mod view;

use super::subject::{self, Machine};
use crate::arguments::BenchFidelity;
use crate::console;
use crate::error::Error;
use crate::inputs;
use crate::load;
use crate::output::Stored;
use crate::output::atomic::Batch;
use crate::progress::Pieces;
use sim_core::genotype::Genotype;
use sim_core::model::environment::Environment;
use sim_core::physics::EngineKind;
use sim_core::problem::Job;
use std::fs;
use std::path::Path;
use study::fidelity::comparison::Comparison;
use study::fidelity::table;
use study::gaits;
use study::setting::PhysicsSetting;
use view::View;

/// Names of the files in the output folder.
const FILES: [&str; 4] = ["fidelity.md", "frontier.svg", "frontier.png", "fidelity.json"];

/// Measures the settings and prints the result.
pub fn run(args: BenchFidelity, quiet: bool) -> Result<(), Error> {
    if let Some(out) = &args.out {
        fs::create_dir_all(out).map_err(|e| Error::write(out, e))?;
    }
    let (job, own, stored) = subject_of(&args)?;
    if let Some(out) = &args.out {
        inputs::refuse_all(out, FILES)?;
    }
    args.table.as_deref().map_or(Ok(()), inputs::refuse)?;
    let duration = job.gaits().duration;
    let settings = match &args.settings[..] {
        [] if args.table.is_some() => table::settings(args.subject.scale.into()),
        [] => vec![own],
        given => given.to_vec(),
    };
    let reference = PhysicsSetting::of(&job);
    let comparison = Comparison { reference, halved: halves(reference)?, settings };
    subject::check(&comparison.settings, duration)?;
    subject::supported(&comparison.settings, &job)?;
    if args.table.is_some() {
        table::check(&comparison, [args.random, args.evolved]).map_err(row::refused)?;
    }

    let drawn = gaits::random(&job, args.random, args.seed);
    let (evolved, from) = evolved(&args, &job, stored, quiet)?;
    if drawn.is_empty() && evolved.is_empty() {
        return Err(Error::Usage {
            message:
                "--random and --evolved are both 0, so there are no gaits to compare: set one of them to at least 1"
                    .to_owned(),
        });
    }
    let progress = Pieces::new("gaits", (drawn.len() + evolved.len()) as u64, quiet);
    let mut sets = Vec::new();
    for (name, gaits) in [("random", drawn), ("evolved", evolved)] {
        if !gaits.is_empty() {
            let motions = subject::compiled(&job, &gaits)?;
            let each = || progress.one_done();
            sets.push(comparison.measure(&job, (name, &motions), args.threads as usize, &each));
        }
    }
    drop(progress);
    let view = View {
        robot: job.robot_spec().name.clone(),
        environment: job.environment().name.clone(),
        gravity: job.physics().gravity,
        duration,
        seed: args.seed,
        threads: args.threads,
        evolved: from,
        machine: Machine::here(),
        reference,
        sets,
    };
    if let Some(out) = &args.out {
        write(out, &view)?;
    }
    if let Some(path) = &args.table {
        let (variant, scale) = (args.subject.variant.as_deref(), args.subject.scale.into());
        row::keep(path, table::rows(&job, variant, scale, &comparison, &view.sets).map_err(row::refused)?)?;
    }
    if args.json { console::say_json(&view) } else { console::say(&report::text(&view)) }
}

/// Returns the engine of the default settings: that of the reference if given, else lockstep if all settings are
/// lockstep or a table is written, else rapier.
fn engine_meant(args: &BenchFidelity) -> EngineKind {
    let all = |engine| !args.settings.is_empty() && args.settings.iter().all(|s| s.engine == engine);
    match args.reference {
        Some(reference) => reference.engine,
        None if args.table.is_some() || all(EngineKind::Lockstep) => EngineKind::Lockstep,
        None => EngineKind::Rapier,
    }
}

/// Returns the job with robot, physics (of the reference) and gaits; the default setting of that job; and the stored
/// winner's gaits if `--gaits` is given.
fn subject_of(args: &BenchFidelity) -> Result<(Job, PhysicsSetting, Option<Vec<Genotype>>), Error> {
    let meant = engine_meant(args);
    let Some(folder) = &args.gaits else {
        let reference = args.reference.unwrap_or_else(|| PhysicsSetting::finest(meant, args.subject.scale.into()));
        subject::check(&[reference], args.duration)?;
        let ground = ground(args)?;
        let job = subject::job(&args.subject, ground, reference, args.duration, args.seed)?;
        return Ok((job, subject::own(&args.subject, meant), None));
    };
    let stored = Stored::read(folder)?;
    let Some(winner) = &stored.result.winner else { return Err(Error::NoWinner { folder: folder.clone() }) };
    let mut spec = stored.job.spec().clone();
    let reference = args.reference.unwrap_or_else(|| PhysicsSetting::finest(meant, spec.physics.scale));
    subject::check(&[reference], stored.job.gaits().duration)?;
    reference.write(&mut spec.physics);
    let job = Job::new(spec).map_err(|source| Error::Invalid { file: folder.display().to_string(), source })?;
    let gaits = gaits::of_set(&job, &winner.scored().genotype).collect();
    Ok((job, PhysicsSetting::of(&stored.job), Some(gaits)))
}

/// Returns the environment of `--environment`, if given.
fn ground(args: &BenchFidelity) -> Result<Option<Environment>, Error> {
    args.environment.as_deref().map(|name| Ok(load::environment(name)?.0)).transpose()
}

/// Returns the reference with twice its substeps, and with twice its steps.
fn halves(reference: PhysicsSetting) -> Result<[PhysicsSetting; 2], Error> {
    reference.halved().ok_or_else(|| Error::Usage {
        message: format!(
            "--reference {reference} can't be halved: allowed are at most 5000 steps a second and 500 substeps"
        ),
    })
}

/// Returns the evolved gaits and a text with their source.
fn evolved(
    args: &BenchFidelity,
    job: &Job,
    stored: Option<Vec<Genotype>>,
    quiet: bool,
) -> Result<(Vec<Genotype>, String), Error> {
    if let Some(mut gaits) = stored {
        gaits.truncate(args.evolved as usize);
        return Ok((gaits, "the winner of a stored run".to_owned()));
    }
    // A search exploits errors of its engine, so the gaits are evolved on the engine of the reference.
    let own = subject::own(&args.subject, job.chosen().engine);
    let (subject, file) = subject::read(&args.subject, ground(args)?)?;
    let evolutions = subject.evolutions(own, args.seed).map_err(|source| Error::Invalid { file, source })?;
    // These jobs differ from the compared job only in setting and duration.
    let generations = gaits::generations(job, args.evolved);
    let progress = Pieces::new("generations of evolving gaits", generations, quiet);
    let gaits = gaits::evolved(evolutions, args.evolved, &|| progress.one_done());
    Ok((gaits, "the last generations of short evolutions".to_owned()))
}

fn write(out: &Path, view: &View) -> Result<(), Error> {
    let picture = report::frontier(view);
    let mut batch = Batch::new(out);
    batch.add("fidelity.md", report::markdown(view).as_bytes())?;
    batch.add("frontier.svg", picture.svg().as_bytes())?;
    batch.add("frontier.png", &crate::output::png("frontier", &picture)?)?;
    batch.add("fidelity.json", console::json(view)?.as_bytes())?;
    batch.commit()
}
