//! Gaits for measurements: random gaits, and gaits of short evolutions.

use sim_core::base::random::{Purpose, Stream};
use sim_core::control::{Infeasible, Run};
use sim_core::evaluate::evaluate;
use sim_core::genotype::{Genotype, Space};
use sim_core::physics::Motion;
use sim_core::problem::Job;

/// Draws `n` gaits, uniformly within the job's bounds.
pub fn random(job: &Job, n: u32, seed: u64) -> Vec<Genotype> {
    let space = space(job);
    (0..n).map(|i| space.draw(&mut Stream::new(seed, Purpose::Sample, 0, i, 0))).collect()
}

/// Returns `n` different gaits from the last generations of short evolutions. It runs as many of the jobs as needed,
/// and returns fewer gaits if the jobs run out. `each` is called after every generation.
pub fn evolved(jobs: impl Iterator<Item = Job>, n: u32, each: &dyn Fn()) -> Vec<Genotype> {
    let n = n as usize;
    let mut gaits: Vec<Genotype> = Vec::new();
    for job in jobs {
        if gaits.len() >= n {
            break;
        }
        for genotype in last_generation(&job, each) {
            // Elites and copies repeat a gait.
            let new = of_set(&job, &genotype).filter(|gait| !gaits.contains(gait)).collect::<Vec<_>>();
            gaits.extend(new);
        }
    }
    gaits.truncate(n);
    gaits
}

/// Returns the number of generations that [`evolved`] runs for `n` gaits if no gait occurs twice.
pub fn generations(job: &Job, n: u32) -> u64 {
    let optimiser = job.optimiser_spec();
    let gaits_of_a_run = optimiser.candidates(optimiser.generations() - 1) * job.gaits().count;
    u64::from(n.div_ceil(gaits_of_a_run)) * u64::from(optimiser.generations())
}

/// Runs a search and returns the candidates of its last generation.
fn last_generation(job: &Job, each: &dyn Fn()) -> Vec<Genotype> {
    let mut optimiser = job.optimiser();
    for generation in 0.. {
        let candidates: Vec<(u32, Genotype)> = (0..).zip(optimiser.ask().genotypes).collect();
        if generation + 1 == job.optimiser_spec().generations() {
            each();
            break;
        }
        let Ok(scored) = evaluate(job, generation, &candidates, &|| false) else { break };
        let scores: Vec<Option<f64>> = scored.iter().map(|e| e.score).collect();
        optimiser.tell(&optimiser.ask().scored(&scores));
        each();
    }
    optimiser.ask().genotypes
}

/// Returns the space of one gait, with the job's bounds.
fn space(job: &Job) -> Space {
    let Space { mut genes, length } = job.space().clone();
    genes.truncate(genes.len() / job.gaits().count as usize);
    Space { genes, length }
}

/// Returns the gaits of a candidate.
pub fn of_set(job: &Job, candidate: &Genotype) -> impl Iterator<Item = Genotype> {
    candidate.gaits(job.gaits().count as usize).map(|gait| gait.to_vec().into())
}

/// Compiles gaits to motions of the job's duration.
///
/// # Errors
/// If the controller can't execute one of them.
pub fn compiled(job: &Job, gaits: &[Genotype]) -> Result<Vec<Motion>, Infeasible> {
    let run = Run::new(job.robot(), job.gaits().duration);
    gaits.iter().map(|gait| job.controller().compile(&run, gait.numbers())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    fn job(seed: u64) -> Job {
        let text = "name = \"a\"\nrobot = \"l-shape\"\nenvironment = \"empty\"\n[gaits]\ncount = 2\nduration = 0.5\n\
                    [planner]\niterations = 4\n[fitness]\nkind = \"coverage\"\ncell = 0.5\n\
                    [optimiser]\nkind = \"ga\"\npopulation = 4\ngenerations = 3";
        Job::from_toml(&format!("seed = {seed}\n{text}")).unwrap()
    }

    #[test]
    fn evolved_gaits_are_unique_and_reproducible() {
        let generations_done = Cell::new(0);
        let found = evolved((1..).map(job), 11, &|| generations_done.set(generations_done.get() + 1));
        assert!(generations_done.get() >= generations(&job(1), 11));
        assert_eq!(generations(&job(1), 11), 6, "two evolutions of eight gaits, three generations each");
        assert_eq!(found.len(), 11, "11 gaits need more than one evolution");
        assert_eq!(found, evolved((1..).map(job), 11, &|| ()));
        let first: Vec<Genotype> = job(1).optimiser().ask().genotypes;
        for (i, gait) in found.iter().enumerate() {
            assert_eq!(space(&job(1)).check(gait), Ok(()));
            assert!(!found[..i].contains(gait), "gait {i} occurs twice");
        }
        let old = |gait: &Genotype| first.iter().any(|set| of_set(&job(1), set).any(|g| g == *gait));
        assert!(
            found.iter().filter(|gait| old(gait)).count() < found.len() / 2,
            "most gaits must not be those of generation 0"
        );
    }

    #[test]
    fn random_gaits_lie_within_the_controllers_bounds() {
        let job = job(1);
        let (few, many) = (random(&job, 3, 7), random(&job, 5, 7));
        assert_eq!(few, many[..3]);
        assert_ne!(few, random(&job, 3, 8));
        for gait in &many {
            assert_eq!(space(&job).check(gait), Ok(()));
        }
    }
}
