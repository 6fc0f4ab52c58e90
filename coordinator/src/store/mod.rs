//! Stores of jobs: one trait, with SQLite and PostgreSQL for production and memory for tests. One test suite covers
//! all.
//!
//! There are few indexed columns; all other data is in versioned blobs (a version byte, then MessagePack by field
//! name). This keeps the second SQL dialect small, and fields can be added. Floating-point numbers are in blobs to
//! preserve their bits: SQLite turns NaN into NULL.

mod blob;
mod memory;
mod postgres;
mod sql;
mod sqlite;
mod tables;
mod url;

pub(crate) use blob::decode_anything;
pub use memory::MemoryStore;
pub use postgres::{BadPostgresUrl, PostgresStore, PostgresUrl};
pub use sqlite::SqliteStore;
pub use url::{BadStoreUrl, StoreUrl};

use crate::permit::PermitKey;
use crate::record::{Claimant, JobEvent, JobId, JobRecord, JobState};
use serde::{Deserialize, Serialize};
use sim_core::base::digest::Digest;
use sim_core::procedure::{Artefact, SeriesRow};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

/// Reason for refusing a store with an earlier schema.
const OLDER: &str = "it was written by an older version of evogait, which did not store jobs as rounds of tasks: finish \
                     them with that version, or use another --store (or folder, for `evogait run`) and submit them again";

/// Change of the store. Related changes are committed together.
#[derive(Clone, Debug, PartialEq)]
pub enum Write {
    /// A new job.
    Submit {
        /// Job of the change.
        record: JobRecord,
        /// Resolved job file.
        toml: Arc<str>,
        /// State of the procedure before the current round.
        state: RunState,
        /// First event of the job.
        event: JobEvent,
    },
    /// Results of the current round.
    Results {
        /// Job of the change.
        job: JobId,
        /// Round of the tasks.
        round: u32,
        /// Ranges without overlap: index of the first task, and results.
        ranges: Vec<(u32, Vec<Arc<[u8]>>)>,
        /// Worker that delivered the results.
        finder: Claimant,
    },
    /// A round was sealed: its stored data, the state for the next round and the events.
    Seal {
        /// Job after the change.
        record: JobRecord,
        /// Stored data of the round; the results of its ranges are deleted.
        sealed: SealedRound,
        /// State of the procedure for the next round.
        state: RunState,
        /// Events, in order.
        events: Vec<JobEvent>,
    },
    /// A job changed.
    Change {
        /// Job after the change.
        record: JobRecord,
        /// Event of the change.
        event: JobEvent,
    },
    /// A client sent a batch: the procedure continues.
    Offer {
        /// Job after the change.
        record: JobRecord,
        /// State of the procedure with the batch.
        state: RunState,
        /// Event of the change.
        event: JobEvent,
    },
    /// A part of the record that causes no event changed: charges or disputes.
    Note {
        /// Job after the change.
        record: JobRecord,
    },
    /// A restarted job takes over the stored data of the first rounds of another job.
    Carry {
        /// Job with the rounds.
        from: JobId,
        /// Restarted job, submitted before this change.
        to: JobId,
        /// Number of rounds, from the first on.
        rounds: u32,
    },
    /// A worker was quarantined: its results are ignored from now on.
    Quarantine {
        /// Quarantined worker.
        entry: Quarantined,
        /// Worker to remove because the limit is reached.
        instead_of: Option<Arc<str>>,
    },
    /// The last round was sealed: the job succeeded.
    Finish {
        /// Job after the change.
        record: JobRecord,
        /// Stored data of the round.
        sealed: SealedRound,
        /// Artefacts of the job.
        artefacts: Vec<Artefact>,
        /// Events, in order.
        events: Vec<JobEvent>,
    },
}

impl Write {
    /// Returns the events of the change, to be published after the commit.
    pub fn events(&self) -> &[JobEvent] {
        match self {
            Self::Submit { event, .. } | Self::Change { event, .. } | Self::Offer { event, .. } => {
                std::slice::from_ref(event)
            }
            Self::Seal { events, .. } | Self::Finish { events, .. } => events,
            Self::Results { .. } | Self::Note { .. } | Self::Carry { .. } | Self::Quarantine { .. } => &[],
        }
    }

    /// Returns the job's record after the change, if the change contains it.
    pub fn record(&self) -> Option<&JobRecord> {
        match self {
            Self::Submit { record, .. }
            | Self::Seal { record, .. }
            | Self::Change { record, .. }
            | Self::Offer { record, .. }
            | Self::Note { record }
            | Self::Finish { record, .. } => Some(record),
            Self::Results { .. } | Self::Carry { .. } | Self::Quarantine { .. } => None,
        }
    }
}

