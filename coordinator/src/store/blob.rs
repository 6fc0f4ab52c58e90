//! Blobs: a version byte, then protobuf. A reader that meets a version it does not know says so.

use super::{Quarantined, StoreError};
use crate::record::{JobRecord, StoredOutcome, StoredRecord};
use crate::scheduler::{Finder, Outcome};
use proto::v1;

const VERSION: u8 = 1;

#[derive(Clone, PartialEq, prost::Message)]
struct Outcomes {
    #[prost(message, repeated, tag = "1")]
    outcomes: Vec<StoredOutcome>,
    /// Who found them.
    #[prost(string, tag = "2")]
    worker: String,
    /// Where that was; empty in a store of an earlier version.
    #[prost(string, tag = "3")]
    host: String,
}

#[derive(Clone, PartialEq, prost::Message)]
struct StoredQuarantine {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(string, tag = "2")]
    reason: String,
    #[prost(int64, tag = "3")]
    at_ms: i64,
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

/// Outcomes, and who found them.
pub(super) fn encode_outcomes(outcomes: &[Outcome], finder: &Finder) -> Vec<u8> {
    let (worker, host) = (finder.worker.to_string(), finder.host.to_string());
    encode(&Outcomes { outcomes: outcomes.iter().map(Into::into).collect(), worker, host })
}

pub(super) fn decode_outcomes(bytes: &[u8]) -> Result<(Vec<Outcome>, Finder), StoreError> {
    let Outcomes { outcomes, worker, host } = decode("results", bytes)?;
    let finder = Finder { worker: worker.into(), host: host.into() };
    Ok((outcomes.into_iter().map(Into::into).collect(), finder))
}

pub(super) fn encode_quarantined(entry: &Quarantined) -> Vec<u8> {
    let Quarantined { worker: _, name, reason, at_ms } = entry;
    encode(&StoredQuarantine { name: name.to_string(), reason: reason.clone(), at_ms: *at_ms })
}

pub(super) fn decode_quarantined(worker: &str, bytes: &[u8]) -> Result<Quarantined, StoreError> {
    let StoredQuarantine { name, reason, at_ms } = decode("quarantine", bytes)?;
    Ok(Quarantined { worker: worker.into(), name: name.into(), reason, at_ms })
}

pub(super) fn encode_scores(scores: &[Option<f64>]) -> Vec<u8> {
    encode(&Scores { scores: proto::scores(scores) })
}

pub(super) fn decode_scores(bytes: &[u8]) -> Result<Vec<Option<f64>>, StoreError> {
    let stored: Scores = decode("scores", bytes)?;
    Ok(stored.scores.into_iter().map(|s| s.score).collect())
}

/// Reads bytes as each kind of blob.
pub(crate) fn decode_anything(bytes: &[u8]) {
    let _ = decode_record(bytes);
    let _ = decode_outcomes(bytes);
    let _ = decode_scores(bytes);
}
