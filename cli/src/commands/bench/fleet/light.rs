//! A light worker: it speaks the protocol of a real one and simulates nothing, so that thousands fit into a process.
//!
//! Its scores follow from the genotypes alone, so any two light workers agree on every bit. The duration of each task is
//! drawn; failures and deaths come as often as the options say.

use super::slots::Slots;
use super::tally::{Busy, Tally};
use super::times::{Times, lifetime};
use crate::client::Url;
use proto::PROTOCOL;
use proto::dial::Way;
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

/// Before a broken session is opened again, and before an unanswered result is sent again.
const PAUSE: Duration = Duration::from_millis(200);
/// From a worker's death to the start of the one that takes its place, as whoever keeps workers running needs.
const REPLACED_AFTER: Duration = Duration::from_secs(1);

/// How light workers behave.
#[derive(Clone, Debug)]
pub struct Behaviour {
    /// Evaluations at once, at least 1.
    pub slots: u32,
    /// What evaluations take.
    pub times: Times,
    /// An evaluation is said to have taken so long, where that is something else: it decides how long ranges are.
    pub claim: Option<Duration>,
    /// Share of ranges that fail, 0 to 1.
    pub fails: f64,
    /// How long a worker lives on the average; then it dies without a word, and another one takes its place.
    pub lifetime: Option<Duration>,
    /// Seed of the lives.
    pub seed: u64,
    /// What it offers.
    pub engines: Vec<Vec<u8>>,
    /// The engine that it says has run.
    pub engine: Vec<u8>,
    /// The result of each job's preparation: they all have the same robot.
    pub prepared: Vec<u8>,
}

/// Works until it is dropped.
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
                // Whether it was hung up or broke: a real one connects again.
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

/// Work that was assigned.
struct Assigned {
    task: AbortHandle,
    /// Grows with every heartbeat once a slot has it; 0 before.
    progress: Arc<AtomicU64>,
}

async fn session(url: &Url, id: &str, behaviour: &Arc<Behaviour>, tally: &Arc<Tally>) -> Result<(), Status> {
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
                    let reason = "a light worker only pretends to evaluate".to_owned();
                    say(worker_message::Message::Reject(Reject { assignment_id, reason }));
                    continue;
                };
                let progress = Arc::new(AtomicU64::new(0));
                // Here, where assignments come in order: only a job's first one to a session has its text.
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

/// A sign of life.
fn alive(running: &BTreeMap<u64, Assigned>) -> Heartbeat {
    let grown = |assigned: &Assigned| match assigned.progress.load(Ordering::Relaxed) {
        0 => 0,
        _ => assigned.progress.fetch_add(1, Ordering::Relaxed),
    };
    let (running, progress) = running.iter().map(|(id, assigned)| (*id, grown(assigned))).unzip();
    Heartbeat { running, progress }
}

/// The generation and the genotypes of an assignment, none for a preparation; `None` for examinations.
fn candidates(assigned: &Assign) -> Option<(u32, Vec<Genotype>)> {
    let (mut of, mut genotypes) = (0, Vec::new());
    for task in assigned.tasks.iter().filter(|_| assigned.round > 0) {
        let Ok(Task::Evaluate { generation, genotype, .. }) = Task::decode(task) else { return None };
        of = generation;
        genotypes.push(genotype);
    }
    Some((of, genotypes))
}

/// A range of candidates that a worker was given, or a preparation.
struct Range {
    /// The worker.
    id: String,
    /// That of its job.
    seed: u64,
    assigned: Assign,
    generation: u32,
    genotypes: Vec<Genotype>,
    progress: Arc<AtomicU64>,
}

impl Range {
    /// Pretends.
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
            if fails { Err("a light worker was told to fail") } else { Ok(genotypes.iter().map(result).collect()) };
        let claim = behaviour.claim.map_or(drawn, |each| each * count).max(Duration::from_micros(count.into()));
        completed(id, assigned, behaviour, results, claim)
    }
}

/// The request that delivers results, or a failure.
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

/// The pretended result of an evaluation.
fn result(genotype: &Genotype) -> Vec<u8> {
    let counts = Counts { rollouts: 1, nodes: 1, ..Counts::default() };
    TaskResult::Evaluated { genotype: None, score: Some(score(genotype)), descriptors: Vec::new(), counts }.encode()
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

/// 0 to 1, from the genotype's bits alone.
fn score(genotype: &Genotype) -> f64 {
    let mut hasher = DefaultHasher::new();
    genotype.numbers().iter().for_each(|value| value.to_bits().hash(&mut hasher));
    unit(hasher.finish())
}

/// 0 to 1, for what a worker does with an assignment.
fn chance(worker: &str, assignment: u64) -> f64 {
    let mut hasher = DefaultHasher::new();
    (worker, assignment).hash(&mut hasher);
    unit(hasher.finish())
}

fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1u64 << 53) as f64
}
