//! Restart of a job from one of its rounds: a new job takes over the rounds before it.
//!
//! Only rounds with kept results are taken over. The procedure's state follows from the results, so the new job's
//! result has the same bits as an undisturbed run.

use crate::record::{Claimant, Origin};
use crate::store::{LastRound, SealedRound, TaskRecord};
use sim_core::base::digest::{Digest, ResultDigest};
use sim_core::procedure::{BadState, Procedure, Step};

/// Rounds that a job takes over from an earlier job.
#[derive(Clone, Debug)]
pub struct Carried {
    /// The earlier job, and the number of rounds taken over.
    pub origin: Origin,
    /// Running digest of their results.
    pub results_digest: Digest,
    /// The last of these rounds.
    pub last: Option<LastRound>,
}

impl Carried {
    /// The state before any round is taken over.
    pub fn start(origin: Origin, job: &Digest) -> Self {
        Self { origin, results_digest: ResultDigest::start(job).value(), last: None }
    }

    /// Takes over a sealed round: feeds its kept results to the procedure. The workers that delivered them are not
    /// recorded.
    ///
    /// # Errors
    /// The results are not kept or don't fit the procedure's round, or no round follows.
    pub fn tell(&mut self, procedure: &mut dyn Procedure, sealed: SealedRound) -> Result<(), BadState> {
        let SealedRound { number, digests, results, .. } = sealed;
        let unfit = |why: String| BadState(format!("round {number} can't be taken over: {why}"));
        let results = results.ok_or_else(|| unfit("its results are not kept".to_owned()))?;
        let round = procedure.round();
        if round.number != number || round.tasks as usize != results.len() || digests.len() != results.len() {
            return Err(unfit(format!(
                "it has {} results, but round {} of the procedure has {} tasks",
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
            finder: Claimant::default(),
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
