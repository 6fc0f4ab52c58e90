//! Whose turn it is: waiting for it on a store that several coordinators can reach, and staying in touch while at work.

use crate::store::{Loaded, Store, StoreError};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tonic::service::Interceptor;
use tonic::{Request, Status};

/// How often a coordinator that waits looks whether it is its turn.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Lets no call through before it is open.
#[derive(Clone)]
pub(crate) struct Gate(watch::Receiver<bool>);

/// Opens a [`Gate`].
pub(crate) struct Key(watch::Sender<bool>);

impl Gate {
    pub fn new(open: bool) -> (Key, Self) {
        let (key, gate) = watch::channel(open);
        (Key(key), Self(gate))
    }

    /// Why nobody gets through, unless it is open.
    pub fn closed(&self) -> Option<Status> {
        (!*self.0.borrow()).then(|| {
            Status::unavailable(
                "standby: another coordinator is at work on the same store, and this one takes over when it ends: ask that \
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

/// Starts an epoch as soon as nobody else is at work. Without `standby` that is refused if somebody else is: then it only
/// waits for as long as it takes to find out whether the other one is still there.
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
                    None if standby => tracing::info!(at_work = epoch, "standby: another coordinator is at work"),
                    None => tracing::info!(at_work = epoch, "looking whether another coordinator is still at work"),
                    Some(_) => {}
                }
                reachable = true;
            }
            Err(error @ StoreError::Unreachable { .. }) if standby => {
                if std::mem::replace(&mut reachable, false) {
                    tracing::warn!(%error, "standby");
                }
            }
            turn => return turn,
        }
        tokio::time::sleep(LOOK_EVERY).await;
    }
}

/// Gives signs of life for as long as that is possible, and tells why it is not any more.
pub(crate) async fn stay_in_touch(store: Arc<dyn Store>, epoch: u64) -> StoreError {
    let Some(every) = store.renew_every() else { return std::future::pending().await };
    loop {
        tokio::time::sleep(every).await;
        if let Err(error) = store.renew(epoch).await {
            return error;
        }
    }
}
