//! Conversions between wire types and sim-core types. Floating-point numbers keep their bits, including NaN payloads
//! and -0.

use crate::v1;
use sim_core::base::digest::Digest;
use sim_core::procedure::{Artefact, Progress, SeriesRow, Value};

/// Invalid message. Not retryable: the sender must change it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConvertError {
    /// Missing field.
    #[error("{field} is missing")]
    Missing {
        /// Name of the field.
        field: &'static str,
    },
    /// SHA-256 digest with a length other than 32 bytes.
    #[error("{field} has {found} bytes: a SHA-256 digest has 32")]
    DigestLength {
        /// Name of the field.
        field: &'static str,
        /// Number of bytes found.
        found: usize,
    },
}

/// Converts bytes to a digest. `field` is its name in the error.
pub fn digest(field: &'static str, bytes: &[u8]) -> Result<Digest, ConvertError> {
    bytes.try_into().map(Digest).map_err(|_| ConvertError::DigestLength { field, found: bytes.len() })
}

impl From<&Value> for v1::Value {
    fn from(value: &Value) -> Self {
        Self { name: value.name.to_string(), unit: value.unit.to_string(), value: value.value }
    }
}

impl From<v1::Value> for Value {
    fn from(wire: v1::Value) -> Self {
        Self { name: wire.name.into(), unit: wire.unit.into(), value: wire.value }
    }
}

impl From<&SeriesRow> for v1::Row {
    fn from(row: &SeriesRow) -> Self {
        let values = row.values.iter().map(Into::into).collect();
        Self { series: row.series.to_string(), index: row.index, values }
    }
}

impl From<v1::Row> for SeriesRow {
    fn from(wire: v1::Row) -> Self {
        let values = wire.values.into_iter().map(Into::into).collect();
        Self { series: wire.series.into(), index: wire.index, values }
    }
}

impl From<&Progress> for v1::Progress {
    fn from(progress: &Progress) -> Self {
        Self {
            phase: progress.phase.to_string(),
            unit: progress.unit.to_string(),
            done: progress.done,
            total: progress.total,
            values: progress.values.iter().map(Into::into).collect(),
        }
    }
}

impl From<v1::Progress> for Progress {
    fn from(wire: v1::Progress) -> Self {
        Self {
            phase: wire.phase.into(),
            unit: wire.unit.into(),
            done: wire.done,
            total: wire.total,
            values: wire.values.into_iter().map(Into::into).collect(),
        }
    }
}

impl From<Artefact> for v1::Artefact {
    fn from(artefact: Artefact) -> Self {
        let Artefact { name, media_type, content } = artefact;
        Self { name, media_type, content }
    }
}

impl From<v1::Artefact> for Artefact {
    fn from(wire: v1::Artefact) -> Self {
        let v1::Artefact { name, media_type, content } = wire;
        Self { name, media_type, content }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message as _;

    #[test]
    fn values_keep_their_bits_over_the_wire() {
        for bits in [0x8000_0000_0000_0000, 0, 0x7ff8_0000_dead_beef, 0xfff0_0000_0000_0000, 1] {
            let value = Value { name: "best".into(), unit: "%".into(), value: Some(f64::from_bits(bits)) };
            let row = SeriesRow { series: "generations".into(), index: 3, values: vec![value] };
            let wire = v1::Row::from(&row).encode_to_vec();
            assert_eq!(SeriesRow::from(v1::Row::decode(wire.as_slice()).expect("it decodes")), row);
        }
        let none = Value { name: "best".into(), unit: "".into(), value: None };
        assert_eq!(Value::from(v1::Value::from(&none)), none);
    }

    #[test]
    fn digest_of_wrong_length_is_refused() {
        let refused = digest("job_digest", &[1, 2]).unwrap_err().to_string();
        assert_eq!(refused, "job_digest has 2 bytes: a SHA-256 digest has 32");
    }
}
