//! result.json: the summary of a job's result.

use crate::progress::Label;
use crate::values;
use proto::v1;
use serde::{Deserialize, Serialize};
use sim_core::base::digest::Digest;
use sim_core::base::score::{Direction, mean};
use sim_core::base::statistics::median;
use sim_core::engines::NUMERIC_CRATES;
use sim_core::problem::Checked;
use sim_core::procedure::evolve::report::{Archived, Audit, Report, Rescored};
use sim_core::search::Scored;
use std::collections::BTreeMap;
use study::setting::Setting;

/// Version of the file's layout.
const FORMAT: u32 = 3;

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
    /// The result digest: bits of all scores, of search and finish, and the winner.
    pub result_digest: Digest,
    /// Digest of the engine that made it, or of both.
    pub engine_digest: Digest,
    /// What it was made on.
    pub engines: Engines,
    /// What the score is.
    pub score: Score,
    /// Best score of the search; `null` if every evaluation failed.
    pub best_fitness: Option<f64>,
    /// The published winner; `null` if every evaluation failed.
    pub winner: Option<Candidate>,
    /// The best of the first generation.
    pub first: Option<Candidate>,
    /// The winner's mean on fresh seeds, divided by that of the first generation's best.
    pub fresh_ratio: Option<f64>,
    /// The same on the reference setting; `null` if the job's finish has none.
    pub reference_ratio: Option<f64>,
    /// The archive, best on the reference setting first; empty if the job's finish has none.
    pub archive: Vec<ArchiveRow>,
    /// The global bests of the search, scored again without reuse; `null` if the job's finish has no audits.
    pub audits: Option<Audits>,
    /// Sums over the search.
    pub counts: Counts,
    /// Examinations of the finish, and sums over them.
    pub finish: FinishCounts,
    /// s from the first evaluation handed out to the end, pauses included.
    pub wall_seconds: f64,
    /// What wrote this.
    pub versions: Versions,
}

/// Engine settings as words, such as `200x2-lockstep`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Engines {
    /// Of the search, and of the finish's scores on fresh seeds and without reuse.
    pub search: String,
    /// Of the reference setting, and of the scores with other friction; `null` if the job's finish has none.
    pub reference: Option<String>,
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
    /// Mean score on fresh seeds on the reference setting; `null` if the job's finish has none.
    pub reference: Option<f64>,
    /// Their standard deviation.
    pub reference_deviation: Option<f64>,
    /// The score of the same trees with every expansion simulated, none reused; `null` where it was not asked for.
    pub without_reuse: Option<f64>,
    /// As on the reference setting, with friction × 0.9; of the winner only.
    pub less_friction: Option<f64>,
    /// As on the reference setting, with friction × 1.1; of the winner only.
    pub more_friction: Option<f64>,
    /// Its parameters.
    #[serde(rename = "genome")]
    pub genotype: Vec<Parameter>,
}

/// A genotype of the archive; `report.json` has its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ArchiveRow {
    /// From 1, by `reference`.
    pub rank: usize,
    /// Generation, from 0.
    pub generation: u32,
    /// Index in its generation, from 0.
    pub candidate: u32,
    /// Its score in the search.
    pub search: f64,
    /// Its mean score on the reference setting.
    pub reference: Option<f64>,
}

/// How far reuse of transitions flattered the search.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Audits {
    /// The gap that flatters most: the greatest where more is better, the least where less is better.
    pub worst_gap: Option<f64>,
    /// The middle gap.
    pub median_gap: Option<f64>,
    /// Every global best, as they came.
    pub bests: Vec<AuditRow>,
}

/// A global best of the search.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AuditRow {
    /// Generation, from 0.
    pub generation: u32,
    /// Index in its generation, from 0.
    pub candidate: u32,
    /// Its score in the search, with reuse.
    pub with_reuse: f64,
    /// The mean of the same trees without.
    pub without_reuse: Option<f64>,
    /// With minus without.
    pub gap: Option<f64>,
}

/// What the finish took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FinishCounts {
    /// Rollouts simulated.
    pub rollouts: u64,
    /// Simulated time, s.
    pub simulated_seconds: f64,
}

/// A number of a genotype.
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

impl Counts {
    /// As the coordinator tells them with the job.
    pub(super) fn told(told: &[v1::Value]) -> Self {
        let counts = values::counts(told);
        Self {
            evaluations: values::count(told, "evaluations"),
            failed_evaluations: values::count(told, "failed"),
            rollouts: counts.rollouts,
            unstable: counts.unstable,
            simulated_seconds: counts.simulated_ms as f64 / 1000.0,
            edges: counts.edges,
            rejected: counts.rejected,
            nodes: counts.nodes,
        }
    }
}

impl Versions {
    /// Those of this build.
    pub(super) fn here() -> Self {
        Self {
            evogait: env!("CARGO_PKG_VERSION").to_owned(),
            crates: NUMERIC_CRATES.iter().map(|(name, version)| (name.to_string(), version.to_string())).collect(),
        }
    }
}

