//! Delivered results: checked, then recorded or compared. They may be late, repeated, wrong, or of work that was never
//! issued.

use super::arbitration::{Contradicted, Delivered, compare_results};
use super::dispatch::dispatch;
use super::events::{has_other_able_worker, revoke_leases_of_ended_job};
use super::fleet::WorkerId;
use super::lease::{AssignmentId, LeaseKind, Range, end_lease, record_failure, remove_lease, revoke_leases};
use super::notes::{LeaseEnd, Note};
use super::round::Recorded;
use super::trust::{defer_job_on_worker, mark, withdraw_crash_charges};
use super::{Action, Now, Scheduler, stuck};
use crate::permit;
use crate::record::{Claimant, JobId};
use crate::store::Write;
use sim_core::base::digest::Digest;
use sim_core::procedure::result_digest;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// The peer that made a call.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Caller {
    /// Its source address without the port.
    pub host: Arc<str>,
    /// First digits of its token's digest; empty where no token is needed.
    pub credential: Arc<str>,
}

/// A delivery of a worker: the outcome of one lease.
#[derive(Clone, Debug)]
pub struct Completed {
    /// The worker.
    pub worker: WorkerId,
    /// Id of the lease.
    pub assignment: AssignmentId,
    /// Its job.
    pub job: JobId,
    /// Digest of the engine that computed it.
    pub engine: Digest,
    /// Its tasks.
    pub range: Range,
    /// Permit that came with the assignment.
    pub permit: Vec<u8>,
    /// Time that a slot was busy; zero if unknown.
    pub compute: Duration,
    /// The outcome.
    pub delivery: Delivery,
    /// The tasks as assigned; only after the answer [`Verdict::NeedsTasks`].
    pub tasks: Vec<Vec<u8>>,
    /// The peer that makes the call.
    pub caller: Caller,
}

/// The outcome of a lease.
#[derive(Clone, Debug)]
pub enum Delivery {
    /// Results, in order of the task index.
    Results(Vec<Arc<[u8]>>),
    /// The computation failed, for this reason.
    Failure(String),
}

/// The answer to a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The result is recorded.
    Accepted,
    /// A result with the same bits was recorded before.
    Duplicate,
    /// A result with other bits was recorded before: one of the workers computes wrongly.
    Conflict,
    /// The result is no longer needed: the job has ended, or the lease or the tasks no longer count.
    Obsolete,
    /// The round was sealed before the last one. The store has its digests, see [`super::on_compare`].
    Older,
    /// The job or range does not exist.
    Unknown,
    /// The worker is quarantined; nothing was stored.
    Quarantined,
    /// It differs from a result sealed long ago. The worker must deliver again with the tasks, so that an arbiter can
    /// decide.
    NeedsTasks,
}

impl Verdict {
    /// All verdicts that a worker can receive.
    pub const ALL: [Self; 7] = [
        Self::Accepted,
        Self::Duplicate,
        Self::Conflict,
        Self::Obsolete,
        Self::Unknown,
        Self::Quarantined,
        Self::NeedsTasks,
    ];

    /// Returns the verdict in a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Duplicate => "duplicate",
            Self::Conflict => "conflict",
            Self::Obsolete => "obsolete",
            Self::Older => "older",
            Self::Unknown => "unknown",
            Self::Quarantined => "quarantined",
            Self::NeedsTasks => "needs tasks",
        }
    }
}

/// A refused delivery: it can't be a result of an assignment that was issued. It costs the worker a mark, and a retry
/// does not help.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RefusedResult {
    /// No such assignment was issued.
    #[error(
        "assignment {} ({count} tasks of round {round} of job {job} from {first} on) was never issued to worker {worker}: \
         a result needs the permit that came with its assignment",
        .assignment.0, round = .range.round, first = .range.first, count = .range.count
    )]
    Unissued {
        /// Id of the assignment in the delivery.
        assignment: AssignmentId,
        /// Worker in the delivery.
        worker: WorkerId,
        /// Job in the delivery.
        job: JobId,
        /// Tasks in the delivery.
        range: Range,
    },
    /// The result is from an engine that the job does not use.
    #[error("the result is from engine {}, but the job needs engine {}", .ran.short(), .needed.short())]
    Engine {
        /// The engine of the result.
        ran: Digest,
        /// The engine that the job needs.
        needed: Digest,
    },
    /// The number of results differs from the number of tasks.
    #[error("the delivery has {found} results, but its assignment has {needed} tasks")]
    Count {
        /// Number of delivered results.
        found: usize,
        /// Number of tasks of the assignment.
        needed: u32,
    },
    /// A result is invalid for its task.
    #[error(transparent)]
    Result(#[from] sim_core::procedure::Rejected),
    /// The delivered tasks are not those that were assigned.
    #[error("the tasks delivered with the result are not those of assignment {}", .assignment.0)]
    Tasks {
        /// Id of the assignment.
        assignment: AssignmentId,
    },
}

