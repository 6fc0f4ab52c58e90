//! `evogait bench fitness`: whether engine settings agree on what genotypes are worth.

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
use sim_core::genotype::Genotype;
use sim_core::job::{JobSpec, Reference};
use sim_core::physics::EngineKind;
use sim_core::problem::Job;
use std::fs;
use std::ops::Range;
use std::path::Path;
use study::clock::{Spent, timed};
use study::fitness::{Measured, compare, measure};
use study::genotypes::of_all_ages;
use study::setting::Setting;
use study::threads::in_order;
use view::{Entry, Finalist, Row, View};

/// Files of the output folder.
const FILES: [&str; 4] = ["fitness.md", "scatter.svg", "scatter.png", "fitness.json"];
/// Candidates of a generation where genotypes are evolved on the spot.
const POPULATION: u32 = 20;
/// Genotypes that an engine with lanes gets at once, as a slot does in a search.
const TOGETHER: usize = 20;

/// One way to score every genotype. The first is the reference, the second its disturbed start, then come the settings.
struct Column {
    setting: Setting,
    job: Job,
    disturbed: bool,
}

/// A genotype to score.
struct Subject {
    genotype: Genotype,
    generation: u32,
    /// Which of the runs it is from.
    run: Option<usize>,
    /// What it is in that run, and what it scored in its search; nothing for those of all ages.
    role: Option<(&'static str, f64)>,
}

/// What scoring a genotype in one way gave, and what it took.
type Found = (Measured, Spent);

/// Measures and tells.
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
    let reference = args.reference.unwrap_or_else(|| Setting::finest(EngineKind::Rapier, base.spec().physics.scale));
    let columns = columns(&base, reference, &settings(&args, &base))?;
    let subjects = match &runs[..] {
        [] => evolved(&args, &base, threads, quiet)?,
        runs => stored(runs, args.genomes as usize)?,
    };
    if subjects.is_empty() {
        return Err(Error::Usage { message: "--genomes 0 without --runs leaves nothing to score".to_owned() });
    }
    let found = score(&columns, &subjects, args.seeds, threads, quiet);
    let view = view(&args, &base, &columns, &subjects, &found);
    if let Some(out) = &args.out {
        write(out, &view)?;
    }
    if args.json { console::say_json(&view) } else { console::say(&report::text(&view)) }
}

