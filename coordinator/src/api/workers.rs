//! WorkerService: what a worker says to the coordinator.

use super::{Api, hello, id, printable, stopping};
use crate::access::Pass;
use crate::actor::Command;
use crate::limits::{HELLO_WITHIN, MAX_RUNNING};
use crate::record::JobId;
use crate::scheduler::{AssignmentId, Completed, Delivery, Outcome, SessionId, Verdict, WorkerId};
use proto::limits::MAX_REASON;
use proto::v1::worker_service_server::WorkerService;
use proto::v1::{
    CompleteRequest, CompleteResponse, CoordinatorMessage, Heartbeat, WorkerMessage, complete_request,
    complete_response, worker_message,
};
use sim_core::base::score::Counts;
use std::pin::Pin;
use std::time::Duration;
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
        let pass = Pass::of(request.extensions());
        let mut inbound = request.into_inner();
        let first = tokio::time::timeout(HELLO_WITHIN, inbound.message()).await.map_err(|_| {
            Status::deadline_exceeded(format!("the worker did not say Hello within {} s", HELLO_WITHIN.as_secs()))
        })??;
        let Some(WorkerMessage { message: Some(worker_message::Message::Hello(hello)) }) = first else {
            return Err(Status::failed_precondition("a session starts with Hello"));
        };
        let greeting = hello::check(hello, address)?;
        let worker = greeting.worker.clone();
        if !hello::is_of_build(&greeting, &self.engines) {
            // Whoever upgrades in mid-job leaves some workers as they were.
            let engines = greeting.engines.clone();
            if !self.ask(|reply| Command::Needs { engines, reply }).await? {
                return Err(hello::other_build(&greeting, &self.engines));
            }
            tracing::info!(%worker, version = greeting.version, "a worker of another build: a job needs its engine");
        }
        let place = self.gates.sessions.pass()?;
        drop(waiting);
        let (outbox, messages) = mpsc::unbounded_channel();
        let messages = pass.clone().over(UnboundedReceiverStream::new(messages).map(Ok));
        let api = self.clone();
        let (connected, welcomed) = oneshot::channel();
        // Of its own: whoever hangs up before the welcome must be missed, too.
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
        let completed = completed(request.into_inner())?;
        let late = completed.clone();
        let mut verdict = self.ask(|reply| Command::Complete { completed, reply }).await?;
        if verdict == Verdict::Older {
            verdict = self.compare(late).await?;
        }
        let verdict = match verdict {
            Verdict::Accepted => complete_response::Verdict::Accepted,
            Verdict::Duplicate => complete_response::Verdict::Duplicate,
            Verdict::Conflict => complete_response::Verdict::Conflict,
            Verdict::Obsolete | Verdict::Older => complete_response::Verdict::Obsolete,
            Verdict::Unknown => complete_response::Verdict::Unknown,
            Verdict::Quarantined => complete_response::Verdict::Quarantined,
        };
        Ok(Response::new(CompleteResponse { verdict: verdict.into() }))
    }
}

