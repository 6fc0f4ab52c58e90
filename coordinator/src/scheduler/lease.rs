//! Leases: workers' time-limited claims on tasks, and the states of tasks.
//!
//! ```text
//!              assign                          complete
//!   PENDING ─────────────▶ LEASED ─────────────────────────────▶ DONE
//!      ▲                     │
//!      └─────────────────────┘  return (worker), revoke (coordinator), expire (time): see LeaseEnd
//! ```
//!
//! A worker first queues a lease and then runs it ([`Stage`]); its progress reports show which. Two kinds of leases
//! change no task's state when they end without a result: copies, because another lease holds their tasks, and
//! arbitrations, because their tasks are done.

use super::fleet::{SessionId, WorkerId};
use super::job::ActiveJob;
use super::notes::{LeaseEnd, Note};
use super::{Message, Now, Scheduler};
use crate::permit::Issued;
pub use crate::record::{AssignmentId, Range};
use crate::record::{Charge, Claimant, JobId, JobState, Poisoned};
use crate::scheduler::Action;
use sim_core::base::digest::Digest;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// An assignment: a lease as sent to a worker, for one slot.
#[derive(Clone, Debug, PartialEq)]
pub struct Assign {
    /// Id of the lease.
    pub assignment: AssignmentId,
    /// The job.
    pub job: JobId,
    /// The job's text; `None` if this session has it already.
    pub toml: Option<Arc<str>>,
    /// Round and indexes of the tasks.
    pub range: Range,
    /// The tasks, in order of their index.
    pub tasks: Vec<Vec<u8>>,
    /// Digest of the bytes that the round's tasks share …
    pub shared_digest: Digest,
    /// … and the shared bytes; `None` if this session has them already.
    pub shared: Option<Arc<[u8]>>,
    /// Permit: proves that the assignment was issued.
    pub permit: Vec<u8>,
}

/// The state of a task.
#[derive(Clone, Debug, Default)]
pub(super) enum TaskState {
    /// It has no lease and no result.
    #[default]
    Pending,
    /// A lease covers it.
    Leased(AssignmentId),
    /// Its result was recorded.
    Done {
        /// Digest of the result.
        digest: Digest,
        /// The worker that delivered the result that holds, at first the first one.
        finder: Claimant,
    },
}

/// Stage of a lease on its worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// The worker has reported no progress, or never does.
    Unknown,
    /// It waits on the worker for a slot.
    Queued,
    /// A slot runs it; the count grows with progress.
    Running(u64),
}

/// Purpose of a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LeaseKind {
    /// The normal case: its tasks are leased to it.
    Ordinary,
    /// A copy of a slow lease. The tasks stay leased to the original, and the first result counts.
    Copy(AssignmentId),
    /// Arbitration: its tasks are done and disputed, and its result decides.
    Arbitration,
}

#[derive(Clone, Debug)]
pub(super) struct Lease {
    pub worker: WorkerId,
    pub job: JobId,
    pub range: Range,
    pub kind: LeaseKind,
    /// True for a suspect that runs with no other lease on its worker.
    pub solo: bool,
    pub since: Duration,
    /// Amount added to the job's fair-queue tag for it.
    pub charged: f64,
    pub stage: Stage,
    /// Time of its last progress.
    pub moved: Duration,
}

impl Lease {
    /// Creates a lease with no charge to its job.
    pub fn new(now: Now, worker: &WorkerId, job: &JobId, range: Range, kind: LeaseKind) -> Self {
        let (worker, job, since) = (worker.clone(), job.clone(), now.since_start);
        Self { worker, job, range, kind, solo: false, since, charged: 0.0, stage: Stage::Unknown, moved: since }
    }

    /// Records the progress count that its worker reports; 0 while it waits for a slot.
    pub fn report(&mut self, now: Now, count: u64) {
        let stage = if count == 0 { Stage::Queued } else { Stage::Running(count) };
        let moves = match (self.stage, stage) {
            (Stage::Running(before), Stage::Running(count)) => count > before,
            (Stage::Unknown | Stage::Queued, Stage::Running(_)) => true,
            _ => false,
        };
        if moves {
            self.moved = now.since_start;
        }
        self.stage = stage;
    }
}

/// All leases.
#[derive(Default)]
pub(super) struct Leases {
    pub all: BTreeMap<AssignmentId, Lease>,
    /// Copies of leases, by the original.
    pub copies: BTreeMap<AssignmentId, AssignmentId>,
    /// Leases on suspects, and their jobs.
    pub solos: BTreeMap<AssignmentId, JobId>,
    next: u64,
}

impl Leases {
    pub fn starting_at(next: u64) -> Self {
        Self { next, ..Self::default() }
    }

    /// Returns a new lease id.
    pub fn new_id(&mut self) -> AssignmentId {
        self.next += 1;
        AssignmentId(self.next - 1)
    }

    /// Returns true if this id was ever issued.
    pub fn was_issued(&self, id: AssignmentId) -> bool {
        id.0 < self.next
    }

    /// Returns the leases of a job.
    pub fn of<'a>(&'a self, job: &'a JobId) -> impl Iterator<Item = (&'a AssignmentId, &'a Lease)> {
        self.all.iter().filter(move |(_, lease)| lease.job == *job)
    }
}

