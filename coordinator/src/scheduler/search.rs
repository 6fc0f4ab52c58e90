//! The state of a search, as it is stored with each sealed generation: optimiser and archive.

use prost::Message as _;
use proto::v1::ScoredCandidate;
use sim_core::finish::Plan;
use sim_core::optimise::BadState;
use sim_core::optimise::archive::Archive;
use sim_core::score::Scored;

#[derive(Clone, PartialEq, prost::Message)]
struct SearchState {
    #[prost(bytes = "vec", tag = "1")]
    optimiser: Vec<u8>,
    #[prost(message, repeated, tag = "2")]
    archive: Vec<ScoredCandidate>,
    #[prost(message, repeated, tag = "3")]
    bests: Vec<ScoredCandidate>,
}

pub(super) fn encode_search(optimiser: Vec<u8>, archive: &Archive) -> Vec<u8> {
    let wire = |all: &[Scored]| all.iter().map(Into::into).collect();
    SearchState { optimiser, archive: wire(archive.entries()), bests: wire(archive.bests()) }.encode_to_vec()
}

/// The optimiser's state and the archive.
pub(super) fn decode_search(plan: &Plan, bytes: &[u8]) -> Result<(Vec<u8>, Archive), BadState> {
    let SearchState { optimiser, archive, bests } =
        SearchState::decode(bytes).map_err(|e| BadState(format!("it can't be decoded: {e}")))?;
    let scored = |all: Vec<ScoredCandidate>| {
        let each = all.into_iter().map(|s| Scored::try_from(s).map_err(|e| BadState(format!("its archive: {e}"))));
        each.collect::<Result<Vec<_>, _>>()
    };
    Ok((optimiser, Archive::restore(plan.direction, plan.archive, scored(archive)?, scored(bests)?)))
}
