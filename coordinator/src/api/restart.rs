//! RestartJob: an ended job is done again from one of its generations on.

use super::jobs::{read, request_id};
use super::{Api, store_failed};
use crate::record::{Dispute, JobRecord, Origin, Ruling, ended};
use crate::scheduler::{Carried, NewJob};
use crate::store::{SealedGeneration, StoreError};
use proto::v1::{RestartJobRequest, SubmitJobRequest};
use sim_core::base::digest::Digest;
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
        let new = self.reading(move || prepare(name, digest, record, job_toml, generations)).await?;
        self.take_in(new).await
    }

    /// The first generations of a job, as they were sealed.
    async fn generations(&self, record: &JobRecord, count: u32) -> Result<Vec<SealedGeneration>, Status> {
        let history = self.store.result(&record.id).await.map_err(store_failed)?.history;
        let mut generations = Vec::with_capacity(count as usize);
        for number in 0..count {
            let scores = self.sealed(&record.id, number).await?;
            let missing = || StoreError::Corrupt {
                what: format!("the statistics of generation {number} of {} are missing", record.id),
            };
            let statistics = *history.get(number as usize).ok_or_else(missing).map_err(store_failed)?;
            generations.push(SealedGeneration { scores, statistics });
        }
        Ok(generations)
    }
}

/// The first generation to be done again: what is asked for, if that can be, or else where the job was tainted or where
/// nobody has decided who is right.
fn first_again(record: &JobRecord, asked: Option<u32>) -> Result<u32, Status> {
    let id = &record.id;
    if !ended(record.state) {
        return Err(Status::failed_precondition(format!(
            "job {id} has not ended: wait for its end or cancel it, then restart it"
        )));
    }
    let doubtful = first_doubtful(record);
    let first = asked.or(doubtful.map(|(round, _)| round)).ok_or_else(|| {
        Status::invalid_argument(format!(
            "nothing of job {id} is wrong or in doubt: tell the first generation to be done again, 0 to {}",
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
    if let Some((round, why)) = doubtful.filter(|(round, _)| *round < first) {
        return Err(Status::failed_precondition(format!(
            "a value of generation {round} of job {id} {why}: restart from generation {round} or an earlier one"
        )));
    }
    if first == record.generations_total && record.best.is_none() {
        return Err(Status::failed_precondition(format!(
            "every evaluation of job {id} failed, so nothing follows its search: restart from an earlier generation"
        )));
    }
    Ok(first)
}

/// The first round that an ended job should not have sealed as it did, and what is the matter with it. That of everything
/// after the search is the number of generations.
fn first_doubtful(record: &JobRecord) -> Option<(u32, &'static str)> {
    let is_sealed = |d: &Dispute| {
        let examined = d.round == record.generations_total && record.winner.is_some();
        d.round < record.generations_done || examined
    };
    let doubtful = record.disputes.iter().filter_map(|d| match d.ruling {
        Some(Ruling::Tainted) => Some((d.round, "is wrong")),
        None if is_sealed(d) => Some((d.round, "is in doubt (the job ended before anybody could decide)")),
        _ => None,
    });
    doubtful.map(|(round, why)| (round.min(record.generations_total), why)).min_by_key(|(round, _)| *round)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scheduler::tests::Rig;
    use crate::scheduler::{Completed, WorkerId};

    /// A job that was cancelled in its third generation, in which two workers differ, and so they do about one of the second.
    fn cancelled() -> JobRecord {
        let mut rig = Rig::new();
        let job = rig.submit("a", 2, 3);
        rig.connect("a", 1);
        while rig.stored(&job).disputes.len() < 2 {
            let given = rig.take().expect("there is work");
            let mut by = |worker: &str, delivery| {
                rig.complete(Completed { worker: WorkerId(worker.into()), ..given.completed(delivery) })
            };
            match (given.range().round, given.range().count) {
                (0, _) => by("a", given.delivery()),
                (1, _) => {
                    by("a", given.delivery());
                    by("b", given.first().wrong(0))
                }
                // Its round must not be complete.
                _ => {
                    by("a", given.first().delivery());
                    by("b", given.first().wrong(0))
                }
            };
        }
        rig.scheduler.cancel(rig.now, &job);
        rig.settle();
        let record = rig.stored(&job);
        assert_eq!((record.generations_done, record.disputes.len()), (2, 2));
        record
    }

    fn refusal(record: &JobRecord, asked: Option<u32>) -> String {
        first_again(record, asked).expect_err("it is refused").message().to_owned()
    }

    #[test]
    fn what_is_in_doubt_is_not_taken_over() {
        let record = cancelled();
        assert_eq!(first_again(&record, None).ok(), Some(1), "from where it is in doubt");
        assert_eq!(first_again(&record, Some(1)).ok(), Some(1));
        let why = refusal(&record, Some(2));
        assert!(why.contains("a value of generation 1 of job") && why.contains("is in doubt"), "{why}");
        assert!(why.contains("restart from generation 1 or an earlier one"), "{why}");

        let mut tainted = record.clone();
        tainted.disputes[0].round = 0;
        tainted.disputes[0].ruling = Some(Ruling::Tainted);
        assert_eq!(first_again(&tainted, None).ok(), Some(0), "whichever comes first");
        assert!(refusal(&tainted, Some(1)).contains("is wrong"));
    }

    #[test]
    fn what_is_decided_or_was_never_sealed_is_no_hindrance() {
        let mut record = cancelled();
        record.disputes[0].ruling = Some(Ruling::Upheld);
        assert_eq!(first_again(&record, Some(2)).ok(), Some(2), "the third generation is done again anyway");
        let why = refusal(&record, None);
        assert!(why.contains("nothing of job") && why.contains("0 to 2"), "{why}");
    }

    #[test]
    fn examinations_in_doubt_are_asked_again() {
        let mut record = cancelled();
        record.generations_done = 3;
        record.disputes.truncate(1);
        record.disputes[0].round = 3;
        assert!(refusal(&record, None).contains("nothing of job"), "they were at hand");
        record.winner = record.best.clone();
        assert_eq!(first_again(&record, None).ok(), Some(3));
    }
}
