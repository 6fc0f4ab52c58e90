//! Assignments of this worker, from their arrival until the coordinator answers their result.

use proto::v1::{Heartbeat, RunningAssignment};
use sim_core::procedure::Bench;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;

/// Tasks of one round of a job.
pub(crate) struct Work {
    /// Job of the round.
    pub bench: Arc<Bench>,
    /// Number of the round.
    pub round: u32,
    /// Tasks with their indices in the round; at least one, without gaps.
    pub tasks: Vec<(u32, Vec<u8>)>,
    /// Bytes shared by all tasks of the round.
    pub shared: Arc<[u8]>,
    /// Proof that the coordinator assigned the tasks to this worker; sent back with the result.
    pub permit: Vec<u8>,
}

impl Work {
    /// Returns the index of the first task.
    pub fn first(&self) -> u32 {
        self.tasks.first().map_or(0, |(index, _)| *index)
    }

    /// Returns the number of tasks.
    pub fn count(&self) -> u32 {
        self.tasks.len() as u32
    }
}

/// States of an assignment. A slot changes it from `WAITING` to `COMPUTING` to `DONE`; the watchdog changes it from
/// `COMPUTING` to `ABANDONED`. An assignment gets only one of the last two.
const WAITING: u8 = 0;
const COMPUTING: u8 = 1;
const DONE: u8 = 2;
const ABANDONED: u8 = 3;

/// Assignment of tasks to one slot.
pub(crate) struct Assignment {
    pub id: u64,
    pub job_id: String,
    pub work: Work,
    stop: AtomicBool,
    stage: AtomicU8,
    progress: AtomicU64,
}

impl Assignment {
    pub fn new(id: u64, job_id: String, work: Work) -> Self {
        let (stop, stage, progress) = (AtomicBool::new(false), AtomicU8::new(WAITING), AtomicU64::new(0));
        Self { id, job_id, work, stop, stage, progress }
    }

    /// Returns true if the assignment is no longer needed.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Marks the assignment as computing. Returns false if it is no longer needed.
    pub fn start(&self) -> bool {
        !self.stopped() && self.step(WAITING, COMPUTING)
    }

    /// Marks the assignment as done. Returns false if the watchdog abandoned it before.
    pub fn finish(&self) -> bool {
        self.step(COMPUTING, DONE)
    }

    /// Abandons the assignment because its slot is stuck: its result is ignored from now on. Returns false if the slot
    /// has just finished it.
    pub fn abandon(&self) -> bool {
        let abandoned = self.step(COMPUTING, ABANDONED);
        if abandoned {
            self.stop.store(true, Ordering::Relaxed);
        }
        abandoned
    }

    /// Counts one step of progress.
    pub fn advance(&self) {
        self.progress.fetch_add(1, Ordering::Relaxed);
    }

    /// Returns the progress: 0 while the assignment waits for a slot, then a growing count.
    pub fn progress(&self) -> u64 {
        match self.stage.load(Ordering::SeqCst) {
            WAITING => 0,
            _ => 1 + self.progress.load(Ordering::Relaxed),
        }
    }

    fn step(&self, from: u8, to: u8) -> bool {
        self.stage.compare_exchange(from, to, Ordering::SeqCst, Ordering::SeqCst).is_ok()
    }

    fn is(&self, stage: u8) -> bool {
        self.stage.load(Ordering::SeqCst) == stage
    }

    fn to_wire(&self) -> RunningAssignment {
        RunningAssignment {
            assignment_id: self.id,
            job_id: self.job_id.clone(),
            round: self.work.round,
            first: self.work.first(),
            count: self.work.count(),
            permit: self.work.permit.clone(),
        }
    }
}

/// All assignments of this worker.
#[derive(Default)]
pub(crate) struct Assignments {
    all: Mutex<BTreeMap<u64, Arc<Assignment>>>,
    /// Assignments that are no longer needed but still occupy a slot.
    left: Mutex<Vec<Arc<Assignment>>>,
    /// Notifies of each removal.
    gone: Notify,
}

impl Assignments {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<u64, Arc<Assignment>>> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock_left(&self) -> MutexGuard<'_, Vec<Arc<Assignment>>> {
        self.left.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn insert(&self, assignment: Arc<Assignment>) {
        self.lock().insert(assignment.id, assignment);
    }

    /// Removes an assignment after the coordinator answered its result.
    pub fn remove(&self, id: u64) {
        self.lock().remove(&id);
        self.gone.notify_waiters();
    }

    /// Stops assignments. Slots that compute them end after the current batch of rollouts.
    pub fn stop(&self, ids: &[u64]) {
        let mut all = self.lock();
        let stopped: Vec<_> = ids.iter().filter_map(|id| all.remove(id)).collect();
        drop(all);
        stopped.iter().for_each(|a| a.stop.store(true, Ordering::Relaxed));
        self.lock_left().extend(stopped);
        self.gone.notify_waiters();
    }

    /// Stops the assignments that no slot has started.
    pub fn stop_waiting(&self) {
        let waiting: Vec<u64> = self.lock().values().filter(|a| a.is(WAITING)).map(|a| a.id).collect();
        self.stop(&waiting);
    }

    /// Stops the unfinished assignments; finished ones stay until their result is answered.
    pub fn stop_computing(&self) {
        let computing: Vec<u64> = self.lock().values().filter(|a| !a.is(DONE)).map(|a| a.id).collect();
        self.stop(&computing);
    }

    pub fn stop_all(&self) {
        let ids = self.ids();
        self.stop(&ids);
    }

    pub fn ids(&self) -> Vec<u64> {
        self.lock().keys().copied().collect()
    }

    /// Returns the assignments that slots compute.
    pub fn computing(&self) -> Vec<Arc<Assignment>> {
        self.lock().values().filter(|a| a.is(COMPUTING)).cloned().collect()
    }

    /// Returns the assignments that occupy a slot: those of `computing`, and stopped ones that are still computed.
    pub fn in_hand(&self) -> Vec<Arc<Assignment>> {
        let mut left = self.lock_left();
        left.retain(|a| a.is(COMPUTING));
        let left = left.clone();
        self.computing().into_iter().chain(left).collect()
    }

    /// Waits until there are no assignments.
    pub async fn none_left(&self) {
        loop {
            let gone = self.gone.notified();
            if self.lock().is_empty() {
                return;
            }
            gone.await;
        }
    }

    /// Returns the assignments for Hello.
    pub fn running(&self) -> Vec<RunningAssignment> {
        self.lock().values().map(|a| a.to_wire()).collect()
    }

    /// Returns a heartbeat with the assignments and their progress.
    pub fn heartbeat(&self) -> Heartbeat {
        let (running, progress) = self.lock().values().map(|a| (a.id, a.progress())).unzip();
        Heartbeat { running, progress }
    }
}
