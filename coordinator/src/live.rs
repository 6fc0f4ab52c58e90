//! Live events for watchers. Each job has its own channel, so the cost of an event depends only on the number of
//! watchers of its job.

use crate::limits::LIVE_EVENTS;
use crate::record::JobId;
use proto::v1::JobEvent;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::broadcast::{Receiver, Sender, channel};

type Channels = HashMap<JobId, Sender<Arc<JobEvent>>>;

/// Channels of the watched jobs.
#[derive(Clone, Debug, Default)]
pub(crate) struct Live(Arc<Mutex<Channels>>);

impl Live {
    /// Subscribes to the events of a job from now on. Call [`Live::forget`] after dropping the receiver.
    pub fn subscribe(&self, id: &JobId) -> Receiver<Arc<JobEvent>> {
        self.lock().entry(id.clone()).or_insert_with(|| channel(LIVE_EVENTS).0).subscribe()
    }

    /// Sends an event to the watchers of a job. The event is built only if there are any.
    pub fn publish(&self, id: &JobId, event: impl FnOnce() -> JobEvent) {
        if let Some(channel) = self.lock().get(id) {
            // The last watcher may have disconnected in this moment.
            let _ = channel.send(Arc::new(event()));
        }
    }

    /// Removes the channel of a job if it has no receivers left.
    pub fn forget(&self, id: &JobId) {
        let mut channels = self.lock();
        if channels.get(id).is_some_and(|channel| channel.receiver_count() == 0) {
            channels.remove(id);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Channels> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn watcher_receives_events_of_its_job_only() {
        let (live, a, b) = (Live::default(), JobId::from("a"), JobId::from("b"));
        let (mut first, mut second) = (live.subscribe(&a), live.subscribe(&a));
        let mut other = live.subscribe(&b);
        let event = JobEvent { sequence: 7, ..JobEvent::default() };
        live.publish(&a, || event.clone());
        live.publish(&JobId::from("c"), || event.clone());
        assert_eq!(first.try_recv().unwrap().sequence, 7);
        assert_eq!(second.try_recv().unwrap().sequence, 7);
        assert!(other.try_recv().is_err(), "the event belongs to another job");
        drop((first, other));
        live.forget(&a);
        live.forget(&b);
        assert_eq!(live.lock().keys().collect::<Vec<_>>(), [&a], "it still has a watcher");
        drop(second);
        live.forget(&a);
        assert!(live.lock().is_empty());
    }
}
