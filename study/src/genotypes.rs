//! Genotypes for measurements, taken from searches.

use crate::threads::in_order;
use serde::{Deserialize, Serialize};
use sim_core::base::error::Invalid;
use sim_core::evaluate::{Evaluation, evaluate};
use sim_core::genotype::Genotype;
use sim_core::job::JobSpec;
use sim_core::problem::Job;
use std::convert::Infallible;

/// Smallest population of a study's genetic algorithm.
pub const LEAST_POPULATION: u32 = 4;

/// Genotype with the generation that it comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Generation that it was a candidate of; 0 for random genotypes.
    pub generation: u32,
    /// Parameters of the gaits.
    pub genotype: Genotype,
}

/// Returns the job with a genetic algorithm of this population and number of generations, with which a study evolves
/// genotypes.
pub fn evolution(job: &Job, population: u32, generations: u32) -> Result<Job, Invalid> {
    let table = format!("kind = \"ga\"\npopulation = {population}\ngenerations = {generations}");
    Job::new(JobSpec { optimiser: toml::from_str(&table)?, ..job.spec().clone() })
}

/// Returns all candidates of a search, by generation. `score` returns a generation's scores, either computed by
/// [`sim_core::evaluate::evaluate`] or read from a store. An error of `score` stops the search.
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

/// Returns all candidates of a search, by generation, evaluated on `threads` threads (at least 1). `each` is called
/// after every generation that is evaluated: all but the last.
pub fn evolved(search: &Job, threads: usize, each: &dyn Fn()) -> Vec<Vec<Genotype>> {
    let generations = searched(search, |generation, candidates| {
        let evaluations = in_order(candidates.len(), threads, |i| {
            let one = evaluate(search, generation, &candidates[i..=i], &|| false);
            one.unwrap_or_else(|_| unreachable!("the stop callback always returns false"))
        });
        each();
        Ok::<_, Infallible>(scores(&evaluations.concat()))
    });
    generations.unwrap_or_else(|never| match never {})
}

/// Returns up to `count` different genotypes of a search. Half of them (rounded up) come from its first generation, the
/// others from its last generations, from the last backwards.
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

/// Returns up to `count` different genotypes of a search, spread evenly over its generations from the first to the
/// last. The position in the population advances from one genotype to the next.
pub fn of_all_ages(generations: &[Vec<Genotype>], count: usize) -> Vec<Sample> {
    let mut samples = Vec::new();
    let last = generations.len().saturating_sub(1);
    for i in 0..count {
        let generation = (i * last).checked_div(count - 1).unwrap_or(0);
        let candidates = &generations[generation];
        // If an elite was already taken from an earlier generation, the next candidate is taken.
        let mut turns = (0..candidates.len()).map(|turn| &candidates[(i + turn) % candidates.len()]);
        let _taken = turns.any(|genotype| add(&mut samples, generation, genotype));
    }
    samples
}

/// Adds the genotype unless it is already in the samples; returns true if it was added.
fn add(samples: &mut Vec<Sample>, generation: usize, genotype: &Genotype) -> bool {
    let new = !samples.iter().any(|s| s.genotype.same_bits(genotype));
    if new {
        samples.push(Sample { generation: generation as u32, genotype: genotype.clone() });
    }
    new
}

/// Returns the scores of evaluations, by candidate.
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
        assert_eq!(again.unwrap(), generations, "a search with stored scores must have the same candidates");
        (search, generations)
    }

    fn assert_unique(samples: &[Sample]) {
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
        assert!(
            samples[5..].iter().all(|s| s.generation >= 2),
            "evolved genotypes must come from the last two generations"
        );
        assert_unique(&samples);
    }

    #[test]
    fn genotypes_of_all_ages_span_all_generations() {
        let (_, generations) = search(5, 4);
        let ages = |count| of_all_ages(&generations, count).iter().map(|s| s.generation).collect::<Vec<_>>();
        assert_eq!(ages(1), [0]);
        assert_eq!(ages(2), [0, 3]);
        assert_eq!(ages(4), [0, 1, 2, 3]);
        assert_eq!(ages(7), [0, 0, 1, 1, 2, 2, 3]);
        assert_unique(&of_all_ages(&generations, 12));
        assert!(
            of_all_ages(&generations, 1000).len() <= 20,
            "a search of 4 generations of 5 candidates has at most 20 genotypes"
        );
    }
}
