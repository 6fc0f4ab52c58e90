//! WatchJob: sends stored events first, then live events, without a gap.

use super::{Api, stopping, store_failed};
use crate::convert;
use crate::limits::EVENTS_AT_ONCE;
use crate::record::JobId;
use crate::store::StoredEvent;
use proto::v1::JobEvent;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio_stream::wrappers::ReceiverStream;
use tonic::Status;

type Outbox = mpsc::Sender<Result<JobEvent, Status>>;

impl Api {
    /// Returns the events after a sequence number, to the end of the job. Holds the permit until then.
    pub(super) fn watch(
        &self,
        id: JobId,
        after: u64,
        place: OwnedSemaphorePermit,
    ) -> ReceiverStream<Result<JobEvent, Status>> {
        let (outbox, stream) = mpsc::channel(64);
        let api = self.clone();
        tokio::spawn(async move {
            let _place = place;
            let ended = api.feed(&id, after, &outbox).await;
            api.live.forget(&id);
            if let Err(status) = ended {
                // The watcher may have disconnected.
                let _ = outbox.send(Err(status)).await;
            }
        });
        ReceiverStream::new(stream)
    }

    async fn feed(&self, id: &JobId, after: u64, outbox: &Outbox) -> Result<(), Status> {
        // Subscribed before the store is read, so that no event between the two is lost.
        let mut live = self.live.subscribe(id);
        let mut stop = self.stopping.clone();
        let mut last = after;
        loop {
            loop {
                let events = self.store.events(id, last, EVENTS_AT_ONCE).await.map_err(store_failed)?;
                let read = events.len();
                for StoredEvent { event, job } in events {
                    last = event.sequence;
                    if outbox.send(Ok(convert::event(&job, &event))).await.is_err() {
                        return Ok(());
                    }
                }
                if read < EVENTS_AT_ONCE as usize {
                    break;
                }
            }
            let job = self.store.job(id).await.map_err(store_failed)?;
            if job.is_none_or(|(record, _)| record.state.is_end() && record.last_event <= last) {
                return Ok(());
            }
            loop {
                let received = tokio::select! {
                    received = live.recv() => received,
                    _ = stop.wait_for(|stop| *stop) => return Err(stopping()),
                    () = outbox.closed() => return Ok(()),
                };
                let event = match received {
                    Ok(event) => (*event).clone(),
                    // The watcher is too slow for live events: continue from the store.
                    Err(RecvError::Lagged(_)) => break,
                    Err(RecvError::Closed) => return Err(stopping()),
                };
                let stored = convert::is_stored(&event);
                if stored && event.sequence <= last {
                    continue;
                }
                if event.sequence > last + u64::from(stored) {
                    break;
                }
                last = last.max(event.sequence);
                let end = convert::is_last(&event);
                if outbox.send(Ok(event)).await.is_err() || end {
                    return Ok(());
                }
            }
        }
    }
}
