//! What is known of a job, as scheduler, store and API share it.

mod charge;
mod dispute;
mod outcome;

pub use charge::Charge;
pub use dispute::{Claim, Dispute, Ruling, Source, Subject};
pub(crate) use outcome::StoredOutcome;
pub use proto::v1::JobState;

use charge::{StoredCharge, charges_of};
use dispute::StoredDispute;
use proto::{ConvertError, v1};
use sim_core::base::digest::{Digest, ResultDigest};
use sim_core::base::score::Counts;
use sim_core::search::Scored;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

/// Most disputes that are told with a job: the newest ones.
const TOLD_DISPUTES: usize = 8;

/// Names a job: its number in the store and the start of its digest, so ids of two stores never mean different work.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
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

/// Whether a job in this state will never change again.
pub fn ended(state: JobState) -> bool {
    matches!(state, JobState::Succeeded | JobState::Failed | JobState::Cancelled | JobState::Tainted)
}

/// Where a restarted job comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The job that it does again.
    pub job: JobId,
    /// Generations taken over from it.
    pub generations: u32,
}

/// A job as it stands. What is told of it changes only together with an event.
#[derive(Clone, Debug, PartialEq)]
pub struct JobRecord {
    /// Its id.
    pub id: JobId,
    /// Position in the order of submission, from 1.
    pub number: u64,
    /// Its own name.
    pub name: String,
    /// What the client named the request.
    pub request_id: String,
    /// Digest of the request's body: tells a repeated request from another one with the same id.
    pub request_digest: Digest,
    /// Where it stands.
    pub state: JobState,
    /// What makes it the same job as another.
    pub job_digest: Digest,
    /// The engine it needs.
    pub engine_digest: Digest,
    /// The version of evogait that took it in; empty if that did not say.
    pub version: String,
    /// [`sim_core::search::REVISION`] of that version.
    pub search_revision: u32,
    /// Candidates a generation.
    pub population: u32,
    /// Generations sealed.
    pub generations_done: u32,
    /// Generations in all.
    pub generations_total: u32,
    /// 1 to 100.
    pub priority: u32,
    /// Best of all sealed generations, by the search's own scores.
    pub best: Option<Scored>,
    /// Best of generation 0; of the first generation with a success if all of generation 0 failed.
    pub first: Option<Scored>,
    /// The published winner; there once it is chosen.
    pub winner: Option<Scored>,
    /// Sum over the evaluations of sealed generations.
    pub counts: Counts,
    /// Evaluations in sealed generations.
    pub evaluations: u64,
    /// Those of them that failed.
    pub failed_evaluations: u64,
    /// Why it failed or was tainted; empty otherwise.
    pub reason: String,
    /// Nothing new is handed out.
    pub paused: bool,
    /// The job that it does again, if it is a restart.
    pub restarted_from: Option<Origin>,
    /// Tasks of which workers gave different bits: all that are not decided, those of the round at hand, and the newest
    /// of the others.
    pub disputes: Vec<Dispute>,
    /// What is held against tasks of the round at hand. Those are worked on alone, and those that failed alone too often
    /// end the job.
    pub charges: Vec<Charge>,
    /// The task that ended it by failing too often.
    pub poisoned: Option<v1::Poisoned>,
    /// Unix time, ms.
    pub submitted_at_ms: i64,
    /// Unix time, ms; 0 = not yet.
    pub started_at_ms: i64,
    /// Unix time, ms; 0 = not yet.
    pub ended_at_ms: i64,
    /// Sequence number of the newest event.
    pub last_event: u64,
    /// Over the scores of the sealed rounds.
    pub scores_digest: ResultDigest,
    /// The result digest; there once the job succeeded.
    pub result_digest: Option<Digest>,
}

impl JobRecord {
    /// As the API tells it.
    pub fn to_wire(&self) -> v1::Job {
        v1::Job {
            id: self.id.to_string(),
            name: self.name.clone(),
            state: self.state.into(),
            job_digest: self.job_digest.0.to_vec(),
            engine_digest: self.engine_digest.0.to_vec(),
            generations_done: self.generations_done,
            generations_total: self.generations_total,
            population: self.population,
            best: self.best.as_ref().map(Into::into),
            counts: Some(self.counts.into()),
            evaluations: self.evaluations,
            failed_evaluations: self.failed_evaluations,
            reason: self.reason.clone(),
            submitted_at_ms: self.submitted_at_ms,
            started_at_ms: self.started_at_ms,
            ended_at_ms: self.ended_at_ms,
            last_event: self.last_event,
            priority: self.priority,
            // Only the scheduler knows of the round at hand.
            round_done: 0,
            round_total: 0,
            paused: self.paused,
            restarted_from: self
                .restarted_from
                .as_ref()
                .map(|origin| v1::Origin { job_id: origin.job.to_string(), generations: origin.generations }),
            disputes: self.disputes[self.disputes.len().saturating_sub(TOLD_DISPUTES)..]
                .iter()
                .map(Dispute::to_wire)
                .collect(),
            poisoned: self.poisoned.clone(),
        }
    }

