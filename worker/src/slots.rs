//! The threads that compute: one a slot. They end when the queue does.

use crate::assignments::Assignment;
use crate::work::carry_out;
use proto::v1::CompleteRequest;
use std::io;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::mpsc::UnboundedSender;

/// The way into the queue of the slots.
#[derive(Clone)]
pub(crate) struct Slots(Sender<Arc<Assignment>>);

impl Slots {
    /// Starts the threads. `done` gets every result; it is closed once the last thread has ended.
    pub fn start(slots: usize, done: UnboundedSender<CompleteRequest>) -> io::Result<Self> {
        let (sender, receiver) = channel();
        let receiver = Arc::new(Mutex::new(receiver));
        for slot in 0..slots {
            let (receiver, done) = (receiver.clone(), done.clone());
            std::thread::Builder::new().name(format!("slot-{slot}")).spawn(move || work_off(&receiver, &done))?;
        }
        Ok(Self(sender))
    }

    pub fn push(&self, assignment: Arc<Assignment>) {
        // The threads outlive every sender: they end when there is none.
        let _ = self.0.send(assignment);
    }
}

fn work_off(queue: &Mutex<Receiver<Arc<Assignment>>>, done: &UnboundedSender<CompleteRequest>) {
    loop {
        let next = queue.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(assignment) = next else { return };
        if assignment.stopped() {
            continue;
        }
        if let Some(result) = carry_out(&assignment)
            && done.send(result).is_err()
        {
            return;
        }
    }
}
