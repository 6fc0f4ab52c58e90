//! Task that owns the scheduler. It handles commands, commits the resulting changes, and only then sends replies,
//! events and messages.
//!
//! Waiting commands are handled together and committed in one transaction (group commit).

use crate::convert;
use crate::fail_point;
use crate::journal::Journal;
use crate::limits::GROUP;
use crate::live::Live;
use crate::metrics::Metrics;
use crate::record::{JobId, JobRecord};
use crate::scheduler::{
    self, Action, AssignmentId, Census, Completed, Demand, Detail, Greeting, NewJob, Now, RefusedResult, Scheduler,
    SessionId, Verdict, WorkerId, WorkerView,
};
use crate::store::{Store, StoreError};
use proto::v1::{self, coordinator_message};
use sim_core::base::digest::Digest;
use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::sync::{mpsc, oneshot};
use tokio::time::Instant;

/// Reason why a job was not accepted.
pub(crate) enum SubmitError {
    /// The request id belongs to another job.
    OtherBody(JobId),
    /// The limit on active jobs is reached.
    TooMany,
}

/// Command to the actor. A `reply` is sent once all changes that it reports are committed.
pub(crate) enum Command {
    Submit {
        new: Box<NewJob>,
        reply: oneshot::Sender<Result<(JobRecord, bool), SubmitError>>,
    },
    Cancel {
        id: JobId,
        reply: oneshot::Sender<Option<JobRecord>>,
    },
    Pause {
        id: JobId,
        paused: bool,
        reply: oneshot::Sender<Option<JobRecord>>,
    },
    Workers {
        reply: oneshot::Sender<Vec<WorkerView>>,
    },
    Demand {
        reply: oneshot::Sender<Demand>,
    },
    Standing {
        ids: Vec<JobId>,
        reply: oneshot::Sender<Vec<Standing>>,
    },
    Detail {
        id: JobId,
        reply: oneshot::Sender<Option<Detail>>,
    },
    /// Asks if an active job needs one of these engines.
    Needs {
        engines: Vec<Digest>,
        reply: oneshot::Sender<bool>,
    },
    Census {
        reply: oneshot::Sender<Census>,
    },
    Connect {
        greeting: Greeting,
        outbox: mpsc::UnboundedSender<v1::CoordinatorMessage>,
        reply: oneshot::Sender<SessionId>,
    },
    Session {
        worker: WorkerId,
        session: SessionId,
        event: SessionEvent,
    },
    Complete {
        completed: Completed,
        reply: oneshot::Sender<Result<Verdict, RefusedResult>>,
    },
    /// Compares a result of a round before the newest sealed round with the stored digests of its round.
    Compare {
        completed: Completed,
        sealed: Vec<Digest>,
        reply: oneshot::Sender<Result<Verdict, RefusedResult>>,
    },
    Stop,
}

/// Event in the session of a connected worker.
pub(crate) enum SessionEvent {
    Heartbeat {
        running: Vec<AssignmentId>,
        progress: Vec<u64>,
    },
    Reject {
        assignment: AssignmentId,
        reason: String,
    },
    Drain {
        finishing: Vec<AssignmentId>,
    },
    Disconnect,
    /// The token of the worker is revoked, so its session ends.
    Expel {
        reason: String,
    },
}

/// State of an active job that its record does not hold.
pub(crate) struct Standing {
    /// Current record; `None` after the end of the job.
    pub record: Option<JobRecord>,
    /// Reason why no task runs; `None` if tasks can run.
    pub waits_for: Option<String>,
    /// Number of done tasks and of all tasks of the current round.
    pub round: Option<(u32, u32)>,
}

/// Ids of a result, for the log.
struct About {
    worker: WorkerId,
    job: JobId,
    assignment: u64,
}

impl About {
    fn of(completed: &Completed) -> Self {
        let Completed { worker, job, assignment, .. } = completed;
        Self { worker: worker.clone(), job: job.clone(), assignment: assignment.0 }
    }
}

type Reply = Box<dyn FnOnce() + Send>;

/// Clock with the times that the scheduler needs.
pub(crate) struct Clock(Instant);

impl Clock {
    pub fn start() -> Self {
        Self(Instant::now())
    }

    pub fn now(&self) -> Now {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Now { since_start: self.0.elapsed(), unix_ms: unix.as_millis() as i64 }
    }

    fn at(&self, since_start: Duration) -> Instant {
        self.0 + since_start
    }
}

pub(crate) struct Actor {
    pub scheduler: Scheduler,
    pub store: Arc<dyn Store>,
    pub epoch: u64,
    pub lease: Duration,
    pub heartbeat: Duration,
    pub clock: Clock,
    pub live: Live,
    pub sessions: HashMap<WorkerId, (SessionId, mpsc::UnboundedSender<v1::CoordinatorMessage>)>,
    pub metrics: Arc<Metrics>,
    pub journal: Journal,
}

