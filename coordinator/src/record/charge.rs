//! Crashes and failures that are charged to tasks.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Crash or failure during the lease of tasks of the current round. The tasks become suspects, and each is leased
/// alone.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Charge {
    /// Index of the first task.
    pub first: u32,
    /// Number of tasks, at least 1.
    pub count: u32,
    /// True if the only task of the lease caused it: it counts as an attempt of that task.
    pub attempt: bool,
    /// Worker that was considered crashed; the charge is withdrawn if the worker reconnects. `None` for a failure that
    /// a worker reported.
    pub lost: Option<Arc<str>>,
}
