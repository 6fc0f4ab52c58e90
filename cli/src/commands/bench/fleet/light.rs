//! A light worker: it speaks the protocol of a real one and simulates nothing, so that thousands fit into a process.
//!
//! Its scores are made from the genomes alone, so that any two of them agree on every bit. It takes as long as it is
//! told to, and fails or dies as often as it is told to.

use crate::client::Url;
use proto::PROTOCOL;
use proto::dial::Way;
use proto::limits::MAX_MESSAGE;
use proto::v1::complete_request::Result as Outcome;
use proto::v1::worker_service_client::WorkerServiceClient;
use proto::v1::{
    Assign, CompleteRequest, Counts, EvaluateResult, EvaluateTask, EvaluationResult, Heartbeat, Hello, Reject,
    WorkerMessage, assign, coordinator_message, worker_message,
};
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::sync::Semaphore;
use tokio::sync::mpsc::unbounded_channel;
use tokio::task::JoinSet;
use tokio::time::{interval, sleep};
use tokio_stream::wrappers::UnboundedReceiverStream;
use tonic::{Code, Status};

/// Before a broken session is opened again, and before an unanswered result is sent again.
const PAUSE: Duration = Duration::from_millis(200);

/// How light workers behave.
#[derive(Clone, Debug)]
pub struct Behaviour {
    /// Evaluations at once, at least 1.
    pub slots: u32,
    /// An evaluation takes so long.
    pub each: Duration,
    /// An evaluation is said to have taken so long, where that is something else: it decides how long ranges are.
    pub claim: Option<Duration>,
    /// Share of assignments that fail, 0 to 1.
    pub fails: f64,
    /// Share of assignments at which the worker dies without a word, 0 to 1; another one takes its place.
    pub dies: f64,
    /// What it offers.
    pub engines: Vec<Vec<u8>>,
    /// The engine that it says has run.
    pub engine: Vec<u8>,
}

/// What all of them did.
#[derive(Debug, Default)]
pub struct Tally {
    /// Sessions that stand.
    pub connected: AtomicU64,
    /// Assignments worked off.
    pub assignments: AtomicU64,
    /// Deaths.
    pub deaths: AtomicU64,
}

/// Works until it is dropped.
pub async fn work(url: Url, number: u64, behaviour: Arc<Behaviour>, tally: Arc<Tally>) {
    for life in 0u64.. {
        let id = format!("light-{number}-{life}");
        while !matches!(session(&url, &id, &behaviour, &tally).await, Ok(End::Died)) {
            sleep(PAUSE).await;
        }
        tally.deaths.fetch_add(1, Ordering::Relaxed);
        sleep(PAUSE).await;
    }
}

/// How a session ends in an orderly way.
enum End {
    HungUp,
    Died,
}

/// Counts a session for as long as it stands.
struct Connected<'a>(&'a Tally);

impl<'a> Connected<'a> {
    fn new(tally: &'a Tally) -> Self {
        tally.connected.fetch_add(1, Ordering::Relaxed);
        Self(tally)
    }
}

impl Drop for Connected<'_> {
    fn drop(&mut self) {
        self.0.connected.fetch_sub(1, Ordering::Relaxed);
    }
}

