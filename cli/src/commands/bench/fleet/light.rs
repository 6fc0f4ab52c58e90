//! Light worker: it uses the protocol of a real worker but simulates nothing, so thousands fit into one process.
//!
//! Its scores depend on the genotypes alone, so the bits of any two light workers are equal. The duration of each task
//! is drawn. Failures and crashes occur at the rates of the options.

use super::slots::Slots;
use super::tally::{Busy, Tally};
use super::times::{Times, lifetime};
use crate::client::Url;
use proto::PROTOCOL;
use proto::dial::FailoverChannel;
use proto::limits::MAX_MESSAGE;
use proto::v1::complete_request::Outcome;
use proto::v1::worker_service_client::WorkerServiceClient;
use proto::v1::{
    Assign, CompleteRequest, Heartbeat, Hello, Reject, Results, WorkerMessage, coordinator_message, worker_message,
};
use sim_core::base::score::Counts;
use sim_core::genotype::Genotype;
use sim_core::procedure::evolve::{Task, TaskResult};
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::sync::mpsc::unbounded_channel;
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::{MissedTickBehavior, interval, sleep, sleep_until};
use tokio_stream::wrappers::UnboundedReceiverStream;
use tonic::{Code, Status};

/// Pause before a broken session is opened again, and before an unanswered result is sent again.
const PAUSE: Duration = Duration::from_millis(200);
/// Time from a crash to the start of the replacement, as a supervisor of real workers needs.
const REPLACED_AFTER: Duration = Duration::from_secs(1);

/// Parameters of all light workers.
#[derive(Clone, Debug)]
pub struct Behaviour {
    /// Number of slots, at least 1.
    pub slots: u32,
    /// Times of the evaluations.
    pub times: Times,
    /// Time of an evaluation that workers report instead of the drawn one. The coordinator sizes ranges by it.
    pub claim: Option<Duration>,
    /// Share of ranges that workers report as failed, 0 to 1.
    pub fails: f64,
    /// Mean time until a worker crashes without notice and is replaced; `None` means that workers never crash.
    pub lifetime: Option<Duration>,
    /// Seed of the times until crashes.
    pub seed: u64,
    /// Engine digests that the worker offers.
    pub engines: Vec<Vec<u8>>,
    /// Engine digest that the worker reports in results.
    pub engine: Vec<u8>,
    /// Result of each job's preparation; it is the same, as all jobs have the same robot.
    pub prepared: Vec<u8>,
}

/// Runs a light worker, with its replacements after crashes, until the future is dropped.
pub async fn work(url: Url, number: u32, behaviour: Arc<Behaviour>, tally: Arc<Tally>) {
    for life in 0u32.. {
        let id = format!("light-{number}-{life}");
        let dies = async {
            match behaviour.lifetime {
                Some(mean) => sleep(lifetime(mean, behaviour.seed, number, life)).await,
                None => std::future::pending().await,
            }
        };
        let lives = async {
            loop {
                // The session ended or broke: like a real worker, connect again.
                let _ = session(&url, &id, &behaviour, &tally).await;
                sleep(PAUSE).await;
            }
        };
        tokio::select! {
            () = dies => {}
            () = lives => {}
        }
        tally.deaths.fetch_add(1, Ordering::Relaxed);
        sleep(REPLACED_AFTER).await;
    }
}

/// Range that the coordinator assigned.
struct Assigned {
    task: AbortHandle,
    /// Grows with every heartbeat while the range has a slot; 0 before.
    progress: Arc<AtomicU64>,
}

async fn session(url: &Url, id: &str, behaviour: &Arc<Behaviour>, tally: &Arc<Tally>) -> Result<(), Status> {
    let mut client = WorkerServiceClient::new(url.channel())
        .max_decoding_message_size(MAX_MESSAGE)
        .max_encoding_message_size(MAX_MESSAGE);
    let (said, outgoing) = unbounded_channel();
    // A broken connection is reported where messages are read.
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
        return Err(Status::unavailable("the coordinator's first message was not Welcome"));
    };
    tally.sessions.fetch_add(1, Ordering::Relaxed);
    let mut heartbeat = interval(Duration::from_millis(u64::from(welcome.heartbeat_ms).max(10)));
    heartbeat.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let slots = Arc::new(Slots::new(behaviour.slots));
    let mut running: BTreeMap<u64, Assigned> = BTreeMap::new();
    let mut working = JoinSet::new();
    loop {
        let message = tokio::select! {
            message = incoming.message() => message?,
            Some(done) = working.join_next() => {
                running.remove(&done.unwrap_or_default());
                continue;
            }
            _ = heartbeat.tick() => {
                say(worker_message::Message::Heartbeat(alive(&running)));
                continue;
            }
        };
        match message.map(|m| m.message) {
            None => return Ok(()),
            Some(Some(coordinator_message::Message::Assign(assigned))) => {
                let assignment_id = assigned.assignment_id;
                let Some((generation, genotypes)) = candidates(&assigned) else {
                    let reason = "a light worker can only evaluate candidates".to_owned();
                    say(worker_message::Message::Reject(Reject { assignment_id, reason }));
                    continue;
                };
                let progress = Arc::new(AtomicU64::new(0));
                // Read here, where assignments arrive in order: only the first assignment of a job to a session has the
                // job's text.
                let seed = tally.seed(&assigned.job_id, &assigned.job_toml);
                let range =
                    Range { id: id.to_owned(), seed, assigned, generation, genotypes, progress: progress.clone() };
                let (client, behaviour, slots, tally) =
                    (client.clone(), behaviour.clone(), slots.clone(), tally.clone());
                let task = working.spawn(async move {
                    let result = range.evaluate(&behaviour, &slots, &tally).await;
                    deliver(client, result).await;
                    tally.ranges.fetch_add(1, Ordering::Relaxed);
                    assignment_id
                });
                running.insert(assignment_id, Assigned { task, progress });
            }
            Some(Some(coordinator_message::Message::Cancel(cancel))) => {
                for assignment in cancel.assignment_ids {
                    if let Some(assigned) = running.remove(&assignment) {
                        assigned.task.abort();
                    }
                }
            }
            Some(_) => {}
        }
    }
}

