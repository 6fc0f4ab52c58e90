//! Disputes: results of one task that differ, and how the disagreement ended.

use serde::{Deserialize, Serialize};
use sim_core::base::digest::Digest;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Worker that delivered a result, and its host.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Claimant {
    /// Id of the worker; empty if unknown.
    pub worker: Arc<str>,
    /// Source address of the worker; empty if unknown.
    pub host: Arc<str>,
}

/// Source of a claim.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Source {
    /// Id and host of the worker.
    pub finder: Claimant,
    /// Name of the worker.
    pub name: Arc<str>,
}

/// Result that a worker delivered for a disputed task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// Worker that delivered the result.
    pub source: Source,
    /// Digest of the result.
    pub digest: Digest,
    /// Description of the result; empty if only its digest was kept.
    pub what: String,
    /// Encoded result, until its round is sealed.
    #[serde(with = "serde_bytes")]
    pub result: Option<Vec<u8>>,
    /// True if the worker is quarantined. The claim then counts only if another worker confirms it.
    pub distrusted: bool,
}

/// Outcome of a dispute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Ruling {
    /// The committed result stands.
    Upheld,
    /// The committed result was wrong, and was replaced before its round was sealed.
    Corrected,
    /// The committed result was wrong, and its round is sealed.
    Tainted,
}

impl Ruling {
    /// Returns the ruling's name.
    pub fn word(self) -> &'static str {
        match self {
            Self::Upheld => "upheld",
            Self::Corrected => "corrected",
            Self::Tainted => "tainted",
        }
    }
}

/// Task with different results from different workers, or with results of quarantined workers only.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dispute {
    /// Round of the task.
    pub round: u32,
    /// Index of the task in its round.
    pub index: u32,
    /// Description of the task.
    pub what: String,
    /// Encoded task, for a new lease.
    #[serde(with = "serde_bytes")]
    pub task: Vec<u8>,
    /// Delivered results; the committed one comes first.
    pub claims: Vec<Claim>,
    /// Ruling; `None` while the dispute is open.
    pub ruling: Option<Ruling>,
    /// Unix time of the newest claim, ms.
    pub at_ms: i64,
}

impl Dispute {
    /// Returns the digest that two workers agree on, if at least one of them is not quarantined. If the workers run on
    /// different hosts, two hosts must agree, since one faulty host may run many workers. A worker that delivered
    /// different results does not vote, nor does a claim without a worker id.
    pub fn agreed(&self) -> Option<Digest> {
        let hosts_differ = self.hosts().len() >= 2;
        self.claims.iter().map(|c| c.digest).find(|digest| {
            let support = || self.claims.iter().filter(|c| c.digest == *digest && self.votes(c));
            let on: BTreeSet<_> = support().map(|c| &c.source.finder.host).filter(|host| !host.is_empty()).collect();
            support().count() >= 2 && (!hosts_differ || on.len() >= 2) && support().any(|c| !c.distrusted)
        })
    }

    /// Returns the known host of each claim that votes.
    fn voting_hosts(&self) -> impl Iterator<Item = &Arc<str>> {
        self.claims.iter().filter(|c| self.votes(c)).map(|c| &c.source.finder.host).filter(|host| !host.is_empty())
    }

    fn hosts(&self) -> BTreeSet<&Arc<str>> {
        self.voting_hosts().collect()
    }

    /// Returns the hosts with two votes, if there are votes from other hosts: another vote from these hosts would not
    /// decide.
    pub fn exhausted_hosts(&self) -> BTreeSet<Arc<str>> {
        let hosts = self.hosts();
        let twice = |host: &&Arc<str>| self.voting_hosts().filter(|voted| voted == host).count() >= 2;
        if hosts.len() < 2 { BTreeSet::new() } else { hosts.into_iter().filter(twice).cloned().collect() }
    }

    /// Describes the host that is needed for a decision; `None` if a host that has voted can still decide.
    pub fn needs_host(&self) -> Option<&'static str> {
        let (hosts, out) = (self.hosts().len(), self.exhausted_hosts().len());
        (hosts >= 2 && hosts == out).then_some(if hosts == 2 { "a third machine" } else { "another machine" })
    }

    fn votes(&self, claim: &Claim) -> bool {
        let worker = &claim.source.finder.worker;
        !worker.is_empty() && self.claims.iter().filter(|c| c.source.finder.worker == *worker).count() == 1
    }

    /// Returns true if claims differ. If not, the only results come from quarantined workers.
    pub fn is_contradicted(&self) -> bool {
        self.claims.windows(2).any(|pair| pair[0].digest != pair[1].digest)
    }

    /// Returns the valid claim: the first with the agreed digest, or else the committed one.
    pub fn holding(&self) -> Option<&Claim> {
        match self.agreed() {
            Some(agreed) => self.claims.iter().find(|c| c.digest == agreed),
            None => self.claims.first(),
        }
    }

    /// Returns true if this worker delivered a result for the task.
    pub fn has_claim_of(&self, worker: &str) -> bool {
        self.claims.iter().any(|c| &*c.source.finder.worker == worker)
    }

    /// Returns true if there is no ruling yet.
    pub fn is_open(&self) -> bool {
        self.ruling.is_none()
    }

    /// Removes the encoded results: once the round is sealed, only digests are compared.
    pub fn seal(&mut self) {
        self.claims.iter_mut().for_each(|claim| claim.result = None);
    }
}
