//! The statements of the SQL stores: one text for all dialects.

use super::blob;
use super::sql::{ResultRow, Row as _, Sql};
use super::{Loaded, StoreError, StoredJob, StoredRange, StoredResult, Write};
use crate::record::{JobId, JobRecord, JobState, ended};
use proto::v1;
use std::collections::BTreeSet;

/// What can go wrong: the database, or what it holds.
pub(super) enum Trouble {
    Database(sqlx::Error),
    Content(StoreError),
}

impl From<sqlx::Error> for Trouble {
    fn from(error: sqlx::Error) -> Self {
        Self::Database(error)
    }
}

impl From<StoreError> for Trouble {
    fn from(error: StoreError) -> Self {
        Self::Content(error)
    }
}

/// All writes of a group, in their order, inside a transaction.
pub(super) async fn apply_all(sql: &mut impl Sql, writes: &[Write]) -> Result<(), sqlx::Error> {
    // Results that follow each other go in together: a database that is far away is asked once.
    let mut results = Vec::new();
    for (write, has_last_record) in writes.iter().zip(last_records(writes)) {
        if let Write::Results { job, round, ranges, finder } = write {
            results.extend(ranges.iter().map(|(first, outcomes)| ResultRow {
                job: job.clone(),
                round: *round,
                first: *first,
                outcomes: blob::encode_outcomes(outcomes, finder),
            }));
            continue;
        }
        if !results.is_empty() {
            sql.insert_results(std::mem::take(&mut results)).await?;
        }
        apply(sql, write, has_last_record).await?;
    }
    if results.is_empty() { Ok(()) } else { sql.insert_results(results).await }
}

/// Of each write, whether no later one has its job's record, too: a record with many doubts is large, and changes with each
/// answer.
fn last_records(writes: &[Write]) -> Vec<bool> {
    let mut seen = BTreeSet::new();
    let mut last: Vec<bool> =
        writes.iter().rev().map(|write| write.record().is_none_or(|r| seen.insert(&r.id))).collect();
    last.reverse();
    last
}

async fn apply(sql: &mut impl Sql, write: &Write, has_last_record: bool) -> Result<(), sqlx::Error> {
    match write {
        Write::Submit { record, toml, search, event } => {
            let values = vec![
                record.number.into(),
                (&record.id).into(),
                record.request_id.as_str().into(),
                record.state.into(),
                blob::encode_record(record).into(),
                search.clone().into(),
            ];
            sql.run(
                "INSERT INTO jobs (number, id, request_id, state, record, search) VALUES ($1, $2, $3, $4, $5, $6)",
                values,
            )
            .await?;
            sql.run("INSERT INTO texts (job, toml) VALUES ($1, $2)", vec![(&record.id).into(), (&**toml).into()])
                .await?;
            insert_events(sql, &record.id, std::slice::from_ref(event)).await
        }
        // They are inserted together, see above.
        Write::Results { .. } => Ok(()),
        Write::Seal { record, sealed, search, events } => {
            let values = vec![
                (&record.id).into(),
                sealed.statistics.generation.into(),
                blob::encode(&sealed.statistics).into(),
                blob::encode_scores(&sealed.scores).into(),
            ];
            sql.run("INSERT INTO generations (job, generation, statistics, scores) VALUES ($1, $2, $3, $4)", values)
                .await?;
            // In one statement: a row is written whole, and the state of a large search is most of it.
            let values = vec![
                search.clone().into(),
                record.state.into(),
                blob::encode_record(record).into(),
                (&record.id).into(),
            ];
            sql.run("UPDATE jobs SET search = $1, state = $2, record = $3 WHERE id = $4", values).await?;
            sql.run("DELETE FROM results WHERE job = $1", vec![(&record.id).into()]).await?;
            insert_events(sql, &record.id, events).await
        }
        Write::Change { record, event } => {
            if has_last_record {
                update_record(sql, record).await?;
            }
            insert_events(sql, &record.id, std::slice::from_ref(event)).await
        }
        Write::Note { record } if has_last_record => update_record(sql, record).await,
        Write::Note { .. } => Ok(()),
        Write::Carry { from, to, generations } => {
            let values = vec![to.into(), from.into(), (*generations).into()];
            let carry = "INSERT INTO generations (job, generation, statistics, scores)
                         SELECT $1, generation, statistics, scores FROM generations WHERE job = $2 AND generation < $3";
            sql.run(carry, values).await.map(drop)
        }
        Write::Quarantine(entry) => {
            let values = vec![(&*entry.worker).into(), blob::encode_quarantined(entry).into()];
            let insert = "INSERT INTO quarantined (worker, entry) VALUES ($1, $2) ON CONFLICT (worker) DO NOTHING";
            sql.run(insert, values).await.map(drop)
        }
        Write::Report { record, report, event } => {
            let values = vec![(&record.id).into(), report.clone().into()];
            sql.run("INSERT INTO reports (job, report) VALUES ($1, $2)", values).await?;
            update_record(sql, record).await?;
            insert_events(sql, &record.id, std::slice::from_ref(event)).await
        }
    }
}

