//! Acceptance of assignments: opens the job if necessary, checks that this worker can compute the tasks, and puts the
//! assignment into the queue.

use crate::assignments::{Assignment, Assignments, Work};
use crate::engines::Engines;
use crate::jobs::{Forgotten, Jobs};
use crate::slots::Slots;
use proto::v1::{Assign, Heartbeat, Reject};
use sim_core::procedure::Bench;
use std::sync::Arc;

pub(crate) struct Intake {
    pub engines: Arc<Engines>,
    pub assignments: Arc<Assignments>,
    pub queue: Slots,
    pub jobs: Jobs,
    /// Assignments that wait until their job is open.
    pub waiting: Vec<Assign>,
}

impl Intake {
    /// Queues an assignment, or returns the reason for its rejection.
    pub fn assigned(&mut self, mut assign: Assign) -> Result<Option<Reject>, Forgotten> {
        self.jobs.receive(&mut assign)?;
        match self.jobs.get(&assign.job_id) {
            Some(bench) => Ok(self.take(assign, bench)),
            None => {
                self.waiting.push(assign);
                Ok(None)
            }
        }
    }

    /// Queues the assignments that waited for this job, or rejects them if it can't be opened.
    pub fn opened(&mut self, id: &str, opened: Result<Arc<Bench>, String>) -> Vec<Reject> {
        let (ready, waiting): (Vec<_>, _) = std::mem::take(&mut self.waiting).into_iter().partition(|a| a.job_id == id);
        self.waiting = waiting;
        let take = |assign: Assign| match &opened {
            Ok(bench) => self.take(assign, bench.clone()),
            Err(problem) => Some(reject(assign.assignment_id, format!("this worker can't open the job: {problem}"))),
        };
        ready.into_iter().filter_map(take).collect()
    }

    /// Stops assignments that are not needed any more.
    pub fn stop(&mut self, ids: &[u64]) {
        self.waiting.retain(|assign| !ids.contains(&assign.assignment_id));
        self.assignments.stop(ids);
    }

    /// Stops all assignments that no slot has started.
    pub fn stop_waiting(&mut self) {
        self.waiting.clear();
        self.assignments.stop_waiting();
    }

    /// Returns a heartbeat with all accepted assignments.
    pub fn heartbeat(&self) -> Heartbeat {
        let mut heartbeat = self.assignments.heartbeat();
        heartbeat.running.extend(self.waiting.iter().map(|assign| assign.assignment_id));
        heartbeat.progress.resize(heartbeat.running.len(), 0);
        heartbeat
    }

    fn take(&self, assign: Assign, bench: Arc<Bench>) -> Option<Reject> {
        let id = assign.assignment_id;
        match self.assignment(assign, bench) {
            Ok(assignment) => {
                let assignment = Arc::new(assignment);
                self.assignments.insert(assignment.clone());
                self.queue.push(assignment);
                None
            }
            Err(reason) => Some(reject(id, reason)),
        }
    }

    fn assignment(&self, assign: Assign, bench: Arc<Bench>) -> Result<Assignment, String> {
        let Assign { assignment_id, job_id, round, first, tasks, shared_digest, permit, .. } = assign;
        if !self.engines.has(&bench.engine_digest()) {
            return Err(format!("this worker has no engine {}", bench.engine_digest().short()));
        }
        let count = u32::try_from(tasks.len()).ok().filter(|count| *count > 0);
        if count.and_then(|count| first.checked_add(count)).is_none() {
            return Err(format!(
                "invalid range of {} tasks from index {first} on: at least one task, and indices below 2^32, are allowed",
                tasks.len()
            ));
        }
        // A preparation shares no bytes, and an empty digest means that no bytes are shared.
        let shared = match round == 0 || shared_digest.is_empty() {
            true => Arc::default(),
            false => self
                .jobs
                .shared(&job_id, &shared_digest)
                .ok_or("the coordinator did not send the bytes that the tasks of the round share")?,
        };
        let tasks = (first..).zip(tasks).collect();
        Ok(Assignment::new(assignment_id, job_id, Work { bench, round, tasks, shared, permit }))
    }
}

fn reject(assignment_id: u64, reason: String) -> Reject {
    Reject { assignment_id, reason }
}
