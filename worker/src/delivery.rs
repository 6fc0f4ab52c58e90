//! Results are brought home whatever happens: each is sent until the coordinator answers, over its restarts.

use crate::assignments::Assignments;
use crate::backoff::Backoff;
use crate::metrics::Metrics;
use proto::dial::Way;
use proto::limits::MAX_MESSAGE;
use proto::v1::complete_request::Result as Outcome;
use proto::v1::complete_response::Verdict;
use proto::v1::worker_service_client::WorkerServiceClient;
use proto::v1::{CompleteRequest, EvaluateResult};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc::UnboundedReceiver;
use tokio::task::JoinSet;
use tonic::Code;

/// An answer takes a commit; longer than this and it is lost.
const ANSWER_WITHIN: Duration = Duration::from_secs(30);

/// Delivers results.
#[derive(Clone)]
pub(crate) struct Courier {
    client: WorkerServiceClient<Way>,
    worker_id: String,
    assignments: Arc<Assignments>,
    metrics: Arc<Metrics>,
}

impl Courier {
    pub fn new(way: Way, worker_id: String, assignments: Arc<Assignments>, metrics: Arc<Metrics>) -> Self {
        let client =
            WorkerServiceClient::new(way).max_decoding_message_size(MAX_MESSAGE).max_encoding_message_size(MAX_MESSAGE);
        Self { client, worker_id, assignments, metrics }
    }

    /// Delivers all that comes, until the slots have ended and everything is answered.
    pub async fn run(self, mut finished: UnboundedReceiver<CompleteRequest>) {
        let mut under_way = JoinSet::new();
        loop {
            tokio::select! {
                result = finished.recv() => match result {
                    Some(result) => {
                        self.metrics.worked(&result);
                        under_way.spawn(self.clone().deliver(result));
                    }
                    None => break,
                },
                Some(_) = under_way.join_next() => {}
            }
        }
        while under_way.join_next().await.is_some() {}
    }

    /// Delivers one result.
    pub async fn deliver(mut self, mut result: CompleteRequest) {
        result.worker_id = self.worker_id.clone();
        let id = result.assignment_id;
        let mut backoff = Backoff::new();
        loop {
            let mut request = tonic::Request::new(result.clone());
            request.set_timeout(ANSWER_WITHIN);
            match self.client.complete(request).await {
                Ok(answer) => {
                    let verdict = answer.into_inner().verdict();
                    self.metrics.result(verdict);
                    log(id, &result, verdict);
                    break;
                }
                Err(status) if retryable(status.code()) => {
                    self.metrics.retries.inc();
                    tracing::debug!(assignment = id, job = result.job_id, %status, "delivered later");
                    backoff.wait().await;
                }
                // The coordinator will never take this one: it has to know, or it would wait for it.
                Err(status) if !matches!(result.result, Some(Outcome::Failure(_))) => {
                    let reason = format!("the coordinator refuses the result: {}", status.message());
                    tracing::error!(assignment = id, reason);
                    result.result = Some(Outcome::Failure(reason));
                }
                Err(status) => {
                    tracing::error!(assignment = id, %status, "the coordinator refuses to hear of a failure");
                    break;
                }
            }
        }
        self.assignments.remove(id);
    }
}

/// Whether the same request may be answered another time.
fn retryable(code: Code) -> bool {
    !matches!(
        code,
        Code::InvalidArgument
            | Code::FailedPrecondition
            | Code::OutOfRange
            | Code::Unimplemented
            | Code::PermissionDenied
            | Code::Unauthenticated
    )
}

fn log(assignment: u64, result: &CompleteRequest, verdict: Verdict) {
    match (&result.result, verdict) {
        (_, Verdict::Conflict) => tracing::error!(
            assignment,
            job = result.job_id,
            "the coordinator has another result for the same work: this machine or another one computes wrongly"
        ),
        (Some(Outcome::Failure(reason)), _) => tracing::error!(assignment, job = result.job_id, reason, "work failed"),
        (Some(Outcome::Evaluate(EvaluateResult { generation, first, evaluations })), verdict) => {
            let (job, count) = (&result.job_id, evaluations.len());
            tracing::debug!(assignment, job, generation, first, count, ?verdict, "delivered");
        }
        (_, verdict) => tracing::debug!(assignment, job = result.job_id, ?verdict, "delivered"),
    }
}
