//! One assignment, carried out on the thread that calls.

use crate::assignments::{Assignment, Task};
#[cfg(any(debug_assertions, feature = "faults"))]
use crate::fault;
use proto::v1::complete_request::Result as Outcome;
use proto::v1::{CompleteRequest, EvaluateResult, ExamineResult};
use sim_core::evaluate::{Stopped, evaluate};
use sim_core::procedure::evolve::finish::{Answer, examine};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

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
    Some(CompleteRequest { compute_us, ..result(assignment, outcome) })
}

/// What is said of work whose slot makes no progress.
pub(crate) fn gave_up(assignment: &Assignment, stuck_after: Duration) -> CompleteRequest {
    let reason = format!("it was stuck: no batch of rollouts came to its end within {} s", stuck_after.as_secs_f64());
    result(assignment, Outcome::Failure(reason))
}

fn result(assignment: &Assignment, outcome: Outcome) -> CompleteRequest {
    CompleteRequest {
        // The courier knows it.
        worker_id: String::new(),
        assignment_id: assignment.id,
        job_id: assignment.job_id.clone(),
        engine_digest: assignment.job.engine_digest().0.to_vec(),
        result: Some(outcome),
        compute_us: 0,
    }
}

fn compute(assignment: &Assignment) -> Result<Outcome, Stopped> {
    // Asked before every batch of rollouts, so it counts them, too.
    let stop = || {
        assignment.advance();
        assignment.stopped()
    };
    #[cfg(any(debug_assertions, feature = "faults"))]
    fault::strike(&assignment.task, &stop)?;
    match &assignment.task {
        Task::Evaluate { generation, first, candidates } => {
            let evaluations = evaluate(&assignment.job, *generation, candidates, &stop)?;
            #[cfg(any(debug_assertions, feature = "faults"))]
            let evaluations = fault::falsified(*generation, evaluations);
            Ok(Outcome::Evaluate(EvaluateResult {
                generation: *generation,
                first: *first,
                evaluations: evaluations.iter().map(Into::into).collect(),
            }))
        }
        Task::Examine { round, index, examination } => {
            let Answer { scores, counts, traces } = examine(&assignment.job, examination, &stop)?;
            let traces_json = match traces.as_ref().map(serde_json::to_vec).transpose() {
                Ok(json) => json.unwrap_or_default(),
                Err(error) => return Ok(Outcome::Failure(format!("the traces can't be written as JSON: {error}"))),
            };
            let (round, index, scores) = (*round, *index, proto::scores(&scores));
            Ok(Outcome::Examine(ExamineResult { round, index, scores, counts: Some(counts.into()), traces_json }))
        }
    }
}

fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message")
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::problem::Job;
    use sim_core::procedure::evolve::finish::{Examination, Question};
    use sim_core::search::Scored;
    use std::sync::Arc;

    fn assignment(candidates: Vec<(u32, Vec<f64>)>) -> Assignment {
        assigned(Task::Evaluate { generation: 0, first: 3, candidates })
    }

    fn assigned(task: Task) -> Assignment {
        let text = "name = \"t\"\nrobot = \"quadropod\"\nenvironment = \"empty\"\n[gaits]\ncount = 1\nduration = 1.0\n\
                    [planner]\niterations = 2\n[fitness]\nkind = \"coverage\"\n[optimiser]\nkind = \"pso\"\n[finish]\nseeds = 2\n";
        let job = Arc::new(Job::from_toml(text).expect("a valid job"));
        Assignment::new(7, "j".to_owned(), job, task)
    }

    #[test]
    fn evaluations_come_back_in_order_with_the_time_they_took() {
        let genomes = assignment(Vec::new()).job.optimiser().ask();
        let candidates = (3..).zip(genomes.into_iter().skip(3).take(2)).collect();
        let done = carry_out(&assignment(candidates)).expect("nobody stopped it");
        let Some(Outcome::Evaluate(result)) = done.result else { panic!("{:?}", done.result) };
        assert_eq!((result.first, result.evaluations.len(), done.assignment_id), (3, 2, 7));
        assert!(done.compute_us > 0);
    }

    #[test]
    fn an_examination_brings_a_score_a_tree_and_traces_where_they_are_asked_for() {
        let genome = assignment(Vec::new()).job.optimiser().ask().remove(0);
        let candidate = Scored { generation: 0, candidate: 0, score: 1.0, genome };
        for (question, scores) in [(Question::Reference, 2), (Question::WithoutReuse, 1), (Question::Traces, 0)] {
            let examination = Examination::new(question, &candidate);
            let done = carry_out(&assigned(Task::Examine { round: 9, index: 4, examination })).expect("not stopped");
            let Some(Outcome::Examine(result)) = done.result else { panic!("{:?}", done.result) };
            assert_eq!((result.round, result.index, result.scores.len()), (9, 4, scores));
            assert_eq!(result.traces_json.is_empty(), question != Question::Traces);
        }
    }

    #[test]
    fn a_panic_is_a_failure_with_its_message_not_the_end_of_the_worker() {
        let done = carry_out(&assignment(vec![(3, vec![0.0])])).expect("nobody stopped it");
        let Some(Outcome::Failure(reason)) = done.result else { panic!("{:?}", done.result) };
        assert!(reason.starts_with("it panicked: ") && reason.len() > 20, "{reason}");
    }
}
