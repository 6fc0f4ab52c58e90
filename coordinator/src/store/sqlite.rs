//! The SQLite store: one file, one connection, one writer.
//!
//! WAL with `synchronous = FULL`: a commit is on the disk when it returns. The file is locked for as long as it is open,
//! so two coordinators can't share it by accident; the system frees the lock when a process dies, however it dies.

use super::migrations::{APPLICATION_ID, FIRST_READABLE, MIGRATIONS};
use super::{Answer, Loaded, Store, StoreError, StoredJob, StoredRange, StoredResult, Write, blob};
use crate::record::{JobId, JobRecord, JobState, ended};
use proto::v1;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqliteLockingMode, SqliteRow, SqliteSynchronous};
use sqlx::{ConnectOptions as _, Connection as _, Row as _, SqliteConnection};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::sync::Mutex;

/// A store in a SQLite file.
pub struct SqliteStore {
    path: PathBuf,
    connection: Mutex<SqliteConnection>,
}

impl SqliteStore {
    /// Opens the file, or makes it if it is not there; its folder must exist. Brings an older store up to date.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        let unusable = |reason: &str| StoreError::Open { path: path.to_owned(), reason: reason.to_owned() };
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(unusable(&format!("there is no folder {}", folder.display())));
        }
        if path.is_dir() {
            return Err(unusable("it is a folder"));
        }
        let connection = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(true)
            .locking_mode(SqliteLockingMode::Exclusive)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .busy_timeout(Duration::from_millis(500))
            // The state of a search of 10,000 candidates is 17 MB: it should neither be spilled before the commit, nor copied
            // from the log into the file after every one.
            .pragma("cache_size", "-65536")
            .pragma("wal_autocheckpoint", "16384")
            .disable_statement_logging()
            .connect()
            .await
            .map_err(|e| failure(path, e))?;
        let store = Self { path: path.to_owned(), connection: Mutex::new(connection) };
        store.migrate().await?;
        Ok(store)
    }

    async fn migrate(&self) -> Result<(), StoreError> {
        let mut connection = self.connection.lock().await;
        // Takes the lock, or finds out that somebody else has it.
        let mut tx = connection.begin_with("BEGIN IMMEDIATE").await.map_err(|e| self.failure(e))?;
        let pragma = |row: SqliteRow| row.try_get::<i64, _>(0);
        let version = sqlx::query("PRAGMA user_version")
            .fetch_one(&mut *tx)
            .await
            .and_then(pragma)
            .map_err(|e| self.failure(e))?;
        let application = sqlx::query("PRAGMA application_id")
            .fetch_one(&mut *tx)
            .await
            .and_then(pragma)
            .map_err(|e| self.failure(e))?;
        let tables: i64 = sqlx::query_scalar("SELECT count(*) FROM sqlite_schema")
            .fetch_one(&mut *tx)
            .await
            .map_err(|e| self.failure(e))?;
        let foreign = |reason: &str| StoreError::Foreign { path: self.path.clone(), reason: reason.to_owned() };
        if tables > 0 && application != i64::from(APPLICATION_ID) {
            return Err(foreign("it is a database of another program"));
        }
        let done = usize::try_from(version).ok().filter(|v| *v <= MIGRATIONS.len());
        let done = done.ok_or_else(|| foreign("it was written by a newer version; use that one"))?;
        if (1..FIRST_READABLE).contains(&done) {
            return Err(foreign(
                "it was written by an older version of evogait, whose jobs have no finish: use that version, or another \
                 --store (or folder, for `evogait run`)",
            ));
        }
        for (step, sql) in MIGRATIONS.iter().enumerate().skip(done) {
            let sql = format!("{sql}; PRAGMA user_version = {}; PRAGMA application_id = {APPLICATION_ID};", step + 1);
            sqlx::raw_sql(sqlx::AssertSqlSafe(sql)).execute(&mut *tx).await.map_err(|e| self.failure(e))?;
        }
        tx.commit().await.map_err(|e| self.failure(e))
    }

    fn failure(&self, error: sqlx::Error) -> StoreError {
        failure(&self.path, error)
    }
}

/// What an error of SQLite means for whoever runs the coordinator.
fn failure(path: &Path, error: sqlx::Error) -> StoreError {
    let path = path.to_owned();
    let sqlx::Error::Database(database) = &error else { return StoreError::Database(error.to_string()) };
    let reason = database.message().to_owned();
    // The primary result code is the low byte of the extended one: https://sqlite.org/rescode.html
    let code = database.code().and_then(|c| c.parse::<i32>().ok()).unwrap_or(1) & 0xff;
    match code {
        5 | 6 => StoreError::InUse { path },
        13 => StoreError::Full { path },
        3 | 8 | 14 | 23 => StoreError::Open { path, reason },
        11 | 26 => StoreError::Foreign { path, reason },
        _ => StoreError::Database(reason),
    }
}