async fn session(url: &Url, id: &str, behaviour: &Arc<Behaviour>, tally: &Arc<Tally>) -> Result<End, Status> {
    let mut client = WorkerServiceClient::new(url.way())
        .max_decoding_message_size(MAX_MESSAGE)
        .max_encoding_message_size(MAX_MESSAGE);
    let (said, outgoing) = unbounded_channel();
    // A connection that broke shows where it is read.
    let say = |message| drop(said.send(WorkerMessage { message: Some(message) }));
    say(worker_message::Message::Hello(Hello {
        protocol: PROTOCOL,
        worker_id: id.to_owned(),
        name: id.to_owned(),
        slots: behaviour.slots,
        engine_digests: behaviour.engines.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        ..Hello::default()
    }));
    let mut incoming = client.session(UnboundedReceiverStream::new(outgoing)).await?.into_inner();
    let first = incoming.message().await?.and_then(|m| m.message);
    let Some(coordinator_message::Message::Welcome(welcome)) = first else {
        return Err(Status::unavailable("it did not say Welcome"));
    };
    let _connected = Connected::new(tally);
    let mut heartbeat = interval(Duration::from_millis(u64::from(welcome.heartbeat_ms).max(10)));
    let slots = Arc::new(Semaphore::new(behaviour.slots as usize));
    let mut running = BTreeMap::new();
    let mut working = JoinSet::new();
    loop {
        let message = tokio::select! {
            message = incoming.message() => message?,
            Some(done) = working.join_next() => {
                running.remove(&done.unwrap_or_default());
                continue;
            }
            _ = heartbeat.tick() => {
                let running = running.keys().copied().collect();
                say(worker_message::Message::Heartbeat(Heartbeat { running, ..Heartbeat::default() }));
                continue;
            }
        };
        match message.map(|m| m.message) {
            None => return Ok(End::HungUp),
            Some(Some(coordinator_message::Message::Assign(assigned))) => {
                let assignment_id = assigned.assignment_id;
                if chance(id, assignment_id, "dies") < behaviour.dies {
                    return Ok(End::Died);
                }
                let Some(assign::Task::Evaluate(task)) = assigned.task.clone() else {
                    let reason = "a light worker only pretends to evaluate".to_owned();
                    say(worker_message::Message::Reject(Reject { assignment_id, reason }));
                    continue;
                };
                let (client, behaviour, slots, id, tally) =
                    (client.clone(), behaviour.clone(), slots.clone(), id.to_owned(), tally.clone());
                let task = working.spawn(async move {
                    // Never closed.
                    let _slot = slots.acquire().await;
                    let result = evaluate(&id, &behaviour, &assigned, &task).await;
                    deliver(client, result).await;
                    tally.assignments.fetch_add(1, Ordering::Relaxed);
                    assignment_id
                });
                running.insert(assignment_id, task);
            }
            Some(Some(coordinator_message::Message::Cancel(cancel))) => {
                for assignment in cancel.assignment_ids {
                    if let Some(task) = running.remove(&assignment) {
                        task.abort();
                    }
                }
            }
            Some(_) => {}
        }
    }
}

/// Pretends.
async fn evaluate(id: &str, behaviour: &Behaviour, assigned: &Assign, task: &EvaluateTask) -> CompleteRequest {
    let count = task.genomes.len() as u32;
    if !behaviour.each.is_zero() {
        sleep(behaviour.each * count).await;
    }
    let result = if chance(id, assigned.assignment_id, "fails") < behaviour.fails {
        Outcome::Failure("a light worker was told to fail".to_owned())
    } else {
        let counts = Some(Counts { rollouts: 1, nodes: 1, ..Counts::default() });
        let score = |genome: &proto::v1::Genome| EvaluationResult { score: Some(score(&genome.values)), counts };
        let evaluations = task.genomes.iter().map(score).collect();
        Outcome::Evaluate(EvaluateResult { generation: task.generation, first: task.first, evaluations })
    };
    let claim = behaviour.claim.unwrap_or(behaviour.each).max(Duration::from_micros(1)) * count;
    CompleteRequest {
        worker_id: id.to_owned(),
        assignment_id: assigned.assignment_id,
        job_id: assigned.job_id.clone(),
        engine_digest: behaviour.engine.clone(),
        result: Some(result),
        compute_us: claim.as_micros() as u64,
    }
}

/// Sends it until it is answered.
async fn deliver(mut client: WorkerServiceClient<Way>, result: CompleteRequest) {
    while let Err(status) = client.complete(result.clone()).await {
        // Whatever it is, asking again would not change it.
        if !matches!(status.code(), Code::Unavailable | Code::Cancelled | Code::Unknown | Code::DeadlineExceeded) {
            return;
        }
        sleep(PAUSE).await;
    }
}

/// 0 to 1, from the genome's bits alone.
fn score(genome: &[f64]) -> f64 {
    let mut hasher = DefaultHasher::new();
    genome.iter().for_each(|value| value.to_bits().hash(&mut hasher));
    unit(hasher.finish())
}

/// 0 to 1, for what a worker does with an assignment.
fn chance(worker: &str, assignment: u64, what: &str) -> f64 {
    let mut hasher = DefaultHasher::new();
    (worker, assignment, what).hash(&mut hasher);
    unit(hasher.finish())
}

fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1u64 << 53) as f64
}
