//! Jobs and workers of a coordinator as JSON and as text. Scripts rely on the field names.

use crate::console;
use crate::failed_task::{Subject, question};
use crate::values::{self, count, number};
use crate::watch::{has_ended, word};
use proto::v1;
use serde::Serialize;
use sim_core::genotype::Genotype;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Job as JSON.
#[derive(Serialize)]
pub struct JobView {
    id: String,
    name: String,
    state: &'static str,
    /// Procedure, such as "evolve".
    procedure: String,
    /// Phase of the current round, such as "searching"; `null` after the job has ended.
    phase: Option<String>,
    job_digest: String,
    engine_digest: String,
    generations_done: u32,
    generations_total: u32,
    /// Tasks of the current round; `null` after the job has ended.
    round: Option<RoundView>,
    best: Option<BestView>,
    evaluations: u64,
    failed_evaluations: u64,
    rollouts: u64,
    simulated_seconds: f64,
    priority: u32,
    /// True while the coordinator leases no more tasks of the job.
    paused: bool,
    /// Job that this one repeats, if it is a restart.
    restarted_from: Option<OriginView>,
    /// Tasks with different results of workers.
    disputes: Vec<DisputeView>,
    /// Task that ended the job because it failed too often.
    poisoned: Option<PoisonedView>,
    /// Reason why the job failed or waits.
    #[serde(skip_serializing_if = "String::is_empty")]
    reason: String,
    submitted_at_ms: Option<i64>,
    started_at_ms: Option<i64>,
    ended_at_ms: Option<i64>,
}

#[derive(Serialize)]
struct RoundView {
    done: u32,
    total: u32,
}

#[derive(Serialize)]
struct BestView {
    generation: u32,
    candidate: u32,
    score: f64,
}

#[derive(Serialize)]
struct OriginView {
    job: String,
    /// Number of generations taken over from that job.
    generations: u32,
}

/// Task with different results of workers, as JSON.
#[derive(Serialize)]
pub struct DisputeView {
    /// Round of the task; `index` is its index in the round.
    round: u32,
    index: u32,
    what: String,
    /// Result of the arbitration: "open", "upheld", "corrected" or "tainted".
    verdict: &'static str,
    /// Claimed results; the committed one comes first.
    claims: Vec<ClaimView>,
}

#[derive(Serialize)]
struct ClaimView {
    worker_id: String,
    worker: String,
    /// Result as text; empty if only its digest is known.
    what: String,
    digest: String,
}

impl DisputeView {
    /// Converts the coordinator's message.
    pub fn new(dispute: &v1::Dispute) -> Self {
        Self {
            round: dispute.round,
            index: dispute.index,
            what: dispute.what.clone(),
            verdict: ruling(dispute),
            claims: dispute.claims.iter().map(ClaimView::new).collect(),
        }
    }
}

impl ClaimView {
    fn new(claim: &v1::Claim) -> Self {
        Self {
            worker_id: claim.worker_id.clone(),
            worker: claim.worker_name.clone(),
            what: claim.what.clone(),
            digest: hex(&claim.digest),
        }
    }
}

/// Returns the verdict of a dispute as a word; "open" before the arbitration has ended.
pub fn ruling(dispute: &v1::Dispute) -> &'static str {
    match dispute.verdict() {
        v1::dispute::Verdict::Unspecified => "open",
        v1::dispute::Verdict::Upheld => "upheld",
        v1::dispute::Verdict::Corrected => "corrected",
        v1::dispute::Verdict::Tainted => "tainted",
    }
}

/// Formats a score's bits as hexadecimal digits; "failed" for none.
pub fn bits(score: Option<f64>) -> String {
    score.map_or_else(|| "failed".to_owned(), |score| format!("{:016x}", score.to_bits()))
}

#[derive(Serialize)]
struct PoisonedView {
    round: u32,
    index: u32,
    what: String,
    attempts: u32,
    /// Generation of the candidate. This and the next three fields are `null` for the preparation.
    generation: Option<u32>,
    candidate: Option<u32>,
    /// Question of the finish; `null` for an evaluation of the search.
    question: Option<&'static str>,
    #[serde(rename = "genome")]
    genotype: Option<Genotype>,
}

