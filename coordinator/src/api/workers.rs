//! WorkerService: calls of workers.

use super::{Api, hello, id, printable, stopping, store_failed};
use crate::access::CallPermit;
use crate::actor::{Command, SessionEvent};
use crate::convert;
use crate::limits::{HELLO_WITHIN, MAX_RUNNING};
use crate::scheduler::{
    AssignmentId, Caller, Completed, Delivery, RefusedResult, SessionId, Verdict, WorkerId, host_of,
};
use crate::store::StoreError;
use proto::ConvertError;
use proto::limits::MAX_REASON;
use proto::v1::worker_service_server::WorkerService;
use proto::v1::{CompleteRequest, CompleteResponse, CoordinatorMessage, Heartbeat, WorkerMessage, worker_message};
use std::pin::Pin;
use tokio::sync::{mpsc, oneshot};
use tokio_stream::wrappers::UnboundedReceiverStream;
use tokio_stream::{Stream, StreamExt as _};
use tonic::{Request, Response, Status, Streaming};

#[tonic::async_trait]
impl WorkerService for Api {
    type SessionStream = Pin<Box<dyn Stream<Item = Result<CoordinatorMessage, Status>> + Send>>;

    async fn session(
        &self,
        request: Request<Streaming<WorkerMessage>>,
    ) -> Result<Response<Self::SessionStream>, Status> {
        let waiting = self.gates.hellos.pass()?;
        let address = request.remote_addr().map(|a| a.to_string()).unwrap_or_default();
        let pass = CallPermit::of(request.extensions());
        let mut inbound = request.into_inner();
        let first = tokio::time::timeout(HELLO_WITHIN, inbound.message()).await.map_err(|_| {
            Status::deadline_exceeded(format!("the worker sent no Hello within {} s", HELLO_WITHIN.as_secs()))
        })??;
        let Some(WorkerMessage { message: Some(worker_message::Message::Hello(hello)) }) = first else {
            return Err(Status::failed_precondition("the first message of a session must be Hello"));
        };
        let greeting = hello::check(hello, address, pass.credential())?;
        let worker = greeting.worker.clone();
        if !hello::is_of_build(&greeting, &self.engines) {
            // After an upgrade some workers may still be of the build that an active job needs.
            let engines = greeting.engines.clone();
            if !self.ask(|reply| Command::Needs { engines, reply }).await? {
                return Err(hello::other_build(&greeting, &self.engines));
            }
            tracing::info!(%worker, version = greeting.version, "worker of another build accepted: a job needs its engine");
        }
        let place = self.gates.sessions.pass()?;
        drop(waiting);
        let (outbox, messages) = mpsc::unbounded_channel();
        let messages = pass.clone().over(UnboundedReceiverStream::new(messages).map(Ok));
        let api = self.clone();
        let (connected, welcomed) = oneshot::channel();
        // A task of its own: a worker that disconnects before the welcome must be handled as disconnected, too.
        tokio::spawn(async move {
            let session = api.ask(|reply| Command::Connect { greeting, outbox, reply }).await;
            let _ = connected.send(session.clone().map(drop));
            if let Ok(session) = session {
                api.listen(inbound, pass, worker, session).await;
            }
            drop(place);
        });
        welcomed.await.map_err(|_| stopping())??;
        Ok(Response::new(Box::pin(messages)))
    }

    async fn complete(&self, request: Request<CompleteRequest>) -> Result<Response<CompleteResponse>, Status> {
        let address = request.remote_addr().map(|a| a.to_string()).unwrap_or_default();
        let caller =
            Caller { host: host_of(&address).into(), credential: CallPermit::of(request.extensions()).credential() };
        let completed = completed(request.into_inner(), caller)?;
        let late = completed.clone();
        let mut verdict = self.ask(|reply| Command::Complete { completed, reply }).await?.map_err(refused)?;
        if verdict == Verdict::Older {
            verdict = self.compare(late).await?;
        }
        Ok(Response::new(CompleteResponse { verdict: convert::verdict(verdict).into() }))
    }
}

fn refused(refused: RefusedResult) -> Status {
    Status::invalid_argument(refused.to_string())
}

