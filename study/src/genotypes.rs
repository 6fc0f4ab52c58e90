//! Genotypes to measure with: those of searches.

use crate::threads::in_order;
use serde::{Deserialize, Serialize};
use sim_core::base::error::Invalid;
use sim_core::evaluate::{Evaluation, evaluate};
use sim_core::genotype::Genotype;
use sim_core::job::JobSpec;
use sim_core::problem::Job;
use std::convert::Infallible;

/// Smallest population that evolves.
pub const LEAST_POPULATION: u32 = 4;

/// A genotype and where it is from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// The generation that it is a candidate of; 0 for random ones.
    pub generation: u32,
    /// Its parameters.
    pub genotype: Genotype,
}

/// The job with a genetic algorithm of so many candidates and generations: what a study evolves genotypes with.
pub fn evolution(job: &Job, population: u32, generations: u32) -> Result<Job, Invalid> {
    let table = format!("kind = \"ga\"\npopulation = {population}\ngenerations = {generations}");
    Job::new(JobSpec { optimiser: toml::from_str(&table)?, ..job.spec().clone() })
}

/// All candidates of a search, by generation. `score` gives a generation's scores: it may compute them anew
/// ([`sim_core::evaluate::evaluate`]) or look them up, and stops the search by an error.
pub fn searched<E>(
    job: &Job,
    mut score: impl FnMut(u32, &[(u32, Genotype)]) -> Result<Vec<Option<f64>>, E>,
) -> Result<Vec<Vec<Genotype>>, E> {
    let mut optimiser = job.optimiser();
    let mut generations: Vec<Vec<Genotype>> = Vec::new();
    for generation in 0..job.optimiser_spec().generations() {
        generations.push(optimiser.ask().genotypes);
        if generation + 1 < job.optimiser_spec().generations() {
            let candidates: Vec<(u32, Genotype)> = (0..).zip(optimiser.ask().genotypes).collect();
            let scores = score(generation, &candidates)?;
            optimiser.tell(&optimiser.ask().scored(&scores));
        }
    }
    Ok(generations)
}

/// All candidates of a search, by generation, evaluated on `threads` threads (at least 1). `each` is called after every
/// generation that is evaluated: all but the last.
pub fn evolved(search: &Job, threads: usize, each: &dyn Fn()) -> Vec<Vec<Genotype>> {
    let generations = searched(search, |generation, candidates| {
        let evaluations = in_order(candidates.len(), threads, |i| {
            let one = evaluate(search, generation, &candidates[i..=i], &|| false);
            one.unwrap_or_else(|_| unreachable!("it is never stopped"))
        });
        each();
        Ok::<_, Infallible>(scores(&evaluations.concat()))
    });
    generations.unwrap_or_else(|never| match never {})
}

/// Up to `count` genotypes of a search: half of them (rounded up) of its first generation, the others of its last
/// generations, from the last backwards; none twice.
pub fn first_and_last(generations: &[Vec<Genotype>], count: usize) -> Vec<Sample> {
    let mut samples = Vec::new();
    let mut take = |generation: usize, most: usize| {
        for genotype in &generations[generation] {
            if samples.len() < most {
                add(&mut samples, generation, genotype);
            }
        }
    };
    take(0, count.div_ceil(2));
    (1..generations.len()).rev().for_each(|generation| take(generation, count));
    samples
}

/// Up to `count` genotypes of a search, spread evenly over its generations, the first and the last among them; none
/// twice. Within a generation every candidate has its turn.
pub fn of_all_ages(generations: &[Vec<Genotype>], count: usize) -> Vec<Sample> {
    let mut samples = Vec::new();
    let last = generations.len().saturating_sub(1);
    for i in 0..count {
        let generation = (i * last).checked_div(count - 1).unwrap_or(0);
        let candidates = &generations[generation];
        // An elite may have been taken at a younger age: then the next candidate.
        let mut turns = (0..candidates.len()).map(|turn| &candidates[(i + turn) % candidates.len()]);
        let _taken = turns.any(|genotype| add(&mut samples, generation, genotype));
    }
    samples
}

/// Whether it was none that is there already.
fn add(samples: &mut Vec<Sample>, generation: usize, genotype: &Genotype) -> bool {
    let new = !samples.iter().any(|s| s.genotype.same_bits(genotype));
    if new {
        samples.push(Sample { generation: generation as u32, genotype: genotype.clone() });
    }
    new
}

/// The scores of evaluations, by candidate.
pub fn scores(evaluations: &[Evaluation]) -> Vec<Option<f64>> {
    evaluations.iter().map(|e| e.score).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::evaluate::Stopped;

    fn search(population: u32, generations: u32) -> (Job, Vec<Vec<Genotype>>) {
        let job = Job::from_toml(
            r#"
            name = "studied"
            robot = "quadropod"
            environment = "empty"
            gaits = { count = 2, duration = 1.0 }
            planner = { iterations = 12 }
            fitness = { kind = "coverage", cell = 0.2 }
            optimiser = { kind = "pso", particles = 4, generations = 3 }
            "#,
        );
        let search = evolution(&job.unwrap(), population, generations).unwrap();
        let mut kept = Vec::new();
        let generations = searched(&search, |generation, candidates| {
            assert_eq!((generation as usize, candidates.len()), (kept.len(), population as usize));
            kept.push(scores(&evaluate(&search, generation, candidates, &|| false)?));
            Ok::<_, Stopped>(kept[kept.len() - 1].clone())
        });
        let again = searched(&search, |generation, _| Ok::<_, Stopped>(kept[generation as usize].clone()));
        let generations = generations.unwrap();
        assert_eq!(again.unwrap(), generations, "stored scores find the same");
        (search, generations)
    }

    fn none_twice(samples: &[Sample]) {
        for (i, sample) in samples.iter().enumerate() {
            assert!(!samples[..i].iter().any(|other| other.genotype == sample.genotype));
        }
    }

    #[test]
    fn evolved_candidates_do_not_depend_on_threads() {
        let (search, generations) = search(5, 3);
        for threads in [1, 3] {
            assert_eq!(evolved(&search, threads, &|| ()), generations);
        }
    }

    #[test]
    fn half_of_the_genotypes_are_random_and_half_evolved() {
        let (search, generations) = search(5, 4);
        let samples = first_and_last(&generations, 9);
        assert_eq!(samples.len(), 9);
        let random: Vec<Genotype> = samples.iter().filter(|s| s.generation == 0).map(|s| s.genotype.clone()).collect();
        assert_eq!(random, search.optimiser().ask().genotypes);
        assert!(samples[5..].iter().all(|s| s.generation >= 2), "the last generation and an elite's predecessor");
        none_twice(&samples);
    }

    #[test]
    fn genotypes_of_all_ages_are_of_every_part_of_a_search() {
        let (_, generations) = search(5, 4);
        let ages = |count| of_all_ages(&generations, count).iter().map(|s| s.generation).collect::<Vec<_>>();
        assert_eq!(ages(1), [0]);
        assert_eq!(ages(2), [0, 3]);
        assert_eq!(ages(4), [0, 1, 2, 3]);
        assert_eq!(ages(7), [0, 0, 1, 1, 2, 2, 3]);
        none_twice(&of_all_ages(&generations, 12));
        assert!(of_all_ages(&generations, 1000).len() <= 20, "there are no more");
    }
}