/// Processes a delivery; see [`super::on_result`]. A result counts even if another worker now holds the lease: the
/// first valid result of a task is recorded.
pub(super) fn take(core: &mut Scheduler, now: Now, completed: Completed) -> Result<Verdict, RefusedResult> {
    let (worker, id, assignment) = (completed.worker.clone(), completed.job.clone(), completed.assignment);
    if core.trust.is_quarantined(&worker) {
        return Ok(Verdict::Quarantined);
    }
    match admit(core, &completed) {
        Ok(None) => {}
        Ok(Some(verdict)) => return Ok(verdict),
        Err(refused) => {
            refuse(core, now, &completed, &refused);
            return Err(refused);
        }
    }
    if !core.fleet.workers.contains_key(&worker) {
        withdraw_crash_charges(core, &worker);
    }
    let lease = core.leases.all.get(&assignment).filter(|l| l.worker == worker && l.job == id);
    let (own, arbitrates) = (lease.is_some(), lease.is_some_and(|l| l.kind == LeaseKind::Arbitration));
    let results = match completed.delivery {
        Delivery::Failure(reason) if own => {
            return_failed(core, now, assignment, arbitrates, &reason);
            return Ok(Verdict::Accepted);
        }
        Delivery::Failure(_) => return Ok(Verdict::Obsolete),
        Delivery::Results(results) => results,
    };
    if own {
        complete_lease(core, assignment, completed.range.count, completed.compute);
    }
    let Some(job) = core.jobs.active.get(&id) else { return Ok(Verdict::Obsolete) };
    let range = completed.range;
    if range.round == job.round.number() {
        return Ok(record_results(core, now, &id, range, results, &worker, arbitrates));
    }
    Ok(compare_sealed(core, now, &id, range, &results, &worker, arbitrates))
}

/// Checks that a delivery belongs to an assignment that was issued, and is complete. Returns a verdict if there is
/// nothing to record.
fn admit(core: &Scheduler, completed: &Completed) -> Result<Option<Verdict>, RefusedResult> {
    let Completed { worker, assignment, job: id, engine, range, permit, delivery, .. } = completed;
    let issued = core.leases.was_issued(*assignment) && core.trust.key.admits(completed.issued(), permit);
    if !issued {
        let (assignment, worker, job, range) = (*assignment, worker.clone(), id.clone(), *range);
        return Err(RefusedResult::Unissued { assignment, worker, job, range });
    }
    let Some(job) = core.jobs.active.get(id) else {
        return Ok(Some(if core.jobs.ended.contains(id) { Verdict::Obsolete } else { Verdict::Unknown }));
    };
    if job.record.engine_digest != *engine {
        return Err(RefusedResult::Engine { ran: *engine, needed: job.record.engine_digest });
    }
    let Delivery::Results(results) = delivery else { return Ok(None) };
    if results.len() != range.count as usize {
        return Err(RefusedResult::Count { found: results.len(), needed: range.count });
    }
    if range.round > job.round.number() {
        return Ok(Some(Verdict::Unknown));
    }
    if range.round == job.round.number() {
        if !job.round.contains(range) {
            return Ok(Some(Verdict::Unknown));
        }
        for (index, result) in range.indexes().zip(results) {
            job.procedure.check(index, result)?;
        }
    }
    Ok(None)
}

/// Refuses a delivery: revokes its lease at no cost to the tasks, and marks the worker. If the permit is wrong, it
/// marks the worker only if the call came from the host and with the token of the worker with this id.
fn refuse(core: &mut Scheduler, now: Now, completed: &Completed, refused: &RefusedResult) {
    let Completed { worker, assignment, job, caller, .. } = completed;
    let is_known =
        core.fleet.workers.get(worker).is_some_and(|w| w.host() == &*caller.host && w.credential == caller.credential);
    if matches!(refused, RefusedResult::Unissued { .. }) {
        if is_known {
            mark(core, now, worker, &refused.to_string());
        }
        return;
    }
    if core.leases.all.get(assignment).is_some_and(|l| l.worker == *worker && l.job == *job) {
        end_lease(core, *assignment, LeaseEnd::Refused);
        defer_job_on_worker(core, now, worker, job);
    }
    mark(core, now, worker, &refused.to_string());
}

