//! The connection to the coordinator: made again and again, and nothing is lost in between.

use crate::Error;
use crate::assignments::{Assignment, Assignments, Task};
use crate::backoff::Backoff;
use crate::delivery::Courier;
use crate::engines::Engines;
use crate::jobs::{Jobs, Unavailable};
use crate::metrics::Metrics;
use crate::slots::Slots;
use proto::limits::MAX_MESSAGE;
use proto::v1::worker_service_client::WorkerServiceClient;
use proto::v1::{
    Assign, CompleteRequest, Drain, Heartbeat, Hello, Reject, Welcome, WorkerMessage, assign, complete_request,
    coordinator_message, worker_message,
};
use proto::{ConvertError, PROTOCOL};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc::{UnboundedSender, unbounded_channel};
use tokio_stream::wrappers::UnboundedReceiverStream;
use tonic::transport::Endpoint;
use tonic::{Code, Status};

/// Shortest time between two heartbeats, whatever the coordinator asks for.
const LEAST_HEARTBEAT: Duration = Duration::from_millis(10);
/// Time to let the last words out.
const LAST_WORDS: Duration = Duration::from_millis(200);

pub(crate) struct Session {
    pub url: String,
    pub endpoint: Endpoint,
    pub id: String,
    pub name: String,
    pub slots: u32,
    pub engines: Arc<Engines>,
    pub assignments: Arc<Assignments>,
    pub jobs: Jobs,
    pub queue: Slots,
    pub courier: Courier,
    pub metrics: Arc<Metrics>,
    /// The way to the coordinator while connected.
    pub said: Option<UnboundedSender<WorkerMessage>>,
}

impl Session {
    /// Connects, works, and connects again, until the coordinator refuses this worker.
    pub async fn keep(&mut self) -> Error {
        let mut backoff = Backoff::new();
        let mut told = false;
        loop {
            let ended = self.once(&mut backoff).await;
            self.said = None;
            self.metrics.connected.set(0);
            if let Err(status) = &ended
                && refusal(status.code())
            {
                return Error::Refused { url: self.url.clone(), reason: status.message().to_owned() };
            }
            match ended {
                Ok(()) => {
                    tracing::info!(url = self.url, "the coordinator hung up: connecting again");
                    told = false;
                }
                Err(status) => {
                    // Once is enough while nothing changes.
                    if !told {
                        tracing::info!(url = self.url, reason = status.message(), "waiting for the coordinator");
                    }
                    told = true;
                }
            }
            backoff.wait().await;
        }
    }

    /// Tells the coordinator that this worker stops, if it is connected.
    pub async fn say_drain(&self) {
        if let Some(said) = &self.said {
            let drain = Drain { reason: "the worker stops".to_owned() };
            if said.send(message(worker_message::Message::Drain(drain))).is_ok() {
                tokio::time::sleep(LAST_WORDS).await;
            }
        }
    }

    /// One connection, from Hello to its end. `Ok` if it stood for a while.
    async fn once(&mut self, backoff: &mut Backoff) -> Result<(), Status> {
        let channel = self.endpoint.connect().await.map_err(|e| Status::unavailable(cause(&e)))?;
        let mut client = WorkerServiceClient::new(channel)
            .max_decoding_message_size(MAX_MESSAGE)
            .max_encoding_message_size(MAX_MESSAGE);
        let (said, outgoing) = unbounded_channel();
        let hello = Hello {
            protocol: PROTOCOL,
            worker_id: self.id.clone(),
            name: self.name.clone(),
            slots: self.slots,
            engine_digests: self.engines.to_wire(),
            running: self.assignments.running(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            seconds_left: 0,
        };
        say(&said, worker_message::Message::Hello(hello));
        let mut incoming = client.session(UnboundedReceiverStream::new(outgoing)).await?.into_inner();
        let welcome = match incoming.message().await? {
            Some(m) => m.message,
            None => return Err(Status::unavailable("it hung up")),
        };
        let Some(coordinator_message::Message::Welcome(Welcome { drop, heartbeat_ms, epoch, .. })) = welcome else {
            return Err(Status::unavailable("it did not say Welcome"));
        };
        backoff.reset();
        self.metrics.connected.set(1);
        self.metrics.sessions.inc();
        tracing::info!(worker = self.id, url = self.url, slots = self.slots, epoch, "connected");
        self.assignments.stop(&drop);
        self.said = Some(said.clone());

        let period = Duration::from_millis(heartbeat_ms.into()).max(LEAST_HEARTBEAT);
        let mut heartbeat = tokio::time::interval(period);
        heartbeat.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            let received = tokio::select! {
                received = incoming.message() => received,
                _ = heartbeat.tick() => {
                    say(&said, worker_message::Message::Heartbeat(Heartbeat { running: self.assignments.ids(), progress: Vec::new() }));
                    continue;
                }
            };
            match received {
                Ok(Some(content)) => match content.message {
                    Some(coordinator_message::Message::Assign(assign)) => self.assigned(assign, &said).await,
                    Some(coordinator_message::Message::Cancel(cancel)) => self.assignments.stop(&cancel.assignment_ids),
                    // It will be back: what is being computed will be welcome then.
                    Some(coordinator_message::Message::Drain(drain)) => tracing::info!(reason = drain.reason, "drain"),
                    Some(coordinator_message::Message::Welcome(_)) | None => {}
                },
                Ok(None) => return Ok(()),
                Err(status) if refusal(status.code()) => return Err(status),
                Err(status) => {
                    tracing::debug!(%status, "connection broke");
                    return Ok(());
                }
            }
        }
    }

