//! What must hold after every event, whatever happened.

use super::*;
use crate::scheduler::lease::Kind;
use sim_core::procedure::result_digest;

impl World {
    pub fn check(&mut self) {
        self.leases();
        let jobs: Vec<JobId> = self.rig.scheduler.jobs.active.keys().cloned().collect();
        for id in &jobs {
            self.active(id);
        }
        let jobs: Vec<JobId> = self.jobs.values().cloned().collect();
        for id in &jobs {
            for dispute in self.rig.stored(id).disputes.iter().filter(|d| d.ruling.is_some()) {
                self.lies.remove(&(id.clone(), dispute.round, dispute.index));
            }
            self.stored(id);
        }
        let quarantined = self.rig.quarantined();
        assert!(quarantined.iter().all(|w| *w == *worker_id(LIAR).0), "only the liar: {quarantined:?}");
    }

    /// Leases and workers agree, and nothing is leased beyond its time.
    fn leases(&self) {
        let scheduler = &self.rig.scheduler;
        let now = self.rig.now.since_start;
        for (id, lease) in &scheduler.leases.all {
            let worker = scheduler.fleet.workers.get(&lease.worker).expect("a lease has a worker");
            assert!(worker.held.contains(id) && worker.expires > now, "leased beyond its worker's sign of life");
            assert!(scheduler.jobs.active.contains_key(&lease.job), "no lease of an ended job");
            assert!(!lease.solo || worker.held.len() == 1 || self.adopted, "a suspect has company");
            if let Kind::Copy(original) = lease.kind {
                let first = &scheduler.leases.all[&original];
                assert!(scheduler.leases.copies[&original] == *id && first.range == lease.range);
                assert!(first.worker != lease.worker && first.kind == Kind::Ordinary);
            }
            // A worker that counts is watched: what stood still for the time that is allowed went to others, at the
            // latest with the next sign of life.
            let busy = worker.held.len() > worker.slots as usize;
            if let Some(still) = self.still.get(id)
                && !busy
            {
                let bound = settings(0).stuck_after + LEASE;
                assert!(now.saturating_sub(*still) <= bound, "leased without progress beyond all bounds");
            }
        }
        let held: usize = scheduler.fleet.workers.values().map(|w| w.held.len()).sum();
        assert_eq!(held, scheduler.leases.all.len());
        assert_eq!(
            scheduler.leases.copies.len(),
            scheduler.leases.all.values().filter(|l| matches!(l.kind, Kind::Copy(_))).count()
        );
        for worker in scheduler.fleet.workers.values() {
            assert!(!worker.draining || worker.held.is_empty());
        }
    }

    fn active(&self, id: &JobId) {
        let scheduler = &self.rig.scheduler;
        let job = &scheduler.jobs.active[id];
        assert_eq!(self.rig.stored(id), job.record, "the store is where memory is");
        // No task is lost: each is pending, done, or in exactly one lease.
        let round = &job.round;
        let leases = || scheduler.leases.all.values().filter(|l| l.job == *id);
        let open = |l: &lease::Lease| l.range.indexes().filter(|i| !round.is_done(&one(round.number(), *i))).count();
        let leased: usize = leases().filter(|l| l.kind == Kind::Ordinary).map(open).sum();
        assert_eq!(round.pending() + round.done() + leased as u32, round.size());
        assert!(
            round.done() < round.size() || job.open_disputes().next().is_some(),
            "a complete round is sealed at once, unless it is in doubt"
        );
        // Only crashes and failures are attempts.
        let mut again = round.clone();
        again.suspect(&job.record.charges);
        assert_eq!(again.suspects(), round.suspects(), "attempts are stored");
        let lost = job.record.charges.iter().filter_map(|charge| charge.lost.clone());
        let back: Vec<_> = lost.filter(|w| scheduler.fleet.workers.contains_key(&WorkerId(w.clone()))).collect();
        assert!(back.is_empty(), "{back:?} came back, and their deaths are held against tasks");
        let attempts: u32 = round.suspects().values().sum();
        assert!(attempts <= self.faults, "{attempts} attempts after {} faults", self.faults);
        // Free slots are used when there is work that may go there.
        let suspect = round.has_pending_suspect();
        let suspects = scheduler.jobs.active.values().any(|job| job.round.has_pending_suspect());
        for worker in
            scheduler.fleet.workers.values().filter(|w| w.is_open() && w.refused.is_empty() && w.ends.is_none())
        {
            let idle = worker.held.len() < worker.slots as usize;
            assert!(!(idle && job.has_ordinary()) || suspects, "an idle slot beside pending work");
            assert!(!(worker.held.is_empty() && suspect && !job.record.paused), "an idle worker beside a suspect");
        }
        // What two agree on is the truth: only one worker lies.
        for dispute in job.record.disputes.iter().filter(|d| d.ruling.is_some()) {
            let held = dispute.holding().expect("a claim is there");
            assert_eq!(held.digest, result_digest(&result_of(&dispute.task)), "a lie holds");
        }
        if let Some(round) = job.record.disputes.iter().find(|d| d.ruling.is_none()).map(|d| d.round) {
            assert!(round <= job.round.number());
            let told = |w: String| w.contains("differ") || w.contains("computed by a worker that computes wrongly");
            assert!(waits_for(scheduler, id).is_some_and(told), "a dispute is told");
        }
        // What only a worker says that computes wrongly is asked again.
        for worker in scheduler.trust.ids() {
            for range in job.found_by(&worker.0) {
                let dispute = job.dispute(range.round, range.first).expect("what the quarantined found is in doubt");
                let trusted = |c: &crate::record::Claim| !c.distrusted;
                assert!(dispute.ruling.is_none() || dispute.claims.iter().any(trusted), "on whose word");
            }
        }
        let found: Vec<_> = job.record.disputes.iter().map(|d| job.dispute(d.round, d.index)).collect();
        assert!(found.into_iter().eq(job.record.disputes.iter().map(Some)), "each dispute is found");
    }

    fn stored(&mut self, id: &JobId) {
        let record = self.rig.stored(id);
        if let Some(then) = self.rig.seen.ended.get(id) {
            assert_eq!(record, *then, "the end is final");
        } else if record.state.is_end() {
            assert!(!record.paused);
            self.rig.seen.ended.insert(id.clone(), record.clone());
        }
        for round in 0..record.rounds_sealed {
            let digests = at_once(self.rig.store.digests(id, round)).expect("a sealed round has digests");
            let then = self.rig.seen.sealed.entry((id.clone(), round)).or_insert_with(|| digests.clone());
            assert_eq!(*then, digests, "a sealed round never changes");
        }
        let next = (id.clone(), record.rounds_sealed);
        assert!(!self.rig.seen.sealed.contains_key(&next), "a sealed round stays sealed");
        let history = at_once(self.rig.store.result(id)).history;
        let numbers: Vec<u32> = history.iter().map(|row| row.index).collect();
        assert_eq!(numbers, (0..record.rounds_sealed.min(ROUNDS)).collect::<Vec<_>>(), "each sealed exactly once");
        let events = at_once(self.rig.store.events(id, 0, 10_000));
        let sequence: Vec<u64> = events.iter().map(|e| e.event.sequence).collect();
        assert_eq!(sequence, (1..=record.last_event).collect::<Vec<_>>(), "events without a gap");
    }
}

fn one(round: u32, first: u32) -> Range {
    Range { round, first, count: 1 }
}
