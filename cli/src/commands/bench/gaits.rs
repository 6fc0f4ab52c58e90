//! Gaits to measure with.

use crate::progress::Pieces;
use sim_core::control::Targets;
use sim_core::evaluate::evaluate;
use sim_core::job::Job;
use sim_core::random::{Purpose, Stream};
use sim_core::score::Genome;

/// `n` gaits, uniform in the controller's bounds.
pub fn random(job: &Job, n: u32, seed: u64) -> Vec<Genome> {
    let bounds = &job.bounds().0[..length(job)];
    let draw = |i| {
        let mut stream = Stream::new(seed, Purpose::Sample, 0, i, 0);
        bounds.iter().map(|&(low, high)| stream.uniform(low, high)).collect()
    };
    (0..n).map(draw).collect()
}

/// `n` gaits of the last generations of short evolutions: of as many as it takes.
pub fn evolved(jobs: impl Iterator<Item = Job>, n: u32, quiet: bool) -> Vec<Genome> {
    let n = n as usize;
    let mut gaits: Vec<Genome> = Vec::new();
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
        for genome in last_generation(&job, progress) {
            // Elites and copies are the same gait again.
            let new = genome.chunks(length(&job)).filter(|gait| !gaits.iter().any(|g| g == gait));
            let new: Vec<Genome> = new.map(<[f64]>::to_vec).collect();
            gaits.extend(new);
        }
    }
    gaits.truncate(n);
    gaits
}

/// The candidates of a search's last generation.
fn last_generation(job: &Job, progress: &Pieces) -> Vec<Genome> {
    let mut optimiser = job.optimiser();
    for generation in 0.. {
        let candidates: Vec<(u32, Genome)> = (0..).zip(optimiser.ask()).collect();
        if generation + 1 == job.spec().optimiser.generations() {
            progress.one_done();
            break;
        }
        let Ok(scored) = evaluate(job, generation, &candidates, &|| false) else { break };
        optimiser.tell(&scored.iter().map(|e| e.score).collect::<Vec<_>>());
        progress.one_done();
    }
    optimiser.ask()
}

/// Parameters of one gait.
pub fn length(job: &Job) -> usize {
    job.bounds().0.len() / job.spec().gaits.count as usize
}

/// The joint targets of gaits over the job's duration.
pub fn compiled(job: &Job, gaits: &[Genome]) -> Vec<Targets> {
    let (joints, duration) = (job.robot().hinges.len(), job.spec().gaits.duration);
    gaits.iter().map(|gait| job.controller().compile(gait, joints, duration)).collect()
}
