//! What a worker found that turned out to compute wrongly: it is in doubt until another one has found the same.

use super::dispute::describe;
use super::job::ActiveJob;
use super::notes::Note;
use super::round::{Range, Round};
use super::sealed::only_score;
use super::worker::WorkerId;
use super::{Now, Scheduler};
use crate::record::{Claim, Dispute, Source};

impl Scheduler {
    /// Whatever rests on this worker alone is asked again, in all jobs.
    pub(super) fn doubt(&mut self, now: Now, source: &Source) {
        for (id, job) in &mut self.jobs {
            let heard = job.distrust(now, &source.worker);
            let tasks = job.open_doubts(now, source);
            if heard || tasks > 0 {
                self.to_note.insert(id.clone());
                let worker = WorkerId(source.worker.clone());
                self.notes.push(Note::Doubted { worker, job: id.clone(), tasks });
            }
        }
    }
}

impl ActiveJob {
    /// What this worker says in disputes counts for nothing by itself from now on, and what was decided by such workers
    /// alone is open again. Tells whether there is anything.
    fn distrust(&mut self, now: Now, worker: &str) -> bool {
        let at_hand: Vec<u32> = self.rounds_at_hand().map(|round| round.number).collect();
        let last = self.last.as_ref().map(|sealed| sealed.number);
        let mut heard = false;
        for dispute in &mut self.record.disputes {
            let kept = at_hand.contains(&dispute.round) || last == Some(dispute.round);
            // What was decided about an older round stays: nobody knows any more what else to compare it with.
            if !dispute.heard(worker) || dispute.ruling.is_some() && !kept {
                continue;
            }
            heard = true;
            let held = dispute.agreed().and_then(|agreed| dispute.claims.iter().position(|c| c.outcome == *agreed));
            for claim in dispute.claims.iter_mut().filter(|c| &*c.source.worker == worker) {
                claim.distrusted = true;
            }
            if dispute.ruling.is_some() && dispute.agreed().is_none() {
                // What holds comes first, like what was committed.
                let held = dispute.claims.remove(held.unwrap_or(0));
                dispute.claims.insert(0, held);
                if last == Some(dispute.round) {
                    for claim in &mut dispute.claims {
                        claim.outcome = only_score(claim.outcome.score());
                    }
                }
                dispute.ruling = None;
                dispute.at_ms = now.unix_ms;
            }
        }
        heard
    }

    /// Opens a dispute about each task that this worker found and nobody else has had a say in. Tells how many.
    fn open_doubts(&mut self, now: Now, source: &Source) -> u32 {
        let mut opened = 0;
        for range in self.found_by(&source.worker) {
            let (round, index) = (range.round, range.first);
            if self.dispute(round, index).is_some() {
                continue;
            }
            let Some((outcome, _, subject)) = self.holds(&range, index) else { continue };
            self.open_dispute(Dispute {
                round,
                index,
                what: describe(round, index, &subject),
                subject,
                claims: vec![Claim { source: source.clone(), outcome, distrusted: true }],
                ruling: None,
                at_ms: now.unix_ms,
            });
            opened += 1;
        }
        opened
    }

    /// The tasks, one by one, whose results this worker found, as far as they are still known.
    pub(super) fn found_by(&self, worker: &str) -> Vec<Range> {
        let one = |round: u32, first: u32| Range { round, first, count: 1 };
        let of_round = |round: &Round| {
            let found = (0..round.size()).filter(|index| &*round.finder(*index).worker == worker);
            found.map(|index| one(round.number, index)).collect::<Vec<_>>()
        };
        let sealed = self.last.iter().flat_map(|sealed| {
            let found = (0..).zip(&sealed.finders).filter(|(_, finder)| &*finder.worker == worker);
            found.map(|(index, _)| one(sealed.number, index))
        });
        sealed.chain(self.rounds_at_hand().flat_map(of_round)).collect()
    }

    /// The round that is worked on, and the examinations before it.
    fn rounds_at_hand(&self) -> impl Iterator<Item = &Round> {
        self.examined.iter().chain([&self.round])
    }
}