/// s from the first task handed out to the end, pauses included.
pub(super) fn wall_seconds(status: &v1::Job) -> f64 {
    (status.ended_at_ms - status.started_at_ms).max(0) as f64 / 1000.0
}

/// Versions that the result may depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Versions {
    /// evogait's.
    pub evogait: String,
    /// Of the crates whose arithmetic enters results.
    pub crates: BTreeMap<String, String>,
}

/// What identifies a job and its result, as the coordinator tells it.
pub struct Digests {
    /// Of the job.
    pub job: Digest,
    /// Of its result.
    pub result: Digest,
    /// Of the engine that computed it.
    pub engine: Digest,
}

impl ResultFile {
    /// Puts a coordinator's answer into words; the report has the scores on fresh seeds.
    pub fn new(
        job: &Checked,
        status: &v1::Job,
        Digests { job: job_digest, result: result_digest, engine: engine_digest }: Digests,
        report: Option<&Report>,
    ) -> Self {
        let names = job.space().names();
        let candidate = |scored: &Scored, scores: &Rescored| Candidate {
            generation: scored.generation,
            candidate: scored.candidate,
            fitness: scored.score,
            fresh: scores.fresh.clone(),
            fresh_mean: mean(&scores.fresh),
            fresh_deviation: deviation(&scores.fresh),
            reference: mean(&scores.reference),
            reference_deviation: deviation(&scores.reference),
            without_reuse: mean(&scores.without_reuse),
            less_friction: mean(&scores.less_friction),
            more_friction: mean(&scores.more_friction),
            genotype: names
                .iter()
                .zip(scored.genotype.numbers())
                .map(|(n, &value)| Parameter { name: n.clone(), value })
                .collect(),
        };
        let winner = report.map(|r| candidate(&r.winner, &r.winner_scores));
        let first = report.map(|r| candidate(&r.first, &r.first_scores));
        let ratio =
            |of: fn(&Candidate) -> Option<f64>| match (winner.as_ref().and_then(of), first.as_ref().and_then(of)) {
                (Some(winner), Some(first)) if first != 0.0 => Some(winner / first),
                _ => None,
            };
        let told = values::progress(status).values;
        let Label { name, unit } = Label::of_job(job);
        Self {
            format: FORMAT,
            name: job.spec().name.clone(),
            seed: job.spec().seed,
            job_digest,
            result_digest,
            engine_digest,
            engines: Engines {
                search: Setting::of(job).to_string(),
                reference: job.on_reference().map(|reference| Setting::of(reference).to_string()),
            },
            score: Score { name, unit, direction: job.direction() },
            best_fitness: values::number(&told, "best"),
            fresh_ratio: ratio(|c| c.fresh_mean),
            reference_ratio: ratio(|c| c.reference),
            winner,
            first,
            archive: report.map(archive).unwrap_or_default(),
            audits: report.and_then(|r| audits(r, job.direction())),
            finish: finish(report.map(|r| r.counts).unwrap_or_default()),
            counts: Counts::told(&told),
            wall_seconds: wall_seconds(status),
            versions: Versions::here(),
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
            genotype: self.genotype.iter().map(|p| p.value).collect(),
        }
    }
}

fn archive(report: &Report) -> Vec<ArchiveRow> {
    let row = |(i, archived): (usize, &Archived)| ArchiveRow {
        rank: i + 1,
        generation: archived.candidate.generation,
        candidate: archived.candidate.candidate,
        search: archived.candidate.score,
        reference: mean(&archived.reference),
    };
    report.archive.iter().enumerate().map(row).collect()
}

fn audits(report: &Report, direction: Direction) -> Option<Audits> {
    let row = |audit: &Audit| AuditRow {
        generation: audit.candidate.generation,
        candidate: audit.candidate.candidate,
        with_reuse: audit.candidate.score,
        without_reuse: mean(&audit.without_reuse),
        gap: audit.gap(),
    };
    let bests: Vec<AuditRow> = report.audits.iter().map(row).collect();
    let mut gaps: Vec<f64> = bests.iter().filter_map(|b| b.gap).collect();
    gaps.sort_by(f64::total_cmp);
    let worst_gap = match direction {
        Direction::Maximise => gaps.last(),
        Direction::Minimise => gaps.first(),
    };
    (!bests.is_empty()).then(|| Audits { worst_gap: worst_gap.copied(), median_gap: median(&gaps), bests })
}

fn finish(counts: sim_core::base::score::Counts) -> FinishCounts {
    FinishCounts { rollouts: counts.rollouts, simulated_seconds: counts.simulated_ms as f64 / 1000.0 }
}

/// Sample standard deviation.
pub(super) fn deviation(scores: &[Option<f64>]) -> Option<f64> {
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