/// Runs one statement.
macro_rules! run {
    ($tx:expr, $sql:literal $(, $value:expr)* $(,)?) => {
        sqlx::query($sql)$(.bind($value))*.execute(&mut **$tx).await
    };
}

type Tx<'a> = sqlx::Transaction<'a, sqlx::Sqlite>;

async fn apply(tx: &mut Tx<'_>, write: Write) -> Result<(), sqlx::Error> {
    match write {
        Write::Submit { record, toml, search, event } => {
            run!(
                tx,
                "INSERT INTO jobs (number, id, request_id, state, record, search) VALUES (?, ?, ?, ?, ?, ?)",
                record.number as i64,
                record.id.as_str(),
                record.request_id.as_str(),
                i64::from(i32::from(record.state)),
                blob::encode_record(&record),
                search,
            )?;
            run!(tx, "INSERT INTO texts (job, toml) VALUES (?, ?)", record.id.as_str(), &*toml)?;
            insert_events(tx, &record.id, &[event]).await
        }
        Write::Results { job, round, ranges, worker } => {
            for (first, outcomes) in ranges {
                run!(
                    tx,
                    "INSERT INTO results (job, round, first, outcomes) VALUES (?, ?, ?, ?)",
                    job.as_str(),
                    round,
                    first,
                    blob::encode_outcomes(&outcomes, &worker),
                )?;
            }
            Ok(())
        }
        Write::Seal { record, sealed, search, events } => {
            run!(
                tx,
                "INSERT INTO generations (job, generation, statistics, scores) VALUES (?, ?, ?, ?)",
                record.id.as_str(),
                sealed.statistics.generation,
                blob::encode(&sealed.statistics),
                blob::encode_scores(&sealed.scores),
            )?;
            // In one statement: a row is written whole, and the state of a large search is most of it.
            run!(
                tx,
                "UPDATE jobs SET search = ?, state = ?, record = ? WHERE id = ?",
                search,
                i64::from(i32::from(record.state)),
                blob::encode_record(&record),
                record.id.as_str(),
            )?;
            run!(tx, "DELETE FROM results WHERE job = ?", record.id.as_str())?;
            insert_events(tx, &record.id, &events).await
        }
        Write::Change { record, event } => {
            update_record(tx, &record).await?;
            insert_events(tx, &record.id, &[event]).await
        }
        Write::Note { record } => update_record(tx, &record).await,
        Write::Carry { from, to, generations } => {
            run!(
                tx,
                "INSERT INTO generations (job, generation, statistics, scores)
                 SELECT ?, generation, statistics, scores FROM generations WHERE job = ? AND generation < ?",
                to.as_str(),
                from.as_str(),
                generations,
            )?;
            Ok(())
        }
        Write::Quarantine(entry) => {
            run!(
                tx,
                "INSERT INTO quarantined (worker, entry) VALUES (?, ?) ON CONFLICT (worker) DO NOTHING",
                &*entry.worker,
                blob::encode_quarantined(&entry),
            )?;
            Ok(())
        }
        Write::Report { record, report, event } => {
            run!(tx, "INSERT INTO reports (job, report) VALUES (?, ?)", record.id.as_str(), report)?;
            update_record(tx, &record).await?;
            insert_events(tx, &record.id, &[event]).await
        }
    }
}

async fn update_record(tx: &mut Tx<'_>, record: &JobRecord) -> Result<(), sqlx::Error> {
    let state = i64::from(i32::from(record.state));
    let bytes = blob::encode_record(record);
    run!(tx, "UPDATE jobs SET state = ?, record = ? WHERE id = ?", state, bytes, record.id.as_str())?;
    if ended(record.state) {
        run!(tx, "DELETE FROM results WHERE job = ?", record.id.as_str())?;
        run!(tx, "UPDATE jobs SET search = NULL WHERE id = ?", record.id.as_str())?;
    }
    Ok(())
}

async fn insert_events(tx: &mut Tx<'_>, id: &JobId, events: &[v1::JobEvent]) -> Result<(), sqlx::Error> {
    for event in events {
        let (sequence, bytes) = (event.sequence as i64, blob::encode(event));
        run!(tx, "INSERT INTO events (job, sequence, event) VALUES (?, ?, ?)", id.as_str(), sequence, bytes)?;
    }
    Ok(())
}

