//! Work that a worker has been given.

use super::notes::{LeaseEnd, Note};
use super::round::Range;
use super::worker::WorkerId;
use super::{Action, Message, Now, Scheduler};
use crate::record::{Charge, JobId, JobState};
use sim_core::genotype::Genome;
use sim_core::procedure::evolve::finish::Examination;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// Names an assignment, uniquely over all starts on a store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct AssignmentId(pub u64);

/// What a worker is asked to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Task {
    /// Score a range of candidates.
    Evaluate {
        /// Which.
        range: Range,
        /// Genomes of candidates, the range's among them.
        genomes: Arc<[Genome]>,
        /// The candidate that the first of these is of.
        base: u32,
    },
    /// Answer a question about a candidate.
    Examine {
        /// Its place in its round: a range of one.
        range: Range,
        /// What is asked, about whom.
        examination: Examination,
    },
}

impl Task {
    /// Which tasks.
    pub fn range(&self) -> Range {
        match self {
            Self::Evaluate { range, .. } | Self::Examine { range, .. } => *range,
        }
    }
}

/// Why there is a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Its tasks are to be done: they are leased to it.
    Ordinary,
    /// Another lease's tasks may get done sooner so. They are leased to that one.
    Copy(AssignmentId),
    /// Its tasks are done, and disputed.
    Decides,
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
    /// The count that its worker told last, if it counts.
    pub progress: Option<u64>,
    /// When that grew last.
    pub moved: Duration,
}

impl Lease {
    /// A new one, that its job is not charged for.
    pub fn new(now: Now, worker: &WorkerId, job: &JobId, range: Range, kind: Kind) -> Self {
        let (worker, job, since) = (worker.clone(), job.clone(), now.since_start);
        Self { worker, job, range, kind, solo: false, since, charged: 0.0, progress: None, moved: since }
    }
}

impl Scheduler {
    /// Gives a lease to its worker, and tells it.
    pub(super) fn assign(&mut self, now: Now, id: AssignmentId, lease: Lease, task: Task) {
        let (Some(worker), Some(job)) = (self.workers.get_mut(&lease.worker), self.jobs.get_mut(&lease.job)) else {
            return;
        };
        let Some(session) = worker.session else { return };
        worker.held.insert(id);
        let toml = worker.known_jobs.insert(lease.job.clone()).then(|| job.toml.clone());
        if let Some(write) = job.start(now) {
            self.actions.push(Action::Write(Box::new(write)));
        }
        let message = Message::Assign { assignment: id, job: lease.job.clone(), toml, task };
        self.actions.push(Action::Send(lease.worker.clone(), session, message));
        self.leases.insert(id, lease);
    }

    /// The next assignment's id.
    pub(super) fn new_assignment(&mut self) -> AssignmentId {
        self.next_assignment += 1;
        AssignmentId(self.next_assignment - 1)
    }

    /// Gives a lease back: what it covers and is not done becomes pending again. Costs nothing.
    pub(super) fn release(&mut self, id: AssignmentId, why: LeaseEnd) -> Option<Lease> {
        let lease = self.leases.get(&id)?.clone();
        self.note_end(id, &lease, why);
        self.drop_lease(id)
    }

    /// Ends a lease; what it covers and is not done becomes pending again.
    pub(super) fn drop_lease(&mut self, id: AssignmentId) -> Option<Lease> {
        let lease = self.leases.remove(&id)?;
        self.solos.remove(&id);
        self.let_go(&lease.worker, id);
        let copy = self.copies.remove(&id);
        if let Kind::Copy(original) = lease.kind {
            self.copies.remove(&original);
        }
        if let Some(job) = self.jobs.get_mut(&lease.job) {
            job.finish_tag -= lease.charged;
            if job.round.contains(&lease.range) {
                if let Some(copy) = copy {
                    job.round.pass_on(&lease.range, id, copy);
                }
                job.round.release(&lease.range, id);
            }
        }
        if let Some(copy) = copy.and_then(|copy| self.leases.get_mut(&copy)) {
            copy.kind = Kind::Ordinary;
        }
        Some(lease)
    }

    /// A worker has an assignment no more.
    pub(super) fn let_go(&mut self, worker: &WorkerId, id: AssignmentId) {
        if let Some(holder) = self.workers.get_mut(worker) {
            holder.give_back(id);
            self.room.may_have(worker);
        }
    }

    /// A failure while this was worked on, or the crash of the worker that was `lost` with it: its tasks are suspects. If
    /// it was one task, and it is `sure` that nothing else was the reason, that is an attempt; too many of them fail the job.
    pub(super) fn blame(&mut self, now: Now, lease: &Lease, sure: bool, lost: Option<&WorkerId>, why: &str) {
        let Some(job) = self.jobs.get_mut(&lease.job) else { return };
        let range = &lease.range;
        // Done meanwhile by somebody else: not to blame.
        if !job.round.contains(range) || job.round.is_done(range) {
            return;
        }
        let Range { first, count, .. } = *range;
        let attempt = sure && count == 1;
        job.charge(Charge { first, count, attempt, lost: lost.map(|worker| worker.0.clone()) });
        let attempts = if attempt { job.round.attempts_of(first) } else { 0 };
        if attempts > 0 {
            let (job, range, why) = (lease.job.clone(), *range, why.to_owned());
            self.notes.push(Note::Attempt { job, range, attempts, why });
        }
        if attempts < super::MAX_ATTEMPTS {
            self.to_note.insert(lease.job.clone());
            return;
        }
        let what = job.round.work.describe(range.round, range.first);
        job.record.poisoned = Some(job.round.poisoned(range.first, attempts));
        let reason = format!("{what} failed {attempts} times; the last time: {why}");
        self.end_job(now, &lease.job, JobState::Failed, reason);
    }

    /// Takes leases away from their workers and tells them. For work that nobody needs any more.
    pub(super) fn cancel_leases(&mut self, ids: &[AssignmentId]) {
        self.take_away(ids, LeaseEnd::Needless);
    }

    /// Takes leases away from their workers, for any reason, and tells them.
    pub(super) fn take_away(&mut self, ids: &[AssignmentId], why: LeaseEnd) {
        let mut by_worker: BTreeMap<WorkerId, Vec<AssignmentId>> = BTreeMap::new();
        for &id in ids {
            if let Some(lease) = self.release(id, why) {
                by_worker.entry(lease.worker).or_default().push(id);
            }
        }
        for (worker, ids) in by_worker {
            if let Some(session) = self.workers.get(&worker).and_then(|w| w.session) {
                self.actions.push(Action::Send(worker, session, Message::Cancel(ids)));
            }
        }
    }
}
