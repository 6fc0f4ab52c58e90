//! Common part of the SQL stores: statements with values, and the implementation of [`Store`].
//!
//! A dialect implements connections, the start of an epoch and the commit of a group. All dialects share the statements
//! in `tables`.

use super::tables::{self, Trouble};
use super::{Answer, Loaded, SealedRound, Store, StoreError, StoredEvent, StoredResult, Write};
use crate::record::{JobId, JobRecord, JobState};
use sim_core::base::digest::Digest;
use sqlx::query::Query;
use sqlx::{Database, Decode, Encode, IntoArguments, Type};
use std::ops::DerefMut;
use std::time::Duration;

/// Value for a statement. Floating-point numbers are not among them: they are in blobs, which preserve their bits.
pub(super) enum Value<'a> {
    Number(i64),
    Text(&'a str),
    Bytes(Vec<u8>),
}

impl From<u32> for Value<'_> {
    fn from(number: u32) -> Self {
        Self::Number(number.into())
    }
}

impl From<u64> for Value<'_> {
    /// Numbers count from 0 and stay far below the limit of `i64`. A larger value means "no limit".
    fn from(number: u64) -> Self {
        Self::Number(i64::try_from(number).unwrap_or(i64::MAX))
    }
}

impl From<JobState> for Value<'_> {
    fn from(state: JobState) -> Self {
        Self::Number(state as i64)
    }
}

impl<'a> From<&'a JobId> for Value<'a> {
    fn from(id: &'a JobId) -> Self {
        Self::Text(id.as_str())
    }
}

impl<'a> From<&'a str> for Value<'a> {
    fn from(text: &'a str) -> Self {
        Self::Text(text)
    }
}

impl From<Vec<u8>> for Value<'_> {
    fn from(bytes: Vec<u8>) -> Self {
        Self::Bytes(bytes)
    }
}

/// Row of a query's result, by column.
pub(super) trait SqlRow: Send {
    fn number(&self, column: usize) -> Result<i64, sqlx::Error>;
    fn text(&self, column: usize) -> Result<String, sqlx::Error>;
    /// Returns the bytes; empty for NULL.
    fn bytes(&self, column: usize) -> Result<Vec<u8>, sqlx::Error>;
}

impl<R: sqlx::Row> SqlRow for R
where
    usize: sqlx::ColumnIndex<R>,
    for<'r> i64: Decode<'r, R::Database> + Type<R::Database>,
    for<'r> String: Decode<'r, R::Database> + Type<R::Database>,
    for<'r> Option<Vec<u8>>: Decode<'r, R::Database> + Type<R::Database>,
{
    fn number(&self, column: usize) -> Result<i64, sqlx::Error> {
        self.try_get(column)
    }

    fn text(&self, column: usize) -> Result<String, sqlx::Error> {
        self.try_get(column)
    }

    fn bytes(&self, column: usize) -> Result<Vec<u8>, sqlx::Error> {
        Ok(self.try_get::<Option<Vec<u8>>, _>(column)?.unwrap_or_default())
    }
}

/// Binds values to a statement.
pub(super) fn statement<'a, DB: Database>(sql: &'static str, values: Vec<Value<'a>>) -> Query<'a, DB, DB::Arguments>
where
    DB::Arguments: IntoArguments<DB>,
    i64: Encode<'a, DB> + Type<DB>,
    &'a str: Encode<'a, DB> + Type<DB>,
    Vec<u8>: Encode<'a, DB> + Type<DB>,
{
    values.into_iter().fold(sqlx::query(sql), |query, value| match value {
        Value::Number(number) => query.bind(number),
        Value::Text(text) => query.bind(text),
        Value::Bytes(bytes) => query.bind(bytes),
    })
}

/// Row of the results table: results of one range.
pub(super) struct ResultRow {
    pub job: JobId,
    pub round: u32,
    pub first: u32,
    pub results: Vec<u8>,
}

/// Connection. Placeholders are `$1`, `$2`, …, which both databases accept.
pub(super) trait Sql: Send {
    type Row: SqlRow;

    /// Runs a statement and returns the number of changed rows.
    fn run(
        &mut self,
        sql: &'static str,
        values: Vec<Value<'_>>,
    ) -> impl Future<Output = Result<u64, sqlx::Error>> + Send;

    /// Runs a query and returns its rows.
    fn rows(
        &mut self,
        sql: &'static str,
        values: Vec<Value<'_>>,
    ) -> impl Future<Output = Result<Vec<Self::Row>, sqlx::Error>> + Send;

    /// Inserts results. Most rows are results, so each dialect has its fastest way.
    fn insert_results(&mut self, rows: Vec<ResultRow>) -> impl Future<Output = Result<(), sqlx::Error>> + Send;
}

