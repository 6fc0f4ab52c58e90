//! Session with the coordinator. It is reopened after each break; assignments and results are kept meanwhile.

use crate::error::Error;
use crate::intake::Intake;
use crate::jobs::Forgotten;
use crate::metrics::Metrics;
use proto::PROTOCOL;
use proto::dial::{Backoff, FailoverChannel};
use proto::limits::MAX_MESSAGE;
use proto::v1::worker_service_client::WorkerServiceClient;
use proto::v1::{CoordinatorMessage, Drain, Hello, Welcome, WorkerMessage, coordinator_message, worker_message};
use std::error::Error as _;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::mpsc::{UnboundedSender, unbounded_channel};
use tokio::sync::watch;
use tokio_stream::wrappers::UnboundedReceiverStream;
use tonic::{Code, Status, Streaming};

/// Shortest time between two heartbeats; a shorter time requested by the coordinator is raised to it.
const LEAST_HEARTBEAT: Duration = Duration::from_millis(10);

/// Stage of the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// Accepts assignments.
    Working,
    /// Finishes its assignments, for the given reason. Sent again after some of them were returned.
    Draining(&'static str),
    /// Closes the connection.
    Leaving,
}

pub(crate) struct Session {
    pub way: FailoverChannel,
    pub id: String,
    pub name: String,
    pub slots: u32,
    /// Time at which the worker ends by itself.
    pub end: Option<Instant>,
    /// Time without progress after which a slot is stuck.
    pub stuck_after: Duration,
    pub intake: Intake,
    pub metrics: Arc<Metrics>,
    pub stage: watch::Receiver<Stage>,
}

/// Open connection.
struct Connection {
    said: UnboundedSender<WorkerMessage>,
    incoming: Streaming<CoordinatorMessage>,
    heartbeat: Duration,
}

impl Session {
    /// Connects, runs the session, and reconnects, until the worker leaves or the coordinator refuses it.
    pub async fn keep(&mut self) -> Result<(), Error> {
        let mut backoff = Backoff::new();
        let (mut told, mut known) = (false, false);
        let mut stage = self.stage.clone();
        loop {
            // Copied now: a failure makes `dial` select the next address.
            let url = self.way.dial().current().to_owned();
            let connected = tokio::select! {
                connected = self.connect(&url) => connected,
                () = leaving(&mut stage) => return Ok(()),
            };
            let ended = match connected {
                Ok(connection) => {
                    known = true;
                    backoff.reset();
                    let ended = self.converse(connection).await;
                    self.metrics.connected.set(0);
                    ended
                }
                Err(status) => Err(status),
            };
            if *stage.borrow() == Stage::Leaving {
                return Ok(());
            }
            match ended {
                Ok(()) => {
                    tracing::info!(url, "the connection ended: reconnecting");
                    told = false;
                }
                // A proxy answers UNIMPLEMENTED while the coordinator behind it is away. After a successful connection
                // it is no refusal.
                Err(status) if refusal(status.code()) && !(known && status.code() == Code::Unimplemented) => {
                    return Err(Error::Refused { url, reason: status.message().to_owned() });
                }
                Err(status) => {
                    // Logged once per outage.
                    if !told {
                        let reason = status.source().map_or(status.message().to_owned(), proto::dial::reason);
                        tracing::info!(url, reason, "waiting for the coordinator");
                    }
                    told = true;
                }
            }
            tokio::select! {
                () = backoff.wait() => {}
                () = leaving(&mut stage) => return Ok(()),
            }
        }
    }

