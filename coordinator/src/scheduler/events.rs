//! The events: one function each.

use super::dispatch::dispatch;
use super::explain::publish_other_build;
use super::fleet::{Greeting, Running, SessionId, Welcome, Worker, WorkerId};
use super::job::{self, ActiveJob, NewJob, Resumed};
use super::lease::{AssignmentId, Kind, Lease, end_lease, record_failure, revoke_leases};
use super::leaving::{drain_leaving, stops};
use super::notes::{LeaseEnd, Note};
use super::results::{self, Completed, RefusedResult, Verdict, seal};
use super::straggler::copy_stragglers;
use super::trust::{clear_of_blame, spare, tell_quarantined};
use super::{Now, Scheduler, stuck};
use crate::permit::Issued;
use crate::record::{Event, JobId, JobRecord, JobState};
use crate::store::Write;
use sim_core::base::digest::Digest;
use sim_core::procedure::{BadState, Refused};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// A client submits a job. The caller has checked that its request id is new.
pub fn on_submit(core: &mut Scheduler, now: Now, new: NewJob) -> JobRecord {
    let number = core.jobs.new_number();
    let (job, writes) = ActiveJob::submitted(now, number, new, core.queue.virtual_time);
    let record = job.record.clone();
    writes.into_iter().for_each(|write| core.out.write(write));
    core.jobs.active.insert(record.id.clone(), job);
    dispatch(core, now);
    record
}

/// A job from the store goes on where it stood; nothing is handed out before the next event. If its state can't be used it
/// fails.
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

/// A job from the store can't go on: it fails.
pub fn on_unusable(core: &mut Scheduler, now: Now, record: JobRecord, reason: String) {
    core.jobs.ended.insert(record.id.clone());
    let (_, write) = job::end(record, now, JobState::Failed, reason);
    core.out.write(write);
}

/// A client cancels a job. `None` if no job that has not ended has this id.
pub fn on_cancel(core: &mut Scheduler, now: Now, id: &JobId) -> Option<JobRecord> {
    let record = end_job(core, now, id, JobState::Cancelled, String::new());
    dispatch(core, now);
    record
}