/// Database for a store.
pub(super) trait Dialect: Send + Sync {
    type Connection: Sql;
    type Lent<'a>: DerefMut<Target = Self::Connection> + Send
    where
        Self: 'a;

    /// Returns a connection for a query.
    fn connection(&self) -> impl Future<Output = Result<Self::Lent<'_>, StoreError>> + Send;

    /// Converts an error of the database, with advice for the operator.
    fn failure(&self, error: sqlx::Error) -> StoreError;

    /// See [`Store::start`].
    fn start(&self) -> impl Future<Output = Result<Loaded, StoreError>> + Send;

    /// See [`Store::commit`].
    fn commit(&self, epoch: u64, writes: Vec<Write>) -> impl Future<Output = Result<(), StoreError>> + Send;

    /// See [`Store::renew_every`].
    fn renew_every(&self) -> Option<Duration> {
        None
    }

    /// See [`Store::renew`].
    fn renew(&self, _epoch: u64) -> impl Future<Output = Result<(), StoreError>> + Send {
        std::future::ready(Ok(()))
    }

    /// See [`Store::release`].
    fn release(&self, _epoch: u64) -> impl Future<Output = Result<(), StoreError>> + Send {
        std::future::ready(Ok(()))
    }

    /// See [`Store::close`].
    fn close(&self) -> impl Future<Output = Result<(), StoreError>> + Send;

    /// Converts an error of a query.
    fn trouble(&self, trouble: Trouble) -> StoreError {
        match trouble {
            Trouble::Database(error) => self.failure(error),
            Trouble::Content(error) => error,
        }
    }
}

impl<D: Dialect> Store for D {
    fn start(&self) -> Answer<'_, Loaded> {
        Box::pin(Dialect::start(self))
    }

    fn commit(&self, epoch: u64, writes: Vec<Write>) -> Answer<'_, ()> {
        Box::pin(Dialect::commit(self, epoch, writes))
    }

    fn renew_every(&self) -> Option<Duration> {
        Dialect::renew_every(self)
    }

    fn renew(&self, epoch: u64) -> Answer<'_, ()> {
        Box::pin(Dialect::renew(self, epoch))
    }

    fn release(&self, epoch: u64) -> Answer<'_, ()> {
        Box::pin(Dialect::release(self, epoch))
    }

    fn job<'a>(&'a self, id: &'a JobId) -> Answer<'a, Option<(JobRecord, String)>> {
        Box::pin(async move {
            let mut connection = self.connection().await?;
            tables::job(&mut *connection, id).await.map_err(|e| self.trouble(e))
        })
    }

    fn job_of_request<'a>(&'a self, request_id: &'a str) -> Answer<'a, Option<JobRecord>> {
        Box::pin(async move {
            let mut connection = self.connection().await?;
            tables::job_of_request(&mut *connection, request_id).await.map_err(|e| self.trouble(e))
        })
    }

    fn jobs<'a>(&'a self, below: u64, limit: u32, states: &'a [JobState]) -> Answer<'a, Vec<JobRecord>> {
        Box::pin(async move {
            let mut connection = self.connection().await?;
            tables::jobs(&mut *connection, below, limit, states).await.map_err(|e| self.trouble(e))
        })
    }

    fn events<'a>(&'a self, id: &'a JobId, after: u64, limit: u32) -> Answer<'a, Vec<StoredEvent>> {
        Box::pin(async move {
            let mut connection = self.connection().await?;
            tables::events(&mut *connection, id, after, limit).await.map_err(|e| self.trouble(e))
        })
    }

    fn digests<'a>(&'a self, id: &'a JobId, round: u32) -> Answer<'a, Option<Vec<Digest>>> {
        Box::pin(async move {
            let mut connection = self.connection().await?;
            tables::digests(&mut *connection, id, round).await.map_err(|e| self.trouble(e))
        })
    }

    fn rounds<'a>(&'a self, id: &'a JobId, from: u32, limit: u32) -> Answer<'a, Vec<SealedRound>> {
        Box::pin(async move {
            let mut connection = self.connection().await?;
            tables::rounds(&mut *connection, id, from, limit).await.map_err(|e| self.trouble(e))
        })
    }

    fn result<'a>(&'a self, id: &'a JobId) -> Answer<'a, StoredResult> {
        Box::pin(async move {
            let mut connection = self.connection().await?;
            tables::result(&mut *connection, id).await.map_err(|e| self.trouble(e))
        })
    }

    fn close(&self) -> Answer<'_, ()> {
        Box::pin(Dialect::close(self))
    }
}
