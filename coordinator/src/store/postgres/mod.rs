//! PostgreSQL store: one database that several coordinators share, with one active coordinator.
//!
//! One row holds the lock on the store, with the epoch of the active coordinator. A commit first updates this row, on
//! condition of its epoch. After a later epoch has begun the condition fails, and the commit changes nothing. So two
//! coordinators may both consider themselves active, but only one can change data. The active coordinator renews the
//! time stamp of the row. Another coordinator may start an epoch if the stamp is too old by the database's clock, or if
//! the lock was released.

mod failure;
mod migrations;
mod url;

pub use url::{BadPostgresUrl, PostgresUrl};

use self::failure::failure;
use self::migrations::{FIRST, MIGRATIONS};
use super::sql::{Dialect, ResultRow, Sql, SqlRow as _, Value, statement};
use super::{Loaded, OLDER, StoreError, Write, tables};
use crate::fail_point;
use proto::credentials::PemError;
use sqlx::pool::PoolConnection;
use sqlx::postgres::{PgConnectOptions, PgConnection, PgPool, PgPoolOptions, PgRow};
use sqlx::{ConnectOptions as _, Connection as _, Executor as _, Postgres};
use std::time::Duration;
use tokio::sync::Mutex;
use tokio::time::Instant;

/// Number of connections for queries. Commits and renewals have two other connections, so that queries can't delay
/// them.
const READERS: u32 = 4;
/// Pause between two attempts to reach the database.
const RETRY: Duration = Duration::from_millis(100);
/// Shortest time limit of an attempt, for any takeover time.
const LEAST_TIMEOUT: Duration = Duration::from_secs(1);
/// Limit on the time for connecting.
const CONNECT_WITHIN: Duration = Duration::from_secs(10);
/// Limit on the time for creating the tables or loading all jobs at a takeover. A large store takes long.
const PREPARE_WITHIN: Duration = Duration::from_secs(300);
/// Advisory lock for changes of the schema: "evogait" as a number.
const MIGRATION_LOCK: i64 = 0x65_766f_6761_6974;

/// Query for the active coordinator. The absolute age counts, since a stamp is in the future after the database's clock
/// was set back.
macro_rules! at_work {
    ($lock:literal) => {
        concat!(
            "SELECT CASE WHEN NOT released AND abs(extract(epoch FROM clock_timestamp() - renewed_at)) * 1000 < takeover_ms
                    THEN 1 ELSE 0 END::BIGINT,
                    epoch, (extract(epoch FROM renewed_at) * 1000000)::BIGINT FROM coordinator",
            $lock
        )
    };
}

/// Store in a PostgreSQL database.
pub struct PostgresStore {
    /// URL without the password.
    name: String,
    readers: PgPool,
    writers: PgPool,
    /// Takeover time: without a renewal for this long another coordinator may take over. So this coordinator must not
    /// retry for longer.
    takeover: Duration,
    prepare_within: Duration,
    /// Number of commits in this epoch.
    commits: Mutex<u64>,
}

impl PostgresStore {
    /// Connects, and creates or upgrades the tables. `takeover`: without a renewal for this long another coordinator
    /// may take over.
    pub async fn open(url: &PostgresUrl, takeover: Duration) -> Result<Self, StoreError> {
        let name = url.to_string();
        let options = url.options().map_err(|e| StoreError::Open { store: name.clone(), reason: e.to_string() })?;
        if url.is_exposed() {
            tracing::warn!(store = %name, "the connection to the database is not protected against reading and tampering: add ?sslmode=verify-full to --store");
        }
        // Checked here: the driver would report a missing file as an unreachable database.
        if let Some(file) = url.root_certificate() {
            let unusable = |e: PemError| StoreError::Open { store: name.clone(), reason: e.to_string() };
            proto::credentials::authority(&file).map_err(unusable)?;
        }
        let patience = takeover.max(LEAST_TIMEOUT);
        let pool = |connections, options: PgConnectOptions| {
            let settings = format!(
                "SET search_path TO evogait;
                 SET SESSION CHARACTERISTICS AS TRANSACTION ISOLATION LEVEL READ COMMITTED;
                 SET idle_in_transaction_session_timeout TO {};
                 SELECT set_config('synchronous_commit', 'on', false)
                 WHERE current_setting('synchronous_commit') IN ('off', 'local')",
                // A transaction of a disconnected coordinator would hold the row that the others wait for.
                patience.as_millis()
            );
            PgPoolOptions::new()
                .max_connections(connections)
                .acquire_timeout(patience)
                .after_connect(move |connection, _| {
                    let settings = settings.clone();
                    Box::pin(async move { connection.execute(sqlx::AssertSqlSafe(settings)).await.map(drop) })
                })
                .connect_lazy_with(options)
        };
        let options = options.disable_statement_logging();
        let store = Self {
            readers: pool(READERS, options.clone()),
            writers: pool(2, options.clone()),
            name,
            takeover,
            prepare_within: PREPARE_WITHIN,
            commits: Mutex::default(),
        };
        // Without a pool, which would retry until its time limit.
        let connected = tokio::time::timeout(CONNECT_WITHIN, options.connect()).await;
        let mut connection = connected.map_err(|_| store.silent(CONNECT_WITHIN))?.map_err(|e| store.failure(e))?;
        let migrated = tokio::time::timeout(PREPARE_WITHIN, store.migrate(&mut connection)).await;
        migrated.unwrap_or_else(|_| Err(store.silent(PREPARE_WITHIN)))?;
        connection.close().await.map_err(|e| store.failure(e))?;
        Ok(store)
    }

