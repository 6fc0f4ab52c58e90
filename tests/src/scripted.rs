//! Worker with messages chosen by the test: it follows the protocol, and fails or falsifies results on request.

use crate::sandbox::{Sandbox, TIMEOUT};
use proto::credentials::Credentials;
use proto::dial::{Dial, FailoverChannel};
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

/// Scripted worker. Dropping it breaks its connection.
pub struct ScriptedWorker {
    id: String,
    client: WorkerServiceClient<FailoverChannel>,
    heard: Streaming<CoordinatorMessage>,
    said: UnboundedSender<WorkerMessage>,
    /// Assignments that its heartbeats report as running: all that it received and has not returned.
    given: Arc<Mutex<Vec<u64>>>,
    /// Engine digest that it reports if it plays a worker of another build.
    other_build: Option<Digest>,
    /// Jobs that it received, by id.
    jobs: BTreeMap<String, Bench>,
    /// Shared data of rounds, by digest.
    shared: BTreeMap<Vec<u8>, Vec<u8>>,
    /// Background task that sends heartbeats.
    heart: JoinHandle<()>,
}

impl Drop for ScriptedWorker {
    fn drop(&mut self) {
        self.heart.abort();
    }
}

/// Interval of heartbeats.
const HEARTBEAT: Duration = Duration::from_millis(300);

impl ScriptedWorker {
    /// Connects a worker with one slot.
    pub async fn join(sandbox: &Sandbox, id: &str) -> Self {
        Self::join_by(open(sandbox), id).await
    }

    /// Connects over a connection with credentials.
    pub async fn join_by(way: FailoverChannel, id: &str) -> Self {
        Self::connect(way, id, None).await.expect("the coordinator accepts the worker")
    }

    /// Connects a worker of another build, which has only the given engine.
    pub async fn of_another_build(sandbox: &Sandbox, id: &str, engine: Digest) -> Result<Self, Status> {
        Self::connect(open(sandbox), id, Some(engine)).await
    }

    async fn connect(way: FailoverChannel, id: &str, other_build: Option<Digest>) -> Result<Self, Status> {
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
        said.send(WorkerMessage { message: Some(worker_message::Message::Hello(hello)) })
            .expect("the receiver is open");
        let stream = UnboundedReceiverStream::new(outgoing);
        let heard = client.session(stream).await?.into_inner();
        let given = Arc::new(Mutex::new(Vec::new()));
        let heart = tokio::spawn(beat(said.clone(), given.clone()));
        let (id, jobs, shared) = (id.to_owned(), BTreeMap::new(), BTreeMap::new());
        Ok(Self { id, client, heard, said, given, other_build, jobs, shared, heart })
    }

    /// Returns the next message from the coordinator.
    pub async fn hears(&mut self) -> coordinator_message::Message {
        let next =
            tokio::time::timeout(TIMEOUT, self.heard.message()).await.expect("the coordinator sends a message in time");
        next.expect("the session is open").and_then(|m| m.message).expect("the stream has a message")
    }

    /// Receives messages until the coordinator ends the session, and returns the status.
    pub async fn is_refused(&mut self) -> Status {
        loop {
            match tokio::time::timeout(TIMEOUT, self.heard.message()).await.expect("the session ends in time") {
                Ok(message) => drop(message.expect("the session ends with a status")),
                Err(status) => return status,
            }
        }
    }

    /// Returns the next assignment, with any tasks.
    pub async fn receive_any_lease(&mut self) -> Assign {
        loop {
            if let coordinator_message::Message::Assign(assign) = self.hears().await {
                self.given.lock().expect("the lock is not poisoned").push(assign.assignment_id);
                if !assign.job_toml.is_empty() {
                    let bench = Bench::open(&assign.job_toml).expect("an accepted job is valid");
                    self.jobs.insert(assign.job_id.clone(), bench);
                }
                if !assign.shared.is_empty() {
                    self.shared.insert(assign.shared_digest.clone(), assign.shared.clone());
                }
                return assign;
            }
        }
    }

    /// Returns the next assignment of evaluations. Preparations that arrive before are computed and delivered.
    pub async fn receive_lease(&mut self) -> Assign {
        loop {
            let assign = self.receive_any_lease().await;
            if assign.round == 0 {
                let prepared = self.honest(&assign);
                self.delivers(&assign, prepared).await;
            } else if matches!(task(&assign), Task::Evaluate { .. }) {
                return assign;
            }
        }
    }

