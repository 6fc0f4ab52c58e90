//! Record of a job, shared by scheduler, store and API.

mod charge;
mod dispute;
mod event;
mod ids;

pub use charge::Charge;
pub use dispute::{Claim, Claimant, Dispute, Ruling, Source};
pub use event::{Event, JobEvent};
pub use ids::{AssignmentId, Range, WorkerId};

use serde::{Deserialize, Serialize};
use sim_core::base::digest::{Digest, ResultDigest};
use sim_core::procedure::Progress;
use std::fmt;
use std::sync::Arc;

/// Id of a job: its number in the store and the start of its digest. Equal ids of two stores therefore mean the same
/// work.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct JobId(Arc<str>);

impl JobId {
    /// Returns the id of the job with this number and digest.
    pub fn new(number: u64, digest: &Digest) -> Self {
        Self(format!("j{number}-{}", digest.short()).into())
    }

    /// Returns the id as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl From<&str> for JobId {
    fn from(text: &str) -> Self {
        Self(text.into())
    }
}

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// State of a job. The numbers are those of the store's column `state`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum JobState {
    /// Stored; none of its tasks has been leased yet.
    Queued = 1,
    /// Its tasks are running or ready to run.
    Running = 2,
    /// Its procedure waits for a client's batch.
    Waiting = 3,
    /// Ended with a result.
    Succeeded = 4,
    /// Ended by a failure; the record has the reason.
    Failed = 5,
    /// Ended by a client.
    Cancelled = 6,
    /// Ended because a result in a sealed round was found to be wrong.
    Tainted = 7,
}

impl JobState {
    /// All states.
    pub const ALL: [Self; 7] =
        [Self::Queued, Self::Running, Self::Waiting, Self::Succeeded, Self::Failed, Self::Cancelled, Self::Tainted];

    /// Returns true if the state is final.
    pub fn is_end(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled | Self::Tainted)
    }

    /// Returns the state's name.
    pub fn word(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Waiting => "waiting",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
            Self::Tainted => "tainted",
        }
    }
}

/// Origin of a restarted job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// Job that was restarted.
    pub job: JobId,
    /// Number of rounds taken over from it.
    pub rounds: u32,
}

/// Task that ended its job by too many crashes or failures.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Poisoned {
    /// Round of the task.
    pub round: u32,
    /// Index of the task in its round.
    pub index: u32,
    /// Description of the task.
    pub what: String,
    /// Encoded task of the procedure.
    #[serde(with = "serde_bytes")]
    pub task: Vec<u8>,
    /// Number of crashes and failures.
    pub attempts: u32,
}

/// State of a job. Parts that clients see change only together with an event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobRecord {
    /// Id of the job.
    pub id: JobId,
    /// Number in the order of submission, from 1.
    pub number: u64,
    /// Name in the job file.
    pub name: String,
    /// Request id that the client chose.
    pub request_id: String,
    /// Digest of the request's body. It distinguishes a repeated request from another one with the same id.
    pub request_digest: Digest,
    /// State of the job.
    pub state: JobState,
    /// Job digest: jobs with equal digests must have equal results.
    pub job_digest: Digest,
    /// Digest of the engine that the job needs.
    pub engine_digest: Digest,
    /// Version of evogait that stored the job.
    pub version: String,
    /// Name of the procedure, such as "evolve".
    pub procedure: String,
    /// Number of sealed rounds.
    pub rounds_sealed: u32,
    /// Number of rounds, from the first on, with results in the store. A restart can take them over.
    pub rounds_kept: u32,
    /// Priority, 1 to 100: relative share of the workers.
    pub priority: u32,
    /// Progress of the procedure.
    pub progress: Progress,
    /// Reason of a failed or tainted job; empty otherwise.
    pub reason: String,
    /// True if no new tasks are leased.
    pub paused: bool,
    /// Origin, if the job is a restart.
    pub restarted_from: Option<Origin>,
    /// Tasks with different results from different workers: all open disputes, those of the current round, and the
    /// newest of the others.
    pub disputes: Vec<Dispute>,
    /// Crashes and failures charged to tasks of the current round. Each of these tasks is leased alone; too many
    /// failures of one task end the job.
    pub charges: Vec<Charge>,
    /// Task that ended the job by too many crashes or failures.
    pub poisoned: Option<Poisoned>,
    /// Unix time of the submission, ms.
    pub submitted_at_ms: i64,
    /// Unix time of the start, ms; 0 before it.
    pub started_at_ms: i64,
    /// Unix time of the end, ms; 0 before it.
    pub ended_at_ms: i64,
    /// Sequence number of the newest event.
    pub last_event: u64,
    /// Digest of the results of the sealed rounds.
    pub results_digest: Digest,
    /// Result digest; set once the job has succeeded.
    pub result_digest: Option<Digest>,
}

/// Limit on the disputes that a client receives with a job: the newest ones.
pub(crate) const MAX_TOLD_DISPUTES: usize = 8;

impl JobRecord {
    /// Creates a queued job without a name, submitted at `submitted_at_ms` (Unix time, ms).
    pub fn new(number: u64, job_digest: Digest, submitted_at_ms: i64) -> Self {
        Self {
            id: JobId::new(number, &job_digest),
            number,
            name: String::new(),
            request_id: String::new(),
            request_digest: Digest([0; 32]),
            state: JobState::Queued,
            job_digest,
            engine_digest: Digest([0; 32]),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            procedure: String::new(),
            rounds_sealed: 0,
            rounds_kept: 0,
            priority: 0,
            progress: Progress::default(),
            reason: String::new(),
            paused: false,
            restarted_from: None,
            disputes: Vec::new(),
            charges: Vec::new(),
            poisoned: None,
            submitted_at_ms,
            started_at_ms: 0,
            ended_at_ms: 0,
            last_event: 0,
            results_digest: ResultDigest::start(&job_digest).value(),
            result_digest: None,
        }
    }

    /// Returns the copy that is stored with an event: the parts that clients receive.
    pub fn snapshot(&self) -> Self {
        let told = &self.disputes[self.disputes.len().saturating_sub(MAX_TOLD_DISPUTES)..];
        let mut disputes = told.to_vec();
        for dispute in &mut disputes {
            dispute.task.clear();
            dispute.seal();
        }
        Self { disputes, charges: Vec::new(), ..self.clone() }
    }

    /// Adds the digests of a sealed round's results to the results digest.
    pub fn fold(&mut self, round: u32, digests: &[Digest]) {
        let mut digest = ResultDigest::resume(self.results_digest);
        digest.round(round, digests);
        self.results_digest = digest.value();
    }
}