/// A client pauses (`true`) or resumes a job; a job that is so already stays so. `None` if no job that has not ended has this
/// id.
pub fn on_pause(core: &mut Scheduler, now: Now, id: &JobId, paused: bool) -> Option<JobRecord> {
    let job = core.jobs.active.get_mut(id)?;
    let write = if job.record.paused == paused {
        // Written all the same: a coordinator that was replaced meanwhile must not say that it is so.
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

/// A client offers a batch to a job whose procedure waits for one. `None` if no job that has not ended has this id.
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

/// The coordinator itself stood still for a while: what its workers sent meanwhile has not been received yet, and counts.
pub fn on_standstill(core: &mut Scheduler, time: Duration) {
    core.fleet.workers.values_mut().for_each(|worker| worker.expires += time);
    core.leases.all.values_mut().for_each(|lease| lease.moved += time);
}

/// Time passed: leases of silent workers expire.
pub fn on_tick(core: &mut Scheduler, now: Now) {
    let silent: Vec<WorkerId> =
        core.fleet.workers.iter().filter(|(_, w)| w.expires <= now.since_start).map(|(id, _)| id.clone()).collect();
    for id in silent {
        lose_worker(core, now, &id);
    }
    for worker in core.fleet.workers.values_mut() {
        worker.refused.retain(|_, until| *until > now.since_start);
    }
    drain_leaving(core, now);
    dispatch(core, now);
    for id in core.fleet.workers.keys().cloned().collect::<Vec<_>>() {
        copy_stragglers(core, now, &id);
    }
    core.alarm.wake = earliest(core);
}

/// When the next lease expires unless a sign of life comes, or a worker is spared a job no more, or has to be told to stop.
fn earliest(core: &Scheduler) -> Option<Duration> {
    let workers = || core.fleet.workers.values();
    let expiry = workers().map(|w| w.expires);
    let refusal = workers().flat_map(|w| w.refused.values().copied());
    let leaving = workers().filter(|w| !w.draining).filter_map(|w| stops(&core.settings, w));
    expiry.chain(refusal).chain(leaving).min()
}

/// Ends a job without success.
pub(super) fn end_job(
    core: &mut Scheduler,
    now: Now,
    id: &JobId,
    state: JobState,
    reason: String,
) -> Option<JobRecord> {
    let (record, write) = job::end(core.jobs.active.remove(id)?.record, now, state, reason);
    core.out.write(write);
    forget(core, id);
    Some(record)
}

/// A job is over: its leases are needed no more.
pub(super) fn forget(core: &mut Scheduler, id: &JobId) {
    core.jobs.ended.insert(id.clone());
    let running: Vec<AssignmentId> = core.leases.of(id).map(|(a, _)| *a).collect();
    revoke_leases(core, &running, LeaseEnd::Needless);
    for worker in core.fleet.workers.values_mut() {
        worker.known.remove(id);
        worker.refused.remove(id);
    }
}

/// A worker connects, for the first time or again. A lease that it still works on stays its own, or becomes its own (after a
/// restart the coordinator knows of none), unless another worker has its tasks or they are done.
pub fn on_connect(core: &mut Scheduler, now: Now, greeting: Greeting) -> Welcome {
    let session = core.fleet.new_session();
    let id = greeting.worker.clone();
    let before = core.fleet.workers.remove(&id);
    if before.is_none() {
        clear_of_blame(core, &id);
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
        stuck_after: core.settings.patience(greeting.stuck_after),
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
    // Assignments that never reached it.
    for assignment in held.iter().filter(|assignment| !keep.contains(assignment)) {
        end_lease(core, *assignment, LeaseEnd::Undelivered);
    }
    tell_quarantined(core, &id);
    drain_leaving(core, now);
    core.alarm.wake_by(now.since_start + core.settings.lease);
    let stays = core.fleet.workers.get(&id).filter(|w| !w.draining);
    if let Some(at) = stays.and_then(|w| stops(&core.settings, w)) {
        core.alarm.wake_by(at);
    }
    dispatch(core, now);
    Welcome { session, keep, drop }
}

/// Makes an assignment that a worker still works on its lease, if it was issued to it and all of its tasks are pending.
fn adopt(core: &mut Scheduler, now: Now, worker: &WorkerId, running: Running) -> bool {
    let Running { assignment, job, range, permit } = running;
    let issued = Issued { assignment, worker, job: &job, range };
    // An id that was never given out would collide with one that will be.
    let known = core.leases.was_issued(assignment) && core.trust.key.admits(issued, &permit);
    if !known || core.leases.all.contains_key(&assignment) {
        return false;
    }
    let Some(active) = core.jobs.active.get_mut(&job) else { return false };
    let able = core.fleet.workers.get(worker).is_some_and(|w| w.engines.contains(&active.record.engine_digest));
    if !able || !active.round.take(&range, assignment) {
        return false;
    }
    core.leases.all.insert(assignment, Lease::new(now, worker, &job, range, Kind::Ordinary));
    if let Some(worker) = core.fleet.workers.get_mut(worker) {
        worker.held.insert(assignment);
    }
    true
}

/// A sign of life, with the assignments that are worked on and, from a worker that counts, how far each of them is. `false` if
/// this session is not known any more: the worker has to connect again.
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
    // An assignment that was sent a while ago and that the worker does not know got lost on the way.
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

/// A connection broke. The worker has a heartbeat's time to come back before its leases expire.
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

/// A worker will stop: it gets nothing new, and its leases are returned at once, at no cost, but for those that it says it
/// still finishes.
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

/// A worker can't run an assignment. It costs no attempt; for the time of a lease it is spared that job.
pub fn on_reject(core: &mut Scheduler, now: Now, id: &WorkerId, session: SessionId, assignment: AssignmentId) {
    let Some(worker) = core.fleet.of_session(id, session) else { return };
    if worker.held.contains(&assignment)
        && let Some(lease) = end_lease(core, assignment, LeaseEnd::Rejected)
    {
        spare(core, now, id, &lease.job);
    }
    dispatch(core, now);
}

/// A worker may not go on in this session: its leases are revoked at once, and nothing is to blame.
pub fn on_expel(core: &mut Scheduler, now: Now, id: &WorkerId, session: SessionId) {
    let Some(worker) = core.fleet.of_session(id, session) else { return };
    for assignment in worker.held.clone() {
        end_lease(core, assignment, LeaseEnd::Drained);
    }
    core.fleet.workers.remove(id);
    core.queue.room.workers_changed();
    dispatch(core, now);
}

/// A worker delivers a result.
///
/// # Errors
/// It can't be a result of an assignment that was issued to this worker; nothing was stored.
pub fn on_result(core: &mut Scheduler, now: Now, completed: Completed) -> Result<Verdict, RefusedResult> {
    results::take_and_dispatch(core, now, |core| results::take(core, now, completed))
}

/// A result that was [`Verdict::Older`], with the digests of its sealed round.
///
/// # Errors
/// The tasks that came with it are not those that were assigned.
pub fn on_compare(
    core: &mut Scheduler,
    now: Now,
    completed: Completed,
    sealed: &[Digest],
) -> Result<Verdict, RefusedResult> {
    results::take_and_dispatch(core, now, |core| results::compare(core, now, completed, sealed))
}

/// Whether another worker takes this job's work.
pub(super) fn others_can(core: &Scheduler, worker: &WorkerId, id: &JobId) -> bool {
    let Some(job) = core.jobs.active.get(id) else { return false };
    core.fleet.workers.iter().any(|(other, w)| other != worker && w.takes_work() && w.can_do(&job.record))
}

/// A worker is gone. If its connection broke it crashed, and its leases are suspected of having crashed it, until it comes
/// back; if it only fell silent (a network that swallows everything), nothing is to blame.
fn lose_worker(core: &mut Scheduler, now: Now, id: &WorkerId) {
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
            let why = format!("worker {} died with it", worker.name);
            record_failure(core, now, &lease, alone, Some(id), &why);
        }
    }
}
