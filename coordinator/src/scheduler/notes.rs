//! Events inside the scheduler for logs and metrics. Nothing is decided by them.

use super::fleet::WorkerId;
use super::lease::{AssignmentId, Range};
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
    /// Results that were not there before were recorded.
    Taken {
        /// The worker that delivered them.
        worker: WorkerId,
        /// The job.
        job: JobId,
        /// The round.
        round: u32,
        /// What the round is about, in a word.
        phase: &'static str,
        /// How many.
        count: u32,
    },
    /// A worker delivered what can't be a result of its task.
    Marked {
        /// The worker.
        worker: WorkerId,
        /// Its marks so far.
        marks: u32,
        /// What is wrong with the result.
        why: String,
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
    ChargesWithdrawn {
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
    /// Its result was refused.
    Refused,
    /// Its tasks are done, or not needed any more.
    Needless,
}

impl LeaseEnd {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Lost,
        Self::Undelivered,
        Self::Drained,
        Self::Rejected,
        Self::Failed,
        Self::Stuck,
        Self::Refused,
        Self::Needless,
    ];

    /// As a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Lost => "lost",
            Self::Undelivered => "undelivered",
            Self::Drained => "drained",
            Self::Rejected => "rejected",
            Self::Failed => "failed",
            Self::Stuck => "stuck",
            Self::Refused => "refused",
            Self::Needless => "needless",
        }
    }
}
