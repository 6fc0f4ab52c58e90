//! Where jobs live. One trait; SQLite and PostgreSQL in production, memory in tests; one test suite for all.
//!
//! Few indexed columns, everything else in versioned blobs (a version byte, then protobuf), so that a second SQL dialect
//! stays small. Numbers that must keep their bits are in blobs: SQLite turns NaN into NULL.

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

use crate::record::{JobId, JobRecord, JobState};
use crate::scheduler::{Finder, Outcome};
use proto::v1;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

/// One change. Changes that belong together are committed together.
#[derive(Clone, Debug, PartialEq)]
pub enum Write {
    /// A job comes in.
    Submit {
        /// The job.
        record: JobRecord,
        /// As it was resolved.
        toml: Arc<str>,
        /// The state of the search at generation 0.
        search: Vec<u8>,
        /// The first event.
        event: v1::JobEvent,
    },
    /// Results of the round at hand.
    Results {
        /// The job.
        job: JobId,
        /// The round: a generation, or examinations after the search.
        round: u32,
        /// Ranges without overlap: (index of the first, outcomes).
        ranges: Vec<(u32, Vec<Outcome>)>,
        /// Who found them.
        finder: Finder,
    },
    /// A generation is over: scores, statistics, the state of the search and the events at once.
    Seal {
        /// The job after it.
        record: JobRecord,
        /// What is kept of the generation; the ranges' results go.
        sealed: SealedGeneration,
        /// The state of the search for the next generation.
        search: Vec<u8>,
        /// What is told.
        events: Vec<v1::JobEvent>,
    },
    /// The job stands elsewhere.
    Change {
        /// The job after it.
        record: JobRecord,
        /// What is told.
        event: v1::JobEvent,
    },
    /// What nobody watches of a job changed: what is held against its tasks, or in doubt.
    Note {
        /// The job after it.
        record: JobRecord,
    },
    /// A restarted job takes over what is kept of the first generations of another.
    Carry {
        /// From this job …
        from: JobId,
        /// … to this one, which was submitted before.
        to: JobId,
        /// How many.
        generations: u32,
    },
    /// A worker's results are not trusted any more.
    Quarantine(Quarantined),
    /// The report: the job succeeded.
    Report {
        /// The job after it.
        record: JobRecord,
        /// JSON.
        report: Vec<u8>,
        /// What is told.
        event: v1::JobEvent,
    },
}

impl Write {
    /// The events among it, to be told once it is committed.
    pub fn events(&self) -> &[v1::JobEvent] {
        match self {
            Self::Submit { event, .. } | Self::Change { event, .. } | Self::Report { event, .. } => {
                std::slice::from_ref(event)
            }
            Self::Seal { events, .. } => events,
            Self::Results { .. } | Self::Note { .. } | Self::Carry { .. } | Self::Quarantine(_) => &[],
        }
    }

    /// The job as it stands after it, if it has that in full.
    fn record(&self) -> Option<&JobRecord> {
        match self {
            Self::Submit { record, .. }
            | Self::Seal { record, .. }
            | Self::Change { record, .. }
            | Self::Note { record }
            | Self::Report { record, .. } => Some(record),
            Self::Results { .. } | Self::Carry { .. } | Self::Quarantine(_) => None,
        }
    }

    /// Whose change it is; `None` if it is of no job.
    pub fn job(&self) -> Option<&JobId> {
        match self {
            Self::Results { job, .. } | Self::Carry { to: job, .. } => Some(job),
            _ => self.record().map(|record| &record.id),
        }
    }
}

/// What is kept of a generation.
#[derive(Clone, Debug)]
pub struct SealedGeneration {
    /// By candidate; `None` where the evaluation failed.
    pub scores: Vec<Option<f64>>,
    /// What the scores look like.
    pub statistics: v1::GenerationSealed,
}

impl PartialEq for SealedGeneration {
    fn eq(&self, other: &Self) -> bool {
        let bits = |s: &Self| s.scores.iter().map(|s| s.map(f64::to_bits)).collect::<Vec<_>>();
        bits(self) == bits(other)
    }
}

/// A worker that gave other bits than two others did.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Quarantined {
    /// Its id.
    pub worker: Arc<str>,
    /// Its name, for people.
    pub name: Arc<str>,
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
    pub outcomes: Vec<Outcome>,
    /// Who found them, as far as that was stored.
    pub finder: Finder,
}

/// A job that has not ended, with all it takes to go on.
#[derive(Clone, Debug)]
pub struct StoredJob {
    /// As it stood.
    pub record: JobRecord,
    /// As it was resolved.
    pub toml: Arc<str>,
    /// The state of the search.
    pub search: Vec<u8>,
    /// Results of the current generation, or of all rounds after the search.
    pub results: Vec<StoredRange>,
    /// Scores of the generation sealed last.
    pub last_scores: Option<Vec<Option<f64>>>,
}

/// What a coordinator finds when it starts.
#[derive(Clone, Debug, Default)]
pub struct Loaded {
    /// Counts the starts on this store, this one included.
    pub epoch: u64,
    /// The number for the next job.
    pub next_job: u64,
    /// Jobs that go on.
    pub active: Vec<StoredJob>,
    /// Jobs that will never change again.
    pub ended: Vec<JobId>,
    /// Workers whose results are not trusted.
    pub quarantined: Vec<Quarantined>,
}

/// What a succeeded job found.
#[derive(Clone, Debug)]
pub struct StoredResult {
    /// Statistics by generation.
    pub history: Vec<v1::GenerationSealed>,
    /// JSON.
    pub report: Vec<u8>,
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
    fn events<'a>(&'a self, id: &'a JobId, after: u64, limit: u32) -> Answer<'a, Vec<v1::JobEvent>>;

    /// Scores of a sealed generation.
    fn scores<'a>(&'a self, id: &'a JobId, generation: u32) -> Answer<'a, Option<Vec<Option<f64>>>>;

    /// History and report.
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
mod tests;