/// The job whose genotypes are scored, on its own setting.
fn base(args: &BenchFitness, runs: &[Stored]) -> Result<Job, Error> {
    let job = match runs {
        [] => load::job(&JobFile { job: args.job.clone(), seed: args.seed })?,
        [first, others @ ..] => {
            let but_seed = |job: &Job| JobSpec { seed: 0, ..job.spec().clone() };
            if let Some(other) = others.iter().find(|other| but_seed(&other.job) != but_seed(&first.job)) {
                let [first, other] = [first, other].map(|stored| stored.folder.display());
                let message = format!("--runs: {other} is of another job than {first}; only their seeds may differ");
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
    spec.gaits.duration = args.gait_seconds.unwrap_or(spec.gaits.duration);
    Job::new(spec).map_err(|source| Error::Invalid { file, source })
}

/// Those asked for; otherwise the job's own, what rapier ships with at its scale, and the one of its finish.
fn settings(args: &BenchFitness, base: &Job) -> Vec<Setting> {
    if !args.settings.is_empty() {
        return args.settings.clone();
    }
    let mut settings = vec![Setting::of(base), Setting::own(EngineKind::Rapier, base.spec().physics.scale)];
    settings.extend(base.on_reference().map(Setting::of));
    (1..settings.len()).rev().for_each(|i| {
        if settings[..i].contains(&settings[i]) {
            settings.remove(i);
        }
    });
    settings
}

fn columns(base: &Job, reference: Setting, settings: &[Setting]) -> Result<Vec<Column>, Error> {
    let duration = base.spec().gaits.duration;
    subject::check(&[&[reference], settings].concat(), duration)?;
    let column = |(setting, disturbed): (Setting, bool)| {
        let mut physics = base.spec().physics.clone();
        setting.write(&mut physics);
        let file = format!("{} on {setting}", base.spec().name);
        let job = base.with_physics(physics).map_err(|source| Error::Invalid { file, source })?;
        Ok(Column { setting, job, disturbed })
    };
    let settings = settings.iter().map(|setting| (*setting, false));
    [(reference, false), (reference, true)].into_iter().chain(settings).map(column).collect()
}

/// Genotypes of all ages of an evolution on the spot.
fn evolved(args: &BenchFitness, base: &Job, threads: usize, quiet: bool) -> Result<Vec<Subject>, Error> {
    if args.genomes == 0 {
        return Ok(Vec::new());
    }
    let generations = genotypes::evolved(base, POPULATION, args.generations, threads, quiet)?;
    let samples = of_all_ages(&generations, args.genomes as usize).into_iter();
    Ok(samples.map(|s| Subject { genotype: s.genotype, generation: s.generation, run: None, role: None }).collect())
}

/// Genotypes of all ages of stored runs, then what each run found.
fn stored(runs: &[Stored], count: usize) -> Result<Vec<Subject>, Error> {
    let mut subjects = Vec::new();
    for (i, run) in runs.iter().enumerate() {
        // As many of each run as there are, a remainder from the first.
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

/// Scores every genotype in every way; by column, then by genotype.
fn score(columns: &[Column], subjects: &[Subject], trees: u32, threads: usize, quiet: bool) -> Vec<Vec<Found>> {
    let together = |column: &Column| if column.job.engine().lanes() > 1 { TOGETHER } else { 1 };
    // All ways of some genotypes before the next genotypes: what remains can be told early.
    let mut work: Vec<(usize, Range<usize>)> = Vec::new();
    for from in (0..subjects.len()).step_by(TOGETHER) {
        let to = (from + TOGETHER).min(subjects.len());
        for (c, column) in columns.iter().enumerate() {
            let step = together(column);
            work.extend((from..to).step_by(step).map(|i| (c, i..(i + step).min(to))));
        }
    }
    let progress = Pieces::new("scored genomes", (columns.len() * subjects.len()) as u64, quiet);
    let done = in_order(work.len(), threads, |i| {
        let (column, range) = (&columns[work[i].0], work[i].1.clone());
        let genotypes: Vec<&Genotype> = subjects[range.clone()].iter().map(|s| &s.genotype).collect();
        let (measured, spent) =
            timed(|| measure(&column.job, range.start as u32, &genotypes, trees, column.disturbed, &|| false));
        let n = range.len() as f64;
        range.for_each(|_| progress.one_done());
        let measured = measured.unwrap_or_else(|_| unreachable!("nobody asks it to stop"));
        let each = Spent { wall: spent.wall / n, cpu: spent.cpu / n };
        measured.into_iter().map(|m| (m, each)).collect::<Vec<Found>>()
    });
    let mut found: Vec<Vec<Found>> = columns.iter().map(|_| Vec::new()).collect();
    // Pieces of a column come in the order of its genotypes.
    work.into_iter().zip(done).for_each(|((c, _), some)| found[c].extend(some));
    found
}

fn view(args: &BenchFitness, base: &Job, columns: &[Column], subjects: &[Subject], found: &[Vec<Found>]) -> View {
    let aged: Vec<usize> = (0..subjects.len()).filter(|&i| subjects[i].role.is_none()).collect();
    let scores = |c: usize| aged.iter().map(|&i| found[c][i].0.mean()).collect::<Vec<f64>>();
    let average = |c: usize, of: &dyn Fn(&Found) -> f64| found[c].iter().map(of).sum::<f64>() / found[c].len() as f64;
    let row = |c: usize| Row {
        setting: columns[c].setting,
        mean: (!aged.is_empty()).then(|| scores(c).iter().sum::<f64>() / aged.len() as f64),
        agreement: (!aged.is_empty()).then(|| compare(&scores(0), &scores(c))),
        cpu_seconds: average(c, &|f| f.1.cpu),
        rollouts: average(c, &|f| f.0.rollouts as f64),
        unstable: found[c].iter().map(|f| f.0.unstable).sum(),
    };
    // The reference stands last, as the finest does in most tables.
    let order: Vec<usize> = (2..columns.len()).chain([0]).collect();
    let pair = |a: usize, b: usize| if aged.is_empty() { None } else { compare(&scores(a), &scores(b)).spearman };
    let of = |i: usize| order.iter().map(|&c| found[c][i].0.scores.clone()).collect::<Vec<_>>();
    let finalist = |(i, subject): (usize, &Subject)| {
        let (role, search) = subject.role?;
        let means: Vec<f64> = order.iter().map(|&c| found[c][i].0.mean()).collect();
        let run = args.runs[subject.run?].display().to_string();
        let kept = ratio(means[means.len() - 1], means[0]);
        Some(Finalist { run, role, generation: subject.generation, search, means, kept })
    };
    View {
        job: base.spec().name.clone(),
        robot: base.robot_spec().name.clone(),
        environment: base.environment().name.clone(),
        seed: base.spec().seed,
        gait_seconds: base.spec().gaits.duration,
        gaits: base.spec().gaits.count,
        iterations: base.spec().planner.iterations,
        trees: args.seeds,
        from: match args.runs.len() {
            0 => format!("a genetic algorithm of {POPULATION} candidates over {} generations", args.generations),
            n => format!("{n} stored run{}", if n == 1 { "" } else { "s" }),
        },
        score: base.score_label().0,
        unit: base.score_label().1,
        reference: columns[0].setting,
        settings: order.iter().map(|&c| row(c)).collect(),
        ceiling: row(1),
        pairs: order.iter().map(|&a| order.iter().map(|&b| pair(a, b)).collect()).collect(),
        finalists: subjects.iter().enumerate().filter_map(finalist).collect(),
        genotypes: aged
            .iter()
            .map(|&i| Entry { run: subjects[i].run, generation: subjects[i].generation, scores: of(i) })
            .collect(),
    }
}

/// `None` where nothing was there to keep.
fn ratio(a: f64, b: f64) -> Option<f64> {
    (b != 0.0).then(|| a / b)
}

fn write(out: &Path, view: &View) -> Result<(), Error> {
    let mut batch = Batch::new(out);
    batch.add("fitness.md", report::markdown(view).as_bytes())?;
    if !view.genotypes.is_empty() {
        let picture = report::scatter(view);
        batch.add("scatter.svg", picture.svg().as_bytes())?;
        batch.add("scatter.png", &crate::output::png("scatter", &picture)?)?;
    }
    batch.add("fitness.json", console::json(view)?.as_bytes())?;
    batch.commit()
}
