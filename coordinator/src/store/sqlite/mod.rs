//! SQLite store: one file, one connection, one writer.
//!
//! It uses WAL with `synchronous = FULL`: a commit is on the disk when it returns. The file is locked while it is open,
//! so two coordinators can't share it by accident. The operating system releases the lock when the process ends, also
//! after a crash.

mod migrations;
mod place;

use self::migrations::{APPLICATION_ID, FIRST, MIGRATIONS};
use super::sql::{Dialect, ResultRow, Sql, SqlRow as _, Value, statement};
use super::{Loaded, OLDER, StoreError, Write, tables};
use crate::fail_point;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqliteLockingMode, SqliteRow, SqliteSynchronous};
use sqlx::{ConnectOptions as _, Connection as _, SqliteConnection};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::sync::{MappedMutexGuard, Mutex, MutexGuard};

/// Store in a SQLite file.
pub struct SqliteStore {
    path: PathBuf,
    /// `None` after closing.
    connection: Mutex<Option<SqliteConnection>>,
}

impl SqliteStore {
    /// Opens the file, or creates it if it does not exist; its folder must exist. Upgrades an older store.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        let connection = SqliteConnectOptions::new()
            .filename(place::check(path)?)
            .create_if_missing(true)
            .locking_mode(SqliteLockingMode::Exclusive)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .busy_timeout(Duration::from_millis(500))
            // The state of a search with 10,000 candidates is 17 MB. The cache must hold it until the commit, and the
            // log must not be copied into the file after each commit.
            .pragma("cache_size", "-65536")
            .pragma("wal_autocheckpoint", "16384")
            .disable_statement_logging()
            .connect()
            .await
            .map_err(|e| failure(path, e))?;
        let store = Self { path: path.to_owned(), connection: Mutex::new(Some(connection)) };
        store.migrate().await?;
        Ok(store)
    }

    async fn migrate(&self) -> Result<(), StoreError> {
        let mut connection = self.connection().await?;
        // Takes the lock, or fails if another process holds it.
        let mut tx = connection.begin_with("BEGIN IMMEDIATE").await.map_err(|e| self.failure(e))?;
        let pragma = |row: SqliteRow| row.number(0);
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
        let foreign =
            |reason: &str| StoreError::Foreign { store: self.path.display().to_string(), reason: reason.to_owned() };
        if tables > 0 && application != i64::from(APPLICATION_ID) {
            return Err(foreign("it is a database of another program"));
        }
        let done = match usize::try_from(version) {
            Ok(0) => 0,
            Ok(version) if version < FIRST => return Err(foreign(OLDER)),
            Ok(version) if version < FIRST + MIGRATIONS.len() => version - FIRST + 1,
            _ => return Err(foreign("it was written by a newer version: use that version")),
        };
        for (step, sql) in MIGRATIONS.iter().enumerate().skip(done) {
            let version = FIRST + step;
            let sql = format!("{sql}; PRAGMA user_version = {version}; PRAGMA application_id = {APPLICATION_ID};");
            sqlx::raw_sql(sqlx::AssertSqlSafe(sql)).execute(&mut *tx).await.map_err(|e| self.failure(e))?;
        }
        tx.commit().await.map_err(|e| self.failure(e))
    }
}

/// Converts an error of SQLite to a store error.
fn failure(path: &Path, error: sqlx::Error) -> StoreError {
    let store = path.display().to_string();
    let sqlx::Error::Database(database) = &error else { return StoreError::Database(error.to_string()) };
    let reason = database.message().to_owned();
    // The primary result code is the low byte of the extended one: https://sqlite.org/rescode.html
    let code = database.code().and_then(|c| c.parse::<i32>().ok()).unwrap_or(1) & 0xff;
    match code {
        5 | 6 => StoreError::InUse { store },
        13 => StoreError::Full { store },
        3 | 8 | 14 | 23 => StoreError::Open { store, reason },
        11 | 26 => StoreError::Foreign { store, reason },
        _ => StoreError::Database(reason),
    }
}

impl Sql for SqliteConnection {
    type Row = SqliteRow;

    async fn run(&mut self, sql: &'static str, values: Vec<Value<'_>>) -> Result<u64, sqlx::Error> {
        Ok(statement(sql, values).execute(self).await?.rows_affected())
    }

    async fn rows(&mut self, sql: &'static str, values: Vec<Value<'_>>) -> Result<Vec<SqliteRow>, sqlx::Error> {
        statement(sql, values).fetch_all(self).await
    }

    async fn insert_results(&mut self, rows: Vec<ResultRow>) -> Result<(), sqlx::Error> {
        for ResultRow { job, round, first, results } in rows {
            let values = vec![(&job).into(), round.into(), first.into(), results.into()];
            self.run("INSERT INTO results (job, round, first, results) VALUES ($1, $2, $3, $4)", values).await?;
        }
        Ok(())
    }
}

impl Dialect for SqliteStore {
    type Connection = SqliteConnection;
    type Lent<'a> = MappedMutexGuard<'a, SqliteConnection>;

    async fn connection(&self) -> Result<MappedMutexGuard<'_, SqliteConnection>, StoreError> {
        MutexGuard::try_map(self.connection.lock().await, Option::as_mut).map_err(|_| StoreError::Closed)
    }

    fn failure(&self, error: sqlx::Error) -> StoreError {
        failure(&self.path, error)
    }

    async fn start(&self) -> Result<Loaded, StoreError> {
        let mut connection = self.connection().await?;
        let mut tx = connection.begin_with("BEGIN IMMEDIATE").await.map_err(|e| self.failure(e))?;
        let next = "UPDATE meta SET epoch = epoch + 1 RETURNING epoch, key";
        let row = tx.rows(next, vec![]).await.map_err(|e| self.failure(e))?.pop();
        let loaded = tables::start(&mut *tx, row).await.map_err(|e| self.trouble(e))?;
        tx.commit().await.map_err(|e| self.failure(e))?;
        Ok(loaded)
    }

    async fn commit(&self, epoch: u64, writes: Vec<Write>) -> Result<(), StoreError> {
        let mut connection = self.connection().await?;
        let mut tx = connection.begin_with("BEGIN IMMEDIATE").await.map_err(|e| self.failure(e))?;
        let current = sqlx::query_scalar::<_, i64>("SELECT epoch FROM meta");
        let current = current.fetch_one(&mut *tx).await.map_err(|e| self.failure(e))? as u64;
        if current != epoch {
            return Err(StoreError::Superseded { own: epoch, by: current });
        }
        tables::apply_all(&mut *tx, &writes).await.map_err(|e| self.failure(e))?;
        fail_point::reached("in-commit");
        tx.commit().await.map_err(|e| self.failure(e))
    }

    /// Closes the file and moves the write-ahead log into it, so that the file can be copied.
    async fn close(&self) -> Result<(), StoreError> {
        match self.connection.lock().await.take() {
            Some(connection) => connection.close().await.map_err(|e| self.failure(e)),
            None => Ok(()),
        }
    }
}
