//! Comparison of engine settings on the scores of genotypes.

use super::{Agreement, Measured, compare, measure};
use crate::clock::{Spent, timed};
use crate::setting::PhysicsSetting;
use crate::statistics::Estimate;
use crate::threads::in_order;
use serde::Serialize;
use sim_core::base::error::Invalid;
use sim_core::genotype::Genotype;
use sim_core::problem::Job;
use std::ops::Range;

/// Number of genotypes that an engine with lanes gets at once, similar to a slot in a search.
const TOGETHER: usize = 20;

/// Setting and start with which every genotype is scored.
#[derive(Clone, Debug)]
pub struct Column {
    setting: PhysicsSetting,
    job: Job,
    disturbed: bool,
}

/// A genotype to score.
#[derive(Clone, Debug, PartialEq)]
pub struct Subject {
    /// Genotype to score.
    pub genotype: Genotype,
    /// Generation that it is a candidate of.
    pub generation: u32,
    /// Index of the run that it comes from, if any.
    pub run: Option<usize>,
    /// Its role in that run ("winner" or "search's best") and its score in the search; `None` for genotypes of all
    /// generations.
    pub role: Option<(&'static str, f64)>,
}

/// Results of a study.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    /// Setting that all others are compared with.
    pub reference: PhysicsSetting,
    /// Results of the settings in their order, then of the reference.
    pub settings: Vec<FitnessRow>,
    /// Results of the reference from starts with joint angles disturbed by 1e-6 rad, compared with the reference.
    pub ceiling: FitnessRow,
    /// Spearman's rank correlation of every pair of `settings`.
    pub pairs: Vec<Vec<Option<Estimate>>>,
    /// Final candidates of stored runs.
    pub finalists: Vec<Finalist>,
    /// Genotypes from all generations, with their scores.
    #[serde(rename = "genomes")]
    pub genotypes: Vec<Entry>,
}

/// Results of one setting over the genotypes from all generations.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FitnessRow {
    /// Engine setting.
    pub setting: PhysicsSetting,
    /// Mean score; `null` without such genotypes.
    pub mean: Option<f64>,
    /// Agreement with the reference; `null` without such genotypes.
    pub agreement: Option<Agreement>,
    /// CPU time per genotype for all its trees, s.
    pub cpu_seconds: f64,
    /// Rollouts per genotype.
    pub rollouts: f64,
    /// Unstable rollouts of all genotypes.
    pub unstable: u64,
}

/// Final candidate of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finalist {
    /// Name of the run.
    pub run: String,
    /// Role in the run: "winner", as published, or "search's best".
    pub role: &'static str,
    /// Generation that it is a candidate of.
    pub generation: u32,
    /// Score in its search.
    pub search: f64,
    /// Mean scores with each of `settings`.
    pub means: Vec<f64>,
    /// Mean score with the reference divided by that with the first setting; `null` if the latter is 0.
    pub kept: Option<f64>,
}

/// Scores of a genotype from any generation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Entry {
    /// Index of the run that it comes from, if any.
    pub run: Option<usize>,
    /// Generation of the genotype; 0 for random ones.
    pub generation: u32,
    /// Scores by setting, then by tree.
    pub scores: Vec<Vec<f64>>,
}

/// Returns the columns of a study: the reference, the reference from a disturbed start, then the settings.
///
/// # Errors
/// The setting that is invalid for the job, and the reason.
pub fn columns(
    job: &Job,
    reference: PhysicsSetting,
    settings: &[PhysicsSetting],
) -> Result<Vec<Column>, (PhysicsSetting, Invalid)> {
    let column = |(setting, disturbed): (PhysicsSetting, bool)| {
        let mut physics = job.spec().physics.clone();
        setting.write(&mut physics);
        let job = job.with_physics(physics).map_err(|reason| (setting, reason))?;
        Ok(Column { setting, job, disturbed })
    };
    let settings = settings.iter().map(|setting| (*setting, false));
    [(reference, false), (reference, true)].into_iter().chain(settings).map(column).collect()
}

