//! How much of a kind may be under way at once, whoever asks for it.

use crate::limits::{MAX_HELLOS, MAX_READINGS, MAX_SESSIONS, MAX_WATCHERS};
use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tonic::Status;

/// One for all services.
#[derive(Clone)]
pub(crate) struct Gates {
    /// Streams of events.
    pub watchers: Gate,
    /// Sessions that have not said Hello.
    pub hellos: Gate,
    /// Sessions that have.
    pub sessions: Gate,
    /// Jobs that are being read.
    pub readings: Gate,
}

impl Default for Gates {
    fn default() -> Self {
        Self {
            watchers: Gate::new("watchers", MAX_WATCHERS),
            hellos: Gate::new("workers that have not said Hello", MAX_HELLOS),
            sessions: Gate::new("sessions of workers", MAX_SESSIONS),
            readings: Gate::new("jobs that are being read", MAX_READINGS),
        }
    }
}

/// Lets so many through at once.
#[derive(Clone)]
pub(crate) struct Gate {
    what: &'static str,
    limit: usize,
    places: Arc<Semaphore>,
}

impl Gate {
    pub fn new(what: &'static str, limit: usize) -> Self {
        Self { what, limit, places: Arc::new(Semaphore::new(limit)) }
    }

    /// A place until the permit is dropped, or a refusal that tells the limit. Retryable.
    pub fn pass(&self) -> Result<OwnedSemaphorePermit, Status> {
        self.places.clone().try_acquire_owned().map_err(|_| {
            let Self { what, limit, .. } = self;
            Status::resource_exhausted(format!("there are {limit} {what}, as many as are allowed: try again later"))
        })
    }

    /// A place, once there is one.
    pub async fn wait(&self) -> Option<OwnedSemaphorePermit> {
        self.places.clone().acquire_owned().await.ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tonic::Code;

    #[test]
    fn a_full_gate_says_what_there_is_too_much_of_and_opens_again() {
        let gate = Gate::new("watchers", 2);
        let (first, _second) = (gate.pass().unwrap(), gate.pass().unwrap());
        let refused = gate.pass().unwrap_err();
        assert_eq!(refused.code(), Code::ResourceExhausted);
        assert!(refused.message().contains("2 watchers"), "{refused}");
        drop(first);
        assert!(gate.pass().is_ok());
    }
}