impl Actor {
    /// Runs until a stop command, or until the store fails. After a failure the state in memory is ahead of the store,
    /// so the coordinator has to restart from the store.
    pub async fn run(mut self, mut commands: mpsc::Receiver<Command>) -> Result<(), StoreError> {
        self.flush(Vec::new()).await?;
        let mut stopping = false;
        let mut looked = self.clock.now().since_start;
        while !stopping {
            let deadline = self.scheduler.next_deadline();
            let tick = async {
                match deadline {
                    Some(at) => tokio::time::sleep_until(self.clock.at(at)).await,
                    None => std::future::pending().await,
                }
            };
            let (mut next, ticks) = tokio::select! {
                command = commands.recv() => (Some(command.unwrap_or(Command::Stop)), false),
                () = tick => (None, true),
                // Wakes up regularly to measure for how long this task did not run.
                () = tokio::time::sleep(self.heartbeat / 2) => (None, false),
            };
            let now = self.clock.now();
            let unheard = now.since_start.saturating_sub(looked);
            looked = now.since_start;
            if unheard > self.heartbeat {
                tracing::warn!(seconds = unheard.as_secs_f64(), "the coordinator did not run for a while");
                scheduler::on_standstill(&mut self.scheduler, unheard);
            }
            if ticks {
                scheduler::on_tick(&mut self.scheduler, now);
            }
            let (mut replies, mut handled) = (Vec::new(), 0);
            while let Some(command) = next {
                stopping |= matches!(command, Command::Stop);
                self.handle(command, &mut replies).await?;
                // Counts commands, not replies: heartbeats have no replies, so a stream of them would never end the
                // group.
                handled += 1;
                next = if handled < GROUP { commands.try_recv().ok() } else { None };
            }
            self.flush(replies).await?;
        }
        for (_, outbox) in self.sessions.values() {
            let drain = v1::Drain { reason: "the coordinator is stopping".to_owned(), finishing: Vec::new() };
            let _ = outbox.send(message(coordinator_message::Message::Drain(drain)));
        }
        Ok(())
    }

    /// Handles a command, and adds its reply to `replies`.
    async fn handle(&mut self, command: Command, replies: &mut Vec<Reply>) -> Result<(), StoreError> {
        let now = self.clock.now();
        match command {
            Command::Submit { new, reply } => {
                // Jobs that were submitted or ended a moment ago must be in the store before it is queried.
                self.flush(std::mem::take(replies)).await?;
                let answer = match self.store.job_of_request(&new.request_id).await? {
                    Some(record) if record.request_digest == new.request_digest => Ok((record, false)),
                    Some(record) => Err(SubmitError::OtherBody(record.id)),
                    None if self.scheduler.active_jobs() >= crate::limits::MAX_ACTIVE_JOBS => Err(SubmitError::TooMany),
                    None => Ok((scheduler::on_submit(&mut self.scheduler, now, *new), true)),
                };
                later(replies, reply, answer);
            }
            Command::Cancel { id, reply } => {
                let record = scheduler::on_cancel(&mut self.scheduler, now, &id);
                later(replies, reply, record);
            }
            Command::Pause { id, paused, reply } => {
                let record = scheduler::on_pause(&mut self.scheduler, now, &id, paused);
                later(replies, reply, record);
            }
            Command::Workers { reply } => later(replies, reply, scheduler::workers(&self.scheduler)),
            Command::Demand { reply } => later(replies, reply, scheduler::demand(&self.scheduler)),
            Command::Standing { ids, reply } => {
                let standing = |id| Standing {
                    record: self.scheduler.job(id).cloned(),
                    waits_for: scheduler::waits_for(&self.scheduler, id),
                    round: self.scheduler.round(id),
                };
                later(replies, reply, ids.iter().map(standing).collect());
            }
            Command::Detail { id, reply } => later(replies, reply, scheduler::detail(&self.scheduler, now, &id)),
            Command::Needs { engines, reply } => later(replies, reply, self.scheduler.needs(&engines)),
            Command::Census { reply } => later(replies, reply, scheduler::census(&self.scheduler)),
            Command::Connect { greeting, outbox, reply } => {
                let session = self.open_session(now, greeting, outbox);
                later(replies, reply, session);
            }
            Command::Session { worker, session, event } => self.handle_session(now, &worker, session, event),
            Command::Complete { completed, reply } => {
                let about = About::of(&completed);
                let verdict = scheduler::on_result(&mut self.scheduler, now, completed);
                self.judged(&about, &verdict);
                later(replies, reply, verdict);
            }
            Command::Compare { completed, sealed, reply } => {
                let about = About::of(&completed);
                let verdict = scheduler::on_compare(&mut self.scheduler, now, completed, &sealed);
                self.judged(&about, &verdict);
                later(replies, reply, verdict);
            }
            Command::Stop => {}
        }
        Ok(())
    }

