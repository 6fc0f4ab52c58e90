//! The state of a search, as it is stored with each sealed generation: optimiser, archive, and who found what in the
//! generation before.

use super::round::Finder;
use super::sealed::Sealed;
use prost::Message as _;
use proto::v1::{Genome as WireGenome, ScoredCandidate};
use sim_core::genotype::Genome;
use sim_core::procedure::evolve::finish::Plan;
use sim_core::search::archive::Archive;
use sim_core::search::{BadState, Scored};
use std::collections::HashMap;
use std::iter;
use std::sync::Arc;

#[derive(Clone, PartialEq, prost::Message)]
struct SearchState {
    #[prost(bytes = "vec", tag = "1")]
    optimiser: Vec<u8>,
    #[prost(message, repeated, tag = "2")]
    archive: Vec<ScoredCandidate>,
    #[prost(message, repeated, tag = "3")]
    bests: Vec<ScoredCandidate>,
    #[prost(message, optional, tag = "4")]
    before: Option<Before>,
}

/// The generation before, as far as it is not stored with its scores.
#[derive(Clone, PartialEq, prost::Message)]
struct Before {
    #[prost(message, repeated, tag = "1")]
    genomes: Vec<WireGenome>,
    /// Ids of workers, each once.
    #[prost(string, repeated, tag = "2")]
    workers: Vec<String>,
    /// By candidate, its worker's place among these.
    #[prost(uint32, repeated, tag = "3")]
    by: Vec<u32>,
    /// By worker, its machine; none in a store of an earlier version.
    #[prost(string, repeated, tag = "4")]
    hosts: Vec<String>,
}

/// What is read back of it.
pub(super) struct Search {
    pub optimiser: Vec<u8>,
    pub archive: Archive,
    /// Genomes of the generation before, by candidate; `None` in a store of an earlier version.
    pub genomes_before: Option<Arc<[Genome]>>,
    /// Who scored them.
    pub finders_before: Vec<Finder>,
}

pub(super) fn encode_search(optimiser: Vec<u8>, archive: &Archive, last: Option<&Sealed>) -> Vec<u8> {
    let wire = |all: &[Scored]| all.iter().map(Into::into).collect();
    let before = last.and_then(before);
    SearchState { optimiser, archive: wire(archive.entries()), bests: wire(archive.bests()), before }.encode_to_vec()
}

fn before(sealed: &Sealed) -> Option<Before> {
    let genomes = sealed.genomes.as_ref()?.iter().map(|g| WireGenome { values: g.clone() }).collect();
    let mut places: HashMap<&Finder, u32> = HashMap::new();
    let (mut workers, mut hosts) = (Vec::new(), Vec::new());
    let by = sealed.finders.iter().map(|finder| {
        *places.entry(finder).or_insert_with(|| {
            workers.push(finder.worker.to_string());
            hosts.push(finder.host.to_string());
            workers.len() as u32 - 1
        })
    });
    let by = by.collect();
    Some(Before { genomes, workers, by, hosts })
}

pub(super) fn decode_search(plan: &Plan, bytes: &[u8]) -> Result<Search, BadState> {
    let SearchState { optimiser, archive, bests, before } =
        SearchState::decode(bytes).map_err(|e| BadState(format!("it can't be decoded: {e}")))?;
    let scored = |all: Vec<ScoredCandidate>| {
        let each = all.into_iter().map(|s| Scored::try_from(s).map_err(|e| BadState(format!("its archive: {e}"))));
        each.collect::<Result<Vec<_>, _>>()
    };
    let archive = Archive::restore(plan.direction, plan.archive, scored(archive)?, scored(bests)?);
    let before = before.map(|Before { genomes, workers, by, hosts }| {
        let hosts = hosts.into_iter().map(Into::into).chain(iter::repeat_with(Arc::default));
        let finders: Vec<Finder> =
            workers.into_iter().zip(hosts).map(|(worker, host)| Finder { worker: worker.into(), host }).collect();
        let by: Vec<_> = by.into_iter().map(|i| finders.get(i as usize).cloned().unwrap_or_default()).collect();
        (genomes.into_iter().map(|g| g.values).collect(), by)
    });
    let (genomes_before, finders_before) = before.map_or((None, Vec::new()), |(g, f)| (Some(g), f));
    Ok(Search { optimiser, archive, genomes_before, finders_before })
}
