//! What is held against tasks: crashes and failures while they were worked on.

use crate::scheduler::MAX_ATTEMPTS;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A crash or failure while tasks of the round at hand were worked on: they are suspects, and each is worked on alone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Charge {
    /// The first of them.
    pub first: u32,
    /// How many, at least 1.
    pub count: u32,
    /// Nothing else can be to blame: it is an attempt of the one task.
    pub attempt: bool,
    /// The worker that was taken for dead; should it live, nothing of this is true. `None` of a failure that a worker told.
    pub lost: Option<Arc<str>>,
}

/// A [`Charge`] in the store.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct StoredCharge {
    #[prost(uint32, tag = "1")]
    first: u32,
    #[prost(uint32, tag = "2")]
    count: u32,
    #[prost(bool, tag = "3")]
    attempt: bool,
    #[prost(string, tag = "4")]
    lost: String,
}

impl From<&Charge> for StoredCharge {
    fn from(charge: &Charge) -> Self {
        let Charge { first, count, attempt, lost } = charge;
        Self { first: *first, count: *count, attempt: *attempt, lost: lost.as_deref().unwrap_or_default().to_owned() }
    }
}

impl From<StoredCharge> for Charge {
    fn from(stored: StoredCharge) -> Self {
        let StoredCharge { first, count, attempt, lost } = stored;
        Self { first, count, attempt, lost: (!lost.is_empty()).then(|| lost.into()) }
    }
}

/// What was stored before it was kept whom a charge comes from: the attempts of each suspect.
pub(super) fn charges_of(suspects: &BTreeMap<u32, u32>) -> impl Iterator<Item = Charge> {
    suspects.iter().flat_map(|(&first, &attempts)| {
        let charge = Charge { first, count: 1, attempt: attempts > 0, lost: None };
        std::iter::repeat_n(charge, attempts.clamp(1, MAX_ATTEMPTS) as usize)
    })
}
