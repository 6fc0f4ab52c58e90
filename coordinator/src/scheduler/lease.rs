//! Leases: workers' time-limited claims on tasks, and the states that tasks go through.
//!
//! ```text
//!              assign                          complete
//!   PENDING ─────────────▶ LEASED ─────────────────────────────▶ DONE
//!      ▲                     │
//!      └─────────────────────┘  return (worker), revoke (coordinator), expire (time): see LeaseEnd
//! ```
//!
//! A worker first queues a lease and then runs it ([`Stage`]); only its progress tells the two apart. A lease whose tasks are
//! leased to another one (a copy) or done (arbitration) changes no task's state when it ends without a result.

use super::fleet::{SessionId, WorkerId};
use super::job::ActiveJob;
use super::notes::{LeaseEnd, Note};
use super::{Message, Now, Scheduler};
use crate::permit::Issued;
pub use crate::record::{AssignmentId, Range};
use crate::record::{Charge, Finder, JobId, JobState, Poisoned};
use crate::scheduler::Action;
use sim_core::base::digest::Digest;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// Work for one slot, as it is sent.
#[derive(Clone, Debug, PartialEq)]
pub struct Assign {
    /// Its id.
    pub assignment: AssignmentId,
    /// The job.
    pub job: JobId,
    /// The job's text, where this session has not had it yet.
    pub toml: Option<Arc<str>>,
    /// The tasks' places.
    pub range: Range,
    /// The tasks, by index from the range's first on.
    pub tasks: Vec<Vec<u8>>,
    /// Digest of what the round's tasks share …
    pub shared_digest: Digest,
    /// … and that itself, where this session has not had it yet.
    pub shared: Option<Arc<[u8]>>,
    /// Proof that it was issued.
    pub permit: Vec<u8>,
}

/// The state of a task.
#[derive(Clone, Debug, Default)]
pub(super) enum TaskState {
    /// No worker has it.
    #[default]
    Pending,
    /// A lease covers it.
    Leased(AssignmentId),
    /// Its result is there.
    Done {
        /// Digest of the result.
        digest: Digest,
        /// The worker that delivered it first.
        finder: Finder,
    },
}

/// How far a worker is with a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// The worker reports no progress, or has reported none yet.
    Unknown,
    /// It waits for a slot.
    Queued,
    /// A slot runs it; the count grows as it moves.
    Running(u64),
}

/// What a lease is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Its tasks are to be done: they are leased to it.
    Ordinary,
    /// Another lease's tasks may get done sooner so. They are leased to that one.
    Copy(AssignmentId),
    /// Its tasks are done and disputed: its result decides.
    Arbitration,
}

#[derive(Clone, Debug)]
pub(super) struct Lease {
    pub worker: WorkerId,
    pub job: JobId,
    pub range: Range,
    pub kind: Kind,
    /// A suspect, with nothing beside it on its worker.
    pub solo: bool,
    pub since: Duration,
    /// What the job's fair-queue tag was charged for it.
    pub charged: f64,
    pub stage: Stage,
    /// When its stage changed last.
    pub moved: Duration,
}

impl Lease {
    /// A new one, that its job is not charged for.
    pub fn new(now: Now, worker: &WorkerId, job: &JobId, range: Range, kind: Kind) -> Self {
        let (worker, job, since) = (worker.clone(), job.clone(), now.since_start);
        Self { worker, job, range, kind, solo: false, since, charged: 0.0, stage: Stage::Unknown, moved: since }
    }

    /// Takes the count that its worker reports; 0 while it waits for a slot.
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
    /// Second copies of leases, by the first.
    pub copies: BTreeMap<AssignmentId, AssignmentId>,
    /// Suspects that are worked on, and their jobs.
    pub solos: BTreeMap<AssignmentId, JobId>,
    next: u64,
}

impl Leases {
    pub fn starting_at(next: u64) -> Self {
        Self { next, ..Self::default() }
    }

    /// The next assignment's id.
    pub fn new_id(&mut self) -> AssignmentId {
        self.next += 1;
        AssignmentId(self.next - 1)
    }

