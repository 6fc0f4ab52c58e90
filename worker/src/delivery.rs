//! Delivery of results: each is sent until the coordinator answers, across its restarts.

use crate::assignments::Assignments;
use crate::metrics::Metrics;
use crate::work::Finished;
use prost::Message as _;
use proto::dial::{Backoff, FailoverChannel};
use proto::limits::MAX_MESSAGE;
use proto::v1::CompleteRequest;
use proto::v1::complete_request::Outcome;
use proto::v1::complete_response::Verdict;
use proto::v1::worker_service_client::WorkerServiceClient;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc::UnboundedReceiver;
use tokio::task::JoinSet;
use tonic::Code;

/// Time limit for an answer, which needs a commit, in addition to the time of the transfer.
const ANSWER_WITHIN: Duration = Duration::from_secs(30);
/// Lowest assumed transfer rate, bytes/s.
const SLOWEST: usize = 10_000;

/// Sender of results.
#[derive(Clone)]
pub(crate) struct Courier {
    client: WorkerServiceClient<FailoverChannel>,
    worker_id: String,
    assignments: Arc<Assignments>,
    metrics: Arc<Metrics>,
}

impl Courier {
    pub fn new(way: FailoverChannel, worker_id: String, assignments: Arc<Assignments>, metrics: Arc<Metrics>) -> Self {
        let client =
            WorkerServiceClient::new(way).max_decoding_message_size(MAX_MESSAGE).max_encoding_message_size(MAX_MESSAGE);
        Self { client, worker_id, assignments, metrics }
    }

    /// Delivers all results until the slots have ended and every result is answered.
    pub async fn run(self, mut finished: UnboundedReceiver<Finished>) {
        let mut under_way = JoinSet::new();
        loop {
            tokio::select! {
                next = finished.recv() => match next {
                    Some(next) => {
                        self.metrics.worked(&next);
                        under_way.spawn(self.clone().deliver(next));
                    }
                    None => break,
                },
                Some(_) = under_way.join_next() => {}
            }
        }
        while under_way.join_next().await.is_some() {}
    }

    async fn deliver(mut self, finished: Finished) {
        let Finished { assignment, outcome, compute_us } = finished;
        let (id, work) = (assignment.id, &assignment.work);
        let mut request = CompleteRequest {
            worker_id: self.worker_id.clone(),
            assignment_id: id,
            job_id: assignment.job_id.clone(),
            engine_digest: work.bench.engine_digest().0.to_vec(),
            round: work.round,
            first: work.first(),
            count: work.count(),
            permit: work.permit.clone(),
            outcome: Some(outcome),
            compute_us,
            tasks: Vec::new(),
        };
        let mut backoff = Backoff::new();
        loop {
            if let Some(reason) = too_large(&request) {
                tracing::error!(assignment = id, reason);
                request.outcome = Some(Outcome::Failure(reason));
            }
            let on_its_way = Duration::from_secs((request.encoded_len() / SLOWEST) as u64);
            let mut call = tonic::Request::new(request.clone());
            call.set_timeout(ANSWER_WITHIN + on_its_way);
            match self.client.complete(call).await {
                Ok(answer) => {
                    let verdict = answer.into_inner().verdict();
                    self.metrics.result(verdict);
                    log(id, &request, verdict);
                    if verdict != Verdict::NeedsTasks || !request.tasks.is_empty() {
                        break;
                    }
                    request.tasks = work.tasks.iter().map(|(_, task)| task.clone()).collect();
                }
                Err(status) if retryable(status.code()) => {
                    self.metrics.retries.inc();
                    tracing::debug!(assignment = id, job = request.job_id, %status, "delivery failed: trying again");
                    backoff.wait().await;
                }
                // The coordinator will never accept this result. Report a failure, so that its task does not stay
                // leased.
                Err(status) if !matches!(request.outcome, Some(Outcome::Failure(_))) => {
                    let reason = format!("the coordinator refuses the result: {}", status.message());
                    tracing::error!(assignment = id, reason);
                    request.outcome = Some(Outcome::Failure(reason));
                }
                Err(status) => {
                    tracing::error!(assignment = id, %status, "the coordinator refuses the report of a failure");
                    break;
                }
            }
        }
        self.assignments.remove(id);
    }
}

/// Returns the reason if a result exceeds the size of a message.
fn too_large(result: &CompleteRequest) -> Option<String> {
    let bytes = result.encoded_len();
    (bytes > MAX_MESSAGE).then(|| format!("its result has {bytes} bytes: at most {MAX_MESSAGE} can be delivered"))
}

/// Returns true if the same request may succeed later: for all codes except those about the request itself. A proxy may
/// answer that the worker or the method is unknown, and corrected tokens may make the worker known again. An expelled
/// worker ends because its session is refused.
fn retryable(code: Code) -> bool {
    !matches!(code, Code::InvalidArgument | Code::FailedPrecondition | Code::OutOfRange)
}

fn log(assignment: u64, request: &CompleteRequest, verdict: Verdict) {
    let CompleteRequest { job_id: job, round, first, count, .. } = request;
    match (&request.outcome, verdict) {
        (_, Verdict::Conflict) => tracing::error!(
            assignment,
            job,
            "the coordinator has a different result for the same task: this machine or another one computes wrongly"
        ),
        (Some(Outcome::Failure(reason)), _) => tracing::error!(assignment, job, reason, "tasks failed"),
        (_, verdict) => tracing::debug!(assignment, job, round, first, count, ?verdict, "delivered"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::v1::Results;

    #[test]
    fn result_too_large_to_send_is_a_failure() {
        let request = |bytes| CompleteRequest {
            outcome: Some(Outcome::Results(Results { results: vec![vec![b' '; bytes]] })),
            ..CompleteRequest::default()
        };
        assert_eq!(too_large(&request(MAX_MESSAGE / 2)), None);
        let reason = too_large(&request(MAX_MESSAGE)).expect("it does not fit");
        assert!(reason.contains("at most 67108864"), "{reason}");
    }
}
