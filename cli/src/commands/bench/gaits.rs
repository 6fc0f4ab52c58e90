//! Gaits to measure with.

use crate::error::Error;
use crate::progress::Pieces;
use sim_core::base::random::{Purpose, Stream};
use sim_core::control::{Infeasible, Run};
use sim_core::evaluate::evaluate;
use sim_core::genotype::{Genotype, Space};
use sim_core::physics::Motion;
use sim_core::problem::Job;

/// `n` gaits, uniform in the controller's bounds.
pub fn random(job: &Job, n: u32, seed: u64) -> Vec<Genotype> {
    let space = space(job);
    (0..n).map(|i| space.draw(&mut Stream::new(seed, Purpose::Sample, 0, i, 0))).collect()
}

/// `n` gaits of the last generations of short evolutions: of as many as it takes.
pub fn evolved(jobs: impl Iterator<Item = Job>, n: u32, quiet: bool) -> Vec<Genotype> {
    let n = n as usize;
    let mut gaits: Vec<Genotype> = Vec::new();
    let mut progress: Option<Pieces> = None;
    for job in jobs {
        if gaits.len() >= n {
            break;
        }
        let optimiser = &job.spec().optimiser;
        let a_run = optimiser.population() as usize * job.spec().gaits.count as usize;
        let progress = progress.get_or_insert_with(|| {
            let evaluations = n.div_ceil(a_run) as u64 * u64::from(optimiser.generations());
            Pieces::new("generations of evolving gaits", evaluations, quiet)
        });
        for genotype in last_generation(&job, progress) {
            // Elites and copies are the same gait again.
            let new = of_set(&job, &genotype).filter(|gait| !gaits.contains(gait)).collect::<Vec<_>>();
            gaits.extend(new);
        }
    }
    gaits.truncate(n);
    gaits
}

/// The candidates of a search's last generation.
fn last_generation(job: &Job, progress: &Pieces) -> Vec<Genotype> {
    let mut optimiser = job.optimiser();
    for generation in 0.. {
        let candidates: Vec<(u32, Genotype)> = (0..).zip(optimiser.ask().genotypes).collect();
        if generation + 1 == job.spec().optimiser.generations() {
            progress.one_done();
            break;
        }
        let Ok(scored) = evaluate(job, generation, &candidates, &|| false) else { break };
        let scores: Vec<Option<f64>> = scored.iter().map(|e| e.score).collect();
        optimiser.tell(&optimiser.ask().scored(&scores));
        progress.one_done();
    }
    optimiser.ask().genotypes
}

/// Space of one gait, with the job's bounds.
fn space(job: &Job) -> Space {
    let Space { mut genes, length } = job.space().clone();
    genes.truncate(genes.len() / job.spec().gaits.count as usize);
    Space { genes, length }
}

/// The gaits of a candidate.
pub fn of_set(job: &Job, candidate: &Genotype) -> impl Iterator<Item = Genotype> {
    candidate.gaits(job.spec().gaits.count as usize).map(|gait| gait.to_vec().into())
}

/// The motions of gaits over the job's duration.
pub fn compiled(job: &Job, gaits: &[Genotype]) -> Result<Vec<Motion>, Error> {
    let run = Run::new(job.robot(), job.spec().gaits.duration);
    let compile = |gait: &Genotype| job.controller().compile(&run, gait.numbers());
    let refused =
        |e: Infeasible| Error::Usage { message: format!("not every gait of this controller can be measured: {e}") };
    gaits.iter().map(compile).collect::<Result<_, _>>().map_err(refused)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn job(seed: u64) -> Job {
        let text = "name = \"a\"\nrobot = \"l-shape\"\nenvironment = \"empty\"\n[gaits]\ncount = 2\nduration = 0.5\n\
                    [planner]\niterations = 4\n[fitness]\nkind = \"coverage\"\ncell = 0.5\n\
                    [optimiser]\nkind = \"ga\"\npopulation = 4\ngenerations = 3";
        Job::from_toml(&format!("seed = {seed}\n{text}")).unwrap()
    }

    #[test]
    fn evolved_gaits_are_of_the_last_generation_each_once_the_same_every_time() {
        let found = evolved((1..).map(job), 11, true);
        assert_eq!(found.len(), 11, "more than one evolution has");
        assert_eq!(found, evolved((1..).map(job), 11, true));
        let first: Vec<Genotype> = job(1).optimiser().ask().genotypes;
        for (i, gait) in found.iter().enumerate() {
            assert_eq!(space(&job(1)).check(gait), Ok(()));
            assert!(!found[..i].contains(gait), "gait {i} is there twice");
        }
        let old = |gait: &Genotype| first.iter().any(|set| of_set(&job(1), set).any(|g| g == *gait));
        assert!(found.iter().filter(|gait| old(gait)).count() < found.len() / 2, "most are not those of the beginning");
    }

    #[test]
    fn random_gaits_lie_in_the_controller_s_bounds_and_more_of_them_begin_alike() {
        let job = job(1);
        let (few, many) = (random(&job, 3, 7), random(&job, 5, 7));
        assert_eq!(few, many[..3]);
        assert_ne!(few, random(&job, 3, 8));
        for gait in &many {
            assert_eq!(space(&job).check(gait), Ok(()));
        }
    }
}
