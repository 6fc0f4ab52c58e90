//! What happens to a job, as clients watch it.

use super::{Dispute, JobRecord, JobState};
use serde::{Deserialize, Serialize};
use sim_core::procedure::Row;

/// A change of a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Event {
    /// It stands elsewhere.
    State(JobState),
    /// A round's results were folded and committed.
    Sealed {
        /// Its number.
        round: u32,
        /// Its phase, in a word.
        phase: String,
        /// The row of its series, if it has one.
        row: Option<Row>,
    },
    /// Tasks of the round at hand came in. Not stored.
    Done {
        /// The round.
        round: u32,
        /// Tasks that are done.
        done: u32,
        /// Tasks that it has.
        total: u32,
    },
    /// It was paused (true) or resumed (false).
    Paused(bool),
    /// Workers disagree about a result, or the dispute was decided.
    Dispute(Box<Dispute>),
    /// A coordinator of another build has taken it up: what it waits for, for people.
    Waits(String),
}

/// An event with its place in the job's history.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobEvent {
    /// From 1 without gaps; an event that is not stored has the number of the one before it.
    pub sequence: u64,
    /// Unix time, ms.
    pub at_ms: i64,
    /// What happened.
    pub event: Event,
}

impl JobRecord {
    /// The next event of this job.
    pub fn next_event(&mut self, at_ms: i64, event: Event) -> JobEvent {
        self.last_event += 1;
        JobEvent { sequence: self.last_event, at_ms, event }
    }
}
