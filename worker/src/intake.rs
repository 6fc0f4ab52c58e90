//! Takes assignments in: opens the job if need be, checks that this worker can do them, and puts them into the queue.

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
    /// Assignments that wait until their job is opened.
    pub waiting: Vec<Assign>,
}

impl Intake {
    /// Takes work on, or says why not.
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

    /// Goes on with what waited for a job that was opened.
    pub fn opened(&mut self, id: &str, opened: Result<Arc<Bench>, String>) -> Vec<Reject> {
        let (ready, waiting): (Vec<_>, _) = std::mem::take(&mut self.waiting).into_iter().partition(|a| a.job_id == id);
        self.waiting = waiting;
        let take = |assign: Assign| match &opened {
            Ok(bench) => self.take(assign, bench.clone()),
            Err(problem) => Some(reject(assign.assignment_id, format!("this worker can't read the job: {problem}"))),
        };
        ready.into_iter().filter_map(take).collect()
    }

    /// Drops assignments that are not needed any more.
    pub fn stop(&mut self, ids: &[u64]) {
        self.waiting.retain(|assign| !ids.contains(&assign.assignment_id));
        self.assignments.stop(ids);
    }

    /// Gives up all that no slot has taken up.
    pub fn stop_waiting(&mut self) {
        self.waiting.clear();
        self.assignments.stop_waiting();
    }

    /// A heartbeat about everything that was taken in.
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
            return Err(format!("{} tasks from {first} on are no range of tasks: it has at least one", tasks.len()));
        }
        // A preparation shares nothing, and the digest of nothing is sent without bytes.
        let shared = match round == 0 || shared_digest.is_empty() {
            true => Arc::default(),
            false => self.jobs.shared(&job_id, &shared_digest).ok_or("what its tasks share was not sent")?,
        };
        let tasks = (first..).zip(tasks).collect();
        Ok(Assignment::new(assignment_id, job_id, Work { bench, round, tasks, shared, permit }))
    }
}

fn reject(assignment_id: u64, reason: String) -> Reject {
    Reject { assignment_id, reason }
}