/// Returns the heartbeat, with the progress of all assigned ranges.
fn alive(running: &BTreeMap<u64, Assigned>) -> Heartbeat {
    let grown = |assigned: &Assigned| match assigned.progress.load(Ordering::Relaxed) {
        0 => 0,
        _ => assigned.progress.fetch_add(1, Ordering::Relaxed),
    };
    let (running, progress) = running.iter().map(|(id, assigned)| (*id, grown(assigned))).unzip();
    Heartbeat { running, progress }
}

/// Returns generation and genotypes of an assignment, with no genotypes for a preparation. Returns `None` for
/// examinations.
fn candidates(assigned: &Assign) -> Option<(u32, Vec<Genotype>)> {
    let (mut of, mut genotypes) = (0, Vec::new());
    for task in assigned.tasks.iter().filter(|_| assigned.round > 0) {
        let Ok(Task::Evaluate { generation, genotype, .. }) = Task::decode(task) else { return None };
        of = generation;
        genotypes.push(genotype);
    }
    Some((of, genotypes))
}

/// Range of candidates, or a preparation, that a worker was assigned.
struct Range {
    /// Id of the worker.
    id: String,
    /// Seed of the job.
    seed: u64,
    assigned: Assign,
    generation: u32,
    genotypes: Vec<Genotype>,
    progress: Arc<AtomicU64>,
}

impl Range {
    /// Sleeps for the drawn time and returns the request with results that depend on the genotypes alone.
    async fn evaluate(self, behaviour: &Behaviour, slots: &Slots, tally: &Tally) -> CompleteRequest {
        let Self { id, seed, assigned, generation, genotypes, progress } = self;
        if assigned.round == 0 {
            return completed(id, assigned, behaviour, Ok(vec![behaviour.prepared.clone()]), Duration::from_micros(1));
        }
        let count = genotypes.len() as u32;
        let drawn = behaviour.times.of_range(seed, generation, assigned.first, count);
        let slot = slots.take().await;
        progress.store(1, Ordering::Relaxed);
        let busy = Busy::begin(tally);
        if !drawn.is_zero() {
            sleep_until((busy.begun() + drawn).into()).await;
        }
        let spell = busy.done(drawn, slot.free_since);
        tally.chains().done(seed, generation, spell);
        drop(slot);
        let fails = chance(&id, assigned.assignment_id) < behaviour.fails;
        let results =
            if fails { Err("failure of a light worker by --fail") } else { Ok(genotypes.iter().map(result).collect()) };
        let claim = behaviour.claim.map_or(drawn, |each| each * count).max(Duration::from_micros(count.into()));
        completed(id, assigned, behaviour, results, claim)
    }
}

/// Returns the request that delivers results or a failure.
fn completed(
    worker_id: String,
    assigned: Assign,
    behaviour: &Behaviour,
    results: Result<Vec<Vec<u8>>, &str>,
    claim: Duration,
) -> CompleteRequest {
    let Assign { assignment_id, job_id, round, first, tasks, permit, .. } = assigned;
    CompleteRequest {
        worker_id,
        assignment_id,
        job_id,
        engine_digest: behaviour.engine.clone(),
        round,
        first,
        count: tasks.len() as u32,
        permit,
        outcome: Some(match results {
            Ok(results) => Outcome::Results(Results { results }),
            Err(reason) => Outcome::Failure(reason.to_owned()),
        }),
        compute_us: claim.as_micros() as u64,
        tasks: Vec::new(),
    }
}

/// Returns the made-up result of an evaluation.
fn result(genotype: &Genotype) -> Vec<u8> {
    let counts = Counts { rollouts: 1, nodes: 1, ..Counts::default() };
    TaskResult::Evaluated { genotype: None, score: Some(score(genotype)), descriptors: Vec::new(), counts }.encode()
}

/// Sends the result until it is answered.
async fn deliver(mut client: WorkerServiceClient<FailoverChannel>, result: CompleteRequest) {
    while let Err(status) = client.complete(result.clone()).await {
        // Any other status would be returned again.
        if !matches!(status.code(), Code::Unavailable | Code::Cancelled | Code::Unknown | Code::DeadlineExceeded) {
            return;
        }
        sleep(PAUSE).await;
    }
}

/// Returns a number from 0 to 1 that depends on the genotype's bits alone.
fn score(genotype: &Genotype) -> f64 {
    let mut hasher = DefaultHasher::new();
    genotype.numbers().iter().for_each(|value| value.to_bits().hash(&mut hasher));
    unit(hasher.finish())
}

/// Returns a number from 0 to 1 that depends on worker and assignment.
fn chance(worker: &str, assignment: u64) -> f64 {
    let mut hasher = DefaultHasher::new();
    (worker, assignment).hash(&mut hasher);
    unit(hasher.finish())
}

fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1u64 << 53) as f64
}
