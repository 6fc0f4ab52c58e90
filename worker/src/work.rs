//! Computation of one assignment on the calling thread.

use crate::assignments::Assignment;
#[cfg(any(debug_assertions, feature = "faults"))]
use crate::fault;
use proto::v1::Results;
use proto::v1::complete_request::Outcome;
use sim_core::procedure::{Hooks, NotRun};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// An assignment with its outcome.
pub(crate) struct Finished {
    pub assignment: Arc<Assignment>,
    pub outcome: Outcome,
    /// Time that the assignment occupied its slot, µs.
    pub compute_us: u64,
}

/// Computes the tasks; returns `None` if they were stopped. A panic is a failure of these tasks and does not end the
/// worker.
pub(crate) fn carry_out(assignment: &Arc<Assignment>) -> Option<Finished> {
    let start = Instant::now();
    let outcome = match catch_unwind(AssertUnwindSafe(|| compute(assignment))) {
        Ok(Ok(results)) => Outcome::Results(Results { results }),
        Ok(Err(NotRun::Stopped)) => return None,
        Ok(Err(error @ NotRun::Task(_))) => Outcome::Failure(error.to_string()),
        Err(panic) => Outcome::Failure(format!("it panicked: {}", message(&*panic))),
    };
    let compute_us = u64::try_from(start.elapsed().as_micros()).unwrap_or(u64::MAX);
    Some(Finished { assignment: assignment.clone(), outcome, compute_us })
}

/// Returns the failure of an assignment on a stuck slot.
pub(crate) fn gave_up(assignment: &Arc<Assignment>, stuck_after: Duration) -> Finished {
    let reason = format!("it was stuck: no batch of rollouts was finished within {} s", stuck_after.as_secs_f64());
    Finished { assignment: assignment.clone(), outcome: Outcome::Failure(reason), compute_us: 0 }
}

/// Stop flag and progress counter for the procedure.
impl Hooks for Assignment {
    fn stop(&self) -> bool {
        self.advance();
        self.stopped()
    }
}

fn compute(assignment: &Assignment) -> Result<Vec<Vec<u8>>, NotRun> {
    let work = &assignment.work;
    #[cfg(any(debug_assertions, feature = "faults"))]
    fault::strike(work, assignment)?;
    let results = work.bench.run(work.round, &work.shared, &work.tasks, assignment)?;
    #[cfg(any(debug_assertions, feature = "faults"))]
    let results = fault::falsified(work, results);
    Ok(results)
}

fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assignments::Work;
    use sim_core::problem::Checked;
    use sim_core::procedure::{self, Bench, Procedure};

    const JOB: &str = "name = \"t\"\nrobot = \"quadropod\"\nenvironment = \"empty\"\n[gaits]\ncount = 1\nduration = 1.0\n\
                       [planner]\niterations = 2\n[fitness]\nkind = \"coverage\"\n[optimiser]\nkind = \"pso\"\n\
                       particles = 3\n[finish]\nkind = \"none\"\n";

    /// Returns an assignment of some tasks of the current round.
    fn assignment(procedure: &dyn Procedure, tasks: std::ops::Range<u32>) -> Arc<Assignment> {
        let round = procedure.round();
        let tasks = tasks.map(|index| (index, procedure.task(index))).collect();
        assigned(JOB, round.number, tasks, round.shared)
    }

    fn assigned(job: &str, round: u32, tasks: Vec<(u32, Vec<u8>)>, shared: Arc<[u8]>) -> Arc<Assignment> {
        let bench = Arc::new(Bench::open(job).expect("a valid job"));
        let work = Work { bench, round, tasks, shared, permit: Vec::new() };
        Arc::new(Assignment::new(7, "j".to_owned(), work))
    }

    fn start() -> Box<dyn Procedure> {
        procedure::start(&Checked::from_toml(JOB).expect("a valid job")).expect("it can start")
    }

    fn results(assignment: &Arc<Assignment>) -> Vec<Arc<[u8]>> {
        let finished = carry_out(assignment).expect("it was not stopped");
        assert!(finished.compute_us > 0);
        match finished.outcome {
            Outcome::Results(done) => done.results.into_iter().map(Into::into).collect(),
            Outcome::Failure(reason) => panic!("{reason}"),
        }
    }

    #[test]
    fn results_come_in_order_of_their_tasks() {
        let mut procedure = start();
        let prepared = results(&assignment(&*procedure, 0..1));
        procedure.check(0, &prepared[0]).expect("a preparation");
        procedure.tell(&prepared);
        let both = results(&assignment(&*procedure, 1..3));
        let each: Vec<_> = (1..3).flat_map(|index| results(&assignment(&*procedure, index..index + 1))).collect();
        assert_eq!(both, each);
        assert_ne!(both[0], both[1]);
        for (index, result) in (1..).zip(&both) {
            procedure.check(index, result).expect("the result of its task");
        }
    }

    #[test]
    fn stopped_preparation_ends_within_a_second() {
        // Settling takes minutes with such a small step size.
        let job = format!("{JOB}[physics]\nengine = \"rapier\"\nsteps_per_second = 10000\n");
        let assignment = assigned(&job, 0, vec![(0, start().task(0))], Arc::default());
        let assignments = crate::assignments::Assignments::default();
        assignments.insert(assignment.clone());
        assert!(assignment.start());
        let slot = std::thread::spawn({
            let assignment = assignment.clone();
            move || carry_out(&assignment).is_none()
        });
        while assignment.progress() < 10 {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(!slot.is_finished());
        assignments.stop_all();
        let stopped = Instant::now();
        assert!(slot.join().expect("it does not panic"));
        assert!(stopped.elapsed() < Duration::from_secs(1), "it took {:?}", stopped.elapsed());
    }

    #[test]
    fn undecodable_task_is_a_failure() {
        let mut procedure = start();
        let prepared = results(&assignment(&*procedure, 0..1));
        procedure.tell(&prepared);
        let shared = procedure.round().shared;
        let finished = carry_out(&assigned(JOB, 1, vec![(0, vec![255; 9])], shared)).expect("it was not stopped");
        let Outcome::Failure(reason) = finished.outcome else { panic!("the task was computed") };
        assert!(reason.len() > 20, "{reason}");
    }
}
