//! Computing threads, one per slot. They end when the queue is closed.

use crate::assignments::Assignment;
use crate::work::{Finished, carry_out, gave_up};
use std::io;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::mpsc::UnboundedSender;

/// Sender to the queue of the slots.
#[derive(Clone)]
pub(crate) struct Slots {
    queue: Sender<Arc<Assignment>>,
    shared: Arc<Shared>,
}

struct Shared {
    queue: Mutex<Receiver<Arc<Assignment>>>,
    done: UnboundedSender<Finished>,
    /// Number of threads started so far.
    started: AtomicUsize,
    /// Number of abandoned threads that have not ended yet.
    stuck: AtomicUsize,
}

impl Slots {
    /// Starts the threads. They send every outcome to `done`.
    pub fn start(slots: usize, done: UnboundedSender<Finished>) -> io::Result<Self> {
        let (queue, receiver) = channel();
        let (started, stuck) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let shared = Arc::new(Shared { queue: Mutex::new(receiver), done, started, stuck });
        let slots = (0..slots).try_for_each(|_| Shared::spawn(&shared));
        slots.map(|()| Self { queue, shared })
    }

    pub fn push(&self, assignment: Arc<Assignment>) {
        // Can't fail: the threads run until all senders are dropped.
        let _ = self.queue.send(assignment);
    }

    /// Abandons a stuck slot: its tasks fail, if they are still needed, and a new thread replaces the slot. The old
    /// thread can't be ended from outside; if it continues, it ends itself. Returns the number of stuck threads.
    pub fn replace(&self, assignment: &Arc<Assignment>, stuck_after: Duration) -> usize {
        let needed = !assignment.stopped();
        if assignment.abandon() {
            self.shared.stuck.fetch_add(1, Ordering::SeqCst);
            if needed {
                // If the receiver is gone, the worker is ending.
                let _ = self.shared.done.send(gave_up(assignment, stuck_after));
            }
            if let Err(error) = Shared::spawn(&self.shared) {
                tracing::error!(%error, "can't start a thread for a new slot: this worker has one slot less");
            }
        }
        self.shared.stuck.load(Ordering::SeqCst)
    }
}

impl Shared {
    fn spawn(shared: &Arc<Self>) -> io::Result<()> {
        let (slot, own) = (shared.started.fetch_add(1, Ordering::SeqCst), shared.clone());
        std::thread::Builder::new().name(format!("slot-{slot}")).spawn(move || own.work_off())?;
        Ok(())
    }

    fn work_off(&self) {
        loop {
            let next = self.queue.lock().unwrap_or_else(PoisonError::into_inner).recv();
            let Ok(assignment) = next else { return };
            if !assignment.start() {
                continue;
            }
            let finished = carry_out(&assignment);
            if !assignment.finish() {
                self.stuck.fetch_sub(1, Ordering::SeqCst);
                return;
            }
            if let Some(finished) = finished
                && self.done.send(finished).is_err()
            {
                return;
            }
        }
    }
}