impl Api {
    /// Passes on what a worker says, until its connection ends or its token is taken away.
    async fn listen(
        &self,
        mut inbound: Streaming<WorkerMessage>,
        mut pass: Pass,
        worker: WorkerId,
        session: SessionId,
    ) {
        let mut stop = self.stopping.clone();
        loop {
            let received = tokio::select! {
                received = inbound.message() => match received {
                    Ok(Some(message)) => Ok(Some(message)),
                    // Without its token it hears no more, and hangs up: that must not be taken for a crash.
                    Ok(None) | Err(_) => pass.check().map(|()| None),
                },
                status = pass.ended() => Err(status),
                _ = stop.wait_for(|stop| *stop) => return,
            };
            let received = match received {
                Ok(received) => received,
                Err(status) => {
                    let reason = status.message().to_owned();
                    // If the actor has gone there is nothing to take back.
                    let _ = self.commands.send(Command::Expel { worker, session, reason }).await;
                    return;
                }
            };
            let worker = worker.clone();
            let command = match received {
                Some(WorkerMessage { message: Some(message) }) => match message {
                    worker_message::Message::Heartbeat(Heartbeat { running: named, progress: told })
                        if named.len().max(told.len()) > MAX_RUNNING =>
                    {
                        tracing::warn!(%worker, running = named.len(), told = told.len(), MAX_RUNNING, "not a worker of ours");
                        Command::Disconnect { worker, session }
                    }
                    worker_message::Message::Drain(drain) if drain.finishing.len() > MAX_RUNNING => {
                        tracing::warn!(%worker, finishing = drain.finishing.len(), MAX_RUNNING, "not a worker of ours");
                        Command::Disconnect { worker, session }
                    }
                    worker_message::Message::Heartbeat(heartbeat) => {
                        let running = heartbeat.running.into_iter().map(AssignmentId).collect();
                        Command::Heartbeat { worker, session, running, progress: heartbeat.progress }
                    }
                    worker_message::Message::Reject(reject) => Command::Reject {
                        worker,
                        session,
                        assignment: AssignmentId(reject.assignment_id),
                        reason: shortened(reject.reason),
                    },
                    worker_message::Message::Drain(drain) => {
                        let finishing = drain.finishing.into_iter().map(AssignmentId).collect();
                        Command::Drain { worker, session, finishing }
                    }
                    // Said once is enough.
                    worker_message::Message::Hello(_) => continue,
                },
                // A message of a later version.
                Some(WorkerMessage { message: None }) => continue,
                None => {
                    let _ = self.commands.send(Command::Disconnect { worker, session }).await;
                    return;
                }
            };
            if self.commands.send(command).await.is_err() {
                return;
            }
        }
    }
}

pub(crate) fn completed(request: CompleteRequest) -> Result<Completed, Status> {
    id("worker_id", &request.worker_id)?;
    printable("worker_id", &request.worker_id)?;
    id("job_id", &request.job_id)?;
    let invalid = |e: proto::ConvertError| Status::invalid_argument(e.to_string());
    let delivery = match request.result {
        None => return Err(invalid(proto::ConvertError::Missing { field: "result" })),
        Some(complete_request::Result::Evaluate(result)) => Delivery::Evaluations {
            generation: result.generation,
            first: result.first,
            outcomes: proto::evaluations(&result)
                .map_err(invalid)?
                .into_iter()
                .map(|e| Outcome::evaluation(e.score, e.counts))
                .collect(),
        },
        Some(complete_request::Result::Examine(result)) => {
            if !result.traces_json.is_empty() {
                let traces = serde_json::from_slice::<sim_core::report::Traces>(&result.traces_json);
                traces.map_err(|e| Status::invalid_argument(format!("traces_json can't be read: {e}")))?;
            }
            Delivery::Examination {
                round: result.round,
                index: result.index,
                outcome: Outcome {
                    scores: result.scores.iter().map(|s| s.score).collect(),
                    counts: result.counts.map(Counts::from).unwrap_or_default(),
                    traces: result.traces_json,
                },
            }
        }
        Some(complete_request::Result::Failure(reason)) => Delivery::Failure(shortened(reason)),
    };
    Ok(Completed {
        worker: WorkerId(request.worker_id.into()),
        assignment: AssignmentId(request.assignment_id),
        job: JobId::from(request.job_id.as_str()),
        engine: proto::digest("engine_digest", &request.engine_digest).map_err(invalid)?,
        compute: Duration::from_micros(request.compute_us),
        delivery,
    })
}

/// A worker's words for people: not too many of them, and nothing that steers a terminal.
fn shortened(mut reason: String) -> String {
    let end = (0..=MAX_REASON).rev().find(|i| reason.is_char_boundary(*i)).unwrap_or(0);
    reason.truncate(end);
    if reason.contains(|c: char| c.is_control() && c != '\n') {
        reason = reason.replace(|c: char| c.is_control() && c != '\n', "\u{fffd}");
    }
    reason
}
