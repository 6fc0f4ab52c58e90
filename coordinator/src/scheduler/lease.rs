//! Work that a worker has been given.

use super::notes::{LeaseEnd, Note};
use super::round::Range;
use super::worker::WorkerId;
use super::{Action, Message, Now, Scheduler};
use crate::record::{JobId, JobState};
use sim_core::finish::Examination;
use sim_core::score::Genome;
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
        /// The genomes of the whole generation, by index.
        genomes: Arc<[Genome]>,
    },
    /// Answer a question about a candidate.
    Examine {
        /// Its place in its round: a range of one.
        range: Range,
        /// What is asked, about whom.
        examination: Examination,
    },
}

#[derive(Clone, Debug)]
pub(super) struct Lease {
    pub worker: WorkerId,
    pub job: JobId,
    pub range: Range,
    pub since: Duration,
    /// What the job's fair-queue tag was charged for it.
    pub charged: f64,
}

impl Scheduler {
    /// Gives a lease back: what it covers and is not done becomes pending again. Costs nothing.
    pub(super) fn release(&mut self, id: AssignmentId, why: LeaseEnd) -> Option<Lease> {
        let lease = self.leases.remove(&id)?;
        self.note_end(id, &lease, why);
        self.let_go(&lease.worker, id);
        if let Some(job) = self.jobs.get_mut(&lease.job) {
            job.finish_tag -= lease.charged;
            if job.round.contains(&lease.range) {
                job.round.release(&lease.range, id);
            }
        }
        Some(lease)
    }

    /// A worker has an assignment no more.
    pub(super) fn let_go(&mut self, worker: &WorkerId, id: AssignmentId) {
        if let Some(held) = self.workers.get_mut(worker).map(|w| &mut w.held) {
            held.remove(&id);
            self.room.may_have(worker);
        }
    }

    /// A crash or failure while this was worked on. A range of several is split to find the culprit; one that failed
    /// alone too often fails the job.
    pub(super) fn blame(&mut self, now: Now, lease: &Lease, why: &str) {
        let Some(job) = self.jobs.get_mut(&lease.job) else { return };
        let range = &lease.range;
        // Done meanwhile by somebody else: not to blame.
        if !job.round.contains(range) || job.round.is_done(range) {
            return;
        }
        let attempts = job.round.blame(range);
        if attempts > 0 {
            let (job, range, why) = (lease.job.clone(), *range, why.to_owned());
            self.notes.push(Note::Attempt { job, range, attempts, why });
        }
        let what = job.round.work.describe(range.round, range.first);
        if attempts >= super::MAX_ATTEMPTS {
            let reason = format!("{what} failed {attempts} times; the last time: {why}");
            self.end_job(now, &lease.job, JobState::Failed, reason);
        }
    }

    /// Takes leases away from their workers and tells them. For work that nobody needs any more.
    pub(super) fn cancel_leases(&mut self, ids: &[AssignmentId]) {
        let mut by_worker: BTreeMap<WorkerId, Vec<AssignmentId>> = BTreeMap::new();
        for &id in ids {
            if let Some(lease) = self.release(id, LeaseEnd::Needless) {
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
