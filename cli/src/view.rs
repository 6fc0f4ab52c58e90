//! A job and a worker of a coordinator as JSON and as words: the names that scripts rely on.

use crate::console;
use crate::watch::word;
use proto::v1;
use serde::Serialize;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// A job.
#[derive(Serialize)]
pub struct JobView {
    id: String,
    name: String,
    state: &'static str,
    job_digest: String,
    engine_digest: String,
    generations_done: u32,
    generations_total: u32,
    /// Tasks of the round at hand, a generation or the examinations of the finish; `null` once the job has ended.
    round: Option<RoundView>,
    population: u32,
    best: Option<BestView>,
    evaluations: u64,
    failed_evaluations: u64,
    rollouts: u64,
    simulated_seconds: f64,
    priority: u32,
    /// Nothing new is handed out.
    paused: bool,
    /// The job that it does again, if it is a restart.
    restarted_from: Option<OriginView>,
    /// Tasks of which workers gave different bits.
    disputes: Vec<DisputeView>,
    /// The task that ended it by failing too often.
    poisoned: Option<PoisonedView>,
    /// Why it failed or waits.
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
    score: Option<f64>,
}

#[derive(Serialize)]
struct OriginView {
    job: String,
    /// Generations taken over from it.
    generations: u32,
}

/// A task of which workers gave different bits.
#[derive(Serialize)]
pub struct DisputeView {
    /// The generation, or the round after the search, and the task's index in it.
    round: u32,
    index: u32,
    what: String,
    /// "open", "upheld", "corrected" or "tainted".
    verdict: &'static str,
    /// What was committed comes first.
    claims: Vec<ClaimView>,
}

#[derive(Serialize)]
struct ClaimView {
    worker_id: String,
    worker: String,
    scores: Vec<Option<f64>>,
    /// The scores' bits in hexadecimal digits; "failed" where there is no score.
    bits: Vec<String>,
    digest: String,
}

impl DisputeView {
    /// As the coordinator tells it.
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
        let scores: Vec<Option<f64>> = claim.scores.iter().map(|s| s.score).collect();
        Self {
            worker_id: claim.worker_id.clone(),
            worker: claim.worker_name.clone(),
            bits: scores.iter().map(|s| bits(*s)).collect(),
            scores,
            digest: hex(&claim.digest),
        }
    }
}

/// How a dispute stands, in a word.
pub fn ruling(dispute: &v1::Dispute) -> &'static str {
    match dispute.verdict() {
        v1::dispute::Verdict::Unspecified => "open",
        v1::dispute::Verdict::Upheld => "upheld",
        v1::dispute::Verdict::Corrected => "corrected",
        v1::dispute::Verdict::Tainted => "tainted",
    }
}

/// A score's bits in hexadecimal digits.
pub fn bits(score: Option<f64>) -> String {
    score.map_or_else(|| "failed".to_owned(), |score| format!("{:016x}", score.to_bits()))
}

#[derive(Serialize)]
struct PoisonedView {
    generation: u32,
    candidate: u32,
    /// What was asked about the candidate once the search was over; `null` for an evaluation of the search.
    question: Option<&'static str>,
    attempts: u32,
    genome: Vec<f64>,
}

impl PoisonedView {
    fn new(poisoned: &v1::Poisoned) -> Self {
        Self {
            generation: poisoned.generation,
            candidate: poisoned.candidate,
            question: question(poisoned.question()),
            attempts: poisoned.attempts,
            genome: poisoned.genome.clone(),
        }
    }
}

/// A question as `evogait evaluate --question` takes it.
pub fn question(question: v1::Question) -> Option<&'static str> {
    Some(match question {
        v1::Question::Unspecified => return None,
        v1::Question::Fresh => "fresh",
        v1::Question::Reference => "reference",
        v1::Question::LessFriction => "less-friction",
        v1::Question::MoreFriction => "more-friction",
        v1::Question::WithoutReuse => "without-reuse",
        v1::Question::Traces => "traces",
    })
}

impl JobView {
    /// As the coordinator tells it.
    pub fn new(job: &v1::Job) -> Self {
        let counts = job.counts.unwrap_or_default();
        let moment = |ms: i64| (ms > 0).then_some(ms);
        Self {
            id: job.id.clone(),
            name: job.name.clone(),
            state: word(job.state()),
            job_digest: hex(&job.job_digest),
            engine_digest: hex(&job.engine_digest),
            generations_done: job.generations_done,
            generations_total: job.generations_total,
            round: (job.round_total > 0).then_some(RoundView { done: job.round_done, total: job.round_total }),
            population: job.population,
            best: job.best.as_ref().map(|b| BestView {
                generation: b.generation,
                candidate: b.candidate,
                score: b.score,
            }),
            evaluations: job.evaluations,
            failed_evaluations: job.failed_evaluations,
            rollouts: counts.rollouts,
            simulated_seconds: counts.simulated_ms as f64 / 1000.0,
            priority: job.priority,
            paused: job.paused,
            restarted_from: job
                .restarted_from
                .as_ref()
                .map(|o| OriginView { job: o.job_id.clone(), generations: o.generations }),
            disputes: job.disputes.iter().map(DisputeView::new).collect(),
            poisoned: job.poisoned.as_ref().map(PoisonedView::new),
            reason: job.reason.clone(),
            submitted_at_ms: moment(job.submitted_at_ms),
            started_at_ms: moment(job.started_at_ms),
            ended_at_ms: moment(job.ended_at_ms),
        }
    }
}

/// A worker.
#[derive(Serialize)]
pub struct WorkerView {
    id: String,
    name: String,
    address: String,
    slots: u32,
    busy: u32,
    evaluations: u64,
    engine_digests: Vec<String>,
    connected_at_ms: i64,
    /// Why it gets no work.
    #[serde(skip_serializing_if = "String::is_empty")]
    reason: String,
    quarantined: bool,
}

impl WorkerView {
    /// As the coordinator tells it.
    pub fn new(worker: &v1::WorkerInfo) -> Self {
        Self {
            id: worker.id.clone(),
            name: worker.name.clone(),
            address: worker.address.clone(),
            slots: worker.slots,
            busy: worker.busy,
            evaluations: worker.evaluations,
            engine_digests: worker.engine_digests.iter().map(|digest| hex(digest)).collect(),
            connected_at_ms: worker.connected_at_ms,
            reason: worker.reason.clone(),
            quarantined: worker.quarantined,
        }
    }
}

/// How many slots a coordinator's jobs could use.
#[derive(Serialize)]
pub struct DemandView {
    pub wanted: u32,
    pub slots: u32,
    pub busy: u32,
}

impl DemandView {
    /// As the coordinator tells it.
    pub fn new(demand: &v1::GetDemandResponse) -> Self {
        Self { wanted: demand.wanted, slots: demand.slots, busy: demand.busy }
    }
}

/// A digest's bytes in hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// How long a job has run: until now, or until it ended; "–" if it has not begun.
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
