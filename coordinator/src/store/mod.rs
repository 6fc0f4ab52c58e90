//! Where jobs live. One trait; SQLite and PostgreSQL in production, memory in tests; one test suite for all.
//!
//! Few indexed columns, everything else in versioned blobs (a version byte, then MessagePack by field name), so that a second
//! SQL dialect stays small and a field can be added. Numbers that must keep their bits are in blobs: SQLite turns NaN into
//! NULL.

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
use crate::record::{Finder, JobEvent, JobId, JobRecord, JobState};
use serde::{Deserialize, Serialize};
use sim_core::base::digest::Digest;
use sim_core::procedure::{Artefact, Row};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

/// Why a store of an earlier schema is refused.
const OLDER: &str = "it was written by an older version of evogait, whose jobs were no rounds of tasks: finish them with that \
                     version, or use another --store (or folder, for `evogait run`) and submit them again";

/// One change. Changes that belong together are committed together.
#[derive(Clone, Debug, PartialEq)]
pub enum Write {
    /// A job comes in.
    Submit {
        /// The job.
        record: JobRecord,
        /// As it was resolved.
        toml: Arc<str>,
        /// Its state before the round at hand.
        state: RunState,
        /// The first event.
        event: JobEvent,
    },
    /// Results of the round at hand.
    Results {
        /// The job.
        job: JobId,
        /// The round.
        round: u32,
        /// Ranges without overlap: (index of the first, results).
        ranges: Vec<(u32, Vec<Arc<[u8]>>)>,
        /// The worker that delivered them.
        finder: Finder,
    },
    /// A round is over: what is kept of it, the state for the next one and the events at once.
    Seal {
        /// The job after it.
        record: JobRecord,
        /// What is kept of the round; the ranges' results go.
        sealed: SealedRound,
        /// The state for the next round.
        state: RunState,
        /// Events, in order.
        events: Vec<JobEvent>,
    },
    /// The job stands elsewhere.
    Change {
        /// The job after it.
        record: JobRecord,
        /// The event.
        event: JobEvent,
    },
    /// A client's batch came: the procedure goes on.
    Offer {
        /// The job after it.
        record: JobRecord,
        /// The state with the batch.
        state: RunState,
        /// The event.
        event: JobEvent,
    },
    /// A part of the record that is not watched changed: charges or disputes.
    Note {
        /// The job after it.
        record: JobRecord,
    },
    /// A restarted job takes over what is kept of the first rounds of another.
    Carry {
        /// From this job …
        from: JobId,
        /// … to this one, which was submitted before.
        to: JobId,
        /// How many.
        rounds: u32,
    },
    /// A worker's results are ignored from now on.
    Quarantine {
        /// The worker.
        entry: Quarantined,
        /// The entry that it replaces, where there are too many.
        instead_of: Option<Arc<str>>,
    },
    /// The last round is over: the job succeeded.
    Finish {
        /// The job after it.
        record: JobRecord,
        /// What is kept of the round.
        sealed: SealedRound,
        /// What the job made.
        artefacts: Vec<Artefact>,
        /// Events, in order.
        events: Vec<JobEvent>,
    },
}

impl Write {
    /// The events among it, to be published once it is committed.
    pub fn events(&self) -> &[JobEvent] {
        match self {
            Self::Submit { event, .. } | Self::Change { event, .. } | Self::Offer { event, .. } => {
                std::slice::from_ref(event)
            }
            Self::Seal { events, .. } | Self::Finish { events, .. } => events,
            Self::Results { .. } | Self::Note { .. } | Self::Carry { .. } | Self::Quarantine { .. } => &[],
        }
    }

    /// The job as it stands after it, if the write has that in full.
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

/// The state of a job between two rounds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunState {
    /// The procedure's own.
    #[serde(with = "serde_bytes")]
    pub procedure: Vec<u8>,
    /// The round sealed last.
    pub last: Option<LastRound>,
}

/// The round sealed last, so that a late result of it can be compared, and decided by a third worker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LastRound {
    /// Its number.
    pub number: u32,
    /// Its tasks, by index.
    pub tasks: Arc<[TaskRecord]>,
}