impl PoisonedView {
    fn new(poisoned: &v1::Poisoned) -> Self {
        let subject = Subject::of(poisoned);
        let candidate = subject.as_ref().map(|subject| &subject.candidate);
        Self {
            round: poisoned.round,
            index: poisoned.index,
            what: poisoned.what.clone(),
            attempts: poisoned.attempts,
            generation: candidate.map(|c| c.generation),
            candidate: candidate.map(|c| c.candidate),
            question: subject.as_ref().and_then(|subject| subject.question.map(question)),
            genotype: candidate.map(|c| c.genotype.clone()),
        }
    }
}

impl JobView {
    /// Converts the coordinator's message.
    pub fn new(job: &v1::Job) -> Self {
        let v1::Progress { phase, done, total, values, .. } = values::progress(job);
        let counts = values::counts(&values);
        let moment = |ms: i64| (ms > 0).then_some(ms);
        Self {
            id: job.id.clone(),
            name: job.name.clone(),
            state: word(job.state()),
            procedure: job.procedure.clone(),
            phase: (!has_ended(job.state())).then_some(phase),
            job_digest: hex(&job.job_digest),
            engine_digest: hex(&job.engine_digest),
            generations_done: done,
            generations_total: total,
            round: (job.tasks_total > 0).then_some(RoundView { done: job.tasks_done, total: job.tasks_total }),
            best: number(&values, "best").map(|score| BestView {
                generation: count(&values, "best_generation") as u32,
                candidate: count(&values, "best_candidate") as u32,
                score,
            }),
            evaluations: count(&values, "evaluations"),
            failed_evaluations: count(&values, "failed"),
            rollouts: counts.rollouts,
            simulated_seconds: counts.simulated_ms as f64 / 1000.0,
            priority: job.priority,
            paused: job.paused,
            restarted_from: job
                .restarted_from
                .as_ref()
                .map(|origin| OriginView { job: origin.job_id.clone(), generations: generations(origin) }),
            disputes: job.disputes.iter().map(DisputeView::new).collect(),
            poisoned: job.poisoned.as_ref().map(PoisonedView::new),
            reason: job.reason.clone(),
            submitted_at_ms: moment(job.submitted_at_ms),
            started_at_ms: moment(job.started_at_ms),
            ended_at_ms: moment(job.ended_at_ms),
        }
    }
}

/// Returns the number of generations that a restart takes over: all its rounds but the first, which is the preparation.
pub fn generations(origin: &v1::Origin) -> u32 {
    origin.rounds.saturating_sub(1)
}

/// Worker as JSON.
#[derive(Serialize)]
pub struct WorkerView {
    id: String,
    name: String,
    address: String,
    slots: u32,
    busy: u32,
    tasks: u64,
    engine_digests: Vec<String>,
    connected_at_ms: i64,
    /// Reason why the worker gets no leases.
    #[serde(skip_serializing_if = "String::is_empty")]
    reason: String,
    quarantined: bool,
}

impl WorkerView {
    /// Converts the coordinator's message.
    pub fn new(worker: &v1::WorkerInfo) -> Self {
        Self {
            id: worker.id.clone(),
            name: worker.name.clone(),
            address: worker.address.clone(),
            slots: worker.slots,
            busy: worker.busy,
            tasks: worker.tasks,
            engine_digests: worker.engine_digests.iter().map(|digest| hex(digest)).collect(),
            connected_at_ms: worker.connected_at_ms,
            reason: worker.reason.clone(),
            quarantined: worker.quarantined,
        }
    }
}

/// Slots that the jobs of a coordinator could use, slots present and slots busy.
#[derive(Serialize)]
pub struct DemandView {
    pub wanted: u32,
    pub slots: u32,
    pub busy: u32,
}

impl DemandView {
    /// Converts the coordinator's message.
    pub fn new(demand: &v1::GetDemandResponse) -> Self {
        Self { wanted: demand.wanted, slots: demand.slots, busy: demand.busy }
    }
}

/// Formats a digest's bytes as hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// Formats the time from a job's start until its end or until now; "–" if it has not started.
pub fn running_time(job: &v1::Job) -> String {
    if job.started_at_ms <= 0 {
        return "–".to_owned();
    }
    let end = if job.ended_at_ms > 0 {
        job.ended_at_ms
    } else {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        now.as_millis() as i64
    };
    console::duration(Duration::from_millis((end - job.started_at_ms).max(0) as u64))
}