/// Records that a worker failed to compute its lease.
fn return_failed(core: &mut Scheduler, now: Now, assignment: AssignmentId, arbitrates: bool, reason: &str) {
    let Some(lease) = core.leases.all.get(&assignment) else { return };
    let (worker, job) = (lease.worker.clone(), lease.job.clone());
    let others = arbitrates || has_other_able_worker(core, &worker, &job);
    if let Some(lease) = end_lease(core, assignment, LeaseEnd::Failed) {
        if others {
            // The worker may be at fault: another one gets the job's tasks first.
            defer_job_on_worker(core, now, &worker, &job);
        }
        record_failure(core, now, &lease, true, None, reason);
    }
}

/// Records results of the current round.
fn record_results(
    core: &mut Scheduler,
    now: Now,
    id: &JobId,
    range: Range,
    results: Vec<Arc<[u8]>>,
    worker: &WorkerId,
    arbitrates: bool,
) -> Verdict {
    let finder = core.fleet.finder(worker);
    let Some(job) = core.jobs.active.get_mut(id) else { return Verdict::Unknown };
    // New results, in ranges without gaps; and results that may contradict recorded ones, or decide a dispute.
    let mut ranges: Vec<(u32, Vec<Arc<[u8]>>)> = Vec::new();
    let mut there: Vec<Delivered> = Vec::new();
    // Leases on these tasks.
    let mut holders: BTreeSet<AssignmentId> = BTreeSet::new();
    for (index, result) in range.indexes().zip(results) {
        match job.round.record(index, &result, &finder) {
            Recorded::New(holder) => {
                holders.extend(holder);
                match ranges.last_mut() {
                    Some((first, run)) if *first + run.len() as u32 == index => run.push(result),
                    _ => ranges.push((index, vec![result])),
                }
            }
            Recorded::Same if !job.is_disputed(range.round, index) => {}
            Recorded::Same | Recorded::Other => {
                there.push(Delivered { index, digest: result_digest(&result), result: Some(result) });
            }
        }
    }
    let accepted = ranges.iter().map(|(_, run)| run.len() as u32).sum();
    let phase = job.round.phase();
    if let Some(worker) = core.fleet.workers.get_mut(worker) {
        worker.tasks += u64::from(accepted);
    }
    stuck::clear_stuck_count(core, worker);
    if accepted > 0 {
        core.out.notes.push(Note::Taken {
            worker: worker.clone(),
            job: id.clone(),
            round: range.round,
            phase,
            count: accepted,
        });
        revoke_done(core, id, holders);
    }
    // This comes before sealing, because a round with an open dispute is not sealed.
    let conflict =
        !there.is_empty() && compare_results(core, now, id, range.round, there, worker, &Contradicted::new());
    if accepted > 0 {
        seal_or_store(core, now, id, range.round, ranges, finder);
    } else {
        seal(core, now, id);
    }
    match (conflict, accepted) {
        (true, _) => Verdict::Conflict,
        (false, 0) if !arbitrates => Verdict::Duplicate,
        (false, _) => Verdict::Accepted,
    }
}

/// Revokes those of these leases, and their copies, that have no task left to do.
fn revoke_done(core: &mut Scheduler, id: &JobId, holders: BTreeSet<AssignmentId>) {
    let Some(job) = core.jobs.active.get(id) else { return };
    let done = |a: &AssignmentId| core.leases.all.get(a).is_some_and(|l| job.round.is_done(&l.range));
    let originals = holders.into_iter().filter(done);
    let needless: Vec<AssignmentId> =
        originals.flat_map(|a| [Some(a), core.leases.copies.get(&a).copied()]).flatten().collect();
    revoke_leases(core, &needless, LeaseEnd::Needless);
}

/// Compares results of a sealed round with those that hold.
fn compare_sealed(
    core: &mut Scheduler,
    now: Now,
    id: &JobId,
    range: Range,
    results: &[Arc<[u8]>],
    worker: &WorkerId,
    arbitrates: bool,
) -> Verdict {
    let Some(job) = core.jobs.active.get(id) else { return Verdict::Unknown };
    let last = job.last.as_ref().filter(|last| last.number == range.round);
    // Tasks beyond the prefix that settled the round don't count.
    let beyond = last.is_some_and(|last| !range.is_within(last.tasks.len() as u32));
    let disputed = range.indexes().any(|index| job.is_disputed(range.round, index));
    if beyond {
        return Verdict::Obsolete;
    }
    if last.is_none() && !disputed {
        return Verdict::Older;
    }
    let delivered = range.indexes().zip(results);
    let delivered = delivered.map(|(index, result)| Delivered { index, digest: result_digest(result), result: None });
    let conflict = compare_results(core, now, id, range.round, delivered, worker, &Contradicted::new());
    // The current round may have waited for this decision.
    seal(core, now, id);
    match (conflict, arbitrates) {
        (true, _) => Verdict::Conflict,
        (false, true) => Verdict::Accepted,
        (false, false) => Verdict::Duplicate,
    }
}

