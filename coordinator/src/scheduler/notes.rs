//! What happened inside the scheduler that whoever runs it wants to read and count. Nothing is decided by it.

use super::lease::{AssignmentId, Lease};
use super::worker::WorkerId;
use super::{Range, Scheduler};
use crate::record::JobId;

/// Something worth a line in the log.
#[derive(Clone, Debug, PartialEq)]
pub enum Note {
    /// A worker fell silent, or its connection broke and it did not come back in time.
    WorkerLost {
        /// Which.
        worker: WorkerId,
        /// For people.
        name: String,
        /// Assignments that were taken from it.
        leases: u32,
        /// Its connection broke, so it is taken for dead; otherwise it only fell silent.
        crashed: bool,
    },
    /// An assignment ended without a result.
    LeaseEnded {
        /// Who had it.
        worker: WorkerId,
        /// Of which job.
        job: JobId,
        /// Which.
        assignment: AssignmentId,
        /// What it was about.
        range: Range,
        /// Why.
        why: LeaseEnd,
    },
    /// Results that were not there before were taken in.
    Taken {
        /// From whom.
        worker: WorkerId,
        /// Of which job.
        job: JobId,
        /// The generation, or the round of examinations.
        round: u32,
        /// Whether they are evaluations of the search.
        evaluations: bool,
        /// How many.
        count: u32,
    },
    /// A task was charged with a crash or a failure.
    Attempt {
        /// Of which job.
        job: JobId,
        /// The task: a range of one.
        range: Range,
        /// So many it has been charged now.
        attempts: u32,
        /// What happened.
        why: String,
    },
    /// A worker that was taken for dead lives: what its death was blamed on is not to blame.
    TakenBack {
        /// Which.
        worker: WorkerId,
        /// Of which job.
        job: JobId,
        /// So many charges were taken back: suspicions and attempts.
        charges: u32,
    },
    /// What a worker found that computes wrongly is in doubt.
    Doubted {
        /// Which.
        worker: WorkerId,
        /// Of which job.
        job: JobId,
        /// So many tasks are asked again that nobody had doubted.
        tasks: u32,
    },
}

/// Why an assignment ended without a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum LeaseEnd {
    /// Its worker was lost.
    Lost,
    /// Its worker does not know of it.
    Undelivered,
    /// Its worker will stop, or may not go on.
    Drained,
    /// Its worker can't run it.
    Rejected,
    /// Its worker tried and failed.
    Failed,
    /// It made no progress for long.
    Stuck,
    /// Nobody needs it any more.
    Needless,
}

impl LeaseEnd {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Lost, Self::Undelivered, Self::Drained, Self::Rejected, Self::Failed, Self::Stuck, Self::Needless];

    /// As a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Lost => "lost",
            Self::Undelivered => "undelivered",
            Self::Drained => "drained",
            Self::Rejected => "rejected",
            Self::Failed => "failed",
            Self::Stuck => "stuck",
            Self::Needless => "needless",
        }
    }
}

impl Scheduler {
    /// What there is to tell since the last call.
    pub fn take_notes(&mut self) -> Vec<Note> {
        std::mem::take(&mut self.notes)
    }

    pub(super) fn note_end(&mut self, id: AssignmentId, lease: &Lease, why: LeaseEnd) {
        let (worker, job, range) = (lease.worker.clone(), lease.job.clone(), lease.range);
        self.notes.push(Note::LeaseEnded { worker, job, assignment: id, range, why });
    }
}
