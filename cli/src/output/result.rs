//! result.json: the summary of a job's result.

use crate::progress::Label;
use proto::v1;
use serde::{Deserialize, Serialize};
use sim_core::identity::Digest;
use sim_core::job::Job;
use sim_core::report::Report;
use sim_core::rollout::NUMERIC_CRATES;
use sim_core::score::{Direction, Scored};
use std::collections::BTreeMap;

/// Version of the file's layout.
const FORMAT: u32 = 1;

/// What a job found, in a file. Numbers are written so that they read back to the same bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResultFile {
    /// Version of this layout.
    pub format: u32,
    /// The job's name.
    pub name: String,
    /// The job's seed.
    pub seed: u64,
    /// The job digest.
    pub job_digest: Digest,
    /// The result digest: bits of all scores and of the winner.
    pub result_digest: Digest,
    /// Digest of the engine that made it.
    pub engine_digest: Digest,
    /// What the score is.
    pub score: Score,
    /// Best score of the search; `null` if every evaluation failed.
    pub best_fitness: Option<f64>,
    /// The winner; `null` if every evaluation failed.
    pub winner: Option<Candidate>,
    /// The best of the first generation.
    pub first: Option<Candidate>,
    /// The winner's mean on fresh seeds, divided by that of the first generation's best.
    pub fresh_ratio: Option<f64>,
    /// Sums over the whole job.
    pub counts: Counts,
    /// s from the first evaluation handed out to the end, pauses included.
    pub wall_seconds: f64,
    /// What wrote this.
    pub versions: Versions,
}

/// What a job's score is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Such as "coverage".
    pub name: String,
    /// Such as "%".
    pub unit: String,
    /// Whether more or less is better.
    pub direction: Direction,
}

/// A candidate with its scores.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Generation, from 0.
    pub generation: u32,
    /// Index in its generation, from 0.
    pub candidate: u32,
    /// Its score in the search.
    pub fitness: f64,
    /// Its scores on fresh seeds of the planner; `null` where an evaluation failed.
    pub fresh: Vec<Option<f64>>,
    /// Mean of those that did not fail.
    pub fresh_mean: Option<f64>,
    /// Their standard deviation.
    pub fresh_deviation: Option<f64>,
    /// The score of the same tree with every expansion simulated, none reused; of the winner only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub without_reuse: Option<f64>,
    /// Its parameters.
    pub genome: Vec<Parameter>,
}

/// A number of a genome.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Such as `gait1.hip-front.omega1`.
    pub name: String,
    /// Its value.
    pub value: f64,
}

/// What the job took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Counts {
    /// Candidates scored.
    pub evaluations: u64,
    /// Of these, those that failed and count as worst.
    pub failed_evaluations: u64,
    /// Rollouts simulated.
    pub rollouts: u64,
    /// Rollouts that ended unstable.
    pub unstable: u64,
    /// Simulated time, s.
    pub simulated_seconds: f64,
    /// Edges tried by the planner, simulated or reused.
    pub edges: u64,
    /// Edges rejected: obstacle, border of the map, unstable.
    pub rejected: u64,
    /// Nodes of all trees.
    pub nodes: u64,
}

/// Versions that the result may depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Versions {
    /// evogait's.
    pub evogait: String,
    /// Of the crates whose arithmetic enters results.
    pub crates: BTreeMap<String, String>,
}

impl ResultFile {
    /// Puts a coordinator's answer into words; the report has the scores on fresh seeds.
    pub fn new(
        job: &Job,
        status: &v1::Job,
        (job_digest, result_digest): (Digest, Digest),
        (winner, first): (Option<Scored>, Option<Scored>),
        report: Option<&Report>,
    ) -> Self {
        let names = job.parameter_names();
        let candidate = |scored: &Scored, fresh: Option<&[Option<f64>]>, without_reuse| Candidate {
            generation: scored.generation,
            candidate: scored.candidate,
            fitness: scored.score,
            fresh: fresh.unwrap_or_default().to_vec(),
            fresh_mean: mean(fresh.unwrap_or_default()),
            fresh_deviation: deviation(fresh.unwrap_or_default()),
            without_reuse,
            genome: names.iter().zip(&scored.genome).map(|(n, &value)| Parameter { name: n.clone(), value }).collect(),
        };
        let without_reuse = report.and_then(|r| r.winner_without_reuse);
        let winner = winner.as_ref().map(|w| candidate(w, report.map(|r| &r.winner_fresh[..]), without_reuse));
        let first = first.as_ref().map(|f| candidate(f, report.map(|r| &r.first_fresh[..]), None));
        let means = (winner.as_ref().and_then(|w| w.fresh_mean), first.as_ref().and_then(|f| f.fresh_mean));
        let counts = status.counts.unwrap_or_default();
        let Label { name, unit } = Label::of_job(job);
        Self {
            format: FORMAT,
            name: job.spec().name.clone(),
            seed: job.spec().seed,
            job_digest,
            result_digest,
            engine_digest: job.engine_digest(),
            score: Score { name, unit, direction: job.direction() },
            best_fitness: winner.as_ref().map(|w| w.fitness),
            fresh_ratio: match means {
                (Some(winner), Some(first)) if first != 0.0 => Some(winner / first),
                _ => None,
            },
            winner,
            first,
            counts: Counts {
                evaluations: status.evaluations,
                failed_evaluations: status.failed_evaluations,
                rollouts: counts.rollouts,
                unstable: counts.unstable,
                simulated_seconds: counts.simulated_ms as f64 / 1000.0,
                edges: counts.edges,
                rejected: counts.rejected,
                nodes: counts.nodes,
            },
            wall_seconds: (status.ended_at_ms - status.started_at_ms).max(0) as f64 / 1000.0,
            versions: Versions {
                evogait: env!("CARGO_PKG_VERSION").to_owned(),
                crates: NUMERIC_CRATES.iter().map(|(name, version)| (name.to_string(), version.to_string())).collect(),
            },
        }
    }
}

impl Candidate {
    /// The candidate as sim-core knows it.
    pub fn scored(&self) -> Scored {
        Scored {
            generation: self.generation,
            candidate: self.candidate,
            score: self.fitness,
            genome: self.genome.iter().map(|p| p.value).collect(),
        }
    }
}

fn mean(scores: &[Option<f64>]) -> Option<f64> {
    let present: Vec<f64> = scores.iter().flatten().copied().collect();
    (!present.is_empty()).then(|| present.iter().sum::<f64>() / present.len() as f64)
}

/// Sample standard deviation.
fn deviation(scores: &[Option<f64>]) -> Option<f64> {
    let mean = mean(scores)?;
    let present: Vec<f64> = scores.iter().flatten().copied().collect();
    let squares: f64 = present.iter().map(|s| (s - mean) * (s - mean)).sum();
    (present.len() > 1).then(|| (squares / (present.len() - 1) as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failed_evaluations_take_no_part_in_mean_and_deviation() {
        let scores = [Some(1.0), None, Some(3.0)];
        assert_eq!(mean(&scores), Some(2.0));
        assert_eq!(deviation(&scores), Some(2.0f64.sqrt()));
        assert_eq!((mean(&[None]), deviation(&[None])), (None, None));
        assert_eq!((mean(&[Some(4.0)]), deviation(&[Some(4.0)])), (Some(4.0), None));
    }
}