/// A task of a sealed round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TaskRecord {
    /// The task.
    #[serde(with = "serde_bytes")]
    pub task: Vec<u8>,
    /// The task, for people.
    pub what: String,
    /// Digest of its result.
    pub digest: Digest,
    /// The worker that delivered the result.
    pub finder: Finder,
}

/// What is kept of a round.
#[derive(Clone, Debug, PartialEq)]
pub struct SealedRound {
    /// Its number.
    pub number: u32,
    /// The row of its series, if it has one.
    pub row: Option<Row>,
    /// Digests of its results, by index.
    pub digests: Vec<Digest>,
    /// The results, if they are kept.
    pub results: Option<Vec<Arc<[u8]>>>,
}

/// A worker whose results are ignored.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Quarantined {
    /// Its id.
    pub worker: Arc<str>,
    /// Its name, for people.
    pub name: Arc<str>,
    /// The host it called from.
    pub host: Arc<str>,
    /// The first digits of its token's digest; empty where calls need none.
    pub credential: Arc<str>,
    /// Why, in a sentence.
    pub reason: String,
    /// Unix time, ms.
    pub at_ms: i64,
}

/// Results of a range of tasks.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredRange {
    /// The round.
    pub round: u32,
    /// Index of the first task.
    pub first: u32,
    /// By index from `first` on.
    pub results: Vec<Arc<[u8]>>,
    /// The worker that delivered them.
    pub finder: Finder,
}

/// A job that has not ended, with all it takes to go on.
#[derive(Clone, Debug)]
pub struct StoredJob {
    /// As it stood.
    pub record: JobRecord,
    /// As it was resolved.
    pub toml: Arc<str>,
    /// Its state before the round at hand.
    pub state: RunState,
    /// Results of the round at hand.
    pub results: Vec<StoredRange>,
}

/// What a coordinator finds when it starts.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// Counts the starts on this store, this one included.
    pub epoch: u64,
    /// The secret of the store's permits.
    pub key: PermitKey,
    /// The number for the next job.
    pub next_job: u64,
    /// Jobs that go on.
    pub active: Vec<StoredJob>,
    /// Jobs that will never change again.
    pub ended: Vec<JobId>,
    /// Workers whose results are ignored.
    pub quarantined: Vec<Quarantined>,
}

/// The result of a job that succeeded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoredResult {
    /// What was told of the sealed rounds, in order.
    pub history: Vec<Row>,
    /// What the job made.
    pub artefacts: Vec<Artefact>,
}

/// An event as the store keeps it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoredEvent {
    /// The event.
    pub event: JobEvent,
    /// The job as it stood after it.
    pub job: JobRecord,
}

/// Why the store can't do what it should.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The file or its folder can't be opened or made. Not retryable before that is mended.
    #[error("the store {store} can't be opened: {reason}")]
    Open {
        /// Which.
        store: String,
        /// What the system says.
        reason: String,
    },
    /// Another process has it open. Retryable once that has ended.
    #[error("the store {store} is in use by another coordinator: stop that one, or choose another --store")]
    InUse {
        /// Which.
        store: String,
    },
    /// The file is no store, or one of a newer version.
    #[error("{store} is no store that this version can read: {reason}")]
    Foreign {
        /// Which.
        store: String,
        /// Why not.
        reason: String,
    },
    /// No space left, or a quota. Retryable once there is.
    #[error(
        "the disk that holds the store {store} is full: free some space and start the coordinator again; nothing that was acknowledged is lost"
    )]
    Full {
        /// Which.
        store: String,
    },
    /// Another coordinator is at work on a store that several can reach. Retryable once that has ended.
    #[error(
        "another coordinator (start {epoch}) is at work on this store: stop that one, choose another --store, or add --standby \
         to wait here until it ends"
    )]
    Active {
        /// The other's epoch.
        epoch: u64,
        /// Changes whenever that one gives a sign of life.
        stamp: i64,
    },
    /// The database does not answer, or breaks the connection off. Retryable.
    #[error(
        "the store {store} can't be reached: {reason}: start the coordinator again once it can; nothing that was acknowledged is lost"
    )]
    Unreachable {
        /// Which.
        store: String,
        /// What the system says.
        reason: String,
    },
    /// Another coordinator has taken the store over; this one's writes change nothing any more.
    #[error("another coordinator (start {by}) has taken over the store of this one (start {own}): this one stops")]
    Superseded {
        /// This coordinator's epoch.
        own: u64,
        /// The other's.
        by: u64,
    },
    /// It was closed in an orderly way: whoever asks is late. Retryable, elsewhere or later.
    #[error("the store is closed: the coordinator stops")]
    Closed,
    /// A stored value that can't be read back.
    #[error("the store holds a value that can't be read: {what}: restore the store from a copy")]
    Corrupt {
        /// What and why.
        what: String,
    },
    /// Anything else that the database says.
    #[error("the store failed: {0}")]
    Database(String),
}

