//! The scheduler's events: one function each.

use super::dispatch::dispatch;
use super::fleet::{Greeting, Running, SessionId, Welcome, Worker, WorkerId};
use super::job::{self, ActiveJob, NewJob, Resumed};
use super::lease::{AssignmentId, Lease, LeaseKind, end_lease, record_failure, revoke_leases};
use super::leaving::{revoke_leaving, stops};
use super::notes::{LeaseEnd, Note};
use super::results::{self, Completed, RefusedResult, Verdict, seal};
use super::straggler::copy_stragglers;
use super::trust::{defer_job_on_worker, send_quarantine_drain, withdraw_crash_charges};
use super::wait_reasons::publish_other_build;
use super::{Now, Scheduler, stuck};
use crate::permit::Issued;
use crate::record::{Event, JobId, JobRecord, JobState};
use crate::store::Write;
use sim_core::base::digest::Digest;
use sim_core::procedure::{BadState, Refused};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// Adds a job that a client submitted. The caller must check before that its request id is new.
pub fn on_submit(core: &mut Scheduler, now: Now, new: NewJob) -> JobRecord {
    let number = core.jobs.new_number();
    let (job, writes) = ActiveJob::submitted(now, number, new, core.queue.virtual_time);
    let record = job.record.clone();
    writes.into_iter().for_each(|write| core.out.write(write));
    core.jobs.active.insert(record.id.clone(), job);
    dispatch(core, now);
    record
}

/// Continues a job from the store where it stopped. No task is assigned before the next event. If the job's state is
/// invalid, the job fails.
pub fn on_resume(core: &mut Scheduler, now: Now, resumed: Resumed) -> Result<(), BadState> {
    let record = resumed.record.clone();
    let id = record.id.clone();
    match ActiveJob::resumed(resumed, core.queue.virtual_time) {
        Ok(job) => {
            core.jobs.active.insert(id.clone(), job);
            publish_other_build(core, now, &id);
            seal(core, now, &id);
            Ok(())
        }
        Err(problem) => {
            on_unusable(core, now, record, problem.to_string());
            Err(problem)
        }
    }
}

/// Fails a job from the store that can't continue, for this reason.
pub fn on_unusable(core: &mut Scheduler, now: Now, record: JobRecord, reason: String) {
    core.jobs.ended.insert(record.id.clone());
    let (_, write) = job::end(record, now, JobState::Failed, reason);
    core.out.write(write);
}

/// Cancels a job for a client. Returns `None` if no active job has this id.
pub fn on_cancel(core: &mut Scheduler, now: Now, id: &JobId) -> Option<JobRecord> {
    let record = end_job(core, now, id, JobState::Cancelled, String::new());
    dispatch(core, now);
    record
}

/// Pauses (`true`) or resumes a job for a client; no change if it already is in that state. Returns `None` if no active
/// job has this id.
pub fn on_pause(core: &mut Scheduler, now: Now, id: &JobId, paused: bool) -> Option<JobRecord> {
    let job = core.jobs.active.get_mut(id)?;
    let write = if job.record.paused == paused {
        // Written anyway: the commit fails if another coordinator has replaced this one, which then must not
        // acknowledge.
        Write::Note { record: job.record.clone() }
    } else {
        job.record.paused = paused;
        job.change(now, Event::Paused(paused))
    };
    let record = job.record.clone();
    core.out.write(write);
    dispatch(core, now);
    Some(record)
}

/// Offers a client's batch to a job with a procedure that waits for one. Returns `None` if no active job has this id.
pub fn on_offer(core: &mut Scheduler, now: Now, id: &JobId, batch: &[u8]) -> Option<Result<JobRecord, Refused>> {
    let job = core.jobs.active.get_mut(id)?;
    if let Err(refused) = job.procedure.offer(batch) {
        return Some(Err(refused));
    }
    job.next_round();
    let write = job.resume_waiting(now);
    let record = job.record.clone();
    core.out.write(write);
    dispatch(core, now);
    Some(Ok(record))
}