async fn update_record(sql: &mut impl Sql, record: &JobRecord) -> Result<(), sqlx::Error> {
    let values = vec![record.state.into(), blob::encode_record(record).into(), (&record.id).into()];
    sql.run("UPDATE jobs SET state = $1, record = $2 WHERE id = $3", values).await?;
    if ended(record.state) {
        sql.run("DELETE FROM results WHERE job = $1", vec![(&record.id).into()]).await?;
        sql.run("UPDATE jobs SET search = NULL WHERE id = $1", vec![(&record.id).into()]).await?;
    }
    Ok(())
}

async fn insert_events(sql: &mut impl Sql, id: &JobId, events: &[v1::JobEvent]) -> Result<(), sqlx::Error> {
    for event in events {
        let values = vec![id.into(), event.sequence.into(), blob::encode(event).into()];
        sql.run("INSERT INTO events (job, sequence, event) VALUES ($1, $2, $3)", values).await?;
    }
    Ok(())
}

/// All that a coordinator needs to go on in a new epoch.
pub(super) async fn load(sql: &mut impl Sql, epoch: u64) -> Result<Loaded, Trouble> {
    let mut loaded = Loaded { epoch, next_job: 1, ..Loaded::default() };
    for row in sql.rows("SELECT number, id, state FROM jobs ORDER BY number", vec![]).await? {
        let id = JobId::from(row.text(1)?.as_str());
        loaded.next_job = row.number(0)? as u64 + 1;
        if ended(JobState::try_from(row.number(2)? as i32).unwrap_or_default()) {
            loaded.ended.push(id);
        } else {
            loaded.active.push(load_job(sql, &id).await?);
        }
    }
    for row in sql.rows("SELECT worker, entry FROM quarantined ORDER BY worker", vec![]).await? {
        loaded.quarantined.push(blob::decode_quarantined(&row.text(0)?, &row.bytes(1)?)?);
    }
    Ok(loaded)
}

async fn load_job(sql: &mut impl Sql, id: &JobId) -> Result<StoredJob, Trouble> {
    let query = "SELECT record, search, toml FROM jobs JOIN texts ON texts.job = jobs.id WHERE jobs.id = $1";
    let mut rows = sql.rows(query, vec![id.into()]).await?;
    let row = rows.pop().ok_or(sqlx::Error::RowNotFound)?;
    let record = blob::decode_record(&row.bytes(0)?)?;
    let (search, toml) = (row.bytes(1)?, row.text(2)?.into());
    let mut results = Vec::new();
    let query = "SELECT round, first, outcomes FROM results WHERE job = $1 ORDER BY round, first";
    for row in sql.rows(query, vec![id.into()]).await? {
        let (round, first) = (row.number(0)? as u32, row.number(1)? as u32);
        let (outcomes, finder) = blob::decode_outcomes(&row.bytes(2)?)?;
        results.push(StoredRange { round, first, outcomes, finder });
    }
    let last_scores = match record.generations_done.checked_sub(1) {
        Some(generation) => scores(sql, id, generation).await?,
        None => None,
    };
    Ok(StoredJob { record, toml, search, results, last_scores })
}

pub(super) async fn job(sql: &mut impl Sql, id: &JobId) -> Result<Option<(JobRecord, String)>, Trouble> {
    let query = "SELECT record, toml FROM jobs JOIN texts ON texts.job = jobs.id WHERE jobs.id = $1";
    let row = sql.rows(query, vec![id.into()]).await?.pop();
    row.map(|row| Ok((blob::decode_record(&row.bytes(0)?)?, row.text(1)?))).transpose()
}

pub(super) async fn job_of_request(sql: &mut impl Sql, request_id: &str) -> Result<Option<JobRecord>, Trouble> {
    let row = sql.rows("SELECT record FROM jobs WHERE request_id = $1", vec![request_id.into()]).await?.pop();
    row.map(|row| Ok(blob::decode_record(&row.bytes(0)?)?)).transpose()
}