/// Scores every genotype in every column on `trees` trees, on `threads` threads (at least 1), and compares the columns.
/// `runs`: names of the runs that genotypes come from. `each` is called after every score.
pub fn study(
    columns: &[Column],
    subjects: &[Subject],
    (trees, threads): (u32, usize),
    runs: &[String],
    each: &(dyn Fn() + Sync),
) -> Found {
    found(columns, subjects, runs, &scored(columns, subjects, trees, threads, each))
}

/// Scores every genotype in every column and measures the time of each. Results are ordered by column, then by
/// genotype.
fn scored(
    columns: &[Column],
    subjects: &[Subject],
    trees: u32,
    threads: usize,
    each: &(dyn Fn() + Sync),
) -> Vec<Vec<(Measured, Spent)>> {
    let together = |column: &Column| if column.job.engine().lanes() > 1 { TOGETHER } else { 1 };
    // All columns score one group of genotypes before the next group begins, so that the remaining time can be
    // estimated early.
    let mut work: Vec<(usize, Range<usize>)> = Vec::new();
    for from in (0..subjects.len()).step_by(TOGETHER) {
        let to = (from + TOGETHER).min(subjects.len());
        for (c, column) in columns.iter().enumerate() {
            let step = together(column);
            work.extend((from..to).step_by(step).map(|i| (c, i..(i + step).min(to))));
        }
    }
    let done = in_order(work.len(), threads, |i| {
        let (column, range) = (&columns[work[i].0], work[i].1.clone());
        let genotypes: Vec<&Genotype> = subjects[range.clone()].iter().map(|s| &s.genotype).collect();
        let (measured, spent) =
            timed(|| measure(&column.job, range.start as u32, &genotypes, trees, column.disturbed, &|| false));
        let share = spent.share(range.len());
        range.for_each(|_| each());
        let measured = measured.unwrap_or_else(|_| unreachable!("the stop callback always returns false"));
        measured.into_iter().map(|m| (m, share)).collect::<Vec<_>>()
    });
    let mut scored: Vec<Vec<(Measured, Spent)>> = columns.iter().map(|_| Vec::new()).collect();
    // Pieces of a column are in the order of its genotypes.
    work.into_iter().zip(done).for_each(|((c, _), some)| scored[c].extend(some));
    scored
}

fn found(columns: &[Column], subjects: &[Subject], runs: &[String], scored: &[Vec<(Measured, Spent)>]) -> Found {
    let aged: Vec<usize> = (0..subjects.len()).filter(|&i| subjects[i].role.is_none()).collect();
    let scores = |c: usize| aged.iter().map(|&i| scored[c][i].0.mean()).collect::<Vec<f64>>();
    let average = |c: usize, of: &dyn Fn(&(Measured, Spent)) -> f64| {
        scored[c].iter().map(of).sum::<f64>() / scored[c].len() as f64
    };
    let row = |c: usize| FitnessRow {
        setting: columns[c].setting,
        mean: (!aged.is_empty()).then(|| scores(c).iter().sum::<f64>() / aged.len() as f64),
        agreement: (!aged.is_empty()).then(|| compare(&scores(0), &scores(c))),
        cpu_seconds: average(c, &|f| f.1.cpu),
        rollouts: average(c, &|f| f.0.rollouts as f64),
        unstable: scored[c].iter().map(|f| f.0.unstable).sum(),
    };
    // The reference is last, because it is usually the finest setting.
    let order: Vec<usize> = (2..columns.len()).chain([0]).collect();
    let pair = |a: usize, b: usize| if aged.is_empty() { None } else { compare(&scores(a), &scores(b)).spearman };
    let of = |i: usize| order.iter().map(|&c| scored[c][i].0.scores.clone()).collect::<Vec<_>>();
    let finalist = |(i, subject): (usize, &Subject)| {
        let (role, search) = subject.role?;
        let means: Vec<f64> = order.iter().map(|&c| scored[c][i].0.mean()).collect();
        let run = runs.get(subject.run?)?.clone();
        let kept = ratio(means[means.len() - 1], means[0]);
        Some(Finalist { run, role, generation: subject.generation, search, means, kept })
    };
    Found {
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

/// Returns `a` / `b`; `None` if `b` is 0.
pub fn ratio(a: f64, b: f64) -> Option<f64> {
    (b != 0.0).then(|| a / b)
}
