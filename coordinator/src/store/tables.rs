//! Statements of the SQL stores, the same for all dialects.

use super::blob;
use super::sql::{ResultRow, Sql, SqlRow as _};
use super::{Loaded, SealedRound, StoreError, StoredEvent, StoredJob, StoredRange, StoredResult, Write};
use crate::permit::PermitKey;
use crate::record::{JobEvent, JobId, JobRecord, JobState};
use sim_core::base::digest::Digest;
use sim_core::procedure::Artefact;
use std::collections::BTreeSet;

/// Error of the database, or of its content.
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

/// Applies all changes of a group, in order, inside a transaction.
pub(super) async fn apply_all(sql: &mut impl Sql, writes: &[Write]) -> Result<(), sqlx::Error> {
    // Consecutive results are inserted together: a remote database then gets one request.
    let mut results = Vec::new();
    for (write, has_last_record) in writes.iter().zip(last_records(writes)) {
        if let Write::Results { job, round, ranges, finder } = write {
            results.extend(ranges.iter().map(|(first, delivered)| ResultRow {
                job: job.clone(),
                round: *round,
                first: *first,
                results: blob::encode_delivered(delivered, finder),
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

/// Returns, for each change, true if it is the last one with its job's record. Only that record is written: a record
/// with many disputes is large, and changes with each result.
fn last_records(writes: &[Write]) -> Vec<bool> {
    let mut seen = BTreeSet::new();
    let mut last: Vec<bool> =
        writes.iter().rev().map(|write| write.record().is_none_or(|r| seen.insert(&r.id))).collect();
    last.reverse();
    last
}

async fn apply(sql: &mut impl Sql, write: &Write, has_last_record: bool) -> Result<(), sqlx::Error> {
    match write {
        Write::Submit { record, toml, state, event } => {
            let values = vec![
                record.number.into(),
                (&record.id).into(),
                record.request_id.as_str().into(),
                record.state.into(),
                blob::encode(record).into(),
                blob::encode(state).into(),
            ];
            sql.run(
                "INSERT INTO jobs (number, id, request_id, state, record, run) VALUES ($1, $2, $3, $4, $5, $6)",
                values,
            )
            .await?;
            sql.run("INSERT INTO texts (job, toml) VALUES ($1, $2)", vec![(&record.id).into(), (&**toml).into()])
                .await?;
            insert_events(sql, record, std::slice::from_ref(event)).await
        }
        // Inserted together by [`apply_all`].
        Write::Results { .. } => Ok(()),
        Write::Seal { record, sealed, state, events } => {
            insert_round(sql, &record.id, sealed).await?;
            // One statement for all columns: each update writes the whole row, and the state of a large search is most
            // of it.
            let values =
                vec![blob::encode(state).into(), record.state.into(), blob::encode(record).into(), (&record.id).into()];
            sql.run("UPDATE jobs SET run = $1, state = $2, record = $3 WHERE id = $4", values).await?;
            sql.run("DELETE FROM results WHERE job = $1", vec![(&record.id).into()]).await?;
            insert_events(sql, record, events).await
        }
        Write::Change { record, event } => {
            if has_last_record {
                update_record(sql, record).await?;
            }
            insert_events(sql, record, std::slice::from_ref(event)).await
        }
        Write::Offer { record, state, event } => {
            let values = vec![blob::encode(state).into(), (&record.id).into()];
            sql.run("UPDATE jobs SET run = $1 WHERE id = $2", values).await?;
            update_record(sql, record).await?;
            insert_events(sql, record, std::slice::from_ref(event)).await
        }
        Write::Note { record } if has_last_record => update_record(sql, record).await,
        Write::Note { .. } => Ok(()),
        Write::Carry { from, to, rounds } => {
            let values = vec![to.into(), from.into(), (*rounds).into()];
            let carry = "INSERT INTO rounds (job, round, told, digests, results)
                         SELECT $1, round, told, digests, results FROM rounds WHERE job = $2 AND round < $3";
            sql.run(carry, values).await.map(drop)
        }
        Write::Quarantine { entry, instead_of } => {
            if let Some(worker) = instead_of {
                sql.run("DELETE FROM quarantined WHERE worker = $1", vec![(&**worker).into()]).await?;
            }
            let values = vec![(&*entry.worker).into(), blob::encode(entry).into()];
            let insert = "INSERT INTO quarantined (worker, entry) VALUES ($1, $2) ON CONFLICT (worker) DO NOTHING";
            sql.run(insert, values).await.map(drop)
        }
        Write::Finish { record, sealed, artefacts, events } => {
            insert_round(sql, &record.id, sealed).await?;
            for (place, artefact) in (0u32..).zip(artefacts) {
                let values = vec![
                    (&record.id).into(),
                    place.into(),
                    artefact.name.as_str().into(),
                    artefact.media_type.as_str().into(),
                    artefact.content.clone().into(),
                ];
                let insert =
                    "INSERT INTO artefacts (job, place, name, media_type, content) VALUES ($1, $2, $3, $4, $5)";
                sql.run(insert, values).await?;
            }
            update_record(sql, record).await?;
            insert_events(sql, record, events).await
        }
    }
}

async fn update_record(sql: &mut impl Sql, record: &JobRecord) -> Result<(), sqlx::Error> {
    let values = vec![record.state.into(), blob::encode(record).into(), (&record.id).into()];
    sql.run("UPDATE jobs SET state = $1, record = $2 WHERE id = $3", values).await?;
    if record.state.is_end() {
        sql.run("DELETE FROM results WHERE job = $1", vec![(&record.id).into()]).await?;
        sql.run("UPDATE jobs SET run = NULL WHERE id = $1", vec![(&record.id).into()]).await?;
    }
    Ok(())
}

async fn insert_round(sql: &mut impl Sql, id: &JobId, sealed: &SealedRound) -> Result<(), sqlx::Error> {
    let SealedRound { number, row, digests, results } = sealed;
    let values = vec![
        id.into(),
        (*number).into(),
        blob::encode(row).into(),
        blob::encode_digests(digests).into(),
        // Empty if the results are not kept.
        results.as_deref().map_or_else(Vec::new, blob::encode_results).into(),
    ];
    let insert = "INSERT INTO rounds (job, round, told, digests, results) VALUES ($1, $2, $3, $4, $5)";
    sql.run(insert, values).await.map(drop)
}

async fn insert_events(sql: &mut impl Sql, record: &JobRecord, events: &[JobEvent]) -> Result<(), sqlx::Error> {
    for event in events {
        let stored = StoredEvent { event: event.clone(), job: record.snapshot() };
        let values = vec![(&record.id).into(), event.sequence.into(), blob::encode(&stored).into()];
        sql.run("INSERT INTO events (job, sequence, event) VALUES ($1, $2, $3)", values).await?;
    }
    Ok(())
}

/// Loads all data to resume the jobs in a new epoch. `row` has the epoch and the secret key of the permits.
pub(super) async fn start<S: Sql>(sql: &mut S, row: Option<S::Row>) -> Result<Loaded, Trouble> {
    let row = row.ok_or(sqlx::Error::RowNotFound)?;
    let corrupt = |_| StoreError::Corrupt { what: "the secret of permits".to_owned() };
    let key = PermitKey::new(row.bytes(1)?.try_into().map_err(corrupt)?);
    let epoch = row.number(0)? as u64;
    let mut loaded = Loaded { epoch, key, next_job: 1, active: Vec::new(), ended: Vec::new(), quarantined: Vec::new() };
    for row in sql.rows("SELECT number, id, state FROM jobs ORDER BY number", vec![]).await? {
        let (id, state) = (JobId::from(row.text(1)?.as_str()), row.number(2)?);
        loaded.next_job = row.number(0)? as u64 + 1;
        let state = JobState::ALL.into_iter().find(|known| *known as i64 == state);
        let unknown = || StoreError::Corrupt { what: format!("the state of job {id}") };
        if state.ok_or_else(unknown)?.is_end() {
            loaded.ended.push(id);
        } else {
            loaded.active.push(load_job(sql, &id).await?);
        }
    }
    for row in sql.rows("SELECT entry FROM quarantined ORDER BY worker", vec![]).await? {
        loaded.quarantined.push(blob::decode("quarantine", &row.bytes(0)?)?);
    }
    Ok(loaded)
}

async fn load_job(sql: &mut impl Sql, id: &JobId) -> Result<StoredJob, Trouble> {
    let query = "SELECT record, run, toml FROM jobs JOIN texts ON texts.job = jobs.id WHERE jobs.id = $1";
    let mut rows = sql.rows(query, vec![id.into()]).await?;
    let row = rows.pop().ok_or(sqlx::Error::RowNotFound)?;
    let record = decode_record(&row.bytes(0)?)?;
    let (state, toml) = (blob::decode("state", &row.bytes(1)?)?, row.text(2)?.into());
    let mut results = Vec::new();
    let query = "SELECT round, first, results FROM results WHERE job = $1 ORDER BY round, first";
    for row in sql.rows(query, vec![id.into()]).await? {
        let (round, first) = (row.number(0)? as u32, row.number(1)? as u32);
        let (delivered, finder) = blob::decode_delivered(&row.bytes(2)?)?;
        results.push(StoredRange { round, first, results: delivered, finder });
    }
    Ok(StoredJob { record, toml, state, results })
}

fn decode_record(bytes: &[u8]) -> Result<JobRecord, StoreError> {
    blob::decode("job", bytes)
}

pub(super) async fn job(sql: &mut impl Sql, id: &JobId) -> Result<Option<(JobRecord, String)>, Trouble> {
    let query = "SELECT record, toml FROM jobs JOIN texts ON texts.job = jobs.id WHERE jobs.id = $1";
    let row = sql.rows(query, vec![id.into()]).await?.pop();
    row.map(|row| Ok((decode_record(&row.bytes(0)?)?, row.text(1)?))).transpose()
}

pub(super) async fn job_of_request(sql: &mut impl Sql, request_id: &str) -> Result<Option<JobRecord>, Trouble> {
    let row = sql.rows("SELECT record FROM jobs WHERE request_id = $1", vec![request_id.into()]).await?.pop();
    row.map(|row| Ok(decode_record(&row.bytes(0)?)?)).transpose()
}

pub(super) async fn jobs(
    sql: &mut impl Sql,
    below: u64,
    limit: u32,
    states: &[JobState],
) -> Result<Vec<JobRecord>, Trouble> {
    let mask = states.iter().fold(0u64, |mask, &state| mask | 1 << (state as u64));
    let query = "SELECT record FROM jobs WHERE number < $1 AND ($2 = 0 OR (($2 >> CAST(state AS INTEGER)) & 1) = 1)
                 ORDER BY number DESC LIMIT $3";
    let rows = sql.rows(query, vec![below.into(), mask.into(), limit.into()]).await?;
    rows.iter().map(|row| Ok(decode_record(&row.bytes(0)?)?)).collect()
}

pub(super) async fn events(
    sql: &mut impl Sql,
    id: &JobId,
    after: u64,
    limit: u32,
) -> Result<Vec<StoredEvent>, Trouble> {
    let query = "SELECT event FROM events WHERE job = $1 AND sequence > $2 ORDER BY sequence LIMIT $3";
    let rows = sql.rows(query, vec![id.into(), after.into(), limit.into()]).await?;
    rows.iter().map(|row| Ok(blob::decode("event", &row.bytes(0)?)?)).collect()
}

pub(super) async fn digests(sql: &mut impl Sql, id: &JobId, round: u32) -> Result<Option<Vec<Digest>>, Trouble> {
    let query = "SELECT digests FROM rounds WHERE job = $1 AND round = $2";
    let row = sql.rows(query, vec![id.into(), round.into()]).await?.pop();
    row.map(|row| Ok(blob::decode_digests(&row.bytes(0)?)?)).transpose()
}

pub(super) async fn rounds(sql: &mut impl Sql, id: &JobId, from: u32, limit: u32) -> Result<Vec<SealedRound>, Trouble> {
    let query = "SELECT round, told, digests, results FROM rounds WHERE job = $1 AND round >= $2
                 ORDER BY round LIMIT $3";
    let rows = sql.rows(query, vec![id.into(), from.into(), limit.into()]).await?;
    let mut found = Vec::with_capacity(rows.len());
    for row in rows {
        let results = row.bytes(3)?;
        found.push(SealedRound {
            number: row.number(0)? as u32,
            row: blob::decode("row", &row.bytes(1)?)?,
            digests: blob::decode_digests(&row.bytes(2)?)?,
            results: if results.is_empty() { None } else { Some(blob::decode_results(&results)?) },
        });
    }
    Ok(found)
}

pub(super) async fn result(sql: &mut impl Sql, id: &JobId) -> Result<StoredResult, Trouble> {
    let mut result = StoredResult::default();
    let query = "SELECT told FROM rounds WHERE job = $1 ORDER BY round";
    for row in sql.rows(query, vec![id.into()]).await? {
        result.history.extend(blob::decode::<Option<_>>("row", &row.bytes(0)?)?);
    }
    let query = "SELECT name, media_type, content FROM artefacts WHERE job = $1 ORDER BY place";
    for row in sql.rows(query, vec![id.into()]).await? {
        result.artefacts.push(Artefact { name: row.text(0)?, media_type: row.text(1)?, content: row.bytes(2)? });
    }
    Ok(result)
}

#[cfg(test)]
mod tests {
    use super::super::sql::Value;
    use super::super::tests::{event, record, submit};
    use super::*;
    use crate::record::Claimant;
    use sqlx::sqlite::SqliteRow;

    /// Records the statements that change data.
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
    async fn repeatedly_changed_job_is_written_once_per_commit() {
        let (job, other) = (record(1), record(2));
        let mut writes = vec![submit(&job), submit(&other), Write::Note { record: other.clone() }];
        for sequence in 2..100 {
            writes.push(Write::Change { record: job.clone(), event: event(sequence, JobState::Running) });
            writes.push(Write::Note { record: job.clone() });
            let results =
                Write::Results { job: job.id.clone(), round: 0, ranges: Vec::new(), finder: Claimant::default() };
            writes.push(results);
        }
        let mut counter = Counter::default();
        apply_all(&mut counter, &writes).await.unwrap();
        let count = |what: &str| counter.0.iter().filter(|sql| sql.starts_with(what)).count();
        assert_eq!(count("UPDATE jobs SET state"), 2, "one update for each job");
        assert_eq!(count("INSERT INTO events"), 2 + 98);
    }
}