impl Store for SqliteStore {
    fn start(&self) -> Answer<'_, Loaded> {
        Box::pin(async move {
            let mut connection = self.connection.lock().await;
            let mut tx = connection.begin_with("BEGIN IMMEDIATE").await.map_err(|e| self.failure(e))?;
            let loaded = load(&mut tx).await.map_err(|e| e.named(&self.path))?;
            tx.commit().await.map_err(|e| self.failure(e))?;
            Ok(loaded)
        })
    }

    fn commit(&self, epoch: u64, writes: Vec<Write>) -> Answer<'_, ()> {
        Box::pin(async move {
            let mut connection = self.connection.lock().await;
            let mut tx = connection.begin_with("BEGIN IMMEDIATE").await.map_err(|e| self.failure(e))?;
            let current: i64 =
                sqlx::query_scalar("SELECT epoch FROM meta").fetch_one(&mut *tx).await.map_err(|e| self.failure(e))?;
            if current as u64 != epoch {
                return Err(StoreError::Superseded { own: epoch, by: current as u64 });
            }
            for write in writes {
                apply(&mut tx, write).await.map_err(|e| self.failure(e))?;
            }
            tx.commit().await.map_err(|e| self.failure(e))
        })
    }

    fn job<'a>(&'a self, id: &'a JobId) -> Answer<'a, Option<(JobRecord, String)>> {
        Box::pin(async move {
            let mut connection = self.connection.lock().await;
            let row = sqlx::query("SELECT record, toml FROM jobs JOIN texts ON texts.job = jobs.id WHERE jobs.id = ?")
                .bind(id.as_str())
                .fetch_optional(&mut *connection)
                .await
                .map_err(|e| self.failure(e))?;
            row.map(|row| {
                let record: Vec<u8> = row.try_get(0).map_err(|e| self.failure(e))?;
                Ok((blob::decode_record(&record)?, row.try_get(1).map_err(|e| self.failure(e))?))
            })
            .transpose()
        })
    }

    fn job_of_request<'a>(&'a self, request_id: &'a str) -> Answer<'a, Option<JobRecord>> {
        Box::pin(async move {
            let mut connection = self.connection.lock().await;
            let record: Option<Vec<u8>> = sqlx::query_scalar("SELECT record FROM jobs WHERE request_id = ?")
                .bind(request_id)
                .fetch_optional(&mut *connection)
                .await
                .map_err(|e| self.failure(e))?;
            record.map(|bytes| blob::decode_record(&bytes)).transpose()
        })
    }

    fn jobs<'a>(&'a self, below: u64, limit: u32, states: &'a [JobState]) -> Answer<'a, Vec<JobRecord>> {
        Box::pin(async move {
            let mask = states.iter().fold(0i64, |mask, &state| mask | 1 << i32::from(state));
            let mut connection = self.connection.lock().await;
            let records: Vec<Vec<u8>> = sqlx::query_scalar(
                "SELECT record FROM jobs WHERE number < ?1 AND (?2 = 0 OR (1 << state) & ?2 <> 0)
                 ORDER BY number DESC LIMIT ?3",
            )
            .bind(i64::try_from(below).unwrap_or(i64::MAX))
            .bind(mask)
            .bind(limit)
            .fetch_all(&mut *connection)
            .await
            .map_err(|e| self.failure(e))?;
            records.iter().map(|bytes| blob::decode_record(bytes)).collect()
        })
    }

    fn events<'a>(&'a self, id: &'a JobId, after: u64, limit: u32) -> Answer<'a, Vec<v1::JobEvent>> {
        Box::pin(async move {
            let mut connection = self.connection.lock().await;
            let events: Vec<Vec<u8>> =
                sqlx::query_scalar("SELECT event FROM events WHERE job = ? AND sequence > ? ORDER BY sequence LIMIT ?")
                    .bind(id.as_str())
                    .bind(i64::try_from(after).unwrap_or(i64::MAX))
                    .bind(limit)
                    .fetch_all(&mut *connection)
                    .await
                    .map_err(|e| self.failure(e))?;
            events.iter().map(|bytes| blob::decode("event", bytes)).collect()
        })
    }

    fn scores<'a>(&'a self, id: &'a JobId, generation: u32) -> Answer<'a, Option<Vec<Option<f64>>>> {
        Box::pin(async move {
            let mut connection = self.connection.lock().await;
            let scores: Option<Vec<u8>> =
                sqlx::query_scalar("SELECT scores FROM generations WHERE job = ? AND generation = ?")
                    .bind(id.as_str())
                    .bind(generation)
                    .fetch_optional(&mut *connection)
                    .await
                    .map_err(|e| self.failure(e))?;
            scores.map(|bytes| blob::decode_scores(&bytes)).transpose()
        })
    }

    fn result<'a>(&'a self, id: &'a JobId) -> Answer<'a, StoredResult> {
        Box::pin(async move {
            let mut connection = self.connection.lock().await;
            let history: Vec<Vec<u8>> =
                sqlx::query_scalar("SELECT statistics FROM generations WHERE job = ? ORDER BY generation")
                    .bind(id.as_str())
                    .fetch_all(&mut *connection)
                    .await
                    .map_err(|e| self.failure(e))?;
            let report: Option<Vec<u8>> = sqlx::query_scalar("SELECT report FROM reports WHERE job = ?")
                .bind(id.as_str())
                .fetch_optional(&mut *connection)
                .await
                .map_err(|e| self.failure(e))?;
            let history = history.iter().map(|b| blob::decode("statistics", b)).collect::<Result<_, _>>()?;
            Ok(StoredResult { history, report: report.unwrap_or_default() })
        })
    }
}

