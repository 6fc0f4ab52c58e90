//! Names and places that permits are made over: workers, assignments, ranges of tasks.

use std::fmt;
use std::sync::Arc;

/// Names a worker from its start to its end, over reconnects.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct WorkerId(pub Arc<str>);

impl fmt::Display for WorkerId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Names an assignment, uniquely over all starts on a store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct AssignmentId(pub u64);

/// Tasks `first .. first + count` of a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// The round's number.
    pub round: u32,
    /// Index of the first.
    pub first: u32,
    /// How many; at least 1.
    pub count: u32,
}

impl Range {
    /// The tasks' indexes.
    pub fn indexes(&self) -> std::ops::Range<u32> {
        self.first..self.first.saturating_add(self.count)
    }

    /// Whether it is not empty and lies within so many tasks.
    pub fn is_within(&self, tasks: u32) -> bool {
        self.count > 0 && self.first.checked_add(self.count).is_some_and(|end| end <= tasks)
    }
}