    /// Connects: sends Hello and waits for Welcome.
    async fn connect(&mut self, url: &str) -> Result<Connection, Status> {
        let mut client = WorkerServiceClient::new(self.way.clone())
            .max_decoding_message_size(MAX_MESSAGE)
            .max_encoding_message_size(MAX_MESSAGE);
        let (said, outgoing) = unbounded_channel();
        // Assignments that still wait for their job are not in Hello, so the coordinator assigns their tasks again.
        self.intake.waiting.clear();
        let left = self.end.map(|end| end.saturating_duration_since(Instant::now()).as_secs().max(1));
        let hello = Hello {
            protocol: PROTOCOL,
            worker_id: self.id.clone(),
            name: self.name.clone(),
            slots: self.slots,
            engine_digests: self.intake.engines.to_wire(),
            running: self.intake.assignments.running(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            seconds_left: left.unwrap_or(0),
            stuck_after_ms: self.stuck_after.as_millis() as u64,
        };
        say(&said, worker_message::Message::Hello(hello));
        let mut incoming = client.session(UnboundedReceiverStream::new(outgoing)).await?.into_inner();
        let welcome = match incoming.message().await? {
            Some(m) => m.message,
            None => return Err(Status::unavailable("the coordinator closed the connection before its Welcome")),
        };
        let Some(coordinator_message::Message::Welcome(Welcome { drop, heartbeat_ms, epoch, .. })) = welcome else {
            return Err(Status::unavailable("the coordinator's first message is not Welcome"));
        };
        self.metrics.connected.set(1);
        self.metrics.sessions.inc();
        tracing::info!(worker = self.id, url, slots = self.slots, epoch, "connected");
        self.intake.stop(&drop);
        let heartbeat = Duration::from_millis(heartbeat_ms.into()).max(LEAST_HEARTBEAT);
        Ok(Connection { said, incoming, heartbeat })
    }

    /// Runs the session from Welcome to the connection's end. An error is a refusal.
    async fn converse(&mut self, connection: Connection) -> Result<(), Status> {
        let Connection { said, mut incoming, heartbeat } = connection;
        let mut heartbeat = tokio::time::interval(heartbeat);
        heartbeat.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let mut stage = self.stage.clone();
        self.say_drain(&said);
        loop {
            let received = tokio::select! {
                received = incoming.message() => received,
                _ = heartbeat.tick() => {
                    say(&said, worker_message::Message::Heartbeat(self.intake.heartbeat()));
                    continue;
                }
                Some((id, opened)) = self.intake.jobs.next() => {
                    for reject in self.intake.opened(&id, opened) {
                        say(&said, worker_message::Message::Reject(reject));
                    }
                    continue;
                }
                Ok(()) = stage.changed() => {
                    self.say_drain(&said);
                    if *stage.borrow() != Stage::Leaving {
                        continue;
                    }
                    // The peer ends the stream after it has received the last messages.
                    drop(said);
                    while let Ok(Some(_)) = incoming.message().await {}
                    return Ok(());
                }
            };
            match received {
                Ok(Some(content)) => match content.message {
                    // Sent before the coordinator received this worker's Drain: repeat it.
                    Some(coordinator_message::Message::Assign(_)) if *stage.borrow() != Stage::Working => {
                        self.say_drain(&said);
                    }
                    Some(coordinator_message::Message::Assign(assign)) => match self.intake.assigned(assign) {
                        Ok(None) => {}
                        Ok(Some(reject)) => say(&said, worker_message::Message::Reject(reject)),
                        Err(Forgotten) => return Ok(()),
                    },
                    Some(coordinator_message::Message::Cancel(cancel)) => self.intake.stop(&cancel.assignment_ids),
                    // The coordinator restarts: computing continues, and results are delivered afterwards.
                    Some(coordinator_message::Message::Drain(drain)) => {
                        tracing::info!(reason = drain.reason, "the coordinator is stopping")
                    }
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

    /// Sends Drain if the worker drains: returns all assignments that no slot has started, and lists those that it
    /// finishes.
    fn say_drain(&mut self, said: &UnboundedSender<WorkerMessage>) {
        let reason = match *self.stage.borrow() {
            Stage::Working => return,
            Stage::Draining(reason) => reason,
            Stage::Leaving => "it ends",
        };
        self.intake.stop_waiting();
        let finishing = self.intake.assignments.ids();
        say(said, worker_message::Message::Drain(Drain { reason: reason.to_owned(), finishing }));
    }
}

/// Waits until the worker leaves.
async fn leaving(stage: &mut watch::Receiver<Stage>) {
    // An error means that the sender is gone: the worker has ended.
    let _ = stage.wait_for(|stage| *stage == Stage::Leaving).await;
}

/// Returns true for codes by which a coordinator refuses this worker permanently.
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
    // A broken connection is detected by the receiving side.
    let _ = said.send(WorkerMessage { message: Some(content) });
}