    async fn migrate(&self, connection: &mut PgConnection) -> Result<(), StoreError> {
        let mut tx = connection.begin().await.map_err(|e| self.failure(e))?;
        let foreign = |reason: &str| StoreError::Foreign { store: self.name.clone(), reason: reason.to_owned() };
        let setting = async |tx: &mut PgConnection, query: &'static str| {
            let value: Result<String, _> = sqlx::query_scalar(query).fetch_one(&mut *tx).await;
            value.map_err(|e| self.failure(e))
        };
        let encoding = setting(&mut *tx, "SELECT current_setting('server_encoding')").await?;
        if encoding != "UTF8" {
            return Err(foreign(&format!(
                "its encoding is {encoding}: create it with CREATE DATABASE … ENCODING 'UTF8'"
            )));
        }
        if setting(&mut *tx, "SELECT current_setting('fsync')").await? == "off" {
            tracing::warn!(store = %self.name, "the database runs with fsync = off: committed data may be lost in a power failure");
        }
        let lock = sqlx::query("SELECT pg_advisory_xact_lock($1)").bind(MIGRATION_LOCK).execute(&mut *tx).await;
        lock.map_err(|e| self.failure(e))?;
        let there = "SELECT to_regnamespace('evogait') IS NOT NULL";
        let there: bool = sqlx::query_scalar(there).fetch_one(&mut *tx).await.map_err(|e| self.failure(e))?;
        let mut done = 0;
        if there {
            let ours = "SELECT to_regclass('evogait.schema_version') IS NOT NULL";
            let ours: bool = sqlx::query_scalar(ours).fetch_one(&mut *tx).await.map_err(|e| self.failure(e))?;
            if !ours {
                return Err(foreign("its schema 'evogait' belongs to another program"));
            }
            let version = sqlx::query_scalar::<_, i64>("SELECT version FROM evogait.schema_version");
            let version = version.fetch_one(&mut *tx).await.map_err(|e| self.failure(e))?;
            done = match usize::try_from(version) {
                Ok(0) => 0,
                Ok(version) if version < FIRST => return Err(foreign(OLDER)),
                Ok(version) if version < FIRST + MIGRATIONS.len() => version - FIRST + 1,
                _ => return Err(foreign("it was written by a newer version: use that version")),
            };
        } else {
            let make = "CREATE SCHEMA evogait;
                        CREATE TABLE evogait.schema_version (version BIGINT NOT NULL);
                        INSERT INTO evogait.schema_version VALUES (0)";
            sqlx::raw_sql(make).execute(&mut *tx).await.map_err(|e| self.failure(e))?;
        }
        for (step, sql) in MIGRATIONS.iter().enumerate().skip(done) {
            let sql = format!(
                "SET LOCAL search_path TO evogait; {sql}; UPDATE schema_version SET version = {}",
                FIRST + step
            );
            sqlx::raw_sql(sqlx::AssertSqlSafe(sql)).execute(&mut *tx).await.map_err(|e| self.failure(e))?;
        }
        tx.commit().await.map_err(|e| self.failure(e))
    }

    /// Time limit for an answer.
    fn patience(&self) -> Duration {
        self.takeover.max(LEAST_TIMEOUT)
    }

    /// Returns the error for a missing answer.
    fn silent(&self, within: Duration) -> StoreError {
        let reason = format!("the database did not respond within {} s", within.as_secs_f64());
        StoreError::Unreachable { store: self.name.clone(), reason }
    }

    /// Repeats a request while the database is unreachable and the takeover time has not passed.
    async fn patiently<F>(&self, epoch: u64, ask: impl Fn() -> F) -> Result<(), StoreError>
    where
        F: Future<Output = Result<(), StoreError>>,
    {
        let patience = Patience { store: self, end: Instant::now() + self.patience() };
        loop {
            return match patience.attempt(ask()).await {
                None => continue,
                Some(Err(error @ StoreError::Unreachable { .. })) => {
                    Err(self.replaced_meanwhile(epoch).await.unwrap_or(error))
                }
                Some(answer) => answer,
            };
        }
    }

    /// Returns an error if a later epoch has begun: this coordinator may have been suspended, rather than the database.
    async fn replaced_meanwhile(&self, epoch: u64) -> Option<StoreError> {
        let current = async {
            let mut connection = self.readers.acquire().await?;
            sqlx::query_scalar::<_, i64>("SELECT epoch FROM coordinator").fetch_one(&mut *connection).await
        };
        let by = tokio::time::timeout(LEAST_TIMEOUT, current).await.ok()?.ok()? as u64;
        (by != epoch).then_some(StoreError::Superseded { own: epoch, by })
    }

    /// Commits the changes as commit `number` of the epoch.
    async fn commit_as(&self, epoch: u64, number: u64, writes: &[Write]) -> Result<(), StoreError> {
        let mut tx = self.writers.begin().await.map_err(|e| self.failure(e))?;
        let fence = "UPDATE coordinator SET commits = $2, renewed_at = clock_timestamp()
                     WHERE epoch = $1 AND commits = $2 - 1";
        let touched = tx.run(fence, vec![epoch.into(), number.into()]).await.map_err(|e| self.failure(e))?;
        if touched == 0 {
            let row = sqlx::query("SELECT epoch, commits FROM coordinator").fetch_one(&mut *tx).await;
            let row = row.map_err(|e| self.failure(e))?;
            let column = |i| row.number(i).map(|n| n as u64).map_err(|e| self.failure(e));
            return match (column(0)?, column(1)?) {
                // The commit had succeeded, but its answer was lost.
                (current, commits) if (current, commits) == (epoch, number) => Ok(()),
                (current, _) if current != epoch => Err(StoreError::Superseded { own: epoch, by: current }),
                (_, commits) => {
                    let what =
                        format!("the number of commits is {commits}, but {} or {number} was expected", number - 1);
                    Err(StoreError::Corrupt { what })
                }
            };
        }
        tables::apply_all(&mut *tx, writes).await.map_err(|e| self.failure(e))?;
        fail_point::reached("in-commit");
        tx.commit().await.map_err(|e| self.failure(e))
    }

    async fn renew_once(&self, epoch: u64) -> Result<(), StoreError> {
        let mut connection = self.writers.acquire().await.map_err(|e| self.failure(e))?;
        let stamp = "UPDATE coordinator SET renewed_at = clock_timestamp() WHERE epoch = $1";
        let touched = connection.run(stamp, vec![epoch.into()]).await.map_err(|e| self.failure(e))?;
        if touched > 0 {
            return Ok(());
        }
        let current = sqlx::query_scalar::<_, i64>("SELECT epoch FROM coordinator").fetch_one(&mut *connection);
        Err(StoreError::Superseded { own: epoch, by: current.await.map_err(|e| self.failure(e))? as u64 })
    }

    /// Begins an epoch, unless another coordinator did meanwhile, and loads the jobs.
    async fn take_over(&self, connection: &mut PgConnection) -> Result<Loaded, StoreError> {
        let mut tx = connection.begin().await.map_err(|e| self.failure(e))?;
        self.refuse_if_active(&mut tx, at_work!(" FOR UPDATE")).await?;
        let next = "UPDATE coordinator SET epoch = epoch + 1, commits = 0, takeover_ms = $1, released = FALSE
                    RETURNING epoch, key";
        let takeover = Value::Number(self.takeover.as_millis() as i64);
        let row = tx.rows(next, vec![takeover]).await.map_err(|e| self.failure(e))?.pop();
        let loaded = tables::start(&mut *tx, row).await.map_err(|e| self.trouble(e))?;
        // Renewed at the end, since loading takes a while.
        let stamp = "UPDATE coordinator SET renewed_at = clock_timestamp()";
        tx.run(stamp, vec![]).await.map_err(|e| self.failure(e))?;
        tx.commit().await.map_err(|e| self.failure(e))?;
        Ok(loaded)
    }

    /// Returns an error if another coordinator is active.
    async fn refuse_if_active(&self, connection: &mut PgConnection, query: &'static str) -> Result<(), StoreError> {
        let row = sqlx::query(query).fetch_one(connection).await.map_err(|e| self.failure(e))?;
        let column = |i| row.number(i).map_err(|e| self.failure(e));
        let (at_work, epoch, stamp) = (column(0)? == 1, column(1)? as u64, column(2)?);
        if at_work { Err(StoreError::Active { epoch, stamp }) } else { Ok(()) }
    }
}

