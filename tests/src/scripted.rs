//! A worker whose every message is chosen by the test: it follows the protocol, and fails or falsifies results on request.

use crate::sandbox::{PATIENCE, Sandbox};
use proto::credentials::Credentials;
use proto::dial::{Dial, Way};
pub use proto::v1::complete_request::Outcome;
use proto::v1::complete_response::Verdict;
use proto::v1::worker_service_client::WorkerServiceClient;
use proto::v1::{
    Assign, CompleteRequest, CoordinatorMessage, Drain, Heartbeat, Hello, Results, WorkerMessage, coordinator_message,
    worker_message,
};
use sim_core::base::digest::Digest;
use sim_core::procedure::evolve::{Task, TaskResult};
use sim_core::procedure::{Bench, Hooks};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::mpsc::{UnboundedSender, unbounded_channel};
use tokio::task::JoinHandle;
use tokio_stream::wrappers::UnboundedReceiverStream;
use tonic::{Status, Streaming};

/// See the module. Its connection breaks when it is dropped.
pub struct Scripted {
    id: String,
    client: WorkerServiceClient<Way>,
    heard: Streaming<CoordinatorMessage>,
    said: UnboundedSender<WorkerMessage>,
    /// All assignments it was ever given: its heartbeats name them as running.
    given: Arc<Mutex<Vec<u64>>>,
    /// The engine that it reports, if it plays a worker of another build.
    other_build: Option<Digest>,
    /// The jobs that it was sent, by id.
    jobs: BTreeMap<String, Bench>,
    /// What rounds share, by digest.
    shared: BTreeMap<Vec<u8>, Vec<u8>>,
    /// Sends heartbeats.
    heart: JoinHandle<()>,
}

impl Drop for Scripted {
    fn drop(&mut self) {
        self.heart.abort();
    }
}

/// How often it gives a sign of life.
const HEARTBEAT: Duration = Duration::from_millis(300);

impl Scripted {
    /// Connects with one slot.
    pub async fn join(sandbox: &Sandbox, id: &str) -> Self {
        Self::join_by(open(sandbox), id).await
    }

    /// The same over a connection with credentials.
    pub async fn join_by(way: Way, id: &str) -> Self {
        Self::connect(way, id, None).await.expect("it is let in")
    }

    /// Connects as a worker of another build, which has this engine and no other.
    pub async fn of_another_build(sandbox: &Sandbox, id: &str, engine: Digest) -> Result<Self, Status> {
        Self::connect(open(sandbox), id, Some(engine)).await
    }

    async fn connect(way: Way, id: &str, other_build: Option<Digest>) -> Result<Self, Status> {
        let mut client = WorkerServiceClient::new(way);
        let engines: Vec<Digest> = match other_build {
            Some(engine) => vec![engine],
            None => sim_core::engines::engine_digests().into_iter().map(|(_, digest)| digest).collect(),
        };
        let hello = Hello {
            protocol: proto::PROTOCOL,
            worker_id: id.to_owned(),
            name: id.to_owned(),
            slots: 1,
            engine_digests: engines.iter().map(|digest| digest.0.to_vec()).collect(),
            version: "scripted".to_owned(),
            ..Hello::default()
        };
        let (said, outgoing) = unbounded_channel();
        said.send(WorkerMessage { message: Some(worker_message::Message::Hello(hello)) }).expect("nobody closed it");
        let stream = UnboundedReceiverStream::new(outgoing);
        let heard = client.session(stream).await?.into_inner();
        let given = Arc::new(Mutex::new(Vec::new()));
        let heart = tokio::spawn(beat(said.clone(), given.clone()));
        let (id, jobs, shared) = (id.to_owned(), BTreeMap::new(), BTreeMap::new());
        Ok(Self { id, client, heard, said, given, other_build, jobs, shared, heart })
    }

    /// The next thing it is told.
    pub async fn hears(&mut self) -> coordinator_message::Message {
        let next = tokio::time::timeout(PATIENCE, self.heard.message()).await.expect("it is told something");
        next.expect("the session stands").and_then(|m| m.message).expect("a message")
    }

    /// Listens until it is told no more, and why.
    pub async fn is_refused(&mut self) -> Status {
        loop {
            match tokio::time::timeout(PATIENCE, self.heard.message()).await.expect("the session ends") {
                Ok(message) => drop(message.expect("a reason")),
                Err(status) => return status,
            }
        }
    }

    /// The next assignment it is given, whatever its tasks.
    pub async fn is_given_any(&mut self) -> Assign {
        loop {
            if let coordinator_message::Message::Assign(assign) = self.hears().await {
                self.given.lock().expect("nobody panics with it").push(assign.assignment_id);
                if !assign.job_toml.is_empty() {
                    let bench = Bench::open(&assign.job_toml).expect("a job that was taken in is valid");
                    self.jobs.insert(assign.job_id.clone(), bench);
                }
                if !assign.shared.is_empty() {
                    self.shared.insert(assign.shared_digest.clone(), assign.shared.clone());
                }
                return assign;
            }
        }
    }

