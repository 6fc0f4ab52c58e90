//! One assignment, carried out on the thread that calls.

use crate::assignments::{Assignment, Task};
use proto::v1::complete_request::Result as Outcome;
use proto::v1::{CompleteRequest, EvaluateResult};
use sim_core::evaluate::{Stopped, evaluate};
use sim_core::report::report;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

/// What came of it, ready to be sent; `None` if it was stopped. A panic is a result like any other: it says that this
/// work can't be done, and the worker lives on.
pub(crate) fn carry_out(assignment: &Assignment) -> Option<CompleteRequest> {
    let start = Instant::now();
    let outcome = match catch_unwind(AssertUnwindSafe(|| compute(assignment))) {
        Ok(Ok(outcome)) => outcome,
        Ok(Err(Stopped)) => return None,
        Err(panic) => Outcome::Failure(format!("it panicked: {}", message(&*panic))),
    };
    let compute_us = u64::try_from(start.elapsed().as_micros()).unwrap_or(u64::MAX);
    Some(CompleteRequest {
        // The courier knows it.
        worker_id: String::new(),
        assignment_id: assignment.id,
        job_id: assignment.job_id.clone(),
        engine_digest: assignment.job.engine_digest().0.to_vec(),
        result: Some(outcome),
        compute_us,
    })
}

fn compute(assignment: &Assignment) -> Result<Outcome, Stopped> {
    let stop = || assignment.stopped();
    match &assignment.task {
        Task::Evaluate { generation, first, candidates } => {
            let evaluations = evaluate(&assignment.job, *generation, candidates, &stop)?;
            Ok(Outcome::Evaluate(EvaluateResult {
                generation: *generation,
                first: *first,
                evaluations: evaluations.iter().map(Into::into).collect(),
            }))
        }
        Task::Report { winner, first } => {
            let report = report(&assignment.job, winner, first, &stop)?;
            Ok(match serde_json::to_vec(&report) {
                Ok(json) => Outcome::ReportJson(json),
                Err(error) => Outcome::Failure(format!("the report can't be written as JSON: {error}")),
            })
        }
    }
}

fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message")
}
