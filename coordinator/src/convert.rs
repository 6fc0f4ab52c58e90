//! Conversion between domain types and wire types. No other module of the coordinator uses both.

use crate::permit::Issued;
use crate::record::{Claim, Dispute, Event, JobEvent, JobId, JobRecord, JobState, MAX_TOLD_DISPUTES, Poisoned, Ruling};
use crate::scheduler::{
    AssignmentId, Caller, Completed, Delivery, Detail, Held, Message, Range, Running, Verdict, Welcome, WorkerId,
    WorkerView,
};
use proto::ConvertError;
use proto::v1::{self, complete_request, complete_response, coordinator_message, job_event};
use sim_core::base::digest::Digest;
use std::time::Duration;

/// Converts a job for clients. The progress of its round is added later, from the scheduler.
pub(crate) fn job(record: &JobRecord) -> v1::Job {
    let told = &record.disputes[record.disputes.len().saturating_sub(MAX_TOLD_DISPUTES)..];
    v1::Job {
        id: record.id.to_string(),
        name: record.name.clone(),
        state: state(record.state).into(),
        job_digest: record.job_digest.0.to_vec(),
        engine_digest: record.engine_digest.0.to_vec(),
        procedure: record.procedure.clone(),
        progress: Some((&record.progress).into()),
        rounds_sealed: record.rounds_sealed,
        reason: record.reason.clone(),
        submitted_at_ms: record.submitted_at_ms,
        started_at_ms: record.started_at_ms,
        ended_at_ms: record.ended_at_ms,
        last_event: record.last_event,
        priority: record.priority,
        tasks_done: 0,
        tasks_total: 0,
        paused: record.paused,
        restarted_from: record
            .restarted_from
            .as_ref()
            .map(|origin| v1::Origin { job_id: origin.job.to_string(), rounds: origin.rounds }),
        disputes: told.iter().map(dispute).collect(),
        poisoned: record.poisoned.as_ref().map(poisoned),
    }
}

/// Converts a job state for clients.
pub(crate) fn state(state: JobState) -> v1::JobState {
    match state {
        JobState::Queued => v1::JobState::Queued,
        JobState::Running => v1::JobState::Running,
        JobState::Waiting => v1::JobState::Waiting,
        JobState::Succeeded => v1::JobState::Succeeded,
        JobState::Failed => v1::JobState::Failed,
        JobState::Cancelled => v1::JobState::Cancelled,
        JobState::Tainted => v1::JobState::Tainted,
    }
}

/// Converts a job state from a client's request; `None` for an unknown one.
pub(crate) fn asked_state(wire: v1::JobState) -> Option<JobState> {
    JobState::ALL.into_iter().find(|known| state(*known) == wire)
}

fn poisoned(poisoned: &Poisoned) -> v1::Poisoned {
    let Poisoned { round, index, what, task, attempts } = poisoned;
    v1::Poisoned { round: *round, index: *index, what: what.clone(), task: task.clone(), attempts: *attempts }
}

fn dispute(dispute: &Dispute) -> v1::Dispute {
    let verdict = match dispute.ruling {
        None => v1::dispute::Verdict::Unspecified,
        Some(Ruling::Upheld) => v1::dispute::Verdict::Upheld,
        Some(Ruling::Corrected) => v1::dispute::Verdict::Corrected,
        Some(Ruling::Tainted) => v1::dispute::Verdict::Tainted,
    };
    let claim = |claim: &Claim| v1::Claim {
        worker_id: claim.source.finder.worker.to_string(),
        worker_name: claim.source.name.to_string(),
        digest: claim.digest.0.to_vec(),
        what: claim.what.clone(),
    };
    v1::Dispute {
        round: dispute.round,
        index: dispute.index,
        what: dispute.what.clone(),
        claims: dispute.claims.iter().map(claim).collect(),
        verdict: verdict.into(),
        at_ms: dispute.at_ms,
    }
}

/// Converts an event for clients, with the job as it was after the event.
pub(crate) fn event(record: &JobRecord, event: &JobEvent) -> v1::JobEvent {
    let what = match &event.event {
        Event::State(new) => job_event::Event::StateChanged(state(*new).into()),
        Event::Sealed { round, phase, row } => job_event::Event::RoundSealed(v1::RoundSealed {
            round: *round,
            phase: phase.clone(),
            row: row.as_ref().map(Into::into),
        }),
        Event::Done { round, done, total } => {
            job_event::Event::TasksDone(v1::TasksDone { round: *round, done: *done, total: *total })
        }
        Event::Paused(paused) => job_event::Event::Paused(*paused),
        Event::Dispute(told) => job_event::Event::Dispute(dispute(told)),
        Event::Waits(reason) => job_event::Event::Waits(reason.clone()),
    };
    let job = v1::Job { last_event: event.sequence, ..job(record) };
    v1::JobEvent { sequence: event.sequence, at_ms: event.at_ms, event: Some(what), job: Some(job) }
}

/// Returns true if events of this kind are stored. Progress events of the current round are not.
pub(crate) fn is_stored(event: &v1::JobEvent) -> bool {
    !matches!(event.event, Some(job_event::Event::TasksDone(_)))
}

/// Returns true if an event is the last one of its job: the change to a final state. The seal of the last round comes
/// before it and has the same job record.
pub(crate) fn is_last(event: &v1::JobEvent) -> bool {
    let Some(job_event::Event::StateChanged(new)) = event.event else { return false };
    v1::JobState::try_from(new).ok().and_then(asked_state).is_some_and(JobState::is_end)
}

