//! What a task found, as it is stored.

use crate::scheduler::Outcome;
use proto::v1;
use sim_core::base::score::Counts;

/// An [`Outcome`] in the store.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct StoredOutcome {
    #[prost(message, repeated, tag = "1")]
    scores: Vec<v1::Score>,
    #[prost(message, optional, tag = "2")]
    counts: Option<v1::Counts>,
    #[prost(bytes = "vec", tag = "3")]
    traces: Vec<u8>,
}

impl From<&Outcome> for StoredOutcome {
    fn from(outcome: &Outcome) -> Self {
        Self {
            scores: proto::scores(&outcome.scores),
            counts: Some(outcome.counts.into()),
            traces: outcome.traces.clone(),
        }
    }
}

impl From<StoredOutcome> for Outcome {
    fn from(stored: StoredOutcome) -> Self {
        Self {
            scores: stored.scores.iter().map(|s| s.score).collect(),
            counts: stored.counts.map(Counts::from).unwrap_or_default(),
            traces: stored.traces,
        }
    }
}
