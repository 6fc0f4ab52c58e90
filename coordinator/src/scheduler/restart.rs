//! A job is done again from one of its rounds on: as a new job that takes over the rounds before it.
//!
//! Only kept results are taken over. The procedure's state follows from them, so the result has the bits of an undisturbed
//! run.

use crate::record::{Finder, Origin};
use crate::store::{LastRound, SealedRound, TaskRecord};
use sim_core::base::digest::{Digest, ResultDigest};
use sim_core::procedure::{BadState, Procedure, Step};

/// What a job takes over from the one that it does again.
#[derive(Clone, Debug)]
pub struct Carried {
    /// That job, and how many of its rounds.
    pub origin: Origin,
    /// Over their results.
    pub results_digest: Digest,
    /// The last of them.
    pub last: Option<LastRound>,
}

impl Carried {
    /// Before any round is taken over.
    pub fn start(origin: Origin, job: &Digest) -> Self {
        Self { origin, results_digest: ResultDigest::start(job).value(), last: None }
    }

    /// Tells a procedure the kept results of its round at hand. Workers that delivered them are not known any more.
    ///
    /// # Errors
    /// The results are not kept or don't fit, or no round follows.
    pub fn tell(&mut self, procedure: &mut dyn Procedure, sealed: SealedRound) -> Result<(), BadState> {
        let SealedRound { number, digests, results, .. } = sealed;
        let unfit = |why: String| BadState(format!("round {number} can't be taken over: {why}"));
        let results = results.ok_or_else(|| unfit("its results are not kept".to_owned()))?;
        let round = procedure.round();
        if round.number != number || round.tasks as usize != results.len() || digests.len() != results.len() {
            return Err(unfit(format!(
                "it has {} results, and round {} has {}",
                results.len(),
                round.number,
                round.tasks
            )));
        }
        for (index, result) in (0..).zip(&results) {
            procedure.check(index, result).map_err(|e| unfit(e.to_string()))?;
        }
        let task = |(index, digest): (u32, &Digest)| TaskRecord {
            task: procedure.task(index),
            what: procedure.describe(index),
            digest: *digest,
            finder: Finder::default(),
        };
        self.last = Some(LastRound { number, tasks: (0..).zip(&digests).map(task).collect() });
        let mut digest = ResultDigest::resume(self.results_digest);
        digest.round(number, &digests);
        self.results_digest = digest.value();
        match procedure.tell(&results).step {
            Step::Next => Ok(()),
            Step::Failed(reason) => Err(unfit(reason)),
            Step::Waiting | Step::Done(_) => Err(unfit("no round of tasks follows it".to_owned())),
        }
    }
}