pub(super) async fn jobs(
    sql: &mut impl Sql,
    below: u64,
    limit: u32,
    states: &[JobState],
) -> Result<Vec<JobRecord>, Trouble> {
    let mask = states.iter().fold(0u64, |mask, &state| mask | 1 << i32::from(state));
    let query = "SELECT record FROM jobs WHERE number < $1 AND ($2 = 0 OR (($2 >> CAST(state AS INTEGER)) & 1) = 1)
                 ORDER BY number DESC LIMIT $3";
    let rows = sql.rows(query, vec![below.into(), mask.into(), limit.into()]).await?;
    rows.iter().map(|row| Ok(blob::decode_record(&row.bytes(0)?)?)).collect()
}

pub(super) async fn events(
    sql: &mut impl Sql,
    id: &JobId,
    after: u64,
    limit: u32,
) -> Result<Vec<v1::JobEvent>, Trouble> {
    let query = "SELECT event FROM events WHERE job = $1 AND sequence > $2 ORDER BY sequence LIMIT $3";
    let rows = sql.rows(query, vec![id.into(), after.into(), limit.into()]).await?;
    rows.iter().map(|row| Ok(blob::decode("event", &row.bytes(0)?)?)).collect()
}

pub(super) async fn scores(
    sql: &mut impl Sql,
    id: &JobId,
    generation: u32,
) -> Result<Option<Vec<Option<f64>>>, Trouble> {
    let query = "SELECT scores FROM generations WHERE job = $1 AND generation = $2";
    let row = sql.rows(query, vec![id.into(), generation.into()]).await?.pop();
    row.map(|row| Ok(blob::decode_scores(&row.bytes(0)?)?)).transpose()
}

pub(super) async fn result(sql: &mut impl Sql, id: &JobId) -> Result<StoredResult, Trouble> {
    let query = "SELECT statistics FROM generations WHERE job = $1 ORDER BY generation";
    let rows = sql.rows(query, vec![id.into()]).await?;
    let statistics = |bytes: Vec<u8>| Ok::<_, Trouble>(blob::decode("statistics", &bytes)?);
    let history = rows.iter().map(|row| statistics(row.bytes(0)?)).collect::<Result<_, _>>()?;
    let report = sql.rows("SELECT report FROM reports WHERE job = $1", vec![id.into()]).await?.pop();
    let report = report.map(|row| row.bytes(0)).transpose()?.unwrap_or_default();
    Ok(StoredResult { history, report })
}

#[cfg(test)]
mod tests {
    use super::super::sql::Value;
    use super::super::tests::{event, record, submit};
    use super::*;
    use crate::scheduler::Finder;
    use sqlx::sqlite::SqliteRow;

    /// Counts what it is told to change.
    #[derive(Default)]
    struct Counter(Vec<&'static str>);

    impl Sql for Counter {
        type Row = SqliteRow;

        async fn run(&mut self, sql: &'static str, _: Vec<Value<'_>>) -> Result<u64, sqlx::Error> {
            self.0.push(sql);
            Ok(1)
        }

        async fn rows(&mut self, _: &'static str, _: Vec<Value<'_>>) -> Result<Vec<SqliteRow>, sqlx::Error> {
            Ok(Vec::new())
        }

        async fn insert_results(&mut self, _: Vec<ResultRow>) -> Result<(), sqlx::Error> {
            self.0.push("INSERT INTO results");
            Ok(())
        }
    }

    #[tokio::test]
    async fn a_job_that_changes_often_in_a_commit_is_written_once() {
        let (job, other) = (record(1), record(2));
        let mut writes = vec![submit(&job), submit(&other), Write::Note { record: other.clone() }];
        for sequence in 2..100 {
            writes.push(Write::Change { record: job.clone(), event: event(sequence, JobState::Running) });
            writes.push(Write::Note { record: job.clone() });
            let results =
                Write::Results { job: job.id.clone(), round: 0, ranges: Vec::new(), finder: Finder::default() };
            writes.push(results);
        }
        let mut counter = Counter::default();
        apply_all(&mut counter, &writes).await.unwrap();
        let count = |what: &str| counter.0.iter().filter(|sql| sql.starts_with(what)).count();
        assert_eq!(count("UPDATE jobs SET state"), 2, "each job");
        assert_eq!(count("INSERT INTO events"), 2 + 98);
    }
}
