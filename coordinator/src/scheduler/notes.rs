//! Scheduler events for logs and metrics. No decision depends on them.

use super::fleet::WorkerId;
use super::lease::{AssignmentId, Range};
use crate::record::JobId;

/// An event for the log and the metrics.
#[derive(Clone, Debug, PartialEq)]
pub enum Note {
    /// A worker sent no heartbeat in time, or its connection broke and it did not reconnect in time.
    WorkerLost {
        /// The worker.
        worker: WorkerId,
        /// Its display name.
        name: String,
        /// Number of its leases, which expired.
        leases: u32,
        /// True if its connection broke, so that it counts as crashed; false if it only sent no heartbeats.
        crashed: bool,
    },
    /// A lease ended without a result.
    LeaseEnded {
        /// The worker that held it.
        worker: WorkerId,
        /// Its job.
        job: JobId,
        /// The lease's id.
        assignment: AssignmentId,
        /// Its tasks.
        range: Range,
        /// Reason of the end.
        why: LeaseEnd,
    },
    /// New results were recorded.
    Taken {
        /// The worker that delivered them.
        worker: WorkerId,
        /// The job.
        job: JobId,
        /// The round.
        round: u32,
        /// Phase of the round.
        phase: &'static str,
        /// Number of new results.
        count: u32,
    },
    /// A worker delivered an invalid result and got a mark.
    Marked {
        /// The worker.
        worker: WorkerId,
        /// Its marks so far.
        marks: u32,
        /// Error in the result.
        why: String,
    },
    /// A crash or failure was counted as an attempt of a task.
    Attempt {
        /// The task's job.
        job: JobId,
        /// The task: a range of one.
        range: Range,
        /// Number of its attempts so far.
        attempts: u32,
        /// Reason of the last one.
        why: String,
    },
    /// A worker that counted as crashed is back: its tasks' charges for that crash are withdrawn.
    ChargesWithdrawn {
        /// The worker.
        worker: WorkerId,
        /// The job with the charged tasks.
        job: JobId,
        /// Number of withdrawn charges: suspicions and attempts.
        charges: u32,
    },
    /// A worker was quarantined: results that only it delivered are disputed.
    Doubted {
        /// The quarantined worker.
        worker: WorkerId,
        /// The job.
        job: JobId,
        /// Number of tasks with a new dispute.
        tasks: u32,
    },
}

/// Reason why a lease ended without a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum LeaseEnd {
    /// It expired: its worker sent no heartbeat in time.
    Lost,
    /// The worker does not list it, so the assignment never arrived.
    Undelivered,
    /// Its worker drains (returned), or was drained, expelled or quarantined (revoked).
    Drained,
    /// The worker returned it because it can't run it.
    Rejected,
    /// The worker returned it because its computation failed.
    Failed,
    /// It was revoked because it made no progress.
    Stuck,
    /// It was revoked because its result was refused.
    Refused,
    /// It was revoked because its tasks are done or no longer needed.
    Needless,
}

impl LeaseEnd {
    /// All reasons.
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

    /// Returns the reason as a word, for logs and metrics.
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
