//! Disputes: results of one task that differ, and how the disagreement ended.

use serde::{Deserialize, Serialize};
use sim_core::base::digest::Digest;
use std::collections::BTreeSet;
use std::sync::Arc;

/// The worker that delivered a result, and its host.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Finder {
    /// Id of the worker; empty if it is not known.
    pub worker: Arc<str>,
    /// The host it called from; empty if it is not known.
    pub host: Arc<str>,
}

/// The source of a claim.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Source {
    /// Id and host of the worker.
    pub finder: Finder,
    /// The worker's name, for people.
    pub name: Arc<str>,
}

/// A result that a worker delivered for a disputed task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// The worker.
    pub source: Source,
    /// Digest of the result.
    pub digest: Digest,
    /// The result for people; empty where only its digest was kept.
    pub what: String,
    /// The result, while its round is at hand.
    #[serde(with = "serde_bytes")]
    pub result: Option<Vec<u8>>,
    /// The worker is quarantined: others may confirm the claim, by itself it counts for nothing.
    pub distrusted: bool,
}

/// How a dispute ended.
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
    /// The ruling in a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Upheld => "upheld",
            Self::Corrected => "corrected",
            Self::Tainted => "tainted",
        }
    }
}

/// A task of which workers gave different bits, or that only a quarantined worker computed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dispute {
    /// The round.
    pub round: u32,
    /// The task's index in it.
    pub index: u32,
    /// The task, for people.
    pub what: String,
    /// The task, to be handed out again.
    #[serde(with = "serde_bytes")]
    pub task: Vec<u8>,
    /// Results that were delivered; the committed one comes first.
    pub claims: Vec<Claim>,
    /// `None` while it is open.
    pub ruling: Option<Ruling>,
    /// Unix time of the newest claim, ms.
    pub at_ms: i64,
}

impl Dispute {
    /// The digest that two workers agree on, at least one of them trusted, if there is one. Where hosts differ it takes two
    /// hosts: one that computes wrongly may have many workers. A worker that delivered different results does not vote, nor
    /// does a claim without a worker id.
    pub fn agreed(&self) -> Option<Digest> {
        let hosts_differ = self.hosts().len() >= 2;
        self.claims.iter().map(|c| c.digest).find(|digest| {
            let support = || self.claims.iter().filter(|c| c.digest == *digest && self.votes(c));
            let on: BTreeSet<_> = support().map(|c| &c.source.finder.host).filter(|host| !host.is_empty()).collect();
            support().count() >= 2 && (!hosts_differ || on.len() >= 2) && support().any(|c| !c.distrusted)
        })
    }

    /// The known hosts of the claims that vote, claim by claim.
    fn voting_hosts(&self) -> impl Iterator<Item = &Arc<str>> {
        self.claims.iter().filter(|c| self.votes(c)).map(|c| &c.source.finder.host).filter(|host| !host.is_empty())
    }

    fn hosts(&self) -> BTreeSet<&Arc<str>> {
        self.voting_hosts().collect()
    }

    /// Hosts on which two workers voted, if others voted as well: one more there would not decide.
    pub fn exhausted_hosts(&self) -> BTreeSet<Arc<str>> {
        let hosts = self.hosts();
        let twice = |host: &&Arc<str>| self.voting_hosts().filter(|voted| voted == host).count() >= 2;
        if hosts.len() < 2 { BTreeSet::new() } else { hosts.into_iter().filter(twice).cloned().collect() }
    }

    /// The host that only can decide, in words; `None` where one that voted may still do.
    pub fn needs_host(&self) -> Option<&'static str> {
        let (hosts, out) = (self.hosts().len(), self.exhausted_hosts().len());
        (hosts >= 2 && hosts == out).then_some(if hosts == 2 { "a third machine" } else { "another machine" })
    }

    fn votes(&self, claim: &Claim) -> bool {
        let worker = &claim.source.finder.worker;
        !worker.is_empty() && self.claims.iter().filter(|c| c.source.finder.worker == *worker).count() == 1
    }

    /// Whether claims differ. If not, a quarantined worker computed the task, and no other result is there.
    pub fn is_contradicted(&self) -> bool {
        self.claims.windows(2).any(|pair| pair[0].digest != pair[1].digest)
    }

    /// The claim that holds: the first with the digest that was agreed on, or else the committed one.
    pub fn holding(&self) -> Option<&Claim> {
        match self.agreed() {
            Some(agreed) => self.claims.iter().find(|c| c.digest == agreed),
            None => self.claims.first(),
        }
    }

    /// Whether a worker delivered a result for it.
    pub fn has_claim_of(&self, worker: &str) -> bool {
        self.claims.iter().any(|c| &*c.source.finder.worker == worker)
    }

    /// Whether it is open.
    pub fn is_open(&self) -> bool {
        self.ruling.is_none()
    }

    /// Forgets the results' bytes: its round is sealed, so that only digests are compared.
    pub fn seal(&mut self) {
        self.claims.iter_mut().for_each(|claim| claim.result = None);
    }
}
