//! Disputes: what workers say who disagree about the result of a task, and what became of it.

use super::StoredOutcome;
use crate::scheduler::{Finder, Outcome};
use proto::{ConvertError, v1};
use sim_core::base::digest::Digest;
use sim_core::genotype::Genome;
use sim_core::procedure::evolve::finish::Examination;
use std::collections::BTreeSet;
use std::sync::Arc;

/// What a disputed task is, so that it can be handed out again.
#[derive(Clone, Debug, PartialEq)]
pub enum Subject {
    /// A candidate to be scored.
    Candidate(Genome),
    /// A question to be answered.
    Examination(Examination),
}

/// Who said something.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Source {
    /// Id of the worker; empty if it is not known any more.
    pub worker: Arc<str>,
    /// Its name, for people.
    pub name: Arc<str>,
    /// The machine it calls from; empty if it is not known.
    pub host: Arc<str>,
}

impl Source {
    /// As whoever found something.
    pub fn finder(&self) -> Finder {
        Finder { worker: self.worker.clone(), host: self.host.clone() }
    }
}

/// What a worker says that a task's result is.
#[derive(Clone, Debug, PartialEq)]
pub struct Claim {
    /// Who.
    pub source: Source,
    /// What.
    pub outcome: Outcome,
    /// Who says so is quarantined: others may confirm it, by itself it counts for nothing.
    pub distrusted: bool,
}

/// How a dispute ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ruling {
    /// What was committed stands.
    Upheld,
    /// What was committed was wrong, and replaced before its round was sealed.
    Corrected,
    /// What was committed was wrong, and its round is sealed.
    Tainted,
}

/// A task of which workers gave different bits, or that only a worker found that is quarantined.
#[derive(Clone, Debug, PartialEq)]
pub struct Dispute {
    /// The round.
    pub round: u32,
    /// The task's index in it.
    pub index: u32,
    /// The task, for people.
    pub what: String,
    /// The task, to be handed out again.
    pub subject: Subject,
    /// What was said; what was committed comes first.
    pub claims: Vec<Claim>,
    /// `None` while nobody has decided.
    pub ruling: Option<Ruling>,
    /// Unix time of the newest claim, ms.
    pub at_ms: i64,
}

impl Dispute {
    /// The outcome that two workers agree on, at least one of them trusted, if there is one. Where machines differ it takes
    /// two machines: one that computes wrongly may have many workers. A worker that said different things has no say, nor
    /// has whoever is not known any more: it may be any of the others.
    pub fn agreed(&self) -> Option<&Outcome> {
        let machines_differ = self.hosts().len() >= 2;
        self.claims.iter().map(|c| &c.outcome).find(|outcome| {
            let support = || self.claims.iter().filter(|c| c.outcome == **outcome && self.has_a_say(c));
            let on: BTreeSet<_> = support().map(|c| &c.source.host).filter(|host| !host.is_empty()).collect();
            support().count() >= 2 && (!machines_differ || on.len() >= 2) && support().any(|c| !c.distrusted)
        })
    }

    /// The machines that are known of those who have a say, one by one.
    fn heard_on(&self) -> impl Iterator<Item = &Arc<str>> {
        self.claims.iter().filter(|c| self.has_a_say(c)).map(|c| &c.source.host).filter(|host| !host.is_empty())
    }

    fn hosts(&self) -> BTreeSet<&Arc<str>> {
        self.heard_on().collect()
    }

    /// Machines of which two workers were heard, if others were heard as well: one more there would not decide.
    pub fn heard_out(&self) -> BTreeSet<Arc<str>> {
        let hosts = self.hosts();
        let twice = |host: &&Arc<str>| self.heard_on().filter(|heard| heard == host).count() >= 2;
        if hosts.len() < 2 { BTreeSet::new() } else { hosts.into_iter().filter(twice).cloned().collect() }
    }

