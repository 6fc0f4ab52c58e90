//! What is known of a job, as scheduler, store and API share it.

mod charge;
mod dispute;
mod event;
mod ids;

pub use charge::Charge;
pub use dispute::{Claim, Dispute, Finder, Ruling, Source};
pub use event::{Event, JobEvent};
pub use ids::{AssignmentId, Range, WorkerId};

use serde::{Deserialize, Serialize};
use sim_core::base::digest::{Digest, ResultDigest};
use sim_core::procedure::Progress;
use std::fmt;
use std::sync::Arc;

/// Names a job: its number in the store and the start of its digest, so ids of two stores never mean different work.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct JobId(Arc<str>);

impl JobId {
    /// The id of the job with this number and digest.
    pub fn new(number: u64, digest: &Digest) -> Self {
        Self(format!("j{number}-{}", digest.short()).into())
    }

    /// As text.
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

/// Where a job stands. The numbers are those of the store's column `state`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum JobState {
    /// Stored; none of its tasks has been handed out yet.
    Queued = 1,
    /// Its rounds are worked on.
    Running = 2,
    /// Its procedure waits for a client's batch.
    Waiting = 3,
    /// Done: it has a result.
    Succeeded = 4,
    /// It can't go on, for a reason.
    Failed = 5,
    /// A client ended it.
    Cancelled = 6,
    /// A result that was folded into a sealed round turned out to be wrong.
    Tainted = 7,
}

impl JobState {
    /// All states.
    pub const ALL: [Self; 7] =
        [Self::Queued, Self::Running, Self::Waiting, Self::Succeeded, Self::Failed, Self::Cancelled, Self::Tainted];

    /// Whether a job in this state will never change again.
    pub fn is_end(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled | Self::Tainted)
    }

    /// The state in a word.
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

/// Where a restarted job comes from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// The job that it does again.
    pub job: JobId,
    /// Rounds taken over from it.
    pub rounds: u32,
}

/// The task that ended a job by failing too often.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Poisoned {
    /// Its round.
    pub round: u32,
    /// Its index in the round.
    pub index: u32,
    /// The task, for people.
    pub what: String,
    /// The task, as its procedure encodes it.
    #[serde(with = "serde_bytes")]
    pub task: Vec<u8>,
    /// How often it failed.
    pub attempts: u32,
}

/// A job as it stands. What is told of it changes only together with an event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobRecord {
    /// Its id.
    pub id: JobId,
    /// Position in the order of submission, from 1.
    pub number: u64,
    /// Its own name.
    pub name: String,
    /// The client's name for the request.
    pub request_id: String,
    /// Digest of the request's body: tells a repeated request from another one with the same id.
    pub request_digest: Digest,
    /// Where it stands.
    pub state: JobState,
    /// Digest of everything that makes it the same job as another.
    pub job_digest: Digest,
    /// The engine it needs.
    pub engine_digest: Digest,
    /// The version of evogait that stored it.
    pub version: String,
    /// Name of its procedure, such as "evolve".
    pub procedure: String,
    /// Rounds sealed.
    pub rounds_sealed: u32,
    /// Of these, how many of the first have their results in the store: a restart can take them over.
    pub rounds_kept: u32,
    /// Share of the workers, 1 to 100.
    pub priority: u32,
    /// How far its procedure is.
    pub progress: Progress,
    /// Why it failed or was tainted; empty otherwise.
    pub reason: String,
    /// Nothing new is handed out.
    pub paused: bool,
    /// The job that it does again, if it is a restart.
    pub restarted_from: Option<Origin>,
    /// Tasks of which workers gave different bits: all that are open, those of the round at hand, and the newest of the
    /// others.
    pub disputes: Vec<Dispute>,
    /// Crashes and failures held against tasks of the round at hand. Those tasks are worked on alone, and one that fails
    /// alone too often ends the job.
    pub charges: Vec<Charge>,
    /// The task that ended it by failing too often.
    pub poisoned: Option<Poisoned>,
    /// Unix time, ms.
    pub submitted_at_ms: i64,
    /// Unix time, ms; 0 = not yet.
    pub started_at_ms: i64,
    /// Unix time, ms; 0 = not yet.
    pub ended_at_ms: i64,
    /// Sequence number of the newest event.
    pub last_event: u64,
    /// Over the results of the sealed rounds.
    pub results_digest: Digest,
    /// The result digest; there once the job succeeded.
    pub result_digest: Option<Digest>,
}

/// Limit on the disputes in a job's answer to clients: the newest are sent.
pub(crate) const MAX_TOLD_DISPUTES: usize = 8;

impl JobRecord {
    /// A job without a name that was submitted at `submitted_at_ms` and has done nothing yet.
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

    /// The record as it is kept with an event: the parts that clients get.
    pub fn snapshot(&self) -> Self {
        let told = &self.disputes[self.disputes.len().saturating_sub(MAX_TOLD_DISPUTES)..];
        let mut disputes = told.to_vec();
        for dispute in &mut disputes {
            dispute.task.clear();
            dispute.seal();
        }
        Self { disputes, charges: Vec::new(), ..self.clone() }
    }

    /// Folds the digests of a sealed round's results.
    pub fn fold(&mut self, round: u32, digests: &[Digest]) {
        let mut digest = ResultDigest::resume(self.results_digest);
        digest.round(round, digests);
        self.results_digest = digest.value();
    }
}
