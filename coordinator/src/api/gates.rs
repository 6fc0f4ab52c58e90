//! Limits on concurrent sessions, streams and readings, over all clients and workers.

use crate::limits::{MAX_HELLOS, MAX_READINGS, MAX_SESSIONS, MAX_WATCHERS};
use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tonic::Status;

/// Limits that all services share.
#[derive(Clone)]
pub(crate) struct Gates {
    /// Event streams.
    pub watchers: Gate,
    /// Worker sessions before Hello.
    pub hellos: Gate,
    /// Worker sessions after Hello.
    pub sessions: Gate,
    /// Jobs that are being parsed and validated.
    pub readings: Gate,
}

impl Default for Gates {
    fn default() -> Self {
        Self {
            watchers: Gate::new("watchers", MAX_WATCHERS),
            hellos: Gate::new("worker sessions without Hello", MAX_HELLOS),
            sessions: Gate::new("worker sessions", MAX_SESSIONS),
            readings: Gate::new("jobs being read", MAX_READINGS),
        }
    }
}

/// Limit on one kind of concurrent work.
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

    /// Returns a permit, or an error that names the limit. The call can be retried.
    pub fn pass(&self) -> Result<OwnedSemaphorePermit, Status> {
        self.places.clone().try_acquire_owned().map_err(|_| {
            let Self { what, limit, .. } = self;
            Status::resource_exhausted(format!("there are {limit} {what}, which is the limit: try again later"))
        })
    }

    /// Waits for a permit.
    pub async fn wait(&self) -> Option<OwnedSemaphorePermit> {
        self.places.clone().acquire_owned().await.ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tonic::Code;

    #[test]
    fn full_gate_names_its_limit_and_opens_again() {
        let gate = Gate::new("watchers", 2);
        let (first, _second) = (gate.pass().unwrap(), gate.pass().unwrap());
        let refused = gate.pass().unwrap_err();
        assert_eq!(refused.code(), Code::ResourceExhausted);
        assert!(refused.message().contains("2 watchers"), "{refused}");
        drop(first);
        assert!(gate.pass().is_ok());
    }
}