    /// Whether an id was ever given out.
    pub fn was_issued(&self, id: AssignmentId) -> bool {
        id.0 < self.next
    }

    /// Those of a job.
    pub fn of<'a>(&'a self, job: &'a JobId) -> impl Iterator<Item = (&'a AssignmentId, &'a Lease)> {
        self.all.iter().filter(move |(_, lease)| lease.job == *job)
    }
}

/// Gives a lease to its worker, and sends it the tasks.
pub(super) fn assign(core: &mut Scheduler, now: Now, id: AssignmentId, lease: Lease, tasks: Vec<Vec<u8>>) {
    let (Some(worker), Some(job)) = (core.fleet.workers.get_mut(&lease.worker), core.jobs.active.get_mut(&lease.job))
    else {
        return;
    };
    let Some(session) = worker.session else { return };
    worker.held.insert(id);
    let (toml, shared) = what_is_new(worker.known.get(&lease.job).copied(), job);
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

/// The job's text and what its round shares, as far as a session lacks them. `known`: digest of what it was sent last.
fn what_is_new(known: Option<Digest>, job: &ActiveJob) -> (Option<Arc<str>>, Option<Arc<[u8]>>) {
    let toml = known.is_none().then(|| job.toml.clone());
    let shared = job.round.shared();
    let lacks = known != Some(job.round.shared_digest) && !shared.is_empty();
    (toml, lacks.then(|| shared.clone()))
}

fn send(core: &mut Scheduler, worker: &WorkerId, session: SessionId, message: Message) {
    core.out.actions.push(Action::Send(worker.clone(), session, message));
}

/// Ends a lease without a result: what it covers and is not done becomes pending again. Costs nothing.
pub(super) fn end_lease(core: &mut Scheduler, id: AssignmentId, why: LeaseEnd) -> Option<Lease> {
    let lease = core.leases.all.get(&id)?;
    let (worker, job, range) = (lease.worker.clone(), lease.job.clone(), lease.range);
    core.out.notes.push(Note::LeaseEnded { worker, job, assignment: id, range, why });
    remove_lease(core, id)
}

/// Removes a lease; what it covers and is not done becomes pending again.
pub(super) fn remove_lease(core: &mut Scheduler, id: AssignmentId) -> Option<Lease> {
    let Scheduler { leases, jobs, fleet, queue, .. } = core;
    let lease = leases.all.remove(&id)?;
    leases.solos.remove(&id);
    fleet.free(&lease.worker, id);
    queue.room.may_have(&lease.worker);
    let copy = leases.copies.remove(&id);
    if let Kind::Copy(original) = lease.kind {
        leases.copies.remove(&original);
    }
    if let Some(job) = jobs.active.get_mut(&lease.job) {
        job.finish_tag -= lease.charged;
        if job.round.contains(&lease.range) {
            if let Some(copy) = copy {
                job.round.pass_on(&lease.range, id, copy);
            }
            job.round.release(&lease.range, id);
        }
    }
    if let Some(copy) = copy.and_then(|copy| leases.all.get_mut(&copy)) {
        copy.kind = Kind::Ordinary;
    }
    Some(lease)
}

/// Revokes leases, and tells their workers.
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

/// A failure while this was worked on, or the crash of the worker that was `lost` with it: its tasks are suspects. If it was
/// one task, and it is `sure` that nothing else was the reason, that is an attempt; too many of them fail the job.
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
    // Done meanwhile by another worker: not to blame.
    if !job.round.contains(range) || job.round.is_done(range) {
        return;
    }
    let Range { first, count, round } = *range;
    let attempt = sure && count == 1;
    job.charge(Charge { first, count, attempt, lost: lost.map(|worker| worker.0.clone()) });
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
    let reason = format!("{what} failed {attempts} times; the last time: {why}");
    let task = job.procedure.task(first);
    job.record.poisoned = Some(Poisoned { round, index: first, what, task, attempts });
    super::events::end_job(core, now, &lease.job, JobState::Failed, reason);
}
