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
    outcomes: Vec<v1::EvaluationResult>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct Scores {
    #[prost(message, repeated, tag = "1")]
    scores: Vec<Score>,
}

#[derive(Clone, Copy, PartialEq, prost::Message)]
struct Score {
    #[prost(double, optional, tag = "1")]
    score: Option<f64>,
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
    let wire = |o: &Outcome| v1::EvaluationResult { score: o.score, counts: Some(o.counts.into()) };
    encode(&Outcomes { outcomes: outcomes.iter().map(wire).collect() })
}

pub(super) fn decode_outcomes(bytes: &[u8]) -> Result<Vec<Outcome>, StoreError> {
    let stored: Outcomes = decode("results", bytes)?;
    let outcome =
        |e: v1::EvaluationResult| Outcome { score: e.score, counts: e.counts.map(Counts::from).unwrap_or_default() };
    Ok(stored.outcomes.into_iter().map(outcome).collect())
}

pub(super) fn encode_scores(scores: &[Option<f64>]) -> Vec<u8> {
    encode(&Scores { scores: scores.iter().map(|&score| Score { score }).collect() })
}

pub(super) fn decode_scores(bytes: &[u8]) -> Result<Vec<Option<f64>>, StoreError> {
    let stored: Scores = decode("scores", bytes)?;
    Ok(stored.scores.into_iter().map(|s| s.score).collect())
}
