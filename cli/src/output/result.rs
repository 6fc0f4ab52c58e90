//! result.json: summary of the result of a job that evolved.

use crate::progress::Label;
use crate::values;
use proto::v1;
use serde::{Deserialize, Serialize};
use sim_core::base::digest::Digest;
use sim_core::base::score::{Direction, mean};
use sim_core::base::statistics::median;
use sim_core::engines::NUMERIC_CRATES;
use sim_core::genotype::Genotype;
use sim_core::problem::Checked;
use sim_core::procedure::evolve::report::{Archived, Audit, Report, Rescored};
use sim_core::search::Scored;
use std::collections::BTreeMap;
use study::setting::PhysicsSetting;

/// Version of the layout of the file.
const FORMAT: u32 = 3;

/// Result of a job that evolved. Numbers read back to the same bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResultFile {
    /// Version of the layout.
    pub format: u32,
    /// Name of the job.
    pub name: String,
    /// Seed of the job.
    pub seed: u64,
    /// Digest of the job.
    pub job_digest: Digest,
    /// Digest of the result, over the bits of all scores of search and finish, and the winner.
    pub result_digest: Digest,
    /// Digest of the engine, or of both engines, that computed the result.
    pub engine_digest: Digest,
    /// Engine settings that computed the result.
    pub engines: Engines,
    /// Name, unit and direction of the score.
    pub score: Score,
    /// Best score of the search; `null` if every evaluation failed.
    pub best_fitness: Option<f64>,
    /// Published winner; `null` if every evaluation failed.
    pub winner: Option<Candidate>,
    /// Best candidate of the first generation.
    pub first: Option<Candidate>,
    /// Winner's mean score on fresh seeds, divided by that of the first generation's best.
    pub fresh_ratio: Option<f64>,
    /// Same ratio on the reference setting; `null` if the job's finish has none.
    pub reference_ratio: Option<f64>,
    /// Archive, best on the reference setting first; empty if the job's finish has none.
    pub archive: Vec<ArchiveRow>,
    /// New bests of the search, scored again without reuse; `null` if the job's finish has no audits.
    pub audits: Option<Audits>,
    /// Sums of the counts over the search.
    pub counts: Counts,
    /// Sums of the counts over the finish.
    pub finish: FinishCounts,
    /// Time from the first lease of an evaluation to the end, s; pauses included.
    pub wall_seconds: f64,
    /// Versions of the program and crates that wrote the file.
    pub versions: Versions,
}

/// Names of engine settings, such as `200x2-lockstep`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Engines {
    /// Setting of the search, and of the finish's scores on fresh seeds and without reuse.
    pub search: String,
    /// Setting of the reference scores and of the scores with other friction; `null` if the job's finish has none.
    pub reference: Option<String>,
}

/// Name, unit and direction of a job's score.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Name, such as "coverage".
    pub name: String,
    /// Unit, such as "%".
    pub unit: String,
    /// Direction: more or less is better.
    pub direction: Direction,
}

/// Candidate with its scores.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Generation, from 0.
    pub generation: u32,
    /// Index in its generation, from 0.
    pub candidate: u32,
    /// Score in the search.
    pub fitness: f64,
    /// Scores on fresh seeds of the planner; `null` for a failed evaluation.
    pub fresh: Vec<Option<f64>>,
    /// Mean of the fresh scores that did not fail.
    pub fresh_mean: Option<f64>,
    /// Sample standard deviation of the fresh scores.
    pub fresh_deviation: Option<f64>,
    /// Mean score on fresh seeds on the reference setting; `null` if the job's finish has none.
    pub reference: Option<f64>,
    /// Sample standard deviation of the scores on the reference setting.
    pub reference_deviation: Option<f64>,
    /// Score of the same trees with every expansion simulated and none reused; `null` if it was not computed.
    pub without_reuse: Option<f64>,
    /// Mean score on the reference setting with friction × 0.9; of the winner only.
    pub less_friction: Option<f64>,
    /// Mean score on the reference setting with friction × 1.1; of the winner only.
    pub more_friction: Option<f64>,
    /// Parameters of the genotype.
    #[serde(rename = "genome")]
    pub genotype: Vec<Parameter>,
}

/// Genotype of the archive; `report.json` has its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ArchiveRow {
    /// Rank by `reference`, from 1.
    pub rank: usize,
    /// Generation, from 0.
    pub generation: u32,
    /// Index in its generation, from 0.
    pub candidate: u32,
    /// Score in the search.
    pub search: f64,
    /// Mean score on the reference setting.
    pub reference: Option<f64>,
}