/// Time limit for repeated requests to a database that does not respond.
struct Patience<'a> {
    store: &'a PostgresStore,
    end: Instant,
}

impl Patience<'_> {
    /// Waits for an answer. Returns `None` if the request should be repeated.
    async fn attempt<T>(&self, answer: impl Future<Output = Result<T, StoreError>>) -> Option<Result<T, StoreError>> {
        let error = match tokio::time::timeout_at(self.end, answer).await {
            Ok(Err(error @ StoreError::Unreachable { .. })) => error,
            Ok(answer) => return Some(answer),
            Err(_) => self.store.silent(self.store.patience()),
        };
        if Instant::now() + RETRY >= self.end {
            return Some(Err(error));
        }
        tracing::warn!(%error, "store unreachable: retrying");
        tokio::time::sleep(RETRY).await;
        None
    }
}

impl Sql for PgConnection {
    type Row = PgRow;

    async fn run(&mut self, sql: &'static str, values: Vec<Value<'_>>) -> Result<u64, sqlx::Error> {
        Ok(statement(sql, values).execute(self).await?.rows_affected())
    }

    async fn rows(&mut self, sql: &'static str, values: Vec<Value<'_>>) -> Result<Vec<PgRow>, sqlx::Error> {
        statement(sql, values).fetch_all(self).await
    }

