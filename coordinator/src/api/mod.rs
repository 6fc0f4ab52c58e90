//! gRPC services: they check requests, query the actor or the store, and respond.

mod gates;
mod hello;
mod jobs;
mod restart;
pub(crate) mod scaler;
mod watch;
mod workers;

pub(crate) use gates::Gates;
pub(crate) use hello::check as check_hello;
pub(crate) use workers::completed as check_completed;

use crate::actor::Command;
use crate::live::Live;
use crate::store::{Store, StoreError};
use proto::limits::MAX_ID;
use sim_core::base::digest::Digest;
use std::sync::Arc;
use tokio::sync::{mpsc, oneshot, watch as watching};
use tonic::Status;

/// State that all services share.
#[derive(Clone)]
pub(crate) struct Api {
    pub store: Arc<dyn Store>,
    pub commands: mpsc::Sender<Command>,
    pub live: Live,
    /// Becomes true when the coordinator stops.
    pub stopping: watching::Receiver<bool>,
    /// Engines of this build, by name.
    pub engines: Arc<[(&'static str, Digest)]>,
    /// Limits on concurrent work.
    pub gates: Gates,
}

impl Api {
    /// Sends a command to the actor and waits for its reply.
    async fn ask<T>(&self, command: impl FnOnce(oneshot::Sender<T>) -> Command) -> Result<T, Status> {
        let (reply, answer) = oneshot::channel();
        self.commands.send(command(reply)).await.map_err(|_| stopping())?;
        answer.await.map_err(|_| stopping())
    }
}

/// Returns the error of a stopping coordinator. The call can be retried, on this coordinator or on its successor.
fn stopping() -> Status {
    Status::unavailable("the coordinator is stopping: try again after its restart")
}

fn store_failed(error: StoreError) -> Status {
    match error {
        // This coordinator restarts, or another one takes over.
        StoreError::Closed | StoreError::Superseded { .. } => stopping(),
        StoreError::Unreachable { .. } => Status::unavailable("the store can't be reached: try again"),
        error => {
            tracing::error!(%error, "store");
            Status::internal(error.to_string())
        }
    }
}

/// Refuses a text longer than the limit, in bytes.
fn at_most(field: &str, value: &str, limit: usize) -> Result<(), Status> {
    if value.len() <= limit {
        Ok(())
    } else {
        Err(Status::invalid_argument(format!("{field} has {} bytes: at most {limit} are allowed", value.len())))
    }
}

/// Checks an id: 1 to [`MAX_ID`] bytes without NUL.
fn id(field: &str, value: &str) -> Result<(), Status> {
    if value.is_empty() {
        return Err(Status::invalid_argument(format!("{field} is missing: 1 to {MAX_ID} bytes are required")));
    }
    no_nul(field, value)?;
    at_most(field, value, MAX_ID)
}

/// Refuses text with control characters, which could alter a terminal that prints it.
fn printable(field: &str, value: &str) -> Result<(), Status> {
    match value.chars().find(|c| c.is_control()) {
        None => Ok(()),
        Some(c) => Err(Status::invalid_argument(format!("{field} has a control character, {}", c.escape_default()))),
    }
}

/// Refuses text with NUL, which PostgreSQL can't store.
fn no_nul(field: &str, value: &str) -> Result<(), Status> {
    if value.contains('\0') {
        Err(Status::invalid_argument(format!("{field} has a NUL character, which is not allowed")))
    } else {
        Ok(())
    }
}