    /// The next evaluations it is given. Preparations that come before them it carries out.
    pub async fn is_given(&mut self) -> Assign {
        loop {
            let assign = self.is_given_any().await;
            if assign.round == 0 {
                let prepared = self.honest(&assign);
                self.delivers(&assign, prepared).await;
            } else if matches!(task(&assign), Task::Evaluate { .. }) {
                return assign;
            }
        }
    }

    /// Carries out all that it is given, without an end.
    pub async fn works(mut self) {
        loop {
            let assign = self.is_given_any().await;
            let outcome = self.honest(&assign);
            self.delivers(&assign, outcome).await;
        }
    }

    /// The right results of an assignment that it was given.
    pub fn honest(&self, assign: &Assign) -> Outcome {
        let bench = self.jobs.get(&assign.job_id).expect("the job's text came with its first assignment");
        let shared = self.shared.get(&assign.shared_digest).map(Vec::as_slice).unwrap_or_default();
        let tasks: Vec<(u32, Vec<u8>)> = (assign.first..).zip(assign.tasks.clone()).collect();
        let results = bench.run(assign.round, shared, &tasks, &Patient).expect("tasks of this build run");
        Outcome::Results(Results { results })
    }

    /// Announces that it stops, and returns what it was given. It may deliver results all the same.
    pub fn gives_back(&self) {
        self.given.lock().expect("nobody panics with it").clear();
        let drain =
            worker_message::Message::Drain(Drain { reason: "the test says so".to_owned(), finishing: Vec::new() });
        self.said.send(WorkerMessage { message: Some(drain) }).expect("the session stands");
    }

    /// A delivery of an outcome, as a worker sends it.
    pub fn delivery(&self, assign: &Assign, outcome: Outcome) -> CompleteRequest {
        let engine = self.other_build.unwrap_or_else(|| self.jobs[&assign.job_id].engine_digest());
        CompleteRequest {
            worker_id: self.id.clone(),
            assignment_id: assign.assignment_id,
            job_id: assign.job_id.clone(),
            engine_digest: engine.0.to_vec(),
            round: assign.round,
            first: assign.first,
            count: assign.tasks.len() as u32,
            permit: assign.permit.clone(),
            compute_us: 1000,
            outcome: Some(outcome),
            tasks: Vec::new(),
        }
    }

    /// Sends any delivery.
    pub async fn sends(&mut self, delivery: CompleteRequest) -> Result<Verdict, Status> {
        Ok(self.client.complete(delivery).await?.into_inner().verdict())
    }

    /// Delivers an outcome of an assignment.
    pub async fn delivers(&mut self, assign: &Assign, outcome: Outcome) -> Verdict {
        let delivery = self.delivery(assign, outcome);
        self.sends(delivery).await.expect("it is answered")
    }

    /// The same with the tasks beside it, as [`Verdict::NeedsTasks`] asks for.
    pub async fn delivers_with_tasks(&mut self, assign: &Assign, outcome: Outcome) -> Verdict {
        let delivery = CompleteRequest { tasks: assign.tasks.clone(), ..self.delivery(assign, outcome) };
        self.sends(delivery).await.expect("it is answered")
    }
}

/// Lets tasks run to their end.
struct Patient;

impl Hooks for Patient {
    fn stop(&self) -> bool {
        false
    }
}

/// The first task of an assignment of a search or of what follows it.
pub fn task(assign: &Assign) -> Task {
    Task::decode(&assign.tasks[0]).expect("a task of this build")
}

fn open(sandbox: &Sandbox) -> Way {
    Dial::new(sandbox.url().parse().expect("an address"), &Credentials::default()).expect("no secrets").way()
}

async fn beat(said: UnboundedSender<WorkerMessage>, given: Arc<Mutex<Vec<u64>>>) {
    loop {
        let running = given.lock().expect("nobody panics with it").clone();
        let heartbeat = worker_message::Message::Heartbeat(Heartbeat { running, ..Heartbeat::default() });
        if said.send(WorkerMessage { message: Some(heartbeat) }).is_err() {
            return;
        }
        tokio::time::sleep(HEARTBEAT).await;
    }
}

/// The same results, the first one changed.
pub fn with_first(outcome: Outcome, change: impl FnOnce(Vec<u8>) -> Vec<u8>) -> Outcome {
    let Outcome::Results(Results { mut results }) = outcome else { panic!("results") };
    results[0] = change(std::mem::take(&mut results[0]));
    Outcome::Results(Results { results })
}

/// The same results with the last bit of the first score flipped.
pub fn one_bit_off(outcome: Outcome) -> Outcome {
    with_first(outcome, |result| {
        let mut result = TaskResult::decode(&result).expect("a result of this build");
        let TaskResult::Evaluated { score, .. } = &mut result else { panic!("an evaluation") };
        *score = Some(score.map_or(1.0, |score| f64::from_bits(score.to_bits() ^ 1)));
        result.encode()
    })
}
