//! RestartJob: a new job repeats an ended job from one of its rounds on.

use super::jobs::{read, request_id};
use super::{Api, store_failed};
use crate::limits::ROUNDS_AT_ONCE;
use crate::record::{Dispute, JobRecord, Origin, Ruling};
use crate::scheduler::{Carried, NewJob};
use proto::v1::{RestartJobRequest, SubmitJobRequest};
use sim_core::base::digest::Digest;
use tonic::Status;

impl Api {
    /// Returns the new job, and true if it did not exist before.
    pub(super) async fn restart(&self, request: RestartJobRequest) -> Result<(JobRecord, bool), Status> {
        let RestartJobRequest { request_id: name, id, from_round } = request;
        request_id(&name)?;
        let digest = Digest::of("evogait restart 2", &(&id, from_round));
        if let Some(record) = self.requested_before(&name, &digest).await? {
            return Ok((record, false));
        }
        let (record, job_toml) = self.stored(&id).await?;
        let first = first_again(&record, from_round)?;
        let origin = record.clone();
        let read = move || prepare(name, digest, &origin, job_toml);
        let mut new = self.reading(read).await?;
        let mut carried = Carried::start(Origin { job: record.id.clone(), rounds: first }, &new.job_digest);
        while new.procedure.round().number < first {
            let from = new.procedure.round().number;
            let limit = ROUNDS_AT_ONCE.min(first - from);
            let rounds = self.store.rounds(&record.id, from, limit).await.map_err(store_failed)?;
            let failed = |_| Status::internal("taking rounds over failed; this is a bug: please report it");
            let told = tokio::task::spawn_blocking(move || {
                let told = rounds.into_iter().try_for_each(|sealed| carried.tell(&mut *new.procedure, sealed));
                (told, new, carried)
            });
            let (told, taken, carrying) = told.await.map_err(failed)?;
            told.map_err(|e| Status::failed_precondition(format!("job {} can't be restarted: {e}", record.id)))?;
            (new, carried) = (taken, carrying);
            if new.procedure.round().number == from {
                return Err(Status::failed_precondition(format!(
                    "round {from} of job {} is not in the store: restart from an earlier round",
                    record.id
                )));
            }
        }
        self.take_in(NewJob { carried: Some(carried), ..new }).await
    }
}

/// Returns the first round to repeat: the requested round, if it is allowed. Without a request it is the first round
/// with a wrong or disputed result.
fn first_again(record: &JobRecord, asked: Option<u32>) -> Result<u32, Status> {
    let id = &record.id;
    if !record.state.is_end() {
        return Err(Status::failed_precondition(format!(
            "job {id} has not ended: wait for its end or cancel it, then restart it"
        )));
    }
    let doubtful = first_doubtful(record);
    // Results of later rounds are not kept, so those rounds are repeated too.
    let first = asked.or(doubtful.map(|(round, _)| round.min(record.rounds_kept))).ok_or_else(|| {
        Status::invalid_argument(format!(
            "job {id} has no wrong or disputed result: name the first round to repeat, 0 to {}",
            record.rounds_kept
        ))
    })?;
    if first > record.rounds_kept {
        return Err(Status::invalid_argument(format!(
            "round {first} is out of range: the results of {} rounds of job {id} are kept, so the first round to repeat \
             can be 0 to {0}",
            record.rounds_kept
        )));
    }
    if let Some((round, why)) = doubtful.filter(|(round, _)| *round < first) {
        return Err(Status::failed_precondition(format!(
            "a result of round {round} of job {id} {why}: restart from round {round} or an earlier one"
        )));
    }
    Ok(first)
}

/// Returns the first sealed round with a wrong or disputed result, and the fault in words.
fn first_doubtful(record: &JobRecord) -> Option<(u32, &'static str)> {
    let doubtful = |d: &Dispute| match d.ruling {
        Some(Ruling::Tainted) => Some((d.round, "is wrong")),
        None if d.round < record.rounds_sealed => {
            Some((d.round, "is disputed (the job ended before the dispute was decided)"))
        }
        _ => None,
    };
    record.disputes.iter().filter_map(doubtful).min_by_key(|(round, _)| *round)
}

/// Prepares the new job, without rounds of the old one.
fn prepare(request_id: String, request_digest: Digest, record: &JobRecord, job_toml: String) -> Result<NewJob, Status> {
    let request = SubmitJobRequest { request_id, job_toml, priority: record.priority };
    let new = read(request, record.priority, request_digest)?;
    if new.job_digest != record.job_digest {
        return Err(Status::failed_precondition(format!(
            "job {} was submitted to another version of evogait, which interprets it differently (job digest then {}, now {}): \
             submit it again",
            record.id,
            record.job_digest.short(),
            new.job_digest.short()
        )));
    }
    Ok(new)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::JobState;
    use crate::store::tests::record;

    fn dispute(round: u32, ruling: Option<Ruling>) -> Dispute {
        let (what, task) = (format!("a task of round {round}"), Vec::new());
        Dispute { round, index: 0, what, task, claims: Vec::new(), ruling, at_ms: 0 }
    }

    /// Returns a cancelled job with three sealed rounds and the results of all of them.
    fn cancelled(disputes: Vec<Dispute>) -> JobRecord {
        JobRecord { state: JobState::Cancelled, rounds_sealed: 3, rounds_kept: 3, disputes, ..record(1) }
    }

    fn refusal(record: &JobRecord, asked: Option<u32>) -> String {
        first_again(record, asked).expect_err("the restart is refused").message().to_owned()
    }

    #[test]
    fn disputed_result_is_not_taken_over() {
        let record = cancelled(vec![dispute(1, None), dispute(3, None)]);
        assert_eq!(first_again(&record, None).ok(), Some(1), "the disputed round");
        assert_eq!(first_again(&record, Some(1)).ok(), Some(1));
        let why = refusal(&record, Some(2));
        assert!(why.contains("a result of round 1 of job") && why.contains("is disputed"), "{why}");
        assert!(why.contains("restart from round 1 or an earlier one"), "{why}");

        let tainted = cancelled(vec![dispute(1, None), dispute(0, Some(Ruling::Tainted))]);
        assert_eq!(first_again(&tainted, None).ok(), Some(0), "the earlier of both rounds");
        assert!(refusal(&tainted, Some(1)).contains("is wrong"));
    }

    #[test]
    fn decided_or_unsealed_dispute_allows_restart() {
        let record = cancelled(vec![dispute(1, Some(Ruling::Upheld)), dispute(3, None)]);
        assert_eq!(first_again(&record, Some(3)).ok(), Some(3), "the unsealed round is repeated anyway");
        let why = refusal(&record, None);
        assert!(why.contains("has no wrong or disputed result") && why.contains("0 to 3"), "{why}");
        assert!(refusal(&record, Some(4)).contains("round 4 is out of range"));
    }

    #[test]
    fn dispute_beyond_kept_rounds_restarts_after_them() {
        let record = JobRecord { rounds_kept: 2, ..cancelled(vec![dispute(2, Some(Ruling::Tainted))]) };
        assert_eq!(first_again(&record, None).ok(), Some(2));
        let later = JobRecord { rounds_sealed: 5, ..record.clone() };
        let later = JobRecord { disputes: vec![dispute(4, Some(Ruling::Tainted))], ..later };
        assert_eq!(first_again(&later, None).ok(), Some(2), "results of rounds 2 and 3 are not kept");
    }

    #[test]
    fn running_job_is_not_restarted() {
        let running = JobRecord { state: JobState::Running, ..cancelled(Vec::new()) };
        assert!(refusal(&running, Some(0)).contains("has not ended"));
    }
}