/// Adds a lease and sends its tasks to the worker.
pub(super) fn assign(core: &mut Scheduler, now: Now, id: AssignmentId, lease: Lease, tasks: Vec<Vec<u8>>) {
    let (Some(worker), Some(job)) = (core.fleet.workers.get_mut(&lease.worker), core.jobs.active.get_mut(&lease.job))
    else {
        return;
    };
    let Some(session) = worker.session else { return };
    worker.held.insert(id);
    let (toml, shared) = missing_in_session(worker.known.get(&lease.job).copied(), job);
    worker.known.insert(lease.job.clone(), job.round.shared_digest);
    if let Some(write) = job.start(now) {
        core.out.write(write);
    }
    let issued = Issued { assignment: id, worker: &lease.worker, job: &lease.job, range: lease.range };
    let permit = core.trust.key.issue(issued, &tasks);
    let assign = Assign {
        assignment: id,
        job: lease.job.clone(),
        toml,
        range: lease.range,
        tasks,
        shared_digest: job.round.shared_digest,
        shared,
        permit,
    };
    send(core, &lease.worker.clone(), session, Message::Assign(Box::new(assign)));
    core.leases.all.insert(id, lease);
}

/// Returns the job's text and its round's shared bytes, as far as a session lacks them. `known`: digest of the shared
/// bytes that it was sent last.
fn missing_in_session(known: Option<Digest>, job: &ActiveJob) -> (Option<Arc<str>>, Option<Arc<[u8]>>) {
    let toml = known.is_none().then(|| job.toml.clone());
    let shared = job.round.shared();
    let lacks = known != Some(job.round.shared_digest) && !shared.is_empty();
    (toml, lacks.then(|| shared.clone()))
}

fn send(core: &mut Scheduler, worker: &WorkerId, session: SessionId, message: Message) {
    core.out.actions.push(Action::Send(worker.clone(), session, message));
}

/// Ends a lease without a result: its unfinished tasks become pending again. Charges no attempt.
pub(super) fn end_lease(core: &mut Scheduler, id: AssignmentId, why: LeaseEnd) -> Option<Lease> {
    let lease = core.leases.all.get(&id)?;
    let (worker, job, range) = (lease.worker.clone(), lease.job.clone(), lease.range);
    core.out.notes.push(Note::LeaseEnded { worker, job, assignment: id, range, why });
    remove_lease(core, id)
}

/// Removes a lease; its unfinished tasks become pending again, or pass to its copy.
pub(super) fn remove_lease(core: &mut Scheduler, id: AssignmentId) -> Option<Lease> {
    let Scheduler { leases, jobs, fleet, queue, .. } = core;
    let lease = leases.all.remove(&id)?;
    leases.solos.remove(&id);
    fleet.free(&lease.worker, id);
    queue.room.may_have(&lease.worker);
    let copy = leases.copies.remove(&id);
    if let LeaseKind::Copy(original) = lease.kind {
        leases.copies.remove(&original);
    }
    if let Some(job) = jobs.active.get_mut(&lease.job) {
        job.finish_tag -= lease.charged;
        if job.round.contains(&lease.range) {
            if let Some(copy) = copy {
                job.round.move_lease(&lease.range, id, copy);
            }
            job.round.set_pending(&lease.range, id);
        }
    }
    if let Some(copy) = copy.and_then(|copy| leases.all.get_mut(&copy)) {
        copy.kind = LeaseKind::Ordinary;
    }
    Some(lease)
}

/// Revokes leases and sends the revocations to their workers.
pub(super) fn revoke_leases(core: &mut Scheduler, ids: &[AssignmentId], why: LeaseEnd) {
    let mut by_worker: BTreeMap<WorkerId, Vec<AssignmentId>> = BTreeMap::new();
    for &id in ids {
        if let Some(lease) = end_lease(core, id, why) {
            by_worker.entry(lease.worker).or_default().push(id);
        }
    }
    for (worker, ids) in by_worker {
        if let Some(session) = core.fleet.workers.get(&worker).and_then(|w| w.session) {
            send(core, &worker, session, Message::Cancel(ids));
        }
    }
}

/// Records a failure of a lease, or the crash of its worker (`lost`): its tasks become suspects. If the lease has one
/// task and `sure` is set (nothing else can have caused the failure), the failure counts as an attempt of that task.
/// Too many attempts fail the job.
pub(super) fn record_failure(
    core: &mut Scheduler,
    now: Now,
    lease: &Lease,
    sure: bool,
    lost: Option<&WorkerId>,
    why: &str,
) {
    let Some(job) = core.jobs.active.get_mut(&lease.job) else { return };
    let range = &lease.range;
    // Another worker has done the tasks meanwhile, so they did not cause the failure.
    if !job.round.contains(range) || job.round.is_done(range) {
        return;
    }
    let Range { first, count, round } = *range;
    let attempt = sure && count == 1;
    job.record_charge(Charge { first, count, attempt, lost: lost.map(|worker| worker.0.clone()) });
    let attempts = if attempt { job.round.attempts_of(first) } else { 0 };
    if attempts > 0 {
        let (job, range, why) = (lease.job.clone(), *range, why.to_owned());
        core.out.notes.push(Note::Attempt { job, range, attempts, why });
    }
    if attempts < super::MAX_ATTEMPTS {
        core.out.to_note.insert(lease.job.clone());
        return;
    }
    let what = job.procedure.describe(first);
    let reason = format!("{what} failed {attempts} times; the last failure: {why}");
    let task = job.procedure.task(first);
    job.record.poisoned = Some(Poisoned { round, index: first, what, task, attempts });
    super::events::end_job(core, now, &lease.job, JobState::Failed, reason);
}