/// State of a job between two rounds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunState {
    /// Encoded state of the procedure.
    #[serde(with = "serde_bytes")]
    pub procedure: Vec<u8>,
    /// Newest sealed round.
    pub last: Option<LastRound>,
}

/// Newest sealed round. A late result of it can be compared, and a third worker can decide a dispute.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LastRound {
    /// Number of the round.
    pub number: u32,
    /// Tasks of the round, by index.
    pub tasks: Arc<[TaskRecord]>,
}

/// Task of a sealed round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TaskRecord {
    /// Encoded task.
    #[serde(with = "serde_bytes")]
    pub task: Vec<u8>,
    /// Description of the task.
    pub what: String,
    /// Digest of the result.
    pub digest: Digest,
    /// Worker that delivered the result.
    pub finder: Claimant,
}

/// Stored data of a sealed round.
#[derive(Clone, Debug, PartialEq)]
pub struct SealedRound {
    /// Number of the round.
    pub number: u32,
    /// Row of measurements of the round, if it has one.
    pub row: Option<SeriesRow>,
    /// Digests of the results, by index.
    pub digests: Vec<Digest>,
    /// Results, by index, if they are kept.
    pub results: Option<Vec<Arc<[u8]>>>,
}

/// Quarantined worker: its results are ignored.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Quarantined {
    /// Id of the worker.
    pub worker: Arc<str>,
    /// Name of the worker.
    pub name: Arc<str>,
    /// Source address of the worker.
    pub host: Arc<str>,
    /// First digits of the digest of its token; empty if calls require no token.
    pub credential: Arc<str>,
    /// Reason, in a sentence.
    pub reason: String,
    /// Unix time, ms.
    pub at_ms: i64,
}

/// Stored results of a range of tasks.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredRange {
    /// Round of the tasks.
    pub round: u32,
    /// Index of the first task.
    pub first: u32,
    /// Results, by index from `first` on.
    pub results: Vec<Arc<[u8]>>,
    /// Worker that delivered the results.
    pub finder: Claimant,
}

/// Active job, with all data to resume it.
#[derive(Clone, Debug)]
pub struct StoredJob {
    /// Record of the job.
    pub record: JobRecord,
    /// Resolved job file.
    pub toml: Arc<str>,
    /// State of the procedure before the current round.
    pub state: RunState,
    /// Results of the current round.
    pub results: Vec<StoredRange>,
}

/// Content of a store that a starting coordinator needs.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// Number of starts on this store, including this one.
    pub epoch: u64,
    /// Secret key of the store's permits.
    pub key: PermitKey,
    /// Number of the next job.
    pub next_job: u64,
    /// Active jobs.
    pub active: Vec<StoredJob>,
    /// Ended jobs.
    pub ended: Vec<JobId>,
    /// Quarantined workers.
    pub quarantined: Vec<Quarantined>,
}

/// Result of a job that succeeded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoredResult {
    /// Rows of measurements of the sealed rounds, in order.
    pub history: Vec<SeriesRow>,
    /// Artefacts of the job.
    pub artefacts: Vec<Artefact>,
}

/// Stored event, with the record of its job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoredEvent {
    /// Event of the change.
    pub event: JobEvent,
    /// Record of the job after the event.
    pub job: JobRecord,
}

/// Error of a store.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The file, folder or database can't be opened or created. Can't be retried before the cause is removed.
    #[error("can't open the store {store}: {reason}")]
    Open {
        /// Name of the store, without a password.
        store: String,
        /// Message of the system or the database.
        reason: String,
    },
    /// Another process has the store open. Can be retried once that process has ended.
    #[error("the store {store} is in use by another coordinator: stop that one, or choose another --store")]
    InUse {
        /// Name of the store, without a password.
        store: String,
    },
    /// The file or database is not a store, or has another version.
    #[error("{store} is not a store that this version can read: {reason}")]
    Foreign {
        /// Name of the store, without a password.
        store: String,
        /// Description of the difference.
        reason: String,
    },
    /// The disk is full or a quota is reached. Can be retried once there is space.
    #[error(
        "the disk that holds the store {store} is full: free some space and start the coordinator again; nothing that was acknowledged is lost"
    )]
    Full {
        /// Name of the store, without a password.
        store: String,
    },
    /// Another coordinator is active on a shared store. Can be retried once that one has ended.
    #[error(
        "another coordinator (start {epoch}) is active on this store: stop that one, choose another --store, or add --standby \
         to wait here until it ends"
    )]
    Active {
        /// Epoch of the active coordinator.
        epoch: u64,
        /// Unix time of its last renewal, µs; a change shows that the other coordinator is running.
        stamp: i64,
    },
    /// The database does not respond, or closes the connection. Can be retried.
    #[error(
        "can't reach the store {store}: {reason}; start the coordinator again once the database responds; nothing that was acknowledged is lost"
    )]
    Unreachable {
        /// Name of the store, without a password.
        store: String,
        /// Message of the system or the database.
        reason: String,
    },
    /// Another coordinator has taken over the store. Writes of this one are refused.
    #[error("another coordinator (start {by}) has taken over the store of this one (start {own}), which stops now")]
    Superseded {
        /// Epoch of this coordinator.
        own: u64,
        /// Epoch of the other coordinator.
        by: u64,
    },
    /// The store was closed by a clean shutdown. Can be retried on the next coordinator.
    #[error("the store is closed because the coordinator is stopping")]
    Closed,
    /// A stored value can't be read.
    #[error("can't read a value in the store: {what}: restore the store from a backup")]
    Corrupt {
        /// Name of the value, and the fault.
        what: String,
    },
    /// Any other error of the database.
    #[error("the store failed: {0}; check the disk or the database that holds it, then start again")]
    Database(String),
}