    /// Connects a worker and sends it the welcome.
    fn open_session(
        &mut self,
        now: Now,
        greeting: Greeting,
        outbox: mpsc::UnboundedSender<v1::CoordinatorMessage>,
    ) -> SessionId {
        let worker = greeting.worker.clone();
        let Greeting { name, address, slots, running, .. } = &greeting;
        tracing::info!(%worker, name, peer = address, slots, running = running.len(), "worker connected");
        let welcome = scheduler::on_connect(&mut self.scheduler, now, greeting);
        // Sent before all other messages of this session.
        let _ = outbox.send(convert::welcome(&welcome, self.epoch, self.lease, self.heartbeat));
        self.sessions.insert(worker, (welcome.session, outbox));
        welcome.session
    }

    /// Handles an event in the session of a worker. It has no reply.
    fn handle_session(&mut self, now: Now, worker: &WorkerId, session: SessionId, event: SessionEvent) {
        match event {
            SessionEvent::Heartbeat { running, progress } => {
                if !scheduler::on_heartbeat(&mut self.scheduler, now, worker, session, &running, &progress) {
                    // The lease has expired, so the worker has to connect again.
                    self.hang_up(worker, session);
                }
            }
            SessionEvent::Reject { assignment, reason } => {
                tracing::warn!(%worker, assignment = assignment.0, reason, "assignment rejected");
                scheduler::on_return(&mut self.scheduler, now, worker, session, assignment);
            }
            SessionEvent::Drain { finishing } => {
                tracing::info!(%worker, finishing = finishing.len(), "worker drains");
                scheduler::on_drain(&mut self.scheduler, now, worker, session, &finishing);
            }
            SessionEvent::Disconnect => {
                tracing::info!(%worker, "worker disconnected");
                self.hang_up(worker, session);
                scheduler::on_disconnect(&mut self.scheduler, now, worker, session);
            }
            SessionEvent::Expel { reason } => {
                tracing::warn!(%worker, reason, "worker expelled");
                self.hang_up(worker, session);
                scheduler::on_expel(&mut self.scheduler, now, worker, session);
            }
        }
    }

    /// Logs and counts the verdict on a result.
    fn judged(&self, About { worker, job, assignment }: &About, verdict: &Result<Verdict, RefusedResult>) {
        match verdict {
            // Counted after the comparison with the stored digests.
            Ok(Verdict::Older) => return,
            Ok(Verdict::Conflict) => {
                tracing::error!(%worker, %job, assignment, "result differs from the committed result");
            }
            Ok(verdict) => tracing::debug!(%worker, %job, assignment, verdict = verdict.word(), "result"),
            Err(refused) => tracing::warn!(%worker, %job, assignment, %refused, "result refused"),
        }
        self.metrics.result(verdict.as_ref().map_or("refused", |verdict| verdict.word()));
    }

    fn hang_up(&mut self, worker: &WorkerId, session: SessionId) {
        if self.sessions.get(worker).is_some_and(|(s, _)| *s == session) {
            self.sessions.remove(worker);
        }
    }

    /// Commits the pending changes, then sends replies, events and messages.
    async fn flush(&mut self, replies: Vec<Reply>) -> Result<(), StoreError> {
        for note in self.scheduler.take_notes() {
            self.journal.note(&note);
        }
        let actions = self.scheduler.take_actions();
        let writes: Vec<_> = actions
            .iter()
            .filter_map(|a| if let Action::Write(write) = a { Some((**write).clone()) } else { None })
            .collect();
        if !writes.is_empty() {
            self.metrics.commit_writes.observe(writes.len() as f64);
            let begun = Instant::now();
            fail_point::reached("before-commit");
            self.store.commit(self.epoch, writes).await.inspect_err(|error| {
                self.metrics.store_errors.inc();
                tracing::error!(epoch = self.epoch, %error, "commit failed");
            })?;
            fail_point::reached("after-commit");
            self.metrics.commit_seconds.observe(begun.elapsed().as_secs_f64());
        }
        for action in actions {
            match action {
                Action::Write(write) => {
                    self.journal.written(&write);
                    for event in write.events() {
                        if let Some(record) = write.record() {
                            self.live.publish(&record.id, || convert::event(record, event));
                        }
                    }
                }
                Action::Publish(record, event) => {
                    self.live.publish(&record.id, || convert::event(&record, &event));
                }
                Action::Send(worker, session, content) => {
                    if let Some((_, outbox)) = self.sessions.get(&worker).filter(|(s, _)| *s == session) {
                        // A broken session reports its end by itself.
                        let _ = outbox.send(convert::message(content));
                    }
                }
            }
        }
        replies.into_iter().for_each(|reply| reply());
        Ok(())
    }
}

fn later<T: Send + 'static>(replies: &mut Vec<Reply>, reply: oneshot::Sender<T>, value: T) {
    replies.push(Box::new(move || {
        // The receiver may no longer exist.
        let _ = reply.send(value);
    }));
}

fn message(content: coordinator_message::Message) -> v1::CoordinatorMessage {
    v1::CoordinatorMessage { message: Some(content) }
}

#[cfg(test)]
mod tests;
