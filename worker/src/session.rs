//! The connection to the coordinator: made again and again, and nothing is lost in between.

use crate::error::Error;
use crate::intake::Intake;
use crate::jobs::Forgotten;
use crate::metrics::Metrics;
use proto::PROTOCOL;
use proto::dial::{Backoff, Way};
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

/// Shortest time between two heartbeats; shorter requests of the coordinator are raised to it.
const LEAST_HEARTBEAT: Duration = Duration::from_millis(10);

/// Stage of the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// Takes work.
    Working,
    /// Finishes what it has, for a reason. Entered again when something of that is given back.
    Draining(&'static str),
    /// Has nothing left, and hangs up.
    Leaving,
}

pub(crate) struct Session {
    pub way: Way,
    pub id: String,
    pub name: String,
    pub slots: u32,
    /// When the worker ends by itself.
    pub end: Option<Instant>,
    /// When it calls a slot stuck.
    pub stuck_after: Duration,
    pub intake: Intake,
    pub metrics: Arc<Metrics>,
    pub stage: watch::Receiver<Stage>,
}

/// A connection that stands.
struct Connection {
    said: UnboundedSender<WorkerMessage>,
    incoming: Streaming<CoordinatorMessage>,
    heartbeat: Duration,
}

impl Session {
    /// Connects, works, and connects again, until the worker leaves or the coordinator refuses it.
    pub async fn keep(&mut self) -> Result<(), Error> {
        let mut backoff = Backoff::new();
        let (mut told, mut known) = (false, false);
        let mut stage = self.stage.clone();
        loop {
            // The one that this try is about: a failure makes the next try go elsewhere.
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
                    tracing::info!(url, "the connection ended: connecting again");
                    told = false;
                }
                // What was there before is not unknown to the coordinator: a proxy says so while it is away.
                Err(status) if refusal(status.code()) && !(known && status.code() == Code::Unimplemented) => {
                    return Err(Error::Refused { url, reason: status.message().to_owned() });
                }
                Err(status) => {
                    // Once is enough while nothing changes.
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

    /// From dialing to Welcome.
    async fn connect(&mut self, url: &str) -> Result<Connection, Status> {
        let mut client = WorkerServiceClient::new(self.way.clone())
            .max_decoding_message_size(MAX_MESSAGE)
            .max_encoding_message_size(MAX_MESSAGE);
        let (said, outgoing) = unbounded_channel();
        // What the connection before brought and is not yet taken up is not known here any more: it is assigned again.
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
            None => return Err(Status::unavailable("it hung up")),
        };
        let Some(coordinator_message::Message::Welcome(Welcome { drop, heartbeat_ms, epoch, .. })) = welcome else {
            return Err(Status::unavailable("it did not say Welcome"));
        };
        self.metrics.connected.set(1);
        self.metrics.sessions.inc();
        tracing::info!(worker = self.id, url, slots = self.slots, epoch, "connected");
        self.intake.stop(&drop);
        let heartbeat = Duration::from_millis(heartbeat_ms.into()).max(LEAST_HEARTBEAT);
        Ok(Connection { said, incoming, heartbeat })
    }

    /// From Welcome to the connection's end. An error is a refusal.
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
                    // The last words have arrived once the other side ends, too.
                    drop(said);
                    while let Ok(Some(_)) = incoming.message().await {}
                    return Ok(());
                }
            };
            match received {
                Ok(Some(content)) => match content.message {
                    // It crossed the word that this worker drains.
                    Some(coordinator_message::Message::Assign(_)) if *stage.borrow() != Stage::Working => {
                        self.say_drain(&said);
                    }
                    Some(coordinator_message::Message::Assign(assign)) => match self.intake.assigned(assign) {
                        Ok(None) => {}
                        Ok(Some(reject)) => say(&said, worker_message::Message::Reject(reject)),
                        Err(Forgotten) => return Ok(()),
                    },
                    Some(coordinator_message::Message::Cancel(cancel)) => self.intake.stop(&cancel.assignment_ids),
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

    /// If the worker drains: gives back what no slot has taken up, and says what it still finishes.
    fn say_drain(&mut self, said: &UnboundedSender<WorkerMessage>) {
        let reason = match *self.stage.borrow() {
            Stage::Working => return,
            Stage::Draining(reason) => reason,
            Stage::Leaving => "it leaves",
        };
        self.intake.stop_waiting();
        let finishing = self.intake.assignments.ids();
        say(said, worker_message::Message::Drain(Drain { reason: reason.to_owned(), finishing }));
    }
}

/// Waits until the worker leaves.
async fn leaving(stage: &mut watch::Receiver<Stage>) {
    // An error means that there is nothing left to wait for.
    let _ = stage.wait_for(|stage| *stage == Stage::Leaving).await;
}

/// Codes by which a coordinator refuses this worker for good.
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
    let _ = said.send(WorkerMessage { message: Some(content) });
}