/// What a store promises to answer.
pub type Answer<'a, T> = Pin<Box<dyn Future<Output = Result<T, StoreError>> + Send + 'a>>;

/// Durable jobs. All functions see what was committed before they were called.
pub trait Store: Send + Sync {
    /// Starts a new epoch and tells all that a coordinator needs to go on. From here on, writes of an earlier epoch are
    /// refused. Refused itself with [`StoreError::Active`] while another coordinator is at work, on stores that several can
    /// reach.
    fn start(&self) -> Answer<'_, Loaded>;

    /// Commits all of it or nothing; answered once it is on the disk. Refused with [`StoreError::Superseded`] if a
    /// later epoch has started.
    fn commit(&self, epoch: u64, writes: Vec<Write>) -> Answer<'_, ()>;

    /// How often [`Store::renew`] has to be called, if at all: on stores that several coordinators can reach.
    fn renew_every(&self) -> Option<Duration> {
        None
    }

    /// Tells other coordinators that this one is at work. Refused with [`StoreError::Superseded`] if a later epoch has
    /// started.
    fn renew(&self, _epoch: u64) -> Answer<'_, ()> {
        Box::pin(std::future::ready(Ok(())))
    }

    /// Tells other coordinators that this one has ended its work, so that none of them waits.
    fn release(&self, _epoch: u64) -> Answer<'_, ()> {
        Box::pin(std::future::ready(Ok(())))
    }

    /// A job and its text.
    fn job<'a>(&'a self, id: &'a JobId) -> Answer<'a, Option<(JobRecord, String)>>;

    /// The job with this request id.
    fn job_of_request<'a>(&'a self, request_id: &'a str) -> Answer<'a, Option<JobRecord>>;

    /// Up to `limit` jobs with numbers below `below`, newest first; only those in `states` unless that is empty.
    fn jobs<'a>(&'a self, below: u64, limit: u32, states: &'a [JobState]) -> Answer<'a, Vec<JobRecord>>;

    /// Up to `limit` events after a sequence number, in order.
    fn events<'a>(&'a self, id: &'a JobId, after: u64, limit: u32) -> Answer<'a, Vec<StoredEvent>>;

    /// Digests of a sealed round's results, by index.
    fn digests<'a>(&'a self, id: &'a JobId, round: u32) -> Answer<'a, Option<Vec<Digest>>>;

    /// Up to `limit` sealed rounds from a number on, in order, with their results as far as those are kept.
    fn rounds<'a>(&'a self, id: &'a JobId, from: u32, limit: u32) -> Answer<'a, Vec<SealedRound>>;

    /// History and artefacts.
    fn result<'a>(&'a self, id: &'a JobId) -> Answer<'a, StoredResult>;

    /// Ends the use of it in an orderly way; whoever asks from here on gets [`StoreError::Closed`]. May be called again.
    fn close(&self) -> Answer<'_, ()>;
}

/// Opens the store that a URL names. `takeover`: after this long without a sign of life from this coordinator another one
/// may take over, where several can reach the store.
// Boxed, so that it is compiled here, once, and not in every crate that awaits it.
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