/// Moves the deadlines for heartbeats and progress by the time that the coordinator process was suspended. Messages
/// that workers sent meanwhile are still unread.
pub fn on_standstill(core: &mut Scheduler, time: Duration) {
    core.fleet.workers.values_mut().for_each(|worker| worker.expires += time);
    core.leases.all.values_mut().for_each(|lease| lease.moved += time);
}

/// Expires the leases of workers without heartbeats, drains leaving workers, assigns pending tasks and copies
/// stragglers.
pub fn on_tick(core: &mut Scheduler, now: Now) {
    let silent: Vec<WorkerId> =
        core.fleet.workers.iter().filter(|(_, w)| w.expires <= now.since_start).map(|(id, _)| id.clone()).collect();
    for id in silent {
        expire_leases_of_worker(core, now, &id);
    }
    for worker in core.fleet.workers.values_mut() {
        worker.refused.retain(|_, until| *until > now.since_start);
    }
    revoke_leaving(core, now);
    dispatch(core, now);
    for id in core.fleet.workers.keys().cloned().collect::<Vec<_>>() {
        copy_stragglers(core, now, &id);
    }
    core.alarm.wake = earliest(core);
}

/// Returns the earliest deadline: a worker's leases expire, a worker may get a job again that it rejected, or a leaving
/// worker must be drained.
fn earliest(core: &Scheduler) -> Option<Duration> {
    let workers = || core.fleet.workers.values();
    let expiry = workers().map(|w| w.expires);
    let refusal = workers().flat_map(|w| w.refused.values().copied());
    let leaving = workers().filter(|w| !w.draining).filter_map(|w| stops(&core.settings, w));
    expiry.chain(refusal).chain(leaving).min()
}

/// Ends a job in a state other than success.
pub(super) fn end_job(
    core: &mut Scheduler,
    now: Now,
    id: &JobId,
    state: JobState,
    reason: String,
) -> Option<JobRecord> {
    let (record, write) = job::end(core.jobs.active.remove(id)?.record, now, state, reason);
    core.out.write(write);
    revoke_leases_of_ended_job(core, id);
    Some(record)
}

/// Revokes all leases of a job that has ended.
pub(super) fn revoke_leases_of_ended_job(core: &mut Scheduler, id: &JobId) {
    core.jobs.ended.insert(id.clone());
    let running: Vec<AssignmentId> = core.leases.of(id).map(|(a, _)| *a).collect();
    revoke_leases(core, &running, LeaseEnd::Needless);
    for worker in core.fleet.workers.values_mut() {
        worker.known.remove(id);
        worker.refused.remove(id);
    }
}

/// Opens a session for a worker that connects, for the first time or again. The worker keeps the leases that it still
/// runs. After a restart the coordinator has no leases in memory, so it adopts those that the worker reports if all of
/// their tasks are still pending.
pub fn on_connect(core: &mut Scheduler, now: Now, greeting: Greeting) -> Welcome {
    let session = core.fleet.new_session();
    let id = greeting.worker.clone();
    let before = core.fleet.workers.remove(&id);
    if before.is_none() {
        withdraw_crash_charges(core, &id);
    }
    let held = before.as_ref().map(|w| w.held.clone()).unwrap_or_default();
    let worker = Worker {
        session: Some(session),
        name: greeting.name,
        version: greeting.version,
        address: greeting.address,
        credential: greeting.credential,
        slots: greeting.slots,
        engines: greeting.engines,
        held: held.clone(),
        expires: now.since_start + core.settings.lease,
        draining: false,
        known: BTreeMap::new(),
        refused: BTreeMap::new(),
        ends: greeting.time_left.map(|left| now.since_start.saturating_add(left)),
        stuck_after: core.settings.stuck_timeout(greeting.stuck_after),
        trusted: !core.trust.is_quarantined(&id),
        stuck: 0,
        suspect: before.as_ref().and_then(|w| w.suspect),
        connected_at_ms: before.as_ref().map_or(now.unix_ms, |w| w.connected_at_ms),
        tasks: before.as_ref().map_or(0, |w| w.tasks),
    };
    let trusted = worker.trusted;
    core.fleet.workers.insert(id.clone(), worker);
    core.queue.room.may_have(&id);
    core.queue.room.workers_changed();

    let (mut keep, mut drop) = (Vec::new(), Vec::new());
    for running in greeting.running {
        let assignment = running.assignment;
        let kept = held.contains(&assignment) || trusted && adopt(core, now, &id, running);
        if kept { keep.push(assignment) } else { drop.push(assignment) }
    }
    // Leases that the worker never received.
    for assignment in held.iter().filter(|assignment| !keep.contains(assignment)) {
        end_lease(core, *assignment, LeaseEnd::Undelivered);
    }
    send_quarantine_drain(core, &id);
    revoke_leaving(core, now);
    core.alarm.wake_by(now.since_start + core.settings.lease);
    let stays = core.fleet.workers.get(&id).filter(|w| !w.draining);
    if let Some(at) = stays.and_then(|w| stops(&core.settings, w)) {
        core.alarm.wake_by(at);
    }
    dispatch(core, now);
    Welcome { session, keep, drop }
}

