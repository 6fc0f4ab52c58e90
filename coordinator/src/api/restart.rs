//! RestartJob: an ended job is done again from one of its generations on.

use super::jobs::{read, request_id};
use super::{Api, store_failed};
use crate::record::{JobRecord, Origin, Ruling, ended};
use crate::scheduler::{Carried, NewJob};
use crate::store::{SealedGeneration, StoreError};
use proto::v1::{RestartJobRequest, SubmitJobRequest};
use sim_core::identity::Digest;
use tonic::Status;

impl Api {
    /// The new job, and whether it is new.
    pub(super) async fn restart(&self, request: RestartJobRequest) -> Result<(JobRecord, bool), Status> {
        let RestartJobRequest { request_id: name, id, from_generation } = request;
        request_id(&name)?;
        let digest = Digest::of("evogait restart 1", &(&id, from_generation));
        if let Some(record) = self.requested_before(&name, &digest).await? {
            return Ok((record, false));
        }
        let (record, job_toml) = self.stored(&id).await?;
        let generations = first_again(&record, from_generation)?;
        let generations = self.generations(&record, generations).await?;
        let new = tokio::task::spawn_blocking(move || prepare(name, digest, record, job_toml, generations))
            .await
            .map_err(|_| Status::internal("reading the job failed: this is a bug, please report it with the job"))??;
        self.take_in(new).await
    }

    /// The first generations of a job, as they were sealed.
    async fn generations(&self, record: &JobRecord, count: u32) -> Result<Vec<SealedGeneration>, Status> {
        let history = self.store.result(&record.id).await.map_err(store_failed)?.history;
        let mut generations = Vec::with_capacity(count as usize);
        for number in 0..count {
            let scores = self.store.scores(&record.id, number).await.map_err(store_failed)?;
            let missing =
                || StoreError::Corrupt { what: format!("generation {number} of job {} is missing", record.id) };
            let scores = scores.filter(|s| s.len() == record.population as usize);
            let scores = scores.ok_or_else(missing).map_err(store_failed)?;
            let statistics = *history.get(number as usize).ok_or_else(missing).map_err(store_failed)?;
            generations.push(SealedGeneration { scores, statistics });
        }
        Ok(generations)
    }
}

/// The first generation to be done again: what is asked for, if that can be, or else where the job was tainted.
fn first_again(record: &JobRecord, asked: Option<u32>) -> Result<u32, Status> {
    let id = &record.id;
    if !ended(record.state) {
        return Err(Status::failed_precondition(format!(
            "job {id} has not ended: wait for its end or cancel it, then restart it"
        )));
    }
    let tainted = record.disputes.iter().filter(|d| d.ruling == Some(Ruling::Tainted)).map(|d| d.round).min();
    let tainted = tainted.map(|round| round.min(record.generations_total));
    let first = asked.or(tainted).ok_or_else(|| {
        Status::invalid_argument(format!(
            "job {id} is not tainted: tell the first generation to be done again, 0 to {}",
            record.generations_done
        ))
    })?;
    if first > record.generations_done {
        return Err(Status::invalid_argument(format!(
            "generation {first} is out of range: {} generations of job {id} were sealed, so 0 to {0} can be the first to \
             be done again",
            record.generations_done
        )));
    }
    if let Some(tainted) = tainted.filter(|tainted| *tainted < first) {
        return Err(Status::failed_precondition(format!(
            "a value of generation {tainted} of job {id} is wrong: restart from generation {tainted} or an earlier one"
        )));
    }
    if first == record.generations_total && record.best.is_none() {
        return Err(Status::failed_precondition(format!(
            "every evaluation of job {id} failed, so nothing follows its search: restart from an earlier generation"
        )));
    }
    Ok(first)
}

/// The new job.
fn prepare(
    request_id: String,
    request_digest: Digest,
    record: JobRecord,
    job_toml: String,
    generations: Vec<SealedGeneration>,
) -> Result<NewJob, Status> {
    let request = SubmitJobRequest { request_id, job_toml, priority: record.priority };
    let new = read(request, record.priority, request_digest)?;
    if new.job_digest != record.job_digest {
        return Err(Status::failed_precondition(format!(
            "job {} was submitted to another version of evogait, which reads it differently (job digest then {}, now {}): \
             submit it again",
            record.id,
            record.job_digest.short(),
            new.job_digest.short()
        )));
    }
    let origin = Origin { job: record.id, generations: generations.len() as u32 };
    Ok(NewJob { carried: Some(Carried { origin, generations }), ..new })
}
