//! What this worker is working on, from the moment it is assigned until its result is answered.

use proto::v1::RunningAssignment;
use sim_core::finish::Examination;
use sim_core::job::Job;
use sim_core::score::Genome;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What is to be done.
#[derive(Debug)]
pub(crate) enum Task {
    /// Score candidates: (index in the generation, genome).
    Evaluate { generation: u32, first: u32, candidates: Vec<(u32, Genome)> },
    /// Answer a question about a candidate.
    Examine { round: u32, index: u32, examination: Examination },
}

/// Work for one slot.
#[derive(Debug)]
pub(crate) struct Assignment {
    pub id: u64,
    pub job_id: String,
    pub job: Arc<Job>,
    pub task: Task,
    stop: AtomicBool,
}

impl Assignment {
    pub fn new(id: u64, job_id: String, job: Arc<Job>, task: Task) -> Self {
        Self { id, job_id, job, task, stop: AtomicBool::new(false) }
    }

    /// Whether nobody needs it any more.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn to_wire(&self) -> RunningAssignment {
        let (generation, first, count) = match &self.task {
            Task::Evaluate { generation, first, candidates } => (*generation, *first, candidates.len() as u32),
            Task::Examine { round, index, .. } => (*round, *index, 1),
        };
        RunningAssignment { assignment_id: self.id, job_id: self.job_id.clone(), generation, first, count }
    }
}

/// All of them.
#[derive(Debug, Default)]
pub(crate) struct Assignments(Mutex<BTreeMap<u64, Arc<Assignment>>>);

impl Assignments {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<u64, Arc<Assignment>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn insert(&self, assignment: Arc<Assignment>) {
        self.lock().insert(assignment.id, assignment);
    }

    /// Its result was answered, or nobody needs it.
    pub fn remove(&self, id: u64) {
        self.lock().remove(&id);
    }

    /// Gives work up. What is computing ends within a moment.
    pub fn stop(&self, ids: &[u64]) {
        let mut all = self.lock();
        for id in ids {
            if let Some(assignment) = all.remove(id) {
                assignment.stop.store(true, Ordering::Relaxed);
            }
        }
    }

    pub fn stop_all(&self) {
        let ids = self.ids();
        self.stop(&ids);
    }

    pub fn ids(&self) -> Vec<u64> {
        self.lock().keys().copied().collect()
    }

    /// As Hello tells them.
    pub fn running(&self) -> Vec<RunningAssignment> {
        self.lock().values().map(|a| a.to_wire()).collect()
    }
}
