//! Blobs: a version byte, then MessagePack by field name. An unknown version is an error.

use super::{Quarantined, RunState, StoreError, StoredEvent};
use crate::record::{Claimant, JobRecord};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_bytes::ByteBuf;
use sim_core::base::digest::Digest;
use std::sync::Arc;

/// Version of the encoding. Version 1 was protobuf.
const VERSION: u8 = 2;

/// Results, and the worker that delivered them.
pub(super) type Found = (Vec<Arc<[u8]>>, Claimant);

/// Encoded form of [`Found`].
#[derive(Serialize, Deserialize)]
struct Delivered {
    results: Vec<ByteBuf>,
    finder: Claimant,
}

pub(super) fn encode(value: &impl Serialize) -> Vec<u8> {
    let mut bytes = vec![VERSION];
    rmp_serde::encode::write_named(&mut bytes, value).expect("serialisation of our own types can't fail");
    bytes
}

pub(super) fn decode<T: DeserializeOwned>(what: &str, bytes: &[u8]) -> Result<T, StoreError> {
    let corrupt = |reason: String| StoreError::Corrupt { what: format!("{what}: {reason}") };
    match bytes.split_first() {
        Some((&VERSION, value)) => rmp_serde::from_slice(value).map_err(|e| corrupt(e.to_string())),
        Some((version, _)) => Err(corrupt(format!("version {version} is unknown"))),
        None => Err(corrupt("it is empty".to_owned())),
    }
}

/// Encodes the results of a range, and the worker that delivered them.
pub(super) fn encode_delivered(results: &[Arc<[u8]>], finder: &Claimant) -> Vec<u8> {
    encode(&Delivered { results: buffers(results), finder: finder.clone() })
}

pub(super) fn decode_delivered(bytes: &[u8]) -> Result<Found, StoreError> {
    let Delivered { results, finder } = decode("results", bytes)?;
    Ok((shared(results), finder))
}

pub(super) fn encode_results(results: &[Arc<[u8]>]) -> Vec<u8> {
    encode(&buffers(results))
}

pub(super) fn decode_results(bytes: &[u8]) -> Result<Vec<Arc<[u8]>>, StoreError> {
    decode("results", bytes).map(shared)
}

/// Encodes digests one after the other, 32 bytes each.
pub(super) fn encode_digests(digests: &[Digest]) -> Vec<u8> {
    digests.iter().flat_map(|digest| digest.0).collect()
}

pub(super) fn decode_digests(bytes: &[u8]) -> Result<Vec<Digest>, StoreError> {
    match bytes.as_chunks() {
        (digests, []) => Ok(digests.iter().copied().map(Digest).collect()),
        _ => Err(StoreError::Corrupt { what: format!("digests of {} bytes", bytes.len()) }),
    }
}

fn buffers(results: &[Arc<[u8]>]) -> Vec<ByteBuf> {
    results.iter().map(|result| ByteBuf::from(&**result)).collect()
}

fn shared(results: Vec<ByteBuf>) -> Vec<Arc<[u8]>> {
    results.into_iter().map(|result| result.into_vec().into()).collect()
}

/// Decodes bytes as each kind of blob, for fuzzing.
pub(crate) fn decode_anything(bytes: &[u8]) {
    let _ = decode::<JobRecord>("job", bytes);
    let _ = decode::<RunState>("state", bytes);
    let _ = decode::<StoredEvent>("event", bytes);
    let _ = decode::<Quarantined>("quarantine", bytes);
    let _ = decode_delivered(bytes);
    let _ = decode_results(bytes);
    let _ = decode_digests(bytes);
}