impl Api {
    /// Compares a result of a round before the newest sealed round with the digests in the store.
    async fn compare(&self, completed: Completed) -> Result<Verdict, Status> {
        let (job, round) = (&completed.job, completed.range.round);
        let sealed = self.store.digests(job, round).await.map_err(store_failed)?;
        let missing = || StoreError::Corrupt { what: format!("round {round} of job {job} is missing") };
        let sealed = sealed.ok_or_else(missing).map_err(store_failed)?;
        self.ask(|reply| Command::Compare { completed, sealed, reply }).await?.map_err(refused)
    }

    /// Forwards the messages of a worker to the actor, until its connection ends or its token is revoked.
    async fn listen(
        &self,
        mut inbound: Streaming<WorkerMessage>,
        mut pass: CallPermit,
        worker: WorkerId,
        session: SessionId,
    ) {
        let mut stop = self.stopping.clone();
        loop {
            let received = tokio::select! {
                received = inbound.message() => match received {
                    Ok(Some(message)) => Ok(Some(message)),
                    // After a revocation the message stream to the worker ends, and the worker disconnects. That is not
                    // a crash.
                    Ok(None) | Err(_) => pass.check().map(|()| None),
                },
                status = pass.ended() => Err(status),
                _ = stop.wait_for(|stop| *stop) => return,
            };
            let received = match received {
                Ok(received) => received,
                Err(status) => {
                    let reason = status.message().to_owned();
                    // The actor may have stopped.
                    let event = SessionEvent::Expel { reason };
                    let _ = self.commands.send(Command::Session { worker, session, event }).await;
                    return;
                }
            };
            let event = match received {
                Some(WorkerMessage { message: Some(message) }) => match message {
                    worker_message::Message::Heartbeat(Heartbeat { running: named, progress: told })
                        if named.len().max(told.len()) > MAX_RUNNING =>
                    {
                        tracing::warn!(%worker, running = named.len(), told = told.len(), MAX_RUNNING, "malformed heartbeat: session closed");
                        SessionEvent::Disconnect
                    }
                    worker_message::Message::Drain(drain) if drain.finishing.len() > MAX_RUNNING => {
                        tracing::warn!(%worker, finishing = drain.finishing.len(), MAX_RUNNING, "malformed drain message: session closed");
                        SessionEvent::Disconnect
                    }
                    worker_message::Message::Heartbeat(heartbeat) => {
                        let running = heartbeat.running.into_iter().map(AssignmentId).collect();
                        SessionEvent::Heartbeat { running, progress: heartbeat.progress }
                    }
                    worker_message::Message::Reject(reject) => SessionEvent::Reject {
                        assignment: AssignmentId(reject.assignment_id),
                        reason: shortened(reject.reason),
                    },
                    worker_message::Message::Drain(drain) => {
                        let finishing = drain.finishing.into_iter().map(AssignmentId).collect();
                        SessionEvent::Drain { finishing }
                    }
                    // A repeated Hello is ignored.
                    worker_message::Message::Hello(_) => continue,
                },
                // A message of a later version is ignored.
                Some(WorkerMessage { message: None }) => continue,
                None => {
                    let event = SessionEvent::Disconnect;
                    let _ = self.commands.send(Command::Session { worker, session, event }).await;
                    return;
                }
            };
            let command = Command::Session { worker: worker.clone(), session, event };
            if self.commands.send(command).await.is_err() {
                return;
            }
        }
    }
}

/// Checks the fields of a worker's result that can be checked without its job.
pub(crate) fn completed(request: CompleteRequest, caller: Caller) -> Result<Completed, Status> {
    id("worker_id", &request.worker_id)?;
    printable("worker_id", &request.worker_id)?;
    id("job_id", &request.job_id)?;
    let mut completed =
        convert::completed(request, caller).map_err(|e: ConvertError| Status::invalid_argument(e.to_string()))?;
    if let Delivery::Failure(reason) = &mut completed.delivery {
        *reason = shortened(std::mem::take(reason));
    }
    Ok(completed)
}

/// Shortens a worker's text to [`MAX_REASON`] bytes and replaces control characters other than newlines.
fn shortened(mut reason: String) -> String {
    let end = (0..=MAX_REASON).rev().find(|i| reason.is_char_boundary(*i)).unwrap_or(0);
    reason.truncate(end);
    if reason.contains(|c: char| c.is_control() && c != '\n') {
        reason = reason.replace(|c: char| c.is_control() && c != '\n', "\u{fffd}");
    }
    reason
}
