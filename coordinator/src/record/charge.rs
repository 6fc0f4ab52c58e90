//! Crashes and failures that are held against tasks.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A crash or failure while tasks of the round at hand were worked on: they are suspects, and each is worked on alone.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Charge {
    /// Index of the first of them.
    pub first: u32,
    /// How many, at least 1.
    pub count: u32,
    /// Nothing else can be to blame: it is an attempt of the one task.
    pub attempt: bool,
    /// The worker that was taken for crashed; should it come back, the charge is withdrawn. `None` of a failure that a
    /// worker reported.
    pub lost: Option<Arc<str>>,
}