    /// For the store.
    pub(crate) fn to_stored(&self) -> StoredRecord {
        StoredRecord {
            job: Some(self.to_wire()),
            number: self.number,
            request_id: self.request_id.clone(),
            request_digest: self.request_digest.0.to_vec(),
            first: self.first.as_ref().map(Into::into),
            winner: self.winner.as_ref().map(Into::into),
            scores_digest: self.scores_digest.value().0.to_vec(),
            result_digest: self.result_digest.map(|d| d.0.to_vec()).unwrap_or_default(),
            disputes: self.disputes.iter().map(Dispute::to_stored).collect(),
            charges: self.charges.iter().map(Into::into).collect(),
            suspects: BTreeMap::new(),
            version: self.version.clone(),
            search_revision: self.search_revision,
        }
    }

    /// From the store.
    pub(crate) fn from_stored(stored: StoredRecord) -> Result<Self, ConvertError> {
        let job = stored.job.ok_or(ConvertError::Missing { field: "job" })?;
        Ok(Self {
            id: job.id.as_str().into(),
            number: stored.number,
            state: job.state(),
            request_id: stored.request_id,
            request_digest: proto::digest("request_digest", &stored.request_digest)?,
            job_digest: proto::digest("job_digest", &job.job_digest)?,
            engine_digest: proto::digest("engine_digest", &job.engine_digest)?,
            name: job.name,
            version: stored.version,
            // Before it was stored there was only one.
            search_revision: stored.search_revision.max(1),
            population: job.population,
            generations_done: job.generations_done,
            generations_total: job.generations_total,
            priority: job.priority,
            best: job.best.map(Scored::try_from).transpose()?,
            first: stored.first.map(Scored::try_from).transpose()?,
            winner: stored.winner.map(Scored::try_from).transpose()?,
            counts: job.counts.map(Counts::from).unwrap_or_default(),
            evaluations: job.evaluations,
            failed_evaluations: job.failed_evaluations,
            reason: job.reason,
            paused: job.paused,
            restarted_from: job
                .restarted_from
                .map(|origin| Origin { job: origin.job_id.as_str().into(), generations: origin.generations }),
            disputes: stored.disputes.into_iter().map(Dispute::from_stored).collect::<Result<_, _>>()?,
            charges: charges_of(&stored.suspects).chain(stored.charges.into_iter().map(Into::into)).collect(),
            poisoned: job.poisoned,
            submitted_at_ms: job.submitted_at_ms,
            started_at_ms: job.started_at_ms,
            ended_at_ms: job.ended_at_ms,
            last_event: job.last_event,
            scores_digest: ResultDigest::resume(proto::digest("scores_digest", &stored.scores_digest)?),
            result_digest: match stored.result_digest.as_slice() {
                [] => None,
                bytes => Some(proto::digest("result_digest", bytes)?),
            },
        })
    }
}

/// A [`JobRecord`] in the store.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct StoredRecord {
    #[prost(message, optional, tag = "1")]
    job: Option<v1::Job>,
    #[prost(uint64, tag = "2")]
    number: u64,
    #[prost(string, tag = "3")]
    request_id: String,
    #[prost(bytes = "vec", tag = "4")]
    request_digest: Vec<u8>,
    #[prost(message, optional, tag = "5")]
    first: Option<v1::ScoredCandidate>,
    #[prost(bytes = "vec", tag = "6")]
    scores_digest: Vec<u8>,
    #[prost(bytes = "vec", tag = "7")]
    result_digest: Vec<u8>,
    #[prost(message, optional, tag = "8")]
    winner: Option<v1::ScoredCandidate>,
    #[prost(message, repeated, tag = "9")]
    disputes: Vec<StoredDispute>,
    /// Of older versions.
    #[prost(btree_map = "uint32, uint32", tag = "10")]
    suspects: BTreeMap<u32, u32>,
    #[prost(string, tag = "11")]
    version: String,
    #[prost(uint32, tag = "12")]
    search_revision: u32,
    #[prost(message, repeated, tag = "13")]
    charges: Vec<StoredCharge>,
}