    async fn insert_results(&mut self, rows: Vec<ResultRow>) -> Result<(), sqlx::Error> {
        let mut columns = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for ResultRow { job, round, first, results } in rows {
            columns.0.push(job.to_string());
            columns.1.push(i64::from(round));
            columns.2.push(i64::from(first));
            columns.3.push(results);
        }
        let insert = "INSERT INTO results (job, round, first, results)
                      SELECT * FROM unnest($1::TEXT[], $2::BIGINT[], $3::BIGINT[], $4::BYTEA[])";
        let insert = sqlx::query(insert).bind(columns.0).bind(columns.1).bind(columns.2).bind(columns.3);
        insert.execute(self).await.map(drop)
    }
}

impl Dialect for PostgresStore {
    type Connection = PgConnection;
    type Lent<'a> = PoolConnection<Postgres>;

    async fn connection(&self) -> Result<PoolConnection<Postgres>, StoreError> {
        self.readers.acquire().await.map_err(|e| self.failure(e))
    }

    fn failure(&self, error: sqlx::Error) -> StoreError {
        failure(&self.name, error)
    }

    async fn start(&self) -> Result<Loaded, StoreError> {
        let mut commits = self.commits.lock().await;
        let mut connection = self.writers.acquire().await.map_err(|e| self.failure(e))?;
        // The first check takes no row lock: the active coordinator would have to wait for it.
        let look = self.refuse_if_active(&mut connection, at_work!(""));
        let (answer, within) = match tokio::time::timeout(self.patience(), look).await {
            Ok(Ok(())) => {
                let within = self.prepare_within;
                (tokio::time::timeout(within, self.take_over(&mut connection)).await, within)
            }
            Ok(Err(error)) => return Err(error),
            Err(silence) => (Err(silence), self.patience()),
        };
        let Ok(answer) = answer else {
            // Closes the connection: a later request on it would get no answer either.
            drop(connection.detach());
            return Err(self.silent(within));
        };
        let loaded = answer?;
        *commits = 0;
        Ok(loaded)
    }

    async fn commit(&self, epoch: u64, writes: Vec<Write>) -> Result<(), StoreError> {
        let mut commits = self.commits.lock().await;
        let number = *commits + 1;
        self.patiently(epoch, || self.commit_as(epoch, number, &writes)).await?;
        *commits = number;
        Ok(())
    }

    fn renew_every(&self) -> Option<Duration> {
        Some(self.takeover / 5)
    }

    async fn renew(&self, epoch: u64) -> Result<(), StoreError> {
        self.patiently(epoch, || self.renew_once(epoch)).await
    }

    async fn release(&self, epoch: u64) -> Result<(), StoreError> {
        let release = async {
            let mut connection = self.writers.acquire().await.map_err(|e| self.failure(e))?;
            let release = "UPDATE coordinator SET released = TRUE WHERE epoch = $1";
            connection.run(release, vec![epoch.into()]).await.map_err(|e| self.failure(e)).map(drop)
        };
        tokio::time::timeout(self.patience(), release).await.unwrap_or_else(|_| Err(self.silent(self.patience())))
    }

    async fn close(&self) -> Result<(), StoreError> {
        let close = async {
            self.readers.close().await;
            self.writers.close().await;
        };
        // An unreachable database does not receive the end of the connections.
        if tokio::time::timeout(LEAST_TIMEOUT, close).await.is_err() {
            tracing::warn!(store = %self.name, "connections dropped without a clean close: the database does not respond");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