/// Future result of a store's function.
pub type Answer<'a, T> = Pin<Box<dyn Future<Output = Result<T, StoreError>> + Send + 'a>>;

/// Durable store of jobs. All functions see the changes that were committed before the call.
pub trait Store: Send + Sync {
    /// Starts a new epoch and returns all data to resume the jobs. From then on, writes of an earlier epoch are
    /// refused. Returns [`StoreError::Active`] while another coordinator is active on a shared store.
    fn start(&self) -> Answer<'_, Loaded>;

    /// Commits all changes or none, and returns once they are on the disk. Returns [`StoreError::Superseded`] if a
    /// later epoch has started.
    fn commit(&self, epoch: u64, writes: Vec<Write>) -> Answer<'_, ()>;

    /// Interval at which [`Store::renew`] must be called on a shared store; `None` if the store can't be shared.
    fn renew_every(&self) -> Option<Duration> {
        None
    }

    /// Renews the lock on a shared store. Returns [`StoreError::Superseded`] if a later epoch has started.
    fn renew(&self, _epoch: u64) -> Answer<'_, ()> {
        Box::pin(std::future::ready(Ok(())))
    }

    /// Releases the lock on a shared store, so that a standby does not wait.
    fn release(&self, _epoch: u64) -> Answer<'_, ()> {
        Box::pin(std::future::ready(Ok(())))
    }

    /// Returns a job and its resolved job file.
    fn job<'a>(&'a self, id: &'a JobId) -> Answer<'a, Option<(JobRecord, String)>>;

    /// Returns the job with this request id.
    fn job_of_request<'a>(&'a self, request_id: &'a str) -> Answer<'a, Option<JobRecord>>;

    /// Returns up to `limit` jobs with numbers below `below`, newest first. If `states` is not empty, only jobs in
    /// these states are returned.
    fn jobs<'a>(&'a self, below: u64, limit: u32, states: &'a [JobState]) -> Answer<'a, Vec<JobRecord>>;

    /// Returns up to `limit` events after a sequence number, in order.
    fn events<'a>(&'a self, id: &'a JobId, after: u64, limit: u32) -> Answer<'a, Vec<StoredEvent>>;

    /// Returns the digests of a sealed round's results, by index.
    fn digests<'a>(&'a self, id: &'a JobId, round: u32) -> Answer<'a, Option<Vec<Digest>>>;

    /// Returns up to `limit` sealed rounds from a number on, in order. Results are included if they are kept.
    fn rounds<'a>(&'a self, id: &'a JobId, from: u32, limit: u32) -> Answer<'a, Vec<SealedRound>>;

    /// Returns the history and the artefacts of a job.
    fn result<'a>(&'a self, id: &'a JobId) -> Answer<'a, StoredResult>;

    /// Closes the store. Later calls return [`StoreError::Closed`]. May be called several times.
    fn close(&self) -> Answer<'_, ()>;
}

/// Opens the store with this URL. On a shared store, another coordinator may take over if this one does not renew its
/// lock for `takeover`.
// Boxed, so that it is compiled once, here, and not in every crate that awaits it.
pub fn open(url: &StoreUrl, takeover: Duration) -> Answer<'_, Arc<dyn Store>> {
    Box::pin(async move {
        Ok(match url {
            StoreUrl::Sqlite(path) => Arc::new(SqliteStore::open(path).await?) as Arc<dyn Store>,
            StoreUrl::Postgres(url) => Arc::new(PostgresStore::open(url, takeover).await?),
            StoreUrl::Memory => Arc::new(MemoryStore::default()),
        })
    })
}

#[cfg(test)]
pub(crate) mod tests;
