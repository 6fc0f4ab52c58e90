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
        }
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