/// What went wrong while loading: the database, or what it holds.
enum LoadError {
    Database(sqlx::Error),
    Store(StoreError),
}

impl LoadError {
    fn named(self, path: &Path) -> StoreError {
        match self {
            Self::Database(error) => failure(path, error),
            Self::Store(error) => error,
        }
    }
}

impl From<sqlx::Error> for LoadError {
    fn from(error: sqlx::Error) -> Self {
        Self::Database(error)
    }
}

impl From<StoreError> for LoadError {
    fn from(error: StoreError) -> Self {
        Self::Store(error)
    }
}

async fn load(tx: &mut Tx<'_>) -> Result<Loaded, LoadError> {
    let epoch: i64 =
        sqlx::query_scalar("UPDATE meta SET epoch = epoch + 1 RETURNING epoch").fetch_one(&mut **tx).await?;
    let last: Option<i64> = sqlx::query_scalar("SELECT max(number) FROM jobs").fetch_one(&mut **tx).await?;
    let mut loaded = Loaded { epoch: epoch as u64, next_job: last.unwrap_or(0) as u64 + 1, ..Loaded::default() };
    let rows = sqlx::query("SELECT id, state FROM jobs ORDER BY number").fetch_all(&mut **tx).await?;
    for row in rows {
        let (id, state): (String, i64) = (row.try_get(0)?, row.try_get(1)?);
        let id = JobId::from(id.as_str());
        if ended(JobState::try_from(state as i32).unwrap_or_default()) {
            loaded.ended.push(id);
        } else {
            loaded.active.push(load_job(tx, &id).await?);
        }
    }
    let rows = sqlx::query("SELECT worker, entry FROM quarantined ORDER BY worker").fetch_all(&mut **tx).await?;
    for row in rows {
        let (worker, entry): (String, Vec<u8>) = (row.try_get(0)?, row.try_get(1)?);
        loaded.quarantined.push(blob::decode_quarantined(&worker, &entry)?);
    }
    Ok(loaded)
}

async fn load_job(tx: &mut Tx<'_>, id: &JobId) -> Result<StoredJob, LoadError> {
    let row = sqlx::query("SELECT record, search, toml FROM jobs JOIN texts ON texts.job = jobs.id WHERE jobs.id = ?")
        .bind(id.as_str())
        .fetch_one(&mut **tx)
        .await?;
    let record = blob::decode_record(&row.try_get::<Vec<u8>, _>(0)?)?;
    let search: Option<Vec<u8>> = row.try_get(1)?;
    let toml: String = row.try_get(2)?;
    let generation = record.generations_done;
    let rows = sqlx::query("SELECT round, first, outcomes FROM results WHERE job = ? ORDER BY round, first")
        .bind(id.as_str())
        .fetch_all(&mut **tx)
        .await?;
    let mut results = Vec::with_capacity(rows.len());
    for row in rows {
        let (round, first): (u32, u32) = (row.try_get(0)?, row.try_get(1)?);
        let (outcomes, worker) = blob::decode_outcomes(&row.try_get::<Vec<u8>, _>(2)?)?;
        results.push(StoredRange { round, first, outcomes, worker: worker.into() });
    }
    let last: Option<Vec<u8>> =
        sqlx::query_scalar("SELECT scores FROM generations WHERE job = ? AND generation = ? - 1")
            .bind(id.as_str())
            .bind(generation)
            .fetch_optional(&mut **tx)
            .await?;
    let last_scores = last.map(|bytes| blob::decode_scores(&bytes)).transpose()?;
    Ok(StoredJob { record, toml: toml.into(), search: search.unwrap_or_default(), results, last_scores })
}