/// Restores a lease that a worker still runs, if it was issued to this worker and all of its tasks are pending.
fn adopt(core: &mut Scheduler, now: Now, worker: &WorkerId, running: Running) -> bool {
    let Running { assignment, job, range, permit } = running;
    let issued = Issued { assignment, worker, job: &job, range };
    // An id that was never issued would collide with a later one.
    let known = core.leases.was_issued(assignment) && core.trust.key.admits(issued, &permit);
    if !known || core.leases.all.contains_key(&assignment) {
        return false;
    }
    let Some(active) = core.jobs.active.get_mut(&job) else { return false };
    let able = core.fleet.workers.get(worker).is_some_and(|w| w.engines.contains(&active.record.engine_digest));
    if !able || !active.round.take(&range, assignment) {
        return false;
    }
    core.leases.all.insert(assignment, Lease::new(now, worker, &job, range, LeaseKind::Ordinary));
    if let Some(worker) = core.fleet.workers.get_mut(worker) {
        worker.held.insert(assignment);
    }
    true
}

/// Records a heartbeat, with the leases that the worker runs and, if it reports progress, the count of each. Returns
/// `false` if this session has ended: the worker must connect again.
pub fn on_heartbeat(
    core: &mut Scheduler,
    now: Now,
    id: &WorkerId,
    session: SessionId,
    running: &[AssignmentId],
    progress: &[u64],
) -> bool {
    let Some(worker) = core.fleet.of_session(id, session) else { return false };
    let held = worker.held.clone();
    if let Some(worker) = core.fleet.workers.get_mut(id) {
        worker.expires = now.since_start + core.settings.lease;
    }
    // A lease that was sent some time ago and that the worker does not list was lost on the way.
    let sent_before = now.since_start.saturating_sub(core.settings.lease / 2);
    for assignment in held {
        let lost = core.leases.all.get(&assignment).is_some_and(|l| l.since < sent_before);
        if lost && !running.contains(&assignment) {
            end_lease(core, assignment, LeaseEnd::Undelivered);
        }
    }
    if progress.len() == running.len() {
        let progress: Vec<_> = running.iter().copied().zip(progress.iter().copied()).collect();
        stuck::watch_progress(core, now, id, &progress);
    }
    dispatch(core, now);
    copy_stragglers(core, now, id);
    true
}

/// Records that a worker's connection broke. Its leases expire unless it connects again within one heartbeat interval.
pub fn on_disconnect(core: &mut Scheduler, now: Now, id: &WorkerId, session: SessionId) {
    if core.fleet.of_session(id, session).is_none() {
        return;
    }
    core.queue.room.workers_changed();
    let grace = now.since_start + core.settings.heartbeat();
    if let Some(worker) = core.fleet.workers.get_mut(id) {
        worker.session = None;
        worker.expires = worker.expires.min(grace);
        if worker.held.is_empty() {
            core.fleet.workers.remove(id);
        }
    }
    core.alarm.wake_by(grace);
    dispatch(core, now);
}