/// Converts a message for a worker.
pub(crate) fn message(content: Message) -> v1::CoordinatorMessage {
    let content = match content {
        Message::Drain(reason) => coordinator_message::Message::Drain(v1::Drain { reason, finishing: Vec::new() }),
        Message::Cancel(ids) => coordinator_message::Message::Cancel(v1::Cancel { assignment_ids: numbers(&ids) }),
        Message::Assign(assign) => coordinator_message::Message::Assign(v1::Assign {
            assignment_id: assign.assignment.0,
            job_id: assign.job.to_string(),
            job_toml: assign.toml.map(|toml| toml.to_string()).unwrap_or_default(),
            round: assign.range.round,
            first: assign.range.first,
            tasks: assign.tasks,
            shared_digest: assign.shared_digest.0.to_vec(),
            shared: assign.shared.map(|shared| shared.to_vec()).unwrap_or_default(),
            permit: assign.permit,
        }),
    };
    v1::CoordinatorMessage { message: Some(content) }
}

/// Converts the reply to a worker's Hello.
pub(crate) fn welcome(welcome: &Welcome, epoch: u64, lease: Duration, heartbeat: Duration) -> v1::CoordinatorMessage {
    let welcome = v1::Welcome {
        epoch,
        lease_ms: lease.as_millis() as u32,
        heartbeat_ms: heartbeat.as_millis() as u32,
        keep: numbers(&welcome.keep),
        drop: numbers(&welcome.drop),
    };
    v1::CoordinatorMessage { message: Some(coordinator_message::Message::Welcome(welcome)) }
}

fn numbers(ids: &[AssignmentId]) -> Vec<u64> {
    ids.iter().map(|id| id.0).collect()
}

/// Converts a worker's result. Its texts are checked by the API.
pub(crate) fn completed(request: v1::CompleteRequest, caller: Caller) -> Result<Completed, ConvertError> {
    let delivery = match request.outcome {
        None => return Err(ConvertError::Missing { field: "outcome" }),
        Some(complete_request::Outcome::Results(results)) => {
            Delivery::Results(results.results.into_iter().map(Into::into).collect())
        }
        Some(complete_request::Outcome::Failure(reason)) => Delivery::Failure(reason),
    };
    Ok(Completed {
        worker: WorkerId(request.worker_id.into()),
        assignment: AssignmentId(request.assignment_id),
        job: JobId::from(request.job_id.as_str()),
        engine: proto::digest("engine_digest", &request.engine_digest)?,
        range: Range { round: request.round, first: request.first, count: request.count },
        permit: request.permit,
        compute: Duration::from_micros(request.compute_us),
        delivery,
        tasks: request.tasks,
        caller,
    })
}

/// Converts the verdict on a worker's result.
pub(crate) fn verdict(verdict: Verdict) -> complete_response::Verdict {
    match verdict {
        Verdict::Accepted => complete_response::Verdict::Accepted,
        Verdict::Duplicate => complete_response::Verdict::Duplicate,
        Verdict::Conflict => complete_response::Verdict::Conflict,
        Verdict::Obsolete | Verdict::Older => complete_response::Verdict::Obsolete,
        Verdict::Unknown => complete_response::Verdict::Unknown,
        Verdict::Quarantined => complete_response::Verdict::Quarantined,
        Verdict::NeedsTasks => complete_response::Verdict::NeedsTasks,
    }
}

/// Converts a worker for clients.
pub(crate) fn worker(view: WorkerView) -> v1::WorkerInfo {
    v1::WorkerInfo {
        id: view.id.to_string(),
        name: view.name,
        slots: view.slots,
        busy: view.busy,
        engine_digests: view.engines.iter().map(|digest: &Digest| digest.0.to_vec()).collect(),
        connected_at_ms: view.connected_at_ms,
        tasks: view.tasks,
        address: view.address,
        reason: view.reason,
        quarantined: view.quarantined,
    }
}

/// Converts the current progress of a job for clients. Its time per round is added later, from the store.
pub(crate) fn standing(detail: Detail) -> v1::Standing {
    let held = |held: Held| v1::Held {
        worker_id: held.worker.to_string(),
        worker_name: held.name,
        first: held.range.first,
        count: held.range.count,
        for_ms: held.since.as_millis() as u64,
    };
    v1::Standing {
        held: detail.held.into_iter().map(held).collect(),
        held_total: detail.held_total,
        pending: detail.pending,
        attempts: detail.attempts.into_iter().map(|(index, attempts)| v1::Attempts { index, attempts }).collect(),
        max_attempts: detail.max_attempts,
        workers: detail.workers,
        slots: detail.slots,
        task_ms: detail.task_seconds.map_or(0.0, |seconds| 1e3 * seconds),
        round_ms: 0.0,
    }
}

/// Converts an assignment that a worker reports as running in its Hello.
pub(crate) fn running(wire: v1::RunningAssignment) -> Running {
    Running {
        assignment: AssignmentId(wire.assignment_id),
        job: JobId::from(wire.job_id.as_str()),
        range: Range { round: wire.round, first: wire.first, count: wire.count },
        permit: wire.permit,
    }
}

impl Completed {
    /// Returns the assignment that this result claims to belong to.
    pub(crate) fn issued(&self) -> Issued<'_> {
        Issued { assignment: self.assignment, worker: &self.worker, job: &self.job, range: self.range }
    }
}