/// Error of the search's scores by reuse of transitions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Audits {
    /// Gap that favours the score with reuse most: the greatest if more is better, the least if less is better.
    pub worst_gap: Option<f64>,
    /// Median of the gaps.
    pub median_gap: Option<f64>,
    /// Every new best of the search, in order.
    pub bests: Vec<AuditRow>,
}

/// New best of the search, scored with and without reuse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AuditRow {
    /// Generation, from 0.
    pub generation: u32,
    /// Index in its generation, from 0.
    pub candidate: u32,
    /// Score in the search, with reuse.
    pub with_reuse: f64,
    /// Mean score of the same trees without reuse.
    pub without_reuse: Option<f64>,
    /// Score with reuse minus score without.
    pub gap: Option<f64>,
}

/// Counts of the finish.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FinishCounts {
    /// Rollouts simulated.
    pub rollouts: u64,
    /// Simulated time, s.
    pub simulated_seconds: f64,
}

/// Parameter of a genotype.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Name, such as `gait1.hip-front.omega1`.
    pub name: String,
    /// Value of the parameter.
    pub value: f64,
}

/// Returns the parameters of a genotype with their names.
fn named(job: &Checked, genotype: &Genotype) -> Vec<Parameter> {
    let names = job.space().names_of(genotype.numbers().len());
    names.into_iter().zip(genotype.numbers()).map(|(name, &value)| Parameter { name, value }).collect()
}

/// Counts of a job's work.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Counts {
    /// Candidates scored.
    pub evaluations: u64,
    /// Evaluations that failed; they count as the worst score.
    pub failed_evaluations: u64,
    /// Rollouts simulated.
    pub rollouts: u64,
    /// Rollouts that ended unstable.
    pub unstable: u64,
    /// Simulated time, s.
    pub simulated_seconds: f64,
    /// Edges tried by the planner, simulated or reused.
    pub edges: u64,
    /// Edges rejected because of an obstacle, the border of the map or an unstable rollout.
    pub rejected: u64,
    /// Nodes of all trees.
    pub nodes: u64,
}

impl Counts {
    /// Reads the counts from the coordinator's values of a job.
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
    /// Returns the versions of this build.
    pub(super) fn here() -> Self {
        Self {
            evogait: env!("CARGO_PKG_VERSION").to_owned(),
            crates: NUMERIC_CRATES.iter().map(|(name, version)| (name.to_string(), version.to_string())).collect(),
        }
    }
}

/// Returns the time from the first lease of a task to the end, s; pauses included.
pub(super) fn wall_seconds(status: &v1::Job) -> f64 {
    (status.ended_at_ms - status.started_at_ms).max(0) as f64 / 1000.0
}

/// Versions that the result may depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Versions {
    /// Version of evogait.
    pub evogait: String,
    /// Versions of the crates that compute the numbers of results.
    pub crates: BTreeMap<String, String>,
}

/// Digests of a job and its result, from the coordinator's answer.
pub struct Digests {
    /// Digest of the job.
    pub job: Digest,
    /// Digest of the result.
    pub result: Digest,
    /// Digest of the engine that computed the result.
    pub engine: Digest,
}

impl ResultFile {
    /// Creates the content of result.json from a coordinator's answer and its report.
    pub fn new(
        job: &Checked,
        status: &v1::Job,
        Digests { job: job_digest, result: result_digest, engine: engine_digest }: Digests,
        report: Option<&Report>,
    ) -> Self {
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
            genotype: named(job, &scored.genotype),
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
                search: PhysicsSetting::of(job).to_string(),
                reference: job.on_reference().map(|reference| PhysicsSetting::of(reference).to_string()),
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
    /// Converts the candidate to the type of sim-core.
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

/// Returns the sample standard deviation of the scores that did not fail; `None` for fewer than two.
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
    fn mean_and_deviation_ignore_failed_evaluations() {
        let scores = [Some(1.0), None, Some(3.0)];
        assert_eq!(mean(&scores), Some(2.0));
        assert_eq!(deviation(&scores), Some(2.0f64.sqrt()));
        assert_eq!((mean(&[None]), deviation(&[None])), (None, None));
        assert_eq!((mean(&[Some(4.0)]), deviation(&[Some(4.0)])), (Some(4.0), None));
    }
}
