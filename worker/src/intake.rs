//! Takes assignments in: reads the job if need be, checks that this worker can do them, and puts them into the queue.

use crate::assignments::{Assignment, Assignments, Task};
use crate::delivery::Courier;
use crate::engines::Engines;
use crate::jobs::Jobs;
use crate::slots::Slots;
use proto::ConvertError;
use proto::v1::{Assign, CompleteRequest, Heartbeat, Reject, assign, complete_request};
use sim_core::problem::Job;
use std::sync::Arc;

/// A job was told before and is not known any more. Connecting again brings it.
pub(crate) struct Forgotten;

pub(crate) struct Intake {
    pub engines: Arc<Engines>,
    pub assignments: Arc<Assignments>,
    pub queue: Slots,
    pub courier: Courier,
    pub jobs: Jobs,
    /// Those whose job is being read.
    pub waiting: Vec<Assign>,
}

impl Intake {
    /// Takes work on, or says why not.
    pub fn assigned(&mut self, assign: Assign) -> Result<Option<Reject>, Forgotten> {
        if let Some(job) = self.jobs.get(&assign.job_id) {
            return Ok(self.take(assign, job));
        }
        if !self.jobs.is_read(&assign.job_id) {
            if assign.job_toml.is_empty() {
                return Err(Forgotten);
            }
            self.jobs.read(assign.job_id.clone(), assign.job_toml.clone());
        }
        self.waiting.push(assign);
        Ok(None)
    }

    /// Goes on with what waited for a job that was read.
    pub fn read(&mut self, id: &str, read: Result<Arc<Job>, String>) -> Vec<Reject> {
        let (ready, waiting) = std::mem::take(&mut self.waiting).into_iter().partition(|a| a.job_id == id);
        self.waiting = waiting;
        let ready: Vec<Assign> = ready;
        let take = |assign: Assign| match &read {
            Ok(job) => self.take(assign, job.clone()),
            Err(problem) => Some(reject(assign.assignment_id, format!("this worker can't read the job: {problem}"))),
        };
        ready.into_iter().filter_map(take).collect()
    }

    /// Nobody needs these any more.
    pub fn stop(&mut self, ids: &[u64]) {
        self.waiting.retain(|assign| !ids.contains(&assign.assignment_id));
        self.assignments.stop(ids);
    }

    /// Gives up all that no slot has taken up.
    pub fn stop_waiting(&mut self) {
        self.waiting.clear();
        self.assignments.stop_waiting();
    }

    /// What there is to be told of everything that was taken in.
    pub fn heartbeat(&self) -> Heartbeat {
        let mut heartbeat = self.assignments.heartbeat();
        heartbeat.running.extend(self.waiting.iter().map(|assign| assign.assignment_id));
        heartbeat.progress.resize(heartbeat.running.len(), 0);
        heartbeat
    }

    fn take(&self, assign: Assign, job: Arc<Job>) -> Option<Reject> {
        let Assign { assignment_id: id, job_id, task, .. } = assign;
        if !self.engines.has(&job.engine_digest()) {
            return Some(reject(id, format!("this worker has no engine {}", job.engine_digest().short())));
        }
        let task = match task_of(task) {
            Ok(task) => task,
            Err(problem) => return Some(reject(id, problem.to_string())),
        };
        // A genome that does not fit would be a panic later on.
        let parameters = job.bounds().0.len();
        let fits = match &task {
            Task::Evaluate { candidates, .. } => candidates.iter().all(|(_, genome)| genome.len() == parameters),
            Task::Examine { examination, .. } => examination.candidate.genome.len() == parameters,
        };
        if !fits {
            let result = Some(complete_request::Result::Failure(format!(
                "its genomes do not have the {parameters} parameters that the job asks for"
            )));
            let engine_digest = job.engine_digest().0.to_vec();
            let failure =
                CompleteRequest { assignment_id: id, job_id, engine_digest, result, ..CompleteRequest::default() };
            tokio::spawn(self.courier.clone().deliver(failure));
            return None;
        }
        let assignment = Arc::new(Assignment::new(id, job_id, job, task));
        self.assignments.insert(assignment.clone());
        self.queue.push(assignment);
        None
    }
}

fn reject(assignment_id: u64, reason: String) -> Reject {
    Reject { assignment_id, reason }
}

fn task_of(task: Option<assign::Task>) -> Result<Task, ConvertError> {
    match task.ok_or(ConvertError::Missing { field: "task" })? {
        assign::Task::Evaluate(evaluate) => {
            proto::range_length(evaluate.first, evaluate.genomes.len())?;
            let candidates = (evaluate.first..).zip(evaluate.genomes.into_iter().map(|g| g.values)).collect();
            Ok(Task::Evaluate { generation: evaluate.generation, first: evaluate.first, candidates })
        }
        assign::Task::Examine(task) => {
            let (round, index) = (task.round, task.index);
            Ok(Task::Examine { round, index, examination: proto::examination(task)? })
        }
    }
}