    /// Whether only a worker on another machine can decide, and which one that would be.
    pub fn needs_machine(&self) -> Option<&'static str> {
        let (hosts, out) = (self.hosts().len(), self.heard_out().len());
        (hosts >= 2 && hosts == out).then_some(if hosts == 2 { "a third machine" } else { "another machine" })
    }

    fn has_a_say(&self, claim: &Claim) -> bool {
        let of_its_worker = self.claims.iter().filter(|c| c.source.worker == claim.source.worker);
        !claim.source.worker.is_empty() && of_its_worker.count() == 1
    }

    /// Whether claims differ. If not, a quarantined worker found it, and nobody has said anything else.
    pub fn is_contradicted(&self) -> bool {
        self.claims.windows(2).any(|pair| pair[0].outcome != pair[1].outcome)
    }

    /// The claim that holds: the first that says what was agreed on, or else what was committed.
    pub fn holding(&self) -> Option<&Claim> {
        match self.agreed() {
            Some(agreed) => self.claims.iter().find(|c| c.outcome == *agreed),
            None => self.claims.first(),
        }
    }

    /// Whether a worker has had its say.
    pub fn heard(&self, worker: &str) -> bool {
        self.claims.iter().any(|c| &*c.source.worker == worker)
    }

    /// As the API tells it.
    pub fn to_wire(&self) -> v1::Dispute {
        v1::Dispute {
            round: self.round,
            index: self.index,
            what: self.what.clone(),
            claims: self.claims.iter().map(claim_to_wire).collect(),
            verdict: match self.ruling {
                None => v1::dispute::Verdict::Unspecified,
                Some(Ruling::Upheld) => v1::dispute::Verdict::Upheld,
                Some(Ruling::Corrected) => v1::dispute::Verdict::Corrected,
                Some(Ruling::Tainted) => v1::dispute::Verdict::Tainted,
            }
            .into(),
            at_ms: self.at_ms,
        }
    }

    pub(super) fn to_stored(&self) -> StoredDispute {
        let (genome, examination) = match &self.subject {
            Subject::Candidate(genome) => (genome.clone(), None),
            Subject::Examination(examination) => (
                Vec::new(),
                Some(v1::ExamineTask {
                    round: self.round,
                    index: self.index,
                    question: v1::Question::from(examination.question).into(),
                    candidate: Some((&examination.candidate).into()),
                }),
            ),
        };
        let claim = |c: &Claim| StoredClaim {
            worker: c.source.worker.to_string(),
            name: c.source.name.to_string(),
            host: c.source.host.to_string(),
            outcome: Some((&c.outcome).into()),
            distrusted: c.distrusted,
        };
        StoredDispute {
            told: Some(v1::Dispute { claims: Vec::new(), ..self.to_wire() }),
            genome,
            examination,
            claims: self.claims.iter().map(claim).collect(),
        }
    }

    pub(super) fn from_stored(stored: StoredDispute) -> Result<Self, ConvertError> {
        let told = stored.told.ok_or(ConvertError::Missing { field: "dispute" })?;
        let ruling = match told.verdict() {
            v1::dispute::Verdict::Unspecified => None,
            v1::dispute::Verdict::Upheld => Some(Ruling::Upheld),
            v1::dispute::Verdict::Corrected => Some(Ruling::Corrected),
            v1::dispute::Verdict::Tainted => Some(Ruling::Tainted),
        };
        let subject = match stored.examination {
            Some(task) => Subject::Examination(proto::examination(task)?),
            None => Subject::Candidate(stored.genome),
        };
        let claim = |c: StoredClaim| Claim {
            source: Source { worker: c.worker.into(), name: c.name.into(), host: c.host.into() },
            outcome: c.outcome.unwrap_or_default().into(),
            distrusted: c.distrusted,
        };
        Ok(Self {
            round: told.round,
            index: told.index,
            what: told.what,
            subject,
            claims: stored.claims.into_iter().map(claim).collect(),
            ruling,
            at_ms: told.at_ms,
        })
    }
}

fn claim_to_wire(claim: &Claim) -> v1::Claim {
    v1::Claim {
        worker_id: claim.source.worker.to_string(),
        worker_name: claim.source.name.to_string(),
        scores: proto::scores(&claim.outcome.scores),
        digest: digest(&claim.outcome).0.to_vec(),
    }
}

/// Over all bits of an outcome.
fn digest(outcome: &Outcome) -> Digest {
    let bits: Vec<Option<u64>> = outcome.scores.iter().map(|s| s.map(f64::to_bits)).collect();
    let counts = v1::Counts::from(outcome.counts);
    let counts = [counts.rollouts, counts.unstable, counts.simulated_ms, counts.edges, counts.rejected, counts.nodes];
    Digest::of("evogait outcome 1", &(bits, counts, &outcome.traces))
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct StoredDispute {
    /// Without its claims.
    #[prost(message, optional, tag = "1")]
    told: Option<v1::Dispute>,
    #[prost(double, repeated, tag = "2")]
    genome: Vec<f64>,
    #[prost(message, optional, tag = "3")]
    examination: Option<v1::ExamineTask>,
    #[prost(message, repeated, tag = "4")]
    claims: Vec<StoredClaim>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct StoredClaim {
    #[prost(string, tag = "1")]
    worker: String,
    #[prost(string, tag = "2")]
    name: String,
    #[prost(string, tag = "3")]
    host: String,
    #[prost(message, optional, tag = "4")]
    outcome: Option<StoredOutcome>,
    #[prost(bool, tag = "5")]
    distrusted: bool,
}