/// Drains a worker that announced its stop: it gets no new leases, and returns at once all leases that it does not
/// finish. Returned leases cost no attempt.
pub fn on_drain(core: &mut Scheduler, now: Now, id: &WorkerId, session: SessionId, finishing: &[AssignmentId]) {
    let Some(worker) = core.fleet.of_session(id, session) else { return };
    let finishing: BTreeSet<_> = finishing.iter().collect();
    for assignment in worker.held.clone() {
        if !finishing.contains(&assignment) {
            end_lease(core, assignment, LeaseEnd::Drained);
        }
    }
    if let Some(worker) = core.fleet.workers.get_mut(id) {
        worker.draining = true;
    }
    core.queue.room.workers_changed();
    dispatch(core, now);
}

/// Ends a lease that its worker returned because it can't run it. That costs no attempt. The worker gets no work of
/// that job for one lease time.
pub fn on_return(core: &mut Scheduler, now: Now, id: &WorkerId, session: SessionId, assignment: AssignmentId) {
    let Some(worker) = core.fleet.of_session(id, session) else { return };
    if worker.held.contains(&assignment)
        && let Some(lease) = end_lease(core, assignment, LeaseEnd::Rejected)
    {
        defer_job_on_worker(core, now, id, &lease.job);
    }
    dispatch(core, now);
}

/// Ends a worker's session: its leases are revoked at once, at no cost to the tasks.
pub fn on_expel(core: &mut Scheduler, now: Now, id: &WorkerId, session: SessionId) {
    let Some(worker) = core.fleet.of_session(id, session) else { return };
    for assignment in worker.held.clone() {
        end_lease(core, assignment, LeaseEnd::Drained);
    }
    core.fleet.workers.remove(id);
    core.queue.room.workers_changed();
    dispatch(core, now);
}

/// Processes a worker's delivery.
///
/// # Errors
/// The delivery can't belong to an assignment that was issued to this worker; no result is stored.
pub fn on_result(core: &mut Scheduler, now: Now, completed: Completed) -> Result<Verdict, RefusedResult> {
    results::complete_and_dispatch(core, now, |core| results::take(core, now, completed))
}

/// Compares a result that got [`Verdict::Older`] with the digests of its sealed round.
///
/// # Errors
/// The tasks that were delivered with it are not those that were assigned.
pub fn on_compare(
    core: &mut Scheduler,
    now: Now,
    completed: Completed,
    sealed: &[Digest],
) -> Result<Verdict, RefusedResult> {
    results::complete_and_dispatch(core, now, |core| results::compare(core, now, completed, sealed))
}

/// Returns true if another worker can take this job's tasks.
pub(super) fn has_other_able_worker(core: &Scheduler, worker: &WorkerId, id: &JobId) -> bool {
    let Some(job) = core.jobs.active.get(id) else { return false };
    core.fleet.workers.iter().any(|(other, w)| other != worker && w.takes_work() && w.can_do(&job.record))
}

/// Removes a worker that sent no heartbeat in time; its leases expire. If its connection broke, it counts as crashed,
/// and the tasks of its leases become suspects until it comes back. If the connection is still open (a network that
/// loses all packets), its tasks are not charged.
fn expire_leases_of_worker(core: &mut Scheduler, now: Now, id: &WorkerId) {
    let Some(worker) = core.fleet.workers.remove(id) else { return };
    core.queue.room.workers_changed();
    let crashed = worker.session.is_none();
    let (leases, name) = (worker.held.len() as u32, worker.name.clone());
    core.out.notes.push(Note::WorkerLost { worker: id.clone(), name, leases, crashed });
    let alone = leases == 1;
    for assignment in worker.held {
        if let Some(lease) = end_lease(core, assignment, LeaseEnd::Lost)
            && crashed
        {
            let why = format!("worker {} crashed while running it", worker.name);
            record_failure(core, now, &lease, alone, Some(id), &why);
        }
    }
}
