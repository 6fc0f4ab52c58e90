//! Invariants that must hold after every event.

use super::*;
use crate::scheduler::lease::LeaseKind;
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
                self.undecided.remove(&(id.clone(), dispute.round, dispute.index));
            }
            self.stored(id);
        }
        let quarantined = self.rig.quarantined();
        assert!(
            quarantined.iter().all(|w| *w == *worker_id(FAULTY).0),
            "only the faulty worker may be quarantined: {quarantined:?}"
        );
    }

    /// Checks that leases and workers are consistent, and that no lease outlives its deadline.
    fn leases(&self) {
        let scheduler = &self.rig.scheduler;
        let now = self.rig.now.since_start;
        for (id, lease) in &scheduler.leases.all {
            let worker = scheduler.fleet.workers.get(&lease.worker).expect("each lease has a worker");
            assert!(worker.held.contains(id) && worker.expires > now, "the lease outlives its worker's deadline");
            assert!(scheduler.jobs.active.contains_key(&lease.job), "an ended job has a lease");
            assert!(!lease.solo || worker.held.len() == 1 || self.adopted, "a suspect runs beside another lease");
            if let LeaseKind::Copy(original) = lease.kind {
                let first = &scheduler.leases.all[&original];
                assert!(scheduler.leases.copies[&original] == *id && first.range == lease.range);
                assert!(first.worker != lease.worker && first.kind == LeaseKind::Ordinary);
            }
            // A worker that reports progress is watched: a lease without progress for the allowed time is revoked, at
            // the latest at the next heartbeat.
            let busy = worker.held.len() > worker.slots as usize;
            if let Some(still) = self.still.get(id)
                && !busy
            {
                let bound = settings(0).stuck_after + LEASE;
                assert!(now.saturating_sub(*still) <= bound, "a stuck lease was not revoked in time");
            }
        }
        let held: usize = scheduler.fleet.workers.values().map(|w| w.held.len()).sum();
        assert_eq!(held, scheduler.leases.all.len());
        assert_eq!(
            scheduler.leases.copies.len(),
            scheduler.leases.all.values().filter(|l| matches!(l.kind, LeaseKind::Copy(_))).count()
        );
        for worker in scheduler.fleet.workers.values() {
            assert!(!worker.draining || worker.held.is_empty());
        }
    }

    fn active(&self, id: &JobId) {
        let scheduler = &self.rig.scheduler;
        let job = &scheduler.jobs.active[id];
        assert_eq!(self.rig.stored(id), job.record, "the stored record differs from the one in memory");
        // No task is lost: each is pending, done, or in exactly one lease.
        let round = &job.round;
        let leases = || scheduler.leases.all.values().filter(|l| l.job == *id);
        let open = |l: &lease::Lease| l.range.indexes().filter(|i| !round.is_done(&one(round.number(), *i))).count();
        let leased: usize = leases().filter(|l| l.kind == LeaseKind::Ordinary).map(open).sum();
        assert_eq!(round.pending() + round.done() + leased as u32, round.size());
        assert!(
            round.done() < round.size() || job.open_disputes().next().is_some(),
            "a complete round without open disputes is not sealed"
        );
        // Only crashes and failures are attempts.
        let mut again = round.clone();
        again.suspect(&job.record.charges);
        assert_eq!(again.suspects(), round.suspects(), "the attempts differ from the stored charges");
        let lost = job.record.charges.iter().filter_map(|charge| charge.lost.clone());
        let back: Vec<_> = lost.filter(|w| scheduler.fleet.workers.contains_key(&WorkerId(w.clone()))).collect();
        assert!(back.is_empty(), "tasks are still charged for crashes of connected workers {back:?}");
        let attempts: u32 = round.suspects().values().sum();
        assert!(attempts <= self.faults, "{attempts} attempts after {} faults", self.faults);
        // Free slots are used while tasks are pending that may run there.
        let suspect = round.has_pending_suspect();
        let suspects = scheduler.jobs.active.values().any(|job| job.round.has_pending_suspect());
        for worker in
            scheduler.fleet.workers.values().filter(|w| w.is_open() && w.refused.is_empty() && w.ends.is_none())
        {
            let idle = worker.held.len() < worker.slots as usize;
            assert!(!(idle && job.has_ordinary()) || suspects, "a slot is idle while a task is pending");
            assert!(
                !(worker.held.is_empty() && suspect && !job.record.paused),
                "a worker is idle while a suspect is pending"
            );
        }
        // The result that two workers agree on is right, because only one worker is faulty.
        for dispute in job.record.disputes.iter().filter(|d| d.ruling.is_some()) {
            let held = dispute.holding().expect("each dispute has a claim");
            assert_eq!(held.digest, result_digest(&result_of(&dispute.task)), "a wrong result holds");
        }
        if let Some(round) = job.record.disputes.iter().find(|d| d.ruling.is_none()).map(|d| d.round) {
            assert!(round <= job.round.number());
            let told = |w: String| w.contains("differ") || w.contains("only a quarantined worker computed");
            assert!(waits_for(scheduler, id).is_some_and(told), "the job's reasons do not mention its dispute");
        }
        // Results that only a quarantined worker delivered are disputed.
        for worker in scheduler.trust.ids() {
            for range in job.found_by(&worker.0) {
                let dispute =
                    job.dispute(range.round, range.first).expect("each result of a quarantined worker is disputed");
                let trusted = |c: &crate::record::Claim| !c.distrusted;
                assert!(
                    dispute.ruling.is_none() || dispute.claims.iter().any(trusted),
                    "only distrusted claims decided a dispute"
                );
            }
        }
        let found: Vec<_> = job.record.disputes.iter().map(|d| job.dispute(d.round, d.index)).collect();
        assert!(found.into_iter().eq(job.record.disputes.iter().map(Some)), "the index of disputes is incomplete");
    }

    fn stored(&mut self, id: &JobId) {
        let record = self.rig.stored(id);
        if let Some(then) = self.rig.seen.ended.get(id) {
            assert_eq!(record, *then, "the record of an ended job changed");
        } else if record.state.is_end() {
            assert!(!record.paused);
            self.rig.seen.ended.insert(id.clone(), record.clone());
        }
        for round in 0..record.rounds_sealed {
            let digests = at_once(self.rig.store.digests(id, round)).expect("each sealed round has digests");
            let then = self.rig.seen.sealed.entry((id.clone(), round)).or_insert_with(|| digests.clone());
            assert_eq!(*then, digests, "a sealed round changed");
        }
        let next = (id.clone(), record.rounds_sealed);
        assert!(!self.rig.seen.sealed.contains_key(&next), "a sealed round is no longer sealed");
        let history = at_once(self.rig.store.result(id)).history;
        let numbers: Vec<u32> = history.iter().map(|row| row.index).collect();
        assert_eq!(
            numbers,
            (0..record.rounds_sealed.min(ROUNDS)).collect::<Vec<_>>(),
            "each kept round has exactly one row"
        );
        let events = at_once(self.rig.store.events(id, 0, 10_000));
        let sequence: Vec<u64> = events.iter().map(|e| e.event.sequence).collect();
        assert_eq!(sequence, (1..=record.last_event).collect::<Vec<_>>(), "the event sequence has a gap");
    }
}

fn one(round: u32, first: u32) -> Range {
    Range { round, first, count: 1 }
}
