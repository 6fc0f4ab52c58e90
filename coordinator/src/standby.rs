//! Standby: waits until no other coordinator is active on a shared store. An active coordinator renews its lock on the
//! store.

use crate::store::{Loaded, Store, StoreError};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tonic::service::Interceptor;
use tonic::{Request, Status};

/// Interval at which a standby checks the store.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Refuses all calls until it is open.
#[derive(Clone)]
pub(crate) struct Gate(watch::Receiver<bool>);

/// Handle that opens a [`Gate`].
pub(crate) struct Key(watch::Sender<bool>);

impl Gate {
    pub fn new(open: bool) -> (Key, Self) {
        let (key, gate) = watch::channel(open);
        (Key(key), Self(gate))
    }

    /// Returns the error for calls; `None` once the gate is open.
    pub fn closed(&self) -> Option<Status> {
        (!*self.0.borrow()).then(|| {
            Status::unavailable(
                "standby: another coordinator is active on the same store, and this one takes over when it ends: call that \
                 one, or try again",
            )
        })
    }
}

impl Key {
    pub fn open(&self) {
        self.0.send_replace(true);
    }
}

impl Interceptor for Gate {
    fn call(&mut self, request: Request<()>) -> Result<Request<()>, Status> {
        self.closed().map_or(Ok(request), Err)
    }
}

/// Starts an epoch as soon as no other coordinator is active. Without `standby` it returns an error if another one is
/// active, and waits only to find out if that one still renews its lock.
pub(crate) async fn turn(store: &dyn Store, standby: bool) -> Result<Loaded, StoreError> {
    let mut seen = None;
    let mut reachable = true;
    loop {
        match store.start().await {
            Err(StoreError::Active { epoch, stamp }) => {
                if !standby && seen.is_some_and(|before| before != (epoch, stamp)) {
                    return Err(StoreError::Active { epoch, stamp });
                }
                match seen.replace((epoch, stamp)) {
                    None if standby => tracing::info!(at_work = epoch, "standby: another coordinator is active"),
                    None => tracing::info!(at_work = epoch, "checking if another coordinator is still active"),
                    Some(_) => {}
                }
                reachable = true;
            }
            Err(error @ StoreError::Unreachable { .. }) if standby => {
                if std::mem::replace(&mut reachable, false) {
                    tracing::warn!(%error, "standby: can't reach the store");
                }
            }
            turn => return turn,
        }
        tokio::time::sleep(LOOK_EVERY).await;
    }
}

/// Renews the lock on the store until that fails, and returns the error.
pub(crate) async fn stay_in_touch(store: Arc<dyn Store>, epoch: u64) -> StoreError {
    let Some(every) = store.renew_every() else { return std::future::pending().await };
    loop {
        tokio::time::sleep(every).await;
        if let Err(error) = store.renew(epoch).await {
            return error;
        }
    }
}
