//! Ids of workers and assignments, and ranges of tasks. Permits authenticate them.

use std::fmt;
use std::sync::Arc;

/// Id of a worker from its start to its exit, over reconnects.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct WorkerId(pub Arc<str>);

impl fmt::Display for WorkerId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Id of an assignment, unique over all starts on a store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct AssignmentId(pub u64);

/// Tasks `first .. first + count` of a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// The round's number.
    pub round: u32,
    /// Index of the first task.
    pub first: u32,
    /// Number of tasks, at least 1.
    pub count: u32,
}

impl Range {
    /// Returns the indices of the tasks.
    pub fn indexes(&self) -> std::ops::Range<u32> {
        self.first..self.first.saturating_add(self.count)
    }

    /// Returns true if the range is not empty and within a round of `tasks` tasks.
    pub fn is_within(&self, tasks: u32) -> bool {
        self.count > 0 && self.first.checked_add(self.count).is_some_and(|end| end <= tasks)
    }
}
