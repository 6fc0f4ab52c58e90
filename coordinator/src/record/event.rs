//! Events of a job.

use super::{Dispute, JobRecord, JobState};
use serde::{Deserialize, Serialize};
use sim_core::procedure::SeriesRow;

/// Change of a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Event {
    /// The state changed.
    State(JobState),
    /// A round was sealed and committed.
    Sealed {
        /// Number of the round.
        round: u32,
        /// Name of its phase.
        phase: String,
        /// Row of measurements of the round, if it has one.
        row: Option<SeriesRow>,
    },
    /// Results of the current round arrived. Not stored.
    Done {
        /// Number of the round.
        round: u32,
        /// Number of done tasks.
        done: u32,
        /// Number of all tasks.
        total: u32,
    },
    /// The job was paused (true) or resumed (false).
    Paused(bool),
    /// A dispute was opened or decided.
    Dispute(Box<Dispute>),
    /// The job waits for workers of another build; the reason in words.
    Waits(String),
}

/// Event with its place in the job's history.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobEvent {
    /// Sequence number, from 1 without gaps. An event that is not stored has the number of the event before it.
    pub sequence: u64,
    /// Unix time, ms.
    pub at_ms: i64,
    /// Change of the job.
    pub event: Event,
}

impl JobRecord {
    /// Adds an event with the next sequence number to the job.
    pub fn next_event(&mut self, at_ms: i64, event: Event) -> JobEvent {
        self.last_event += 1;
        JobEvent { sequence: self.last_event, at_ms, event }
    }
}
