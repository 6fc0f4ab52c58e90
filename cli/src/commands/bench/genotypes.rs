//! Candidates of all generations of a search, which this command runs or which a stored run contains.

use crate::commands::with_runtime;
use crate::error::Error;
use crate::output::{STORE, Stored};
use crate::progress::Pieces;
use coordinator::{StoreError, StoreUrl, store};
use sim_core::genotype::Genotype;
use sim_core::problem::Job;
use sim_core::procedure::evolve::TaskResult;
use std::io;
use std::path::Path;
use study::genotypes::{self, evolution, searched};

/// Returns the generations of a genetic algorithm with the job's own reuse.
pub fn evolved(
    job: &Job,
    population: u32,
    generations: u32,
    threads: usize,
    quiet: bool,
) -> Result<Vec<Vec<Genotype>>, Error> {
    let file = format!("the evolution of {}", job.spec().name);
    let search = evolution(job, population, generations).map_err(|source| Error::Invalid { file, source })?;
    let progress = Pieces::new("generations of evolving genomes", u64::from(generations) - 1, quiet);
    Ok(genotypes::evolved(&search, threads, &|| progress.one_done()))
}

/// Returns the generations of a finished run: replays its optimiser with the scores in the run's store.
pub fn stored(folder: &Path) -> Result<Vec<Vec<Genotype>>, Error> {
    let job = Stored::read(folder)?.job;
    let path = folder.join(STORE);
    if !path.is_file() {
        return Err(Error::Usage {
            message: format!(
                "{} has no {STORE}: give a folder that `evogait run` wrote (`evogait fetch` writes no store)",
                folder.display()
            ),
        });
    }
    let unreadable = |reason: String| Error::read(&path, io::Error::other(reason));
    let generations = job.optimiser_spec().generations();
    let scores = with_runtime(async {
        let read = async {
            let store = store::open(&StoreUrl::Sqlite(path.clone()), coordinator::limits::DEFAULT_TAKEOVER).await?;
            let newest = store.jobs(i64::MAX as u64, 1, &[]).await?;
            let mut scores = Vec::new();
            if let Some(record) = newest.first() {
                // The first round is the preparation.
                for round in store.rounds(&record.id, 1, generations).await? {
                    let results = round.results.unwrap_or_default();
                    scores.push(results.iter().filter_map(|result| score(result)).collect::<Vec<_>>());
                }
            }
            Ok(scores)
        };
        read.await.map_err(|e: StoreError| unreadable(e.to_string()))
    })?;
    searched(&job, |generation, candidates| match scores.get(generation as usize) {
        Some(scores) if scores.len() == candidates.len() => Ok(scores.clone()),
        _ => Err(unreadable(format!("the store has no complete scores of generation {generation}"))),
    })
}

/// Returns the score in a task result, with `None` inside for a failed evaluation. Returns `None` for any other bytes.
fn score(result: &[u8]) -> Option<Option<f64>> {
    match TaskResult::decode(result).ok()? {
        TaskResult::Evaluated { score, .. } => Some(score),
        TaskResult::Examined { .. } => None,
    }
}