    /// Takes work on, or says why not.
    async fn assigned(&mut self, assign: Assign, said: &UnboundedSender<WorkerMessage>) {
        let Assign { assignment_id: id, job_id, job_toml, task } = assign;
        let reject = |reason: String| {
            say(said, worker_message::Message::Reject(Reject { assignment_id: id, reason }));
        };
        let job = match self.jobs.get(&job_id, job_toml).await {
            Ok(job) => job,
            Err(problem @ (Unavailable::Unknown | Unavailable::Unreadable(_))) => return reject(problem.to_string()),
        };
        if !self.engines.has(&job.engine_digest()) {
            return reject(format!("this worker has no engine {}", job.engine_digest().short()));
        }
        let task = match read(task) {
            Ok(task) => task,
            Err(problem) => return reject(problem.to_string()),
        };
        // A genome that does not fit would be a panic later on.
        let parameters = job.bounds().0.len();
        let fits = match &task {
            Task::Evaluate { candidates, .. } => candidates.iter().all(|(_, genome)| genome.len() == parameters),
            Task::Examine { examination, .. } => examination.candidate.genome.len() == parameters,
        };
        if !fits {
            let result = Some(complete_request::Result::Failure(format!(
                "its genomes do not have the {parameters} parameters that the job asks for"
            )));
            let engine_digest = job.engine_digest().0.to_vec();
            let failure =
                CompleteRequest { assignment_id: id, job_id, engine_digest, result, ..CompleteRequest::default() };
            tokio::spawn(self.courier.clone().deliver(failure));
            return;
        }
        let assignment = Arc::new(Assignment::new(id, job_id, job, task));
        self.assignments.insert(assignment.clone());
        self.queue.push(assignment);
    }
}

fn read(task: Option<assign::Task>) -> Result<Task, ConvertError> {
    match task.ok_or(ConvertError::Missing { field: "task" })? {
        assign::Task::Evaluate(evaluate) => {
            proto::range_length(evaluate.first, evaluate.genomes.len())?;
            let candidates = (evaluate.first..).zip(evaluate.genomes.into_iter().map(|g| g.values)).collect();
            Ok(Task::Evaluate { generation: evaluate.generation, first: evaluate.first, candidates })
        }
        assign::Task::Examine(task) => {
            let (round, index) = (task.round, task.index);
            Ok(Task::Examine { round, index, examination: proto::examination(task)? })
        }
    }
}

/// Codes by which a coordinator says that this worker will never do.
fn refusal(code: Code) -> bool {
    matches!(
        code,
        Code::FailedPrecondition
            | Code::InvalidArgument
            | Code::Unimplemented
            | Code::PermissionDenied
            | Code::Unauthenticated
    )
}

fn say(said: &UnboundedSender<WorkerMessage>, content: worker_message::Message) {
    // A connection that broke shows where it is read.
    let _ = said.send(message(content));
}

fn message(content: worker_message::Message) -> WorkerMessage {
    WorkerMessage { message: Some(content) }
}

/// The innermost reason: "connection refused" rather than "transport error".
fn cause(error: &dyn std::error::Error) -> String {
    let mut inner = error;
    while let Some(source) = inner.source() {
        inner = source;
    }
    inner.to_string()
}
