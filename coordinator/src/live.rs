//! What happens to jobs, for those who watch: each job has a channel of its own, so that an event costs as much as there are
//! watchers of its job, and not of any.

use crate::limits::LIVE_EVENTS;
use crate::record::JobId;
use proto::v1::JobEvent;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::broadcast::{Receiver, Sender, channel};

type Channels = HashMap<JobId, Sender<Arc<JobEvent>>>;

/// The channels of the jobs that are watched.
#[derive(Clone, Debug, Default)]
pub(crate) struct Live(Arc<Mutex<Channels>>);

impl Live {
    /// What happens to a job from now on. Once it is watched no more, [`Live::forget`] it.
    pub fn subscribe(&self, id: &JobId) -> Receiver<Arc<JobEvent>> {
        self.lock().entry(id.clone()).or_insert_with(|| channel(LIVE_EVENTS).0).subscribe()
    }

    /// Sends an event to those who watch the job; it is made only if there are any.
    pub fn publish(&self, id: &JobId, event: impl FnOnce() -> JobEvent) {
        if let Some(channel) = self.lock().get(id) {
            // The last watcher may have gone this moment.
            let _ = channel.send(Arc::new(event()));
        }
    }

    /// Somebody does not watch it any more.
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
    fn who_watches_a_job_wakes_for_it_alone_and_nothing_is_kept_of_what_nobody_watches() {
        let (live, a, b) = (Live::default(), JobId::from("a"), JobId::from("b"));
        let (mut first, mut second) = (live.subscribe(&a), live.subscribe(&a));
        let mut other = live.subscribe(&b);
        let event = JobEvent { sequence: 7, ..JobEvent::default() };
        live.publish(&a, || event.clone());
        live.publish(&JobId::from("c"), || event.clone());
        assert_eq!(first.try_recv().unwrap().sequence, 7);
        assert_eq!(second.try_recv().unwrap().sequence, 7);
        assert!(other.try_recv().is_err(), "that was about another job");
        drop((first, other));
        live.forget(&a);
        live.forget(&b);
        assert_eq!(live.lock().keys().collect::<Vec<_>>(), [&a], "one still watches it");
        drop(second);
        live.forget(&a);
        assert!(live.lock().is_empty());
    }
}