    /// Computes and delivers all assignments, without end.
    pub async fn works(mut self) {
        loop {
            let assign = self.receive_any_lease().await;
            let outcome = self.honest(&assign);
            self.delivers(&assign, outcome).await;
        }
    }

    /// Returns the correct results of an assignment.
    pub fn honest(&self, assign: &Assign) -> Outcome {
        let bench = self.jobs.get(&assign.job_id).expect("the job's text arrived with its first assignment");
        let shared = self.shared.get(&assign.shared_digest).map(Vec::as_slice).unwrap_or_default();
        let tasks: Vec<(u32, Vec<u8>)> = (assign.first..).zip(assign.tasks.clone()).collect();
        let results = bench.run(assign.round, shared, &tasks, &Patient).expect("tasks of this build can be run");
        Outcome::Results(Results { results })
    }

    /// Announces a drain and returns all leases. The test may still deliver results afterwards.
    pub fn gives_back(&self) {
        self.given.lock().expect("the lock is not poisoned").clear();
        let drain =
            worker_message::Message::Drain(Drain { reason: "requested by the test".to_owned(), finishing: Vec::new() });
        self.said.send(WorkerMessage { message: Some(drain) }).expect("the session is open");
    }

    /// Returns the request that delivers an outcome, as a worker sends it.
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

    /// Sends a delivery.
    pub async fn sends(&mut self, delivery: CompleteRequest) -> Result<Verdict, Status> {
        Ok(self.client.complete(delivery).await?.into_inner().verdict())
    }

    /// Delivers the outcome of an assignment.
    pub async fn delivers(&mut self, assign: &Assign, outcome: Outcome) -> Verdict {
        let delivery = self.delivery(assign, outcome);
        self.sends(delivery).await.expect("the delivery is answered")
    }

    /// Delivers the outcome together with the tasks, as [`Verdict::NeedsTasks`] requires.
    pub async fn delivers_with_tasks(&mut self, assign: &Assign, outcome: Outcome) -> Verdict {
        let delivery = CompleteRequest { tasks: assign.tasks.clone(), ..self.delivery(assign, outcome) };
        self.sends(delivery).await.expect("the delivery is answered")
    }
}

/// Hooks that let every task run to its end.
struct Patient;

impl Hooks for Patient {
    fn stop(&self) -> bool {
        false
    }
}

/// Returns the first task of an assignment of a search or of its finish.
pub fn task(assign: &Assign) -> Task {
    Task::decode(&assign.tasks[0]).expect("the task can be decoded")
}

fn open(sandbox: &Sandbox) -> FailoverChannel {
    Dial::new(sandbox.url().parse().expect("the URL is valid"), &Credentials::default())
        .expect("a dial without credentials is valid")
        .channel()
}

async fn beat(said: UnboundedSender<WorkerMessage>, given: Arc<Mutex<Vec<u64>>>) {
    loop {
        let running = given.lock().expect("the lock is not poisoned").clone();
        let heartbeat = worker_message::Message::Heartbeat(Heartbeat { running, ..Heartbeat::default() });
        if said.send(WorkerMessage { message: Some(heartbeat) }).is_err() {
            return;
        }
        tokio::time::sleep(HEARTBEAT).await;
    }
}

/// Returns the results with the first one changed.
pub fn with_first(outcome: Outcome, change: impl FnOnce(Vec<u8>) -> Vec<u8>) -> Outcome {
    let Outcome::Results(Results { mut results }) = outcome else { panic!("the outcome must be results") };
    results[0] = change(std::mem::take(&mut results[0]));
    Outcome::Results(Results { results })
}

/// Returns the results with the last bit of the first score flipped.
pub fn one_bit_off(outcome: Outcome) -> Outcome {
    with_first(outcome, |result| {
        let mut result = TaskResult::decode(&result).expect("the result can be decoded");
        let TaskResult::Evaluated { score, .. } = &mut result else { panic!("the result must be an evaluation") };
        *score = Some(score.map_or(1.0, |score| f64::from_bits(score.to_bits() ^ 1)));
        result.encode()
    })
}
