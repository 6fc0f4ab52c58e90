//! Blobs: a version byte, then protobuf. A reader that meets a version it does not know says so.

use super::StoreError;
use crate::record::{JobRecord, StoredRecord};
use crate::scheduler::Outcome;
use proto::v1;
use sim_core::score::Counts;

const VERSION: u8 = 1;

#[derive(Clone, PartialEq, prost::Message)]
struct Outcomes {
    #[prost(message, repeated, tag = "1")]
    outcomes: Vec<StoredOutcome>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct StoredOutcome {
    #[prost(message, repeated, tag = "1")]
    scores: Vec<v1::Score>,
    #[prost(message, optional, tag = "2")]
    counts: Option<v1::Counts>,
    #[prost(bytes = "vec", tag = "3")]
    traces: Vec<u8>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct Scores {
    #[prost(message, repeated, tag = "1")]
    scores: Vec<v1::Score>,
}

pub(super) fn encode(message: &impl prost::Message) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(1 + message.encoded_len());
    bytes.push(VERSION);
    bytes.extend_from_slice(&message.encode_to_vec());
    bytes
}

pub(super) fn decode<M: prost::Message + Default>(what: &str, bytes: &[u8]) -> Result<M, StoreError> {
    let corrupt = |reason: String| StoreError::Corrupt { what: format!("{what}: {reason}") };
    match bytes.split_first() {
        Some((&VERSION, message)) => M::decode(message).map_err(|e| corrupt(e.to_string())),
        Some((version, _)) => Err(corrupt(format!("version {version} is not known"))),
        None => Err(corrupt("it is empty".to_owned())),
    }
}

pub(super) fn encode_record(record: &JobRecord) -> Vec<u8> {
    encode(&record.to_stored())
}

pub(super) fn decode_record(bytes: &[u8]) -> Result<JobRecord, StoreError> {
    let stored: StoredRecord = decode("job", bytes)?;
    JobRecord::from_stored(stored).map_err(|e| StoreError::Corrupt { what: format!("job: {e}") })
}

pub(super) fn encode_outcomes(outcomes: &[Outcome]) -> Vec<u8> {
    let stored = |o: &Outcome| StoredOutcome {
        scores: proto::scores(&o.scores),
        counts: Some(o.counts.into()),
        traces: o.traces.clone(),
    };
    encode(&Outcomes { outcomes: outcomes.iter().map(stored).collect() })
}

pub(super) fn decode_outcomes(bytes: &[u8]) -> Result<Vec<Outcome>, StoreError> {
    let stored: Outcomes = decode("results", bytes)?;
    let outcome = |o: StoredOutcome| Outcome {
        scores: o.scores.iter().map(|s| s.score).collect(),
        counts: o.counts.map(Counts::from).unwrap_or_default(),
        traces: o.traces,
    };
    Ok(stored.outcomes.into_iter().map(outcome).collect())
}

pub(super) fn encode_scores(scores: &[Option<f64>]) -> Vec<u8> {
    encode(&Scores { scores: proto::scores(scores) })
}

pub(super) fn decode_scores(bytes: &[u8]) -> Result<Vec<Option<f64>>, StoreError> {
    let stored: Scores = decode("scores", bytes)?;
    Ok(stored.scores.into_iter().map(|s| s.score).collect())
}
