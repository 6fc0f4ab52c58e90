//! Assignments of this worker, from their arrival until their result is answered.

use proto::v1::{Heartbeat, RunningAssignment};
use sim_core::procedure::Bench;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;

/// Tasks of one round of a job.
pub(crate) struct Work {
    /// The job.
    pub bench: Arc<Bench>,
    /// The round's number.
    pub round: u32,
    /// The tasks, each with its index in the round; at least one, without gaps.
    pub tasks: Vec<(u32, Vec<u8>)>,
    /// Bytes that all tasks of the round share.
    pub shared: Arc<[u8]>,
    /// Shows that the tasks were assigned to this worker: goes back with the result.
    pub permit: Vec<u8>,
}

impl Work {
    /// Index of the first task.
    pub fn first(&self) -> u32 {
        self.tasks.first().map_or(0, |(index, _)| *index)
    }

    /// Number of tasks.
    pub fn count(&self) -> u32 {
        self.tasks.len() as u32
    }
}

/// State of an assignment. A slot takes it from `WAITING` to `COMPUTING` and to `DONE`; the watchdog takes it from
/// `COMPUTING` to `ABANDONED`. Only one of the last two ever happens.
const WAITING: u8 = 0;
const COMPUTING: u8 = 1;
const DONE: u8 = 2;
const ABANDONED: u8 = 3;

/// Work for one slot.
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

    /// Returns true if it is no longer needed.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Marks it as computing. Returns false if it is no longer needed.
    pub fn start(&self) -> bool {
        !self.stopped() && self.step(WAITING, COMPUTING)
    }

    /// Its slot is done with it. `false` if the slot took so long that it was given up.
    pub fn finish(&self) -> bool {
        self.step(COMPUTING, DONE)
    }

    /// Gives it up because its slot is stuck: its result is ignored from now on. Returns false if it has just been
    /// finished.
    pub fn abandon(&self) -> bool {
        let abandoned = self.step(COMPUTING, ABANDONED);
        if abandoned {
            self.stop.store(true, Ordering::Relaxed);
        }
        abandoned
    }

    /// A sign that its slot gets on.
    pub fn advance(&self) {
        self.progress.fetch_add(1, Ordering::Relaxed);
    }

    /// Returns its progress: 0 while it waits for a slot, then a growing count.
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

/// All of them.
#[derive(Default)]
pub(crate) struct Assignments {
    all: Mutex<BTreeMap<u64, Arc<Assignment>>>,
    /// Assignments that are no longer needed but still run on a slot.
    left: Mutex<Vec<Arc<Assignment>>>,
    /// One of them went.
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

    /// Removes it after its result was answered, or when it is no longer needed.
    pub fn remove(&self, id: u64) {
        self.lock().remove(&id);
        self.gone.notify_waiters();
    }

    /// Gives work up. What is computing ends within a moment.
    pub fn stop(&self, ids: &[u64]) {
        let mut all = self.lock();
        let stopped: Vec<_> = ids.iter().filter_map(|id| all.remove(id)).collect();
        drop(all);
        stopped.iter().for_each(|a| a.stop.store(true, Ordering::Relaxed));
        self.lock_left().extend(stopped);
        self.gone.notify_waiters();
    }

    /// Gives up what no slot has taken up.
    pub fn stop_waiting(&self) {
        let waiting: Vec<u64> = self.lock().values().filter(|a| a.is(WAITING)).map(|a| a.id).collect();
        self.stop(&waiting);
    }

    /// Gives up what slots work on; what is done stays until it is answered.
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

    /// Those that a slot works on.
    pub fn computing(&self) -> Vec<Arc<Assignment>> {
        self.lock().values().filter(|a| a.is(COMPUTING)).cloned().collect()
    }

    /// The same with those that a slot should have dropped by now.
    pub fn in_hand(&self) -> Vec<Arc<Assignment>> {
        let mut left = self.lock_left();
        left.retain(|a| a.is(COMPUTING));
        let left = left.clone();
        self.computing().into_iter().chain(left).collect()
    }

    /// Waits until there are none.
    pub async fn none_left(&self) {
        loop {
            let gone = self.gone.notified();
            if self.lock().is_empty() {
                return;
            }
            gone.await;
        }
    }

    /// As Hello tells them.
    pub fn running(&self) -> Vec<RunningAssignment> {
        self.lock().values().map(|a| a.to_wire()).collect()
    }

    /// As a heartbeat tells them.
    pub fn heartbeat(&self) -> Heartbeat {
        let (running, progress) = self.lock().values().map(|a| (a.id, a.progress())).unzip();
        Heartbeat { running, progress }
    }
}
