//! The gRPC services: check what comes in, ask the actor or the store, answer.

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

/// What all services share.
#[derive(Clone)]
pub(crate) struct Api {
    pub store: Arc<dyn Store>,
    pub commands: mpsc::Sender<Command>,
    pub live: Live,
    /// Turns true when the coordinator stops.
    pub stopping: watching::Receiver<bool>,
    /// The engines of this build.
    pub engines: Arc<[(&'static str, Digest)]>,
    /// How much of a kind may be under way.
    pub gates: Gates,
}

impl Api {
    /// Asks the actor and waits for what it answers.
    async fn ask<T>(&self, command: impl FnOnce(oneshot::Sender<T>) -> Command) -> Result<T, Status> {
        let (reply, answer) = oneshot::channel();
        self.commands.send(command(reply)).await.map_err(|_| stopping())?;
        answer.await.map_err(|_| stopping())
    }
}

/// Retryable: the coordinator will be back, or another one.
fn stopping() -> Status {
    Status::unavailable("the coordinator stops: try again once it is back")
}

fn store_failed(error: StoreError) -> Status {
    match error {
        // It is back in a moment, or another coordinator is.
        StoreError::Closed | StoreError::Superseded { .. } => stopping(),
        StoreError::Unreachable { .. } => Status::unavailable("the store can't be reached: try again"),
        error => {
            tracing::error!(%error, "store");
            Status::internal(error.to_string())
        }
    }
}

/// Refuses texts beyond a limit.
fn at_most(field: &str, value: &str, limit: usize) -> Result<(), Status> {
    if value.len() <= limit {
        Ok(())
    } else {
        Err(Status::invalid_argument(format!("{field} has {} bytes: at most {limit} are allowed", value.len())))
    }
}

/// Refuses what can't be an id.
fn id(field: &str, value: &str) -> Result<(), Status> {
    if value.is_empty() {
        return Err(Status::invalid_argument(format!("{field} is missing: 1 to {MAX_ID} bytes are needed")));
    }
    no_nul(field, value)?;
    at_most(field, value, MAX_ID)
}

/// Refuses text that could steer a terminal it is printed on.
fn printable(field: &str, value: &str) -> Result<(), Status> {
    match value.chars().find(|c| c.is_control()) {
        None => Ok(()),
        Some(c) => Err(Status::invalid_argument(format!("{field} has a control character, {}", c.escape_default()))),
    }
}

/// Refuses the one letter that not every store can keep.
fn no_nul(field: &str, value: &str) -> Result<(), Status> {
    if value.contains('\0') {
        Err(Status::invalid_argument(format!("{field} has a NUL, which is not allowed")))
    } else {
        Ok(())
    }
}