/// Compares a result that got [`Verdict::Older`]; see [`super::on_compare`].
pub(super) fn compare(
    core: &mut Scheduler,
    now: Now,
    completed: Completed,
    sealed: &[Digest],
) -> Result<Verdict, RefusedResult> {
    let Completed { worker, assignment, job: id, range, permit, delivery, tasks, .. } = completed;
    // The worker may have been quarantined, or the job may have ended, while the digests were read.
    if core.trust.is_quarantined(&worker) {
        return Ok(Verdict::Quarantined);
    }
    if !core.jobs.active.contains_key(&id) {
        return Ok(Verdict::Obsolete);
    }
    let Delivery::Results(results) = delivery else { return Ok(Verdict::Unknown) };
    if !range.is_within(sealed.len() as u32) {
        return Ok(Verdict::Obsolete);
    }
    let delivered = range.indexes().zip(&results).map(|(index, result)| (index, result_digest(result)));
    let differing: Vec<(u32, Digest)> = delivered.filter(|(i, digest)| sealed[*i as usize] != *digest).collect();
    if differing.is_empty() {
        return Ok(Verdict::Duplicate);
    }
    if tasks.is_empty() {
        return Ok(Verdict::NeedsTasks);
    }
    if tasks.len() != range.count as usize || !permit::is_of(&permit, &tasks) {
        let refused = RefusedResult::Tasks { assignment };
        mark(core, now, &worker, &refused.to_string());
        return Err(refused);
    }
    let committed = |&(index, _): &(u32, Digest)| {
        let task = tasks[(index - range.first) as usize].clone();
        (index, super::Committed { digest: sealed[index as usize], task })
    };
    let contradicted: Contradicted = differing.iter().map(committed).collect();
    let delivered = differing.into_iter().map(|(index, digest)| Delivered { index, digest, result: None });
    let conflict = compare_results(core, now, &id, range.round, delivered, &worker, &contradicted);
    Ok(if conflict { Verdict::Conflict } else { Verdict::Duplicate })
}

/// Stores new results, or seals the round if it is complete.
fn seal_or_store(
    core: &mut Scheduler,
    now: Now,
    id: &JobId,
    round: u32,
    ranges: Vec<(u32, Vec<Arc<[u8]>>)>,
    finder: Claimant,
) {
    // A round that is sealed now is stored as a whole.
    if seal(core, now, id) {
        return;
    }
    core.out.write(Write::Results { job: id.clone(), round, ranges, finder });
    let Some(job) = core.jobs.active.get_mut(id) else { return };
    if let Some(event) = job.publish(now) {
        core.out.actions.push(Action::Publish(Box::new(job.record.clone()), event));
    }
}

/// Seals the current round if it is complete, and revokes leases on tasks that are no longer needed. Returns true if it
/// was sealed.
pub(super) fn seal(core: &mut Scheduler, now: Now, id: &JobId) -> bool {
    let Some(job) = core.jobs.active.get_mut(id) else { return false };
    let round = job.round.number();
    let Some(write) = job.seal(now) else { return false };
    let ended = job.record.state.is_end();
    core.out.write(write);
    if ended {
        core.jobs.active.remove(id);
        revoke_leases_of_ended_job(core, id);
        return true;
    }
    let beyond = core.leases.of(id).filter(|(_, l)| l.range.round == round && l.kind != LeaseKind::Arbitration);
    let beyond: Vec<AssignmentId> = beyond.map(|(id, _)| *id).collect();
    revoke_leases(core, &beyond, LeaseEnd::Needless);
    true
}

/// Completes a lease: its measured cost replaces the estimate.
fn complete_lease(core: &mut Scheduler, id: AssignmentId, count: u32, compute: Duration) {
    let Some(lease) = core.leases.all.get_mut(&id) else { return };
    if let Some(job) = core.jobs.active.get_mut(&lease.job) {
        if compute.is_zero() {
            // Unknown cost: the estimate stays.
            lease.charged = 0.0;
        } else {
            let each = compute.as_secs_f64() / f64::from(count.max(1));
            // Tasks of other rounds may have another cost.
            if lease.range.round == job.round.number() {
                job.cost = Some(job.cost.map_or(each, |cost| 0.7 * cost + 0.3 * each));
            }
            job.finish_tag += compute.as_secs_f64() / f64::from(job.record.priority);
        }
    }
    remove_lease(core, id);
}

/// Processes a delivery, then assigns pending tasks.
pub(super) fn complete_and_dispatch(
    core: &mut Scheduler,
    now: Now,
    take: impl FnOnce(&mut Scheduler) -> Result<Verdict, RefusedResult>,
) -> Result<Verdict, RefusedResult> {
    let verdict = take(core);
    dispatch(core, now);
    verdict
}
